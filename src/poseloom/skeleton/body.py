"""The body that everything in poseloom moves: the 22 humanoid bones of VRM 1.0, in a T-pose."""

from collections.abc import Mapping
from functools import cache

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

_PARENTS: Mapping[str, str] = {
    "hips": "",
    "spine": "hips",
    "chest": "spine",
    "upperChest": "chest",
    "neck": "upperChest",
    "head": "neck",
    "leftShoulder": "upperChest",
    "leftUpperArm": "leftShoulder",
    "leftLowerArm": "leftUpperArm",
    "leftHand": "leftLowerArm",
    "rightShoulder": "upperChest",
    "rightUpperArm": "rightShoulder",
    "rightLowerArm": "rightUpperArm",
    "rightHand": "rightLowerArm",
    "leftUpperLeg": "hips",
    "leftLowerLeg": "leftUpperLeg",
    "leftFoot": "leftLowerLeg",
    "leftToes": "leftFoot",
    "rightUpperLeg": "hips",
    "rightLowerLeg": "rightUpperLeg",
    "rightFoot": "rightLowerLeg",
    "rightToes": "rightFoot",
}

BODY_BONES: tuple[str, ...] = tuple(_PARENTS)
"""Names of the body's 22 bones, parents before children."""

# Means over 41 skeletons of the CMU Graphics Lab Motion Capture Database (free for all uses; NSF EIA-0196217), left and
# right averaged, legs turned straight down and arms straight out; the segment above upperChest from CMU's ASF files.
_CENTRE: Mapping[str, tuple[float, float, float]] = {
    "hips": (0.0, 0.0, 0.0),
    "spine": (0.0, 0.0, 0.0),
    "chest": (0.0, 0.115, -0.008),
    "upperChest": (0.0, 0.115, 0.0),
    "neck": (0.0, 0.120, 0.0),
    "head": (0.0, 0.094, 0.009),
}
_LEFT: Mapping[str, tuple[float, float, float]] = {
    "Shoulder": (0.0, 0.120, 0.0),
    "UpperArm": (0.181, 0.063, -0.008),
    "LowerArm": (0.290, 0.0, 0.0),
    "Hand": (0.188, 0.0, 0.0),
    "UpperLeg": (0.089, -0.099, 0.044),
    "LowerLeg": (0.0, -0.403, 0.0),
    "Foot": (0.0, -0.426, 0.0),
    "Toes": (0.0, -0.030, 0.115),
}
_HEAD_TIP = (0.0, 0.192, -0.020)
_HAND_TIP = (0.160, 0.0, 0.0)
_TOE_TIP = (0.0, 0.0, 0.060)

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Reflection in the body's sagittal plane, for points."""


@cache
def average_body() -> Skeleton:
    """The 22-bone body of average size: T-pose, facing +Z, left hand towards +X, metres."""
    offsets: dict[str, Floats[Array, 3]] = {name: np.array(value) for name, value in _CENTRE.items()}
    for bone, value in _LEFT.items():
        offsets[f"left{bone}"] = np.array(value)
        offsets[f"right{bone}"] = np.array(value) * MIRROR
    tips = {
        "head": np.array(_HEAD_TIP),
        "leftHand": np.array(_HAND_TIP),
        "rightHand": np.array(_HAND_TIP) * MIRROR,
        "leftToes": np.array(_TOE_TIP),
        "rightToes": np.array(_TOE_TIP),
    }
    return make_skeleton(
        BODY_BONES,
        [BODY_BONES.index(parent) if parent else -1 for parent in _PARENTS.values()],
        np.stack([offsets[name] for name in BODY_BONES]),
        tips,
    )


@cache
def mirror_bones() -> tuple[int, ...]:
    """For each body bone the index of the bone on the other side (itself in the middle)."""
    other = {"left": "right", "right": "left"}
    swapped = [
        other[n[: n.index("t") + 1]] + n[n.index("t") + 1 :] if n[:4] in ("left", "righ") else n for n in BODY_BONES
    ]
    return tuple(BODY_BONES.index(name) for name in swapped)


@cache
def moving_dofs() -> Bools[Array, "dofs"]:
    """Which pose-vector entries are moving angles, for `joint_angle_deg`: no root place, toes or hinge's still axes.

    Knees bend about X only; elbows bend (Y) and roll (X). Counting axes that never move would flatter every method.
    (Where a straight arm's twist was shared, see `forearms`, its small bend is partly about Z, which does not count.)
    """
    moving = np.ones(3 + 3 * len(BODY_BONES), dtype=np.bool_)
    moving[:3] = False
    for bone in ("leftToes", "rightToes"):
        at = 3 + 3 * BODY_BONES.index(bone)
        moving[at : at + 3] = False
    for side in ("left", "right"):
        knee = 3 + 3 * BODY_BONES.index(f"{side}LowerLeg")
        moving[knee + 1 : knee + 3] = False
        moving[3 + 3 * BODY_BONES.index(f"{side}LowerArm") + 2] = False
    moving.flags.writeable = False
    return moving
