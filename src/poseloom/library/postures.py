"""Postures: where a body's joints are, seen from its hips, and where the hips are."""

import numpy as np

from poseloom.arrays import Array, Floats32
from poseloom.library import _posture_kernels as kernels
from poseloom.skeleton.body import BODY_BONES, MIRROR, average_body

JOINTS = (
    "head",
    "leftLowerArm",
    "rightLowerArm",
    "leftHand",
    "rightHand",
    "leftLowerLeg",
    "rightLowerLeg",
    "leftFoot",
    "rightFoot",
)
JOINT_COORDINATES = 3 * len(JOINTS)
"""Columns of postures that hold joints; the hips' place in the world is in the three after them."""

_MIRRORED = (0, 2, 1, 4, 3, 6, 5, 8, 7, 9)
_CHUNK = 1 << 16


def postures(poses: Floats32[Array, "poses dofs"]) -> Floats32[Array, "poses coordinates"]:
    """Places of head, elbows, wrists, knees and ankles in the hips' frame, then of the hips; average body, metres."""
    body = average_body()
    joints = np.array([BODY_BONES.index(name) for name in JOINTS], dtype=np.int64)
    out = np.empty((len(poses), JOINT_COORDINATES + 3), dtype=np.float32)
    for start in range(0, len(poses), _CHUNK):
        rows = slice(start, start + _CHUNK)
        kernels.joint_places(body.parents, body.offsets, np.asarray(poses[rows]), joints, out[rows])
    out[:, JOINT_COORDINATES:] = poses[:, :3]
    return out


def mirrored_postures(places: Floats32[Array, "poses coordinates"]) -> Floats32[Array, "poses coordinates"]:
    """The same with left and right exchanged."""
    points = places.reshape(len(places), -1, 3)[:, list(_MIRRORED)]
    return np.ascontiguousarray(points * MIRROR.astype(np.float32)).reshape(places.shape)
