"""Training pairs as the arrays that every comparator learns from: poses without place and heading, steps, signals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints
from poseloom.errors import MethodError
from poseloom.methods.imus.pairs import CHANNELS, SignalPair, pairs_digest
from poseloom.rotations import (
    heading_angle,
    heading_matrix,
    matrix_from_rotvec,
    quat_from_matrix,
    rotvec_from_matrix,
)
from poseloom.sensors import SensorLayout
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.contacts import contacts
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.skeleton import Skeleton

FEATURES = 1 + 6 * len(BODY_BONES)
"""Height of the hips over the length of a leg, then two columns of each joint's rotation matrix.

Columns of matrices can be averaged and regressed: unlike rotation vectors they have no branches."""

STEP = 3
"""From one frame to the next, seen along the former's heading: to the left and ahead, over the length of a leg; turn in
radians."""

_SHORTEST = 2


class Posture(NamedTuple):
    """A pose without place and heading.

    Attributes:
        height: Of the hips, in lengths of a leg.
        rotations: Of all joints, the root's without its heading.
    """

    height: float
    rotations: Floats[Array, "joints 3 3"]


@dataclass(frozen=True, eq=False)
class Examples:
    """Frames of all training pairs, one after the other.

    Attributes:
        layout: The IMUs.
        signals: Channels of the IMUs, standardised by `centre` and `scale`.
        features: Pose of each frame (see `FEATURES`).
        steps: What led to each frame from the one before (see `STEP`); of a clip's first frame, what leads on.
        standing: Whether the left and the right foot stand.
        starts: First frame of each clip.
        behaviours: What happens in each clip.
        builds: Lengths of the bones of who moves in each clip, metres.
        centre: Mean of each channel.
        scale: Standard deviation of each channel; the three axes of a quantity share one, so that directions stay.
        digest: Of the pairs.
    """

    layout: SensorLayout
    signals: Floats32[Array, "frames channels"]
    features: Floats32[Array, "frames features"]
    steps: Floats32[Array, "frames 3"]
    standing: Bools[Array, "frames 2"]
    starts: Ints[Array, "clips"]
    behaviours: tuple[str, ...]
    builds: Floats[Array, "clips bones"]
    centre: Floats[Array, "channels"]
    scale: Floats[Array, "channels"]
    digest: str

    def __len__(self) -> int:
        return len(self.signals)

    @property
    def stops(self) -> Ints[Array, "clips"]:
        """The frame after the last of each clip."""
        return np.append(self.starts[1:], len(self.signals))

    @property
    def clip_of_frame(self) -> Ints[Array, "frames"]:
        """Number of the clip that a frame is of."""
        return np.repeat(np.arange(len(self.starts)), self.stops - self.starts)

    def standardised(self, signal: Floats[Array, "channels"]) -> Floats[Array, "channels"]:
        """A signal as the examples have it; what is NaN stays so."""
        return (signal - self.centre) / self.scale

    def strangeness(self, skeleton: Skeleton, weight: float) -> Floats32[Array, "frames"]:
        """How far each example's person is built differently, in squared centimetres a bone, times a weight."""
        apart = 100 * (self.builds - bone_lengths(skeleton))
        return (weight * np.square(apart).mean(axis=1)).astype(np.float32)[self.clip_of_frame]

    def followers(self, rows: Ints[Array, "rows"]) -> Ints[Array, "rows"]:
        """The frames after these; a clip's last frame is followed by itself."""
        last = self.stops[np.searchsorted(self.stops, rows, side="right")] - 1
        return np.minimum(rows + 1, last)


