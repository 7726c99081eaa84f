"""What the prior network receives and gives, number by number: shared by training and run time.

For each bone of the network's list, in this order: rotation (the first two columns of its matrix), acceleration,
angular rate, position, bend and calibration residual, each followed by 1 where it was measured and 0 where not (its
numbers are 0 then). After the bones: the up direction, which bone is the reference, body size, calibration pose.
The rotations that a network gives follow a base, bone by bone: the rotation, as last measured, of the measured bone
that is likest to it (`likeness`); the identity where none is measured. All vectors are in the axes of the reference
bone as measured; without any orientation the reference is level and faces the way the hips face.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import MethodError
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.skeleton import Skeleton

RATE = 40.0
"""Samples a second that the network is trained at."""


class Channel(IntEnum):
    """What a bone's sensor may measure."""

    ROTATION = 0
    ACCELERATION = 1
    ANGULAR_RATE = 2
    POSITION = 3
    BEND = 4
    RESIDUAL = 5
    """At the calibration pose: rotation vector from the pose that was asked for to the measured one, bone's axes."""


CHANNEL_SIZES: tuple[int, ...] = (6, 3, 3, 3, 1, 3)
"""Numbers of each channel, without its mask."""

CHANNEL_SCALES: tuple[float, ...] = (1.0, 10.0, 5.0, 1.0, 2.4, 0.2)
"""What a channel's numbers are divided by: 1, m/s^2, rad/s, m, rad, rad."""

REFERENCE_ORDER: tuple[str, ...] = (
    "hips", "upperChest", "chest", "spine", "rightUpperLeg", "leftUpperLeg", "head", "neck",
    "rightLowerArm", "leftLowerArm", "rightHand", "leftHand", "rightLowerLeg", "leftLowerLeg",
    "rightFoot", "leftFoot", "rightUpperArm", "leftUpperArm", "rightShoulder", "leftShoulder", "rightToes", "leftToes",
)  # fmt: skip
"""The reference is the first of these bones whose orientation is measured."""

SIX_BONES: tuple[str, ...] = ("hips", "head", "leftLowerArm", "rightLowerArm", "leftLowerLeg", "rightLowerLeg")
"""Where the field wears six IMUs."""

_SIZES: tuple[tuple[str, ...], ...] = (
    ("leftLowerLeg", "rightLowerLeg"),
    ("leftFoot", "rightFoot"),
    ("leftUpperLeg", "rightUpperLeg"),
    ("chest", "upperChest", "neck"),
    ("head",),
    ("leftUpperArm", "rightUpperArm"),
    ("leftLowerArm", "rightLowerArm"),
    ("leftHand", "rightHand"),
)
"""Bone lengths that the network receives: each the sum of these joints' distances from their parents."""

SIZE_COUNT = len(_SIZES)


class CalibrationPose(IntEnum):
    """A pose in which people stand to calibrate."""

    NONE = 0
    T = 1
    N = 2


CONTACTS: tuple[str, ...] = ("left heel", "left toe", "right heel", "right toe")


@dataclass(frozen=True)
class InputSpec:
    """Which numbers a network receives.

    Attributes:
        bones: The bones that may wear a sensor.
        channels: What these sensors may measure.
    """

    bones: tuple[str, ...]
    channels: tuple[Channel, ...]

    def __post_init__(self) -> None:
        unknown = [bone for bone in self.bones if bone not in BODY_BONES]
        if unknown or len(set(self.bones)) < len(self.bones) or not self.bones:
            raise MethodError(
                f"a prior network for the bones {', '.join(self.bones) or 'none'}",
                remedy=f"Name each of these at most once: {', '.join(BODY_BONES)}",
            )

    @property
    def indices(self) -> tuple[int, ...]:
        """The bones' indices in the body."""
        return tuple(BODY_BONES.index(bone) for bone in self.bones)

    @property
    def size(self) -> int:
        """Numbers a sample."""
        per_bone = sum(CHANNEL_SIZES[channel] + 1 for channel in self.channels)
        return len(self.bones) * (per_bone + 1) + 3 + SIZE_COUNT + len(CalibrationPose)


