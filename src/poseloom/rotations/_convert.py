"""Exponential and logarithm: rotation vectors, quaternions (scalar first) and matrices into one another."""

import numpy as np

from poseloom.arrays import Array, Floats

_SMALL = 1e-4
"""Below this angle, in radians, series replace quotients of vanishing numbers; their error is below 1e-17."""


def quat_from_rotvec(rotvec: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 4"]:
    """Exponential map to unit quaternions `wxyz`."""
    angle = np.asarray(np.linalg.norm(rotvec, axis=-1, keepdims=True))
    small = angle < _SMALL
    half = 0.5 * angle
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 0.5 - angle**2 / 48, np.sin(half) / safe)
    return np.concatenate([np.cos(half), factor * rotvec], axis=-1)


def rotvec_from_quat(quat_wxyz: Floats[Array, "*batch 4"]) -> Floats[Array, "*batch 3"]:
    """Logarithm of unit quaternions, on the branch with angle in [0, pi]."""
    quat = np.where(quat_wxyz[..., :1] < 0, -quat_wxyz, quat_wxyz)
    sine = np.linalg.norm(quat[..., 1:], axis=-1, keepdims=True)
    cosine = quat[..., :1]
    small = sine < _SMALL
    safe = np.where(small, 1.0, sine)
    ratio = sine / np.where(small, cosine, 1.0)
    factor = np.where(small, 2 / np.where(small, cosine, 1.0) * (1 - ratio**2 / 3), 2 * np.arctan2(sine, cosine) / safe)
    return factor * quat[..., 1:]


def matrix_from_quat(quat_wxyz: Floats[Array, "*batch 4"]) -> Floats[Array, "*batch 3 3"]:
    """Rotation matrices of unit quaternions `wxyz`."""
    w, x, y, z = np.moveaxis(quat_wxyz, -1, 0)
    matrix = np.empty((*quat_wxyz.shape[:-1], 3, 3))
    matrix[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[..., 0, 1] = 2 * (x * y - w * z)
    matrix[..., 0, 2] = 2 * (x * z + w * y)
    matrix[..., 1, 0] = 2 * (x * y + w * z)
    matrix[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[..., 1, 2] = 2 * (y * z - w * x)
    matrix[..., 2, 0] = 2 * (x * z - w * y)
    matrix[..., 2, 1] = 2 * (y * z + w * x)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def quat_from_matrix(matrix: Floats[Array, "*batch 3 3"]) -> Floats[Array, "*batch 4"]:
    """Unit quaternions `wxyz` of rotation matrices, with non-negative scalar part.

    Of the four quotients of Shepperd's method the one with the largest divisor is taken: no angle is ill-conditioned.
    """
    m = matrix
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    squares = np.stack([trace, m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    rows = np.empty((*m.shape[:-2], 4, 4))
    rows[..., 0, 0] = 1 + trace
    rows[..., 0, 1] = rows[..., 1, 0] = m[..., 2, 1] - m[..., 1, 2]
    rows[..., 0, 2] = rows[..., 2, 0] = m[..., 0, 2] - m[..., 2, 0]
    rows[..., 0, 3] = rows[..., 3, 0] = m[..., 1, 0] - m[..., 0, 1]
    for i in range(3):
        rows[..., 1 + i, 1 + i] = 1 + 2 * m[..., i, i] - trace
    rows[..., 1, 2] = rows[..., 2, 1] = m[..., 0, 1] + m[..., 1, 0]
    rows[..., 1, 3] = rows[..., 3, 1] = m[..., 0, 2] + m[..., 2, 0]
    rows[..., 2, 3] = rows[..., 3, 2] = m[..., 1, 2] + m[..., 2, 1]
    best = np.argmax(squares, axis=-1)
    quat = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    quat = quat / np.asarray(np.linalg.norm(quat, axis=-1, keepdims=True))
    return np.where(quat[..., :1] < 0, -quat, quat)


def matrix_from_rotvec(rotvec: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3 3"]:
    """Exponential map to rotation matrices."""
    return matrix_from_quat(quat_from_rotvec(rotvec))


def rotvec_from_matrix(matrix: Floats[Array, "*batch 3 3"]) -> Floats[Array, "*batch 3"]:
    """Logarithm of rotation matrices, on the branch with angle in [0, pi]."""
    return rotvec_from_quat(quat_from_matrix(matrix))
