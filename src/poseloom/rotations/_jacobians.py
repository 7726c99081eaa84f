"""Jacobians of the exponential and logarithm on SO(3).

The left Jacobian J_l satisfies exp(w + d) = exp(J_l(w) d) exp(w) to first order; the right one J_r(w) = J_l(-w)
satisfies exp(w + d) = exp(w) exp(J_r(w) d). Their inverses are the Jacobians of the logarithm.
"""

import numpy as np

from poseloom.arrays import Array, Floats

_SMALL = 1e-2
"""Below this angle, in radians, the coefficients are series to fourth order; the error is below 1e-14."""


def skew(vector: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3 3"]:
    """The matrix [v]x with [v]x u = v x u."""
    matrix = np.zeros((*vector.shape[:-1], 3, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def _assemble(
    rotvec: Floats[Array, "*batch 3"], first: Floats[Array, "*batch"], second: Floats[Array, "*batch"]
) -> Floats[Array, "*batch 3 3"]:
    cross = skew(rotvec)
    return np.eye(3) + first[..., None, None] * cross + second[..., None, None] * (cross @ cross)


def left_jacobian(rotvec: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3 3"]:
    """J_l(w) = I + (1 - cos a) / a^2 [w]x + (a - sin a) / a^3 [w]x^2, with a = |w|."""
    a = np.asarray(np.linalg.norm(rotvec, axis=-1))
    small = a < _SMALL
    safe = np.where(small, 1.0, a)
    first = np.where(small, 0.5 - a**2 / 24 + a**4 / 720, (1 - np.cos(a)) / safe**2)
    second = np.where(small, 1 / 6 - a**2 / 120 + a**4 / 5040, (a - np.sin(a)) / safe**3)
    return _assemble(rotvec, first, second)


def left_jacobian_inverse(rotvec: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3 3"]:
    """J_l(w)^-1 = I - [w]x / 2 + (1 / a^2 - cot(a / 2) / (2 a)) [w]x^2; finite for |w| < 2 pi."""
    a = np.asarray(np.linalg.norm(rotvec, axis=-1))
    small = a < _SMALL
    safe = np.where(small, 1.0, a)
    second = np.where(small, 1 / 12 + a**2 / 720 + a**4 / 30240, 1 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe)))
    return _assemble(rotvec, np.full_like(a, -0.5), second)


def right_jacobian(rotvec: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3 3"]:
    """J_r(w) = J_l(-w)."""
    return left_jacobian(-rotvec)


def right_jacobian_inverse(rotvec: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3 3"]:
    """J_r(w)^-1 = J_l(-w)^-1."""
    return left_jacobian_inverse(-rotvec)
