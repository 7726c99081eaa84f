"""Euler angles, at the border only: files speak them, poseloom's inside does not."""

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.rotations._series_kernels import rotvecs_from_euler


def _axis_matrix(axis: str, angle: Floats[Array, "*batch"]) -> Floats[Array, "*batch 3 3"]:
    matrix = np.zeros((*angle.shape, 3, 3))
    i = "XYZ".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    matrix[..., i, i] = 1
    matrix[..., j, j] = matrix[..., k, k] = np.cos(angle)
    matrix[..., k, j] = np.sin(angle)
    matrix[..., j, k] = -matrix[..., k, j]
    return matrix


def matrix_from_euler(angles: Floats[Array, "*batch axes"], axes: str) -> Floats[Array, "*batch 3 3"]:
    """The product of turns about `axes` (letters X, Y, Z; any number, left to right), angles in radians.

    "ZXY" with angles (a, b, c) gives R_z(a) R_x(b) R_y(c): the order in which BVH lists its channels.
    """
    matrix = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for index, axis in enumerate(axes):
        turn = _axis_matrix(axis, angles[..., index])
        matrix = turn if index == 0 else matrix @ turn
    return np.array(matrix)


def euler_from_matrix(matrix: Floats[Array, "*batch 3 3"], axes: str) -> Floats[Array, "*batch 3"]:
    """Angles in radians about three different `axes` whose product is the matrix; the middle one is in [-pi/2, pi/2].

    At the gimbal lock the last angle is zero.
    """
    i, j, k = ("XYZ".index(axis) for axis in axes)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    sine = np.clip(sign * matrix[..., i, k], -1.0, 1.0)
    cosine = np.hypot(matrix[..., i, i], matrix[..., i, j])
    middle = np.arctan2(sine, cosine)
    locked = cosine < 1e-9
    first = np.arctan2(-sign * matrix[..., j, k], matrix[..., k, k])
    last = np.arctan2(-sign * matrix[..., i, j], matrix[..., i, i])
    first_locked = np.arctan2(sign * matrix[..., k, j], matrix[..., j, j])
    return np.stack([np.where(locked, first_locked, first), middle, np.where(locked, 0.0, last)], axis=-1)


def rotvec_series_from_euler(
    angles: Floats[Array, "frames joints turns"], axes: Ints[Array, "joints turns"]
) -> Floats[Array, "frames joints 3"]:
    """Rotation vectors, continuous in time, of many joints given by Euler angles.

    Args:
        angles: Radians.
        axes: For each joint the axes of its turns, 0 to 2 for X to Z, whose product, left to right, is its rotation; -1
            where it has fewer turns. One axis may come twice (as in ZXZ).
    """
    out = np.empty((*angles.shape[:2], 3))
    rotvecs_from_euler(angles, axes, out)
    return out
