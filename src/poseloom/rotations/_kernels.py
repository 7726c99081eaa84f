"""Scalar-speed rotation kernels for the inner loops: results go into arrays of the caller."""

import math

from poseloom.arrays import Array, Floats, compiled


@compiled
def exp_matrix(x: float, y: float, z: float, out: Floats[Array, "3 3"]) -> None:
    """Rotation matrix of the rotation vector (x, y, z)."""
    square = x * x + y * y + z * z
    if square < 1e-8:
        a = 1.0 - square / 6.0
        b = 0.5 - square / 24.0
    else:
        angle = math.sqrt(square)
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / square
    out[0, 0] = 1.0 - b * (y * y + z * z)
    out[0, 1] = b * x * y - a * z
    out[0, 2] = b * x * z + a * y
    out[1, 0] = b * x * y + a * z
    out[1, 1] = 1.0 - b * (x * x + z * z)
    out[1, 2] = b * y * z - a * x
    out[2, 0] = b * x * z - a * y
    out[2, 1] = b * y * z + a * x
    out[2, 2] = 1.0 - b * (x * x + y * y)


@compiled
def left_jacobian_matrix(x: float, y: float, z: float, out: Floats[Array, "3 3"]) -> None:
    """J_l of the rotation vector (x, y, z): exp(w + d) = exp(J_l d) exp(w) to first order."""
    square = x * x + y * y + z * z
    if square < 1e-4:
        a = 0.5 - square / 24.0 + square * square / 720.0
        b = 1.0 / 6.0 - square / 120.0 + square * square / 5040.0
    else:
        angle = math.sqrt(square)
        a = (1.0 - math.cos(angle)) / square
        b = (angle - math.sin(angle)) / (square * angle)
    out[0, 0] = 1.0 - b * (y * y + z * z)
    out[0, 1] = b * x * y - a * z
    out[0, 2] = b * x * z + a * y
    out[1, 0] = b * x * y + a * z
    out[1, 1] = 1.0 - b * (x * x + z * z)
    out[1, 2] = b * y * z - a * x
    out[2, 0] = b * x * z - a * y
    out[2, 1] = b * y * z + a * x
    out[2, 2] = 1.0 - b * (x * x + y * y)


@compiled
def log_rotation(r: Floats[Array, "3 3"], out: Floats[Array, "3"]) -> None:
    """Rotation vector, angle in [0, pi], of a rotation matrix: by way of the best conditioned quaternion."""
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    if trace >= r[0, 0] and trace >= r[1, 1] and trace >= r[2, 2]:
        w = 1.0 + trace
        x = r[2, 1] - r[1, 2]
        y = r[0, 2] - r[2, 0]
        z = r[1, 0] - r[0, 1]
    elif r[0, 0] >= r[1, 1] and r[0, 0] >= r[2, 2]:
        w = r[2, 1] - r[1, 2]
        x = 1.0 + 2.0 * r[0, 0] - trace
        y = r[0, 1] + r[1, 0]
        z = r[0, 2] + r[2, 0]
    elif r[1, 1] >= r[2, 2]:
        w = r[0, 2] - r[2, 0]
        x = r[0, 1] + r[1, 0]
        y = 1.0 + 2.0 * r[1, 1] - trace
        z = r[1, 2] + r[2, 1]
    else:
        w = r[1, 0] - r[0, 1]
        x = r[0, 2] + r[2, 0]
        y = r[1, 2] + r[2, 1]
        z = 1.0 + 2.0 * r[2, 2] - trace
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 / w if sine < 1e-12 * w else 2.0 * math.atan2(sine, w) / sine
    out[0] = factor * x
    out[1] = factor * y
    out[2] = factor * z