SIX = InputSpec(SIX_BONES, (Channel.ROTATION, Channel.ACCELERATION, Channel.RESIDUAL))
"""Six IMUs with orientation and acceleration."""

ANY = InputSpec(BODY_BONES, tuple(Channel))
"""Any subset of channels at any bone."""

OUTPUT_ROTATIONS = 6 * len(BODY_BONES)
OUTPUT_SIGMAS = len(BODY_BONES)
OUTPUT_SIZE = OUTPUT_ROTATIONS + OUTPUT_SIGMAS + len(CONTACTS) + 3
"""Rotations from the base (two columns a bone), log sigma a bone, contact logits, root velocity."""


_BENDS: Mapping[str, float] = {
    "head": 2.0, "Shoulder": 1.5, "UpperArm": 2.0, "UpperLeg": 1.5, "LowerArm": 1.5, "LowerLeg": 1.5, "neck": 1.2,
}  # fmt: skip
"""How freely a bone turns against its parent, beside the spine's 1: sets which measured bone another is like."""


@cache
def likeness() -> Floats[Array, "joints others"]:
    """How unlike a bone's rotation is to each other's, as the sum of how freely the joints between them turn."""
    count = len(BODY_BONES)
    parents = average_body().parents
    free = np.array([_BENDS.get(name.removeprefix("left").removeprefix("right"), 1.0) for name in BODY_BONES])
    apart = np.full((count, count), np.inf)
    np.fill_diagonal(apart, 0.0)
    for joint in range(1, count):
        apart[joint, :joint] = apart[parents[joint], :joint] + free[joint]
        apart[:joint, joint] = apart[joint, :joint]
    # Of two bones alike in this the one nearer to the root counts: ties must fall the same way everywhere.
    return apart + 1e-3 * np.arange(count)


def choose_reference(oriented: Sequence[str]) -> str:
    """The reference among bones whose orientation is measured; empty if there is none."""
    return next((bone for bone in REFERENCE_ORDER if bone in oriented), "")


def body_sizes(skeleton: Skeleton) -> Floats[Array, "sizes"]:
    """Bone lengths as the network receives them: ten times the share by which each differs from the average body's."""
    return 10 * (_lengths(skeleton.offsets) / _lengths(average_body().offsets) - 1)


def _lengths(offsets: Floats[Array, "joints 3"]) -> Floats[Array, "sizes"]:
    norms = np.linalg.norm(offsets, axis=-1)
    return np.array([sum(norms[BODY_BONES.index(name)] for name in names) / len(names) for names in _SIZES])


def size_matrix() -> Floats[Array, "joints sizes"]:
    """Takes joint distances to the lengths of `body_sizes`."""
    matrix = np.zeros((len(BODY_BONES), SIZE_COUNT))
    for column, names in enumerate(_SIZES):
        for name in names:
            matrix[BODY_BONES.index(name), column] = 1 / len(names)
    return matrix


def fill_inputs(
    spec: InputSpec,
    values: dict[Channel, Floats[Array, "bones _"]],
    measured: Bools[Array, "bones channels"],
    up: Floats[Array, "3"],
    reference: str,
    sizes: Floats[Array, "sizes"],
    pose: CalibrationPose,
) -> Floats[Array, "inputs"]:
    """One sample as the network receives it.

    Args:
        spec: Which numbers.
        values: For each channel of `spec` its numbers by body bone, SI units, in the reference's axes.
        measured: By body bone and `Channel`.
        up: World up in the reference's axes.
        reference: The reference bone; empty for none.
        sizes: See `body_sizes`.
        pose: At which the residuals were taken.
    """
    rows = list(spec.indices)
    parts: list[Floats[Array, "bones _"]] = []
    for channel in spec.channels:
        there = measured[rows, channel][:, None]
        numbers = np.where(there, values[channel][rows], 0.0) / CHANNEL_SCALES[channel]
        parts += [numbers, there.astype(np.float64)]
    is_reference = np.array([[float(bone == reference)] for bone in spec.bones])
    parts.append(is_reference)
    chosen = np.zeros(len(CalibrationPose))
    chosen[pose] = 1.0
    return np.concatenate([np.concatenate(parts, axis=1).reshape(-1), up, sizes, chosen])
