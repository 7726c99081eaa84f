"""Rotations in three dimensions as rotation vectors, unit quaternions (scalar first) and matrices.

All functions take any leading batch shape and return float64. Conventions: a rotation acts on column vectors; a
rotation vector is axis times angle in radians; quaternions are `wxyz`. Kernels for the inner loops stand in `_kernels`.
"""

from poseloom.rotations._convert import (
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_matrix,
    quat_from_rotvec,
    rotvec_from_matrix,
    rotvec_from_quat,
)
from poseloom.rotations._euler import euler_from_matrix, matrix_from_euler, rotvec_series_from_euler
from poseloom.rotations._group import (
    aligning_matrix,
    geodesic_angle,
    heading_angle,
    heading_matrix,
    mean_quat,
    nearest_branch,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    slerp,
    unwrap_rotvec,
)
from poseloom.rotations._jacobians import left_jacobian, left_jacobian_inverse, right_jacobian, right_jacobian_inverse

__all__ = [
    "aligning_matrix",
    "euler_from_matrix",
    "geodesic_angle",
    "heading_angle",
    "heading_matrix",
    "left_jacobian",
    "left_jacobian_inverse",
    "matrix_from_euler",
    "matrix_from_quat",
    "matrix_from_rotvec",
    "mean_quat",
    "nearest_branch",
    "quat_conjugate",
    "quat_from_matrix",
    "quat_from_rotvec",
    "quat_multiply",
    "quat_rotate",
    "right_jacobian",
    "right_jacobian_inverse",
    "rotvec_from_matrix",
    "rotvec_from_quat",
    "rotvec_series_from_euler",
    "slerp",
    "unwrap_rotvec",
]
