"""Which sensors people wear in training: named sets, and random ones."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Bools
from poseloom.methods.prior.channels import SIX_BONES, Channel
from poseloom.skeleton.body import BODY_BONES

_ROTATION, _RATE, _BEND = frozenset({Channel.ROTATION}), frozenset({Channel.ANGULAR_RATE}), frozenset({Channel.BEND})
_IMU = _ROTATION | {Channel.ACCELERATION}
_TRACKER = _ROTATION | {Channel.POSITION}

SensorSet = Mapping[str, frozenset[Channel]]
"""Channels by bone."""


def _pair(bone: str) -> tuple[str, str]:
    return f"left{bone}", f"right{bone}"


_LEGS = (*_pair("UpperLeg"), *_pair("LowerLeg"))
_FLEX: SensorSet = dict.fromkeys((*_pair("LowerLeg"), *_pair("LowerArm")), _BEND)


def _all(bones: tuple[str, ...], channels: frozenset[Channel]) -> SensorSet:
    return dict.fromkeys(bones, channels)


SIX_IMUS: SensorSet = _all(SIX_BONES, _IMU)

NAMED_SETS: Mapping[str, tuple[float, SensorSet]] = {
    "six-imus": (4, SIX_IMUS),
    "six-trackers": (3, _all(("head", "upperChest", *_pair("Hand"), *_pair("LowerLeg")), _TRACKER)),
    "six-trackers-hips": (1, _all(("head", "hips", *_pair("Hand"), *_pair("LowerLeg")), _TRACKER)),
    "three-trackers": (2, _all(("head", *_pair("Hand")), _TRACKER)),
    "slimevr-5": (1, _all(("upperChest", *_LEGS), _IMU)),
    "slimevr-6": (1, _all(("upperChest", "hips", *_LEGS), _IMU)),
    "slimevr-7": (1, _all(("upperChest", *_LEGS, *_pair("Foot")), _IMU)),
    "slimevr-8": (1, _all(("upperChest", "hips", *_LEGS, *_pair("Foot")), _IMU)),
    "slimevr-10": (1, _all(("upperChest", "hips", *_LEGS, *_pair("Foot"), *_pair("UpperArm")), _IMU)),
    "pelvis-wrists": (1.5, _all(("hips", *_pair("LowerArm")), _IMU)),
    "wrist-pocket": (1, _all(("leftLowerArm", "rightUpperLeg"), _IMU)),
    "wrist-same-pocket": (0.5, _all(("rightLowerArm", "rightUpperLeg"), _IMU)),
    "head-wrists": (1, _all(("head", *_pair("LowerArm")), _IMU)),
    "wrist": (0.3, _all(("rightLowerArm",), _IMU)),
    "pocket": (0.5, _all(("rightUpperLeg",), _IMU)),
    "hips": (0.5, _all(("hips",), _IMU)),
    "flex-four": (1, _FLEX),
    "flex-four-hips": (1, {**_FLEX, "hips": _IMU}),
    "flex-four-six-imus": (0.5, {**_FLEX, **SIX_IMUS, **{b: _IMU | _BEND for b in SIX_BONES if "Lower" in b}}),
}
"""Sets that people own, with how often each is drawn."""

_RANDOM_SHARE = 0.35
_RANDOM_BONES = tuple(bone for bone in BODY_BONES if bone not in ("spine", "chest", "neck", "leftToes", "rightToes"))
_RATE_SHARE = 0.3
"""Share of sets whose IMUs give angular rates too."""
_NO_ACCELERATION = 0.15
"""Share of sets whose IMUs give orientations alone."""
_WITH_HEADSET = 0.2
"""Share of named sets to which a head tracker is added."""


@dataclass(frozen=True, eq=False)
class SensorMasks:
    """Who measures what.

    Attributes:
        measured: By stretch, body bone and channel.
        trackers: By stretch and body bone: whether the sensor is a tracker, which turns less and knows its heading.
    """

    measured: Bools[Array, "batch bones channels"]
    trackers: Bools[Array, "batch bones"]


def fixed_masks(batch: int, worn: SensorSet) -> SensorMasks:
    """The same set for all."""
    return masks_of([worn] * batch)


def draw_masks(batch: int, generator: Generator) -> SensorMasks:
    """A set for each stretch."""
    return masks_of([draw_set(generator) for _ in range(batch)])


def draw_set(generator: Generator) -> SensorSet:
    """A named set or a random one."""
    if generator.random() < _RANDOM_SHARE:
        return _random_set(generator)
    shares = np.array([share for share, _ in NAMED_SETS.values()])
    worn = dict(list(NAMED_SETS.values())[int(generator.choice(len(shares), p=shares / shares.sum()))][1])
    if generator.random() < _WITH_HEADSET:
        worn["head"] = _TRACKER
    drop = generator.random() < _NO_ACCELERATION
    add = generator.random() < _RATE_SHARE
    return {bone: _varied(channels, drop, add) for bone, channels in worn.items()}


def _varied(channels: frozenset[Channel], drop: bool, add: bool) -> frozenset[Channel]:
    if Channel.ACCELERATION not in channels:
        return channels
    kept = channels - {Channel.ACCELERATION} if drop else channels
    return kept | _RATE if add else kept


def _random_set(generator: Generator) -> SensorSet:
    count = int(generator.integers(1, 12))
    bones = generator.choice(np.array(_RANDOM_BONES), size=count, replace=False)
    positions = generator.random() * (generator.random() < 0.4)
    worn: dict[str, frozenset[Channel]] = {}
    for bone in bones:
        draw = generator.random()
        if draw < positions:
            worn[str(bone)] = _TRACKER
        else:
            worn[str(bone)] = _IMU | (_RATE if draw > 0.8 else frozenset()) if draw > 0.15 else _ROTATION
    return worn


def masks_of(sets: list[SensorSet]) -> SensorMasks:
    """The sets as arrays."""
    measured = np.zeros((len(sets), len(BODY_BONES), len(Channel)), dtype=np.bool_)
    for row, worn in enumerate(sets):
        for bone, channels in worn.items():
            measured[row, BODY_BONES.index(bone), list(channels)] = True
    return SensorMasks(measured, measured[..., Channel.POSITION].copy())
