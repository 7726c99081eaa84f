"""Velocities and accelerations of sampled places and rotations, by finite differences of a chosen order.

Inside a series the differences are central; towards its ends the stencils lean inwards, at the same order of accuracy.
"""

from collections.abc import Iterator
from functools import cache
from math import factorial

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import PoseloomError
from poseloom.rotations import rotvec_from_matrix


def derivative(
    values: Floats[Array, "frames *batch"], rate: float, degree: int = 1, order: int = 2
) -> Floats[Array, "frames *batch"]:
    """The derivative of a series with `rate` frames a second.

    Args:
        values: Anything that is sampled in time, time first.
        rate: Frames a second.
        degree: 1 for the velocity, 2 for the acceleration, 3 for the jerk.
        order: Order of the error in the time step: 2, 4, 6 ...

    Raises:
        PoseloomError: for fewer frames than the stencil needs (`degree + order`), or an odd or negative order.
    """
    out = np.empty_like(values)
    for rows, shifts, weights in _stencils(len(values), degree, order):
        out[rows] = sum(
            weight * values[rows.start + shift : rows.stop + shift]
            for shift, weight in zip(shifts, weights, strict=True)
        )
    return out * rate**degree


def linear_velocity(
    positions: Floats[Array, "frames *batch 3"], rate: float, order: int = 2
) -> Floats[Array, "frames *batch 3"]:
    """Velocities, m/s, of places in metres; errors as `derivative`."""
    return derivative(positions, rate, 1, order)


def linear_acceleration(
    positions: Floats[Array, "frames *batch 3"], rate: float, order: int = 2
) -> Floats[Array, "frames *batch 3"]:
    """Accelerations, m/s^2, of places in metres; errors as `derivative`."""
    return derivative(positions, rate, 2, order)


def angular_velocity(
    rotations: Floats[Array, "frames *batch 3 3"], rate: float, order: int = 2
) -> Floats[Array, "frames *batch 3"]:
    """Angular velocities, rad/s, in world axes, of `R_world_bone`; the bone's own axes: `R_world_bone.T @ omega`.

    About each frame the neighbours are written as exp(phi) R, and the stencil goes over phi: at phi = 0 the Jacobian of
    the exponential is the identity, so the first derivative of phi is the angular velocity. Rotations of half a turn or
    more within the stencil fold. Errors as `derivative`.
    """
    return _turn_derivative(rotations, rate, 1, order)


def angular_acceleration(
    rotations: Floats[Array, "frames *batch 3 3"], rate: float, order: int = 2
) -> Floats[Array, "frames *batch 3"]:
    """Angular accelerations, rad/s^2, in world axes, of `R_world_bone`.

    The second derivative of phi (see `angular_velocity`): the Jacobian's own change adds phi' x phi' / 2 = 0.
    """
    return _turn_derivative(rotations, rate, 2, order)


def _turn_derivative(
    rotations: Floats[Array, "frames *batch 3 3"], rate: float, degree: int, order: int
) -> Floats[Array, "frames *batch 3"]:
    back = np.swapaxes(rotations, -1, -2)
    out = np.zeros(rotations.shape[:-1])
    for rows, shifts, weights in _stencils(len(rotations), degree, order):
        for shift, weight in zip(shifts, weights, strict=True):
            if shift:
                turn = rotations[rows.start + shift : rows.stop + shift] @ back[rows]
                out[rows] += weight * rotvec_from_matrix(turn)
    return out * rate**degree


def _stencils(count: int, degree: int, order: int) -> Iterator[tuple[slice, tuple[int, ...], tuple[float, ...]]]:
    """Rows, the shifts of the frames that make their difference, and the weights."""
    if order < 2 or order % 2 or degree < 1:
        raise PoseloomError(
            f"no central difference of degree {degree} and order {order}",
            remedy="Take degree >= 1 and order 2, 4, 6 ...",
        )
    width = degree + order
    if count < width:
        raise PoseloomError(
            f"{count} frames are too few for a difference of degree {degree} and order {order}",
            remedy=f"Give at least {width} frames, or a lower order",
        )
    half = (degree + 1) // 2 + order // 2 - 1
    middle = tuple(range(-half, half + 1))
    for row in range(half):
        first = tuple(range(-row, width - row))
        last = tuple(-shift for shift in first)
        yield slice(row, row + 1), first, _weights(first, degree)
        yield slice(count - 1 - row, count - row), last, _weights(last, degree)
    yield slice(half, count - half), middle, _weights(middle, degree)


@cache
def _weights(shifts: tuple[int, ...], degree: int) -> tuple[float, ...]:
    """Weights that are exact for polynomials of as many coefficients as there are shifts (Taylor's conditions)."""
    powers = np.vander(np.array(shifts, dtype=np.float64), increasing=True).T
    right = np.zeros(len(shifts))
    right[degree] = factorial(degree)
    return tuple(float(weight) for weight in np.linalg.solve(powers, right))
