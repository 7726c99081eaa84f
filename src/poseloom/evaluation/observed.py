"""What of a person's place and heading sensors observe at all: an error that no sensor can know is not measured."""

from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.rotations import (
    heading_angle,
    heading_matrix,
    quat_from_matrix,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
    unwrap_rotvec,
)
from poseloom.sensors import Recording, SensorKind
from poseloom.skeleton.motion import Motion, make_motion

_BEGINNING = 1.0
"""Seconds over which the heading is brought to the truth's at the beginning."""


@dataclass(frozen=True)
class Observed:
    """What the sensors know of the world.

    Attributes:
        heading: Which way the wearer faces: a tracker's orientation, or the places of two trackers.
        place: Where the wearer is: a tracker's place.
    """

    heading: bool = True
    place: bool = True

    def in_words(self) -> str:
        """What is removed before errors are taken; empty where nothing is."""
        if self.heading and self.place:
            return ""
        removed = "" if self.heading else "heading removed frame by frame for the pose; "
        return f"{removed}the path begins where the truth's does{'' if self.heading else ', with its heading'}"


def observed_by(recording: Recording) -> Observed:
    """What a recording's trackers observe; IMUs and flex sensors observe neither."""
    trackers = list(recording.layout.of_kind(SensorKind.TRACKER))
    places = np.isfinite(recording.positions[:, trackers, 0]).any(axis=0)
    turns = np.isfinite(recording.quats_wxyz[:, trackers, 0]).any(axis=0)
    return Observed(bool(turns.any() or places.sum() >= 2), bool(places.any()))


def facing_as(truth: Motion, estimate: Motion) -> Motion:
    """The estimate with the truth's heading in every frame."""
    return _turned(estimate, _headings(truth) - _headings(estimate))


def begun_as(truth: Motion, estimate: Motion, observed: Observed) -> Motion:
    """The estimate with what is not observed brought to the truth's at the beginning: place, and heading.

    The heading is brought to the truth's in the mean over the first second, the place in the first frame.
    """
    if observed.heading and observed.place:
        return estimate
    if not observed.heading:
        count = max(1, min(len(truth), round(_BEGINNING * truth.rate)))
        gaps = (_headings(truth) - _headings(estimate))[:count]
        gap = float(np.arctan2(np.sin(gaps).mean(), np.cos(gaps).mean()))
        estimate = _turned(estimate, np.full(len(estimate), gap), about_origin=True)
    q = estimate.q.copy()
    if not observed.place:
        q[:, [0, 2]] += truth.q[0, [0, 2]] - q[0, [0, 2]]
    return make_motion(estimate.skeleton, q, estimate.rate, estimate.name)


def _headings(motion: Motion) -> Floats[Array, "frames"]:
    return heading_angle(quat_from_rotvec(motion.q[:, 3:6]))


def _turned(motion: Motion, angles: Floats[Array, "frames"], about_origin: bool = False) -> Motion:
    """Each frame turned about the vertical, through its root or through the first frame's."""
    q = motion.q.copy()
    matrices = heading_matrix(angles)
    if about_origin:
        centre = np.array([q[0, 0], 0.0, q[0, 2]])
        q[:, :3] = np.einsum("fij,fj->fi", matrices, q[:, :3] - centre) + centre
    turned = rotvec_from_quat(quat_multiply(quat_from_matrix(matrices), quat_from_rotvec(q[:, 3:6])))
    q[:, 3:6] = unwrap_rotvec(turned)
    return make_motion(motion.skeleton, q, motion.rate, motion.name)