def examples_of(pairs: Sequence[SignalPair], layout: SensorLayout) -> Examples:
    """Examples of training pairs.

    Raises:
        MethodError: for no pair of at least two frames, or pairs of another number of channels than the layout's.
    """
    usable = [pair for pair in pairs if len(pair) >= _SHORTEST]
    if not usable:
        raise MethodError("there are no training pairs", remedy="Give pairs of at least two frames")
    channels = CHANNELS * len(layout)
    other = next((pair for pair in usable if pair.signal.shape[1] != channels), None)
    if other is not None:
        raise MethodError(
            f"the pair {other.clip!r} has {other.signal.shape[1]} channels, layout {layout.name!r} has {channels}",
            remedy="Make the pairs with the layout of the method",
        )
    signals = np.concatenate([pair.signal for pair in usable])
    centre = signals.mean(axis=0)
    spread = np.sqrt(signals.var(axis=0).reshape(-1, 3).mean(axis=1)).repeat(3)
    scale = np.where(spread > 0, spread, 1.0)
    made = [_described(pair.motion) for pair in usable]
    stands = [contacts(pair.motion) for pair in usable]
    lengths = np.array([len(pair) for pair in usable])
    return Examples(
        layout,
        ((signals - centre) / scale).astype(np.float32),
        np.concatenate([features for features, _ in made]),
        np.concatenate([steps for _, steps in made]),
        np.concatenate([np.stack([each.left, each.right], axis=1) for each in stands]),
        np.cumsum(lengths) - lengths,
        tuple(str(pair.behaviour) for pair in usable),
        np.stack([bone_lengths(pair.motion.skeleton) for pair in usable]),
        centre,
        scale,
        pairs_digest(usable),
    )


def bone_lengths(skeleton: Skeleton) -> Floats[Array, "bones"]:
    """Lengths of all bones that hang on another, metres."""
    return np.linalg.norm(skeleton.offsets[1:], axis=1)


def leg_length(skeleton: Skeleton) -> float:
    """Length of the left leg from hip to ankle, metres."""
    bones = ("leftLowerLeg", "leftFoot")
    return float(sum(np.linalg.norm(skeleton.offsets[skeleton.index(bone)]) for bone in bones))


def posture_of(features: Floats[Array, "features"]) -> Posture:
    """The posture that features describe: columns that are not quite of a rotation are made so (Gram and Schmidt)."""
    columns = features[1:].reshape(-1, 2, 3)
    first = columns[:, 0] / np.linalg.norm(columns[:, 0], axis=-1, keepdims=True)
    second = columns[:, 1] - np.sum(first * columns[:, 1], axis=-1, keepdims=True) * first
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    return Posture(float(features[0]), np.stack([first, second, np.cross(first, second)], axis=-1))


def joint_spreads(variances: Floats[Array, "features"]) -> Floats[Array, "joints"]:
    """Standard deviation of each joint's rotation, radians, from the variances of its features.

    A small turn of variance s^2 about each axis moves each of the two columns by a variance of 2 s^2.
    """
    return np.sqrt(np.maximum(variances[1:].reshape(-1, 6).sum(axis=1), 0.0)) / 2


def posed_rotvecs(posture: Posture, heading: float) -> Floats[Array, "joints 3"]:
    """Rotation vectors of all joints, with the root turned to a heading."""
    rotations = posture.rotations.copy()
    rotations[0] = heading_matrix(np.array(heading)) @ rotations[0]
    return rotvec_from_matrix(rotations)


def _described(motion: Motion) -> tuple[Floats32[Array, "frames features"], Floats32[Array, "frames 3"]]:
    """Features and steps of a motion."""
    leg = leg_length(motion.skeleton)
    rotations = matrix_from_rotvec(motion.rotvecs)
    heading = heading_angle(quat_from_matrix(rotations[:, 0]))
    level = rotations.copy()
    level[:, 0] = heading_matrix(-heading) @ rotations[:, 0]
    columns = np.swapaxes(level[..., :2], -1, -2).reshape(len(motion), -1)
    features = np.concatenate([motion.q[:, 1:2] / leg, columns], axis=1)
    way = np.diff(motion.q[:, [0, 2]], axis=0) / leg
    sine, cosine = np.sin(heading[:-1]), np.cos(heading[:-1])
    left, ahead = cosine * way[:, 0] - sine * way[:, 1], sine * way[:, 0] + cosine * way[:, 1]
    turn = np.diff(np.unwrap(heading))
    steps = np.stack([left, ahead, turn], axis=1)
    return features.astype(np.float32), np.concatenate([steps[:1], steps]).astype(np.float32)
