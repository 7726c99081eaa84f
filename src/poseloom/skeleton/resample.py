"""The same motion at another rate."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Ints, exceeds_room, frozen_float
from poseloom.errors import PoseloomError
from poseloom.rotations import nearest_branch, quat_from_rotvec, rotvec_from_quat, slerp
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton

_COINCIDENCE = 1e-3
"""Instants this near to a frame, in frames, count as that frame: rates in files are rounded (0.00833 s for 120 Hz)."""
_EVEN = 0.05
"""Share of a period by which times may be off their even places for poses to be taken as they are."""


def resample(motion: Motion, rate: float) -> Motion:
    """The motion at `rate` frames a second, from its first instant to the last new frame within its duration.

    Places go in straight lines between frames and each joint turns the shorter way at constant speed (slerp). Where a
    new frame coincides with an old one the old values stand untouched, so 120 to 40 Hz takes every third frame. There
    is no smoothing: speeds above half the new rate fold.

    Raises:
        PoseloomError: if `rate` is not positive and finite, or so far above the motion's own that memory would not do.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise PoseloomError(f"cannot resample to {rate} frames a second", remedy="Give a positive, finite rate")
    if rate == motion.rate:
        return motion
    if exceeds_room(len(motion) / motion.rate * rate, len(motion), motion.skeleton.size):
        raise PoseloomError(
            f"{len(motion)} frames at {motion.rate:g} Hz last {len(motion) / motion.rate:.4g} s, "
            f"too long to be put at {rate:g} Hz",
            cause="the motion's rate is wrong",
            remedy="Mend its rate, or cut it",
        )
    before, fraction = frame_instants(len(motion), motion.rate, float(rate))
    after = np.minimum(before + 1, len(motion) - 1)
    q = motion.q[before]
    between = np.flatnonzero(fraction)
    if between.size:
        q[between] = interpolate_pose_vectors(motion.q[before[between]], motion.q[after[between]], fraction[between])
    moved = motion.displacements
    if moved is not None:
        weight = fraction[:, None, None]
        moved = frozen_float((1 - weight) * moved[before] + weight * moved[after])
    return replace(motion, q=frozen_float(q), rate=float(rate), displacements=moved)


def interpolate_pose_vectors(
    first: Floats[Array, "frames dofs"], second: Floats[Array, "frames dofs"], fraction: Floats[Array, "frames"]
) -> Floats[Array, "frames dofs"]:
    """Pose vectors at `fraction` (0 to 1) of the way: places linearly, rotations by slerp, on the ends' branch."""
    weight = fraction[:, None]
    straight = (1 - weight) * first + weight * second
    joints = first[:, 3:].reshape(len(first), -1, 3)
    quats = slerp(
        quat_from_rotvec(joints),
        quat_from_rotvec(second[:, 3:].reshape(joints.shape)),
        np.broadcast_to(weight, joints.shape[:2]),
    )
    turns = nearest_branch(rotvec_from_quat(quats), straight[:, 3:].reshape(joints.shape))
    straight[:, 3:] = turns.reshape(len(first), -1)
    return straight


class EvenPoses:
    """Gives a pose at every whole period after the first one's time: as they are, or between their neighbours.

    Args:
        rate: Poses a second that are wanted.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._next = 0
        self._first: float | None = None
        self._places: NDArray[np.float64] = np.empty(0)
        self._q: NDArray[np.float64] = np.empty((0, 0))

    def add(self, times: Floats[Array, "poses"], q: Floats[Array, "poses dofs"]) -> Floats[Array, "frames dofs"]:
        """Takes in poses, each later than the one before; returns those at the even times up to the last."""
        if self._first is None:
            self._first, self._q = float(times[0]), q[:0]
        places = np.concatenate([self._places, (times - self._first) * self._rate])
        q = np.concatenate([self._q, q])
        wanted = np.arange(self._next, int(np.floor(places[-1] + _EVEN)) + 1)
        self._next += len(wanted)
        self._places, self._q = places[-1:], q[-1:]
        if len(places) == 1 or not len(wanted):
            return q[: len(wanted)]
        before = np.clip(np.searchsorted(places, wanted, side="right") - 1, 0, len(places) - 2)
        share = np.clip((wanted - places[before]) / (places[before + 1] - places[before]), 0.0, 1.0)
        rows = interpolate_pose_vectors(q[before], q[before + 1], share)
        nearest = before + (share > 0.5)
        as_they_are = np.abs(places[nearest] - wanted) <= _EVEN
        rows[as_they_are] = q[nearest[as_they_are]]
        return rows


def even_motion(
    skeleton: Skeleton, times: Floats[Array, "frames"], q: Floats[Array, "frames dofs"], rate: float, name: str
) -> Motion:
    """Poses at any times as a motion at a rate: as they are where their times are even, else between neighbours.

    A pose whose time is not after all those before it is left out.

    Raises:
        PoseloomError: where a gap in the times is too long to be filled.
    """
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(times)) > 0])
    times, q = times[rising], q[rising]
    span = float((times[-1] - times[0]) * rate)
    if exceeds_room(span, len(times), q.shape[1]):
        widest = int(np.argmax(np.diff(times)))
        raise PoseloomError(
            f"{len(times)} poses span {times[-1] - times[0]:.4g} s, too long to be filled at {rate:g} Hz",
            cause=f"{np.diff(times)[widest]:.4g} s lie between pose {widest} and the next",
            remedy="Cut the recording at that gap",
        )
    return make_motion(skeleton, EvenPoses(rate).add(times, q), rate, name)


def frame_instants(count: int, old: float, new: float) -> tuple[Ints[Array, "instants"], Floats[Array, "instants"]]:
    """For each new frame of `resample` the old one before it and the fraction of the way to the next.

    Args:
        count: Old frames.
        old: Their rate, Hz.
        new: The new rate.
    """
    step = old / new
    # Rates that are almost whole multiples are meant to be: without this, small errors add up over a long take.
    for ratio in (step, 1 / step):
        if abs(ratio - round(ratio)) < 1e-5 * ratio:
            step = float(round(ratio)) if ratio is step else 1 / round(ratio)
            break
    last = (count - 1) / step
    places = np.arange(int(np.floor(last + _COINCIDENCE)) + 1) * step
    whole = np.rint(places)
    places = np.where(np.abs(places - whole) < _COINCIDENCE, whole, places)
    before = np.minimum(np.floor(places).astype(np.int64), count - 1)
    return before, np.clip(places - before, 0.0, 1.0)
