"""Finite differences against trajectories whose derivatives are known."""

import numpy as np
import pytest

from poseloom.errors import PoseloomError
from poseloom.rotations import left_jacobian, matrix_from_rotvec, right_jacobian
from poseloom.skeleton import (
    angular_acceleration,
    angular_velocity,
    derivative,
    linear_acceleration,
    linear_velocity,
)

ORDERS = (2, 4, 6)


def swing(times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A place on a curve, its velocity and its acceleration."""
    p = np.stack([np.sin(3 * times), np.cos(2 * times), 0.5 * times**2], axis=1)
    v = np.stack([3 * np.cos(3 * times), -2 * np.sin(2 * times), times], axis=1)
    a = np.stack([-9 * np.sin(3 * times), -4 * np.cos(2 * times), np.ones_like(times)], axis=1)
    return p, v, a


def tumble(times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations exp(a) exp(b), their angular velocity and acceleration in world axes, by the chain rule."""
    fixed = np.array([0.5, 1.0, -0.7])
    angle, speed, growth = np.sin(2 * times), 2 * np.cos(2 * times), -4 * np.sin(2 * times)
    inner = matrix_from_rotvec(np.stack([1.5 * times, 0 * times, 0 * times], axis=1))
    outer = matrix_from_rotvec(angle[:, None] * fixed)
    spin = outer @ np.array([1.5, 0, 0])
    omega = speed[:, None] * fixed + spin
    alpha = growth[:, None] * fixed + np.cross(speed[:, None] * fixed, spin)
    return outer @ inner, omega, alpha


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("order", ORDERS)
def test_polynomials_up_to_the_order_are_exact_to_the_ends(degree, order):
    rng = np.random.default_rng(0)
    polynomial = np.polynomial.Polynomial(rng.normal(size=degree + order))
    times = np.arange(25) / 10
    expected = polynomial.deriv(degree)(times)
    found = derivative(polynomial(times), 10.0, degree, order)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    ("made", "differences"),
    [(swing, (linear_velocity, linear_acceleration)), (tumble, (angular_velocity, angular_acceleration))],
)
def test_errors_fall_with_the_order(made, differences, order):
    errors = []
    for rate in (50.0, 100.0):
        values, first, second = made(np.arange(int(rate)) / rate)
        found = [difference(values, rate, order) for difference in differences]
        errors.append([np.abs(found[0] - first).max(), np.abs(found[1] - second).max()])
    ratios = np.array(errors[0]) / np.array(errors[1])
    assert (ratios > 0.75 * 2**order).all(), ratios
    assert max(errors[1]) < {2: 0.05, 4: 1e-3, 6: 2e-5}[order]


def test_a_batch_is_its_members():
    times = np.arange(40) / 60
    p, *_ = swing(times)
    r, *_ = tumble(times)
    np.testing.assert_array_equal(
        linear_velocity(np.stack([p, 2 * p], axis=1), 60.0)[:, 1], linear_velocity(2 * p, 60.0)
    )
    np.testing.assert_array_equal(angular_velocity(np.stack([r, r @ r], axis=1), 60.0)[:, 0], angular_velocity(r, 60.0))


def test_angular_velocity_is_the_exponentials_jacobian_times_the_rotation_vectors_rate():
    times = np.arange(400) / 1000
    w = np.stack([np.sin(times), times**2, 0.3 - times], axis=1)
    rate = np.stack([np.cos(times), 2 * times, -np.ones_like(times)], axis=1)
    r = matrix_from_rotvec(w)
    found = angular_velocity(r, 1000.0, 4)
    np.testing.assert_allclose(found, np.einsum("nij,nj->ni", left_jacobian(w), rate), atol=1e-9)
    body = np.einsum("nji,nj->ni", r, found)
    np.testing.assert_allclose(body, np.einsum("nij,nj->ni", right_jacobian(w), rate), atol=1e-9)


def test_too_few_frames_and_odd_orders_are_refused():
    with pytest.raises(PoseloomError, match="at least 4 frames"):
        derivative(np.zeros(3), 10.0, 2, 2)
    for order in (0, 1, 3, -2):
        with pytest.raises(PoseloomError, match="order 2, 4, 6"):
            derivative(np.zeros(30), 10.0, 1, order)
