"""What a person who stands in a known pose teaches the prior: sensors' residuals, and the network's own error."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import MethodError
from poseloom.methods.prior.channels import CalibrationPose
from poseloom.rotations import matrix_from_quat, matrix_from_rotvec, mean_quat, quat_from_matrix, rotvec_from_matrix
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.kinematics import forward_kinematics

ARM_DOWN = math.radians(80.0)
"""How far the upper arms turn down from the T-pose in the N-pose."""

CORRECTED_SHARE = 0.0
"""Share of the constant difference at the pose by which the network's bones are turned. A half, which helped a smaller
network on real sensors, costs these two to six degrees at hips and shoulders on people who were not trained on: they
have seen few T-poses, and their error there is not their error elsewhere."""

HOLD_SECONDS = 1.5
"""For so long the network receives the pose before its estimate is compared."""


def _none() -> Floats[Array, "joints 3"]:
    return np.full((len(BODY_BONES), 3), np.nan)


def _identity() -> Floats[Array, "joints 3 3"]:
    return np.tile(np.eye(3), (len(BODY_BONES), 1, 1))


@dataclass(frozen=True, eq=False)
class PriorCalibration:
    """What a calibration pose showed.

    Attributes:
        pose: Which; NONE without one.
        residuals: For each body bone, rotation vector from the pose that was asked for to the measured one, in the
            bone's axes, radians; NaN without an oriented sensor.
        corrections: By how much the network's bones are turned, in their own axes.
    """

    pose: CalibrationPose = CalibrationPose.NONE
    residuals: Floats[Array, "joints 3"] = field(default_factory=_none)
    corrections: Floats[Array, "joints 3 3"] = field(default_factory=_identity)


@cache
def known_rotations(pose: CalibrationPose) -> Floats[Array, "joints 3 3"]:
    """World rotations of the body's bones in a calibration pose, facing +Z; all identity without one."""
    q = np.zeros(average_body().size)
    if pose is CalibrationPose.N:
        q[3 + 3 * BODY_BONES.index("leftUpperArm") + 2] = -ARM_DOWN
        q[3 + 3 * BODY_BONES.index("rightUpperArm") + 2] = ARM_DOWN
    return frozen_float(forward_kinematics(average_body(), q).rotations)


def measured_residuals(
    bones: Sequence[str], held: Floats[Array, "samples sensors 3 3"], pose: CalibrationPose
) -> tuple[Floats[Array, "joints 3"], float]:
    """Residuals of a pose that was held, and the heading that the person faced.

    Args:
        bones: That of each sensor.
        held: `R_world_bone` as measured while the pose was held; NaN where missing.
        pose: Which.

    Returns:
        The residuals, and the heading in radians: 0 is +Z, positive towards +X. It is the mean of what the sensors'
        headings say, so only their differences remain in the residuals.

    Raises:
        MethodError: if no sensor's orientation was measured, or none is asked for.
    """
    if pose is CalibrationPose.NONE:
        raise MethodError("no calibration pose is named", remedy="Name the pose that was held: T or N")
    known = known_rotations(pose)
    means: dict[int, Floats[Array, "3 3"]] = {}
    for index, bone in enumerate(bones):
        there = held[np.isfinite(held[:, index, 0, 0]), index]
        if len(there):
            means[BODY_BONES.index(bone)] = matrix_from_quat(mean_quat(quat_from_matrix(there), np.ones(len(there))))
    if not means:
        raise MethodError(
            "no orientation was measured in the calibration pose", remedy="Check that the sensors deliver orientations"
        )
    turns = [rotation @ known[joint].T for joint, rotation in means.items()]
    headings = [math.atan2(turn[0, 2] - turn[2, 0], turn[0, 0] + turn[2, 2]) for turn in turns]
    facing = math.atan2(sum(map(math.sin, headings)), sum(map(math.cos, headings)))
    back = matrix_from_rotvec(np.array([0.0, -facing, 0.0]))
    residuals = _none()
    for joint, rotation in means.items():
        residuals[joint] = rotvec_from_matrix(known[joint].T @ back @ rotation)
    return residuals, facing


def part_of(rotations: Floats[Array, "joints 3 3"], share: float) -> Floats[Array, "joints 3 3"]:
    """A share of each rotation."""
    return matrix_from_rotvec(share * rotvec_from_matrix(rotations))
