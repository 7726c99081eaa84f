"""Rotations against scipy, against finite differences, and by their own laws."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation, Slerp

from poseloom.rotations import (
    aligning_matrix,
    euler_from_matrix,
    geodesic_angle,
    heading_angle,
    heading_matrix,
    left_jacobian,
    left_jacobian_inverse,
    matrix_from_euler,
    matrix_from_quat,
    matrix_from_rotvec,
    mean_quat,
    nearest_branch,
    quat_conjugate,
    quat_from_matrix,
    quat_from_rotvec,
    quat_multiply,
    quat_rotate,
    right_jacobian,
    right_jacobian_inverse,
    rotvec_from_matrix,
    rotvec_from_quat,
    slerp,
    unwrap_rotvec,
)
from poseloom.rotations._kernels import exp_matrix, left_jacobian_matrix, log_rotation

ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def rotvecs(largest: float = 3.1):
    """Rotation vectors with all sizes of angle, zero and tiny ones included."""
    directions = arrays(np.float64, 3, elements=st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 1e-3)
    angles = st.one_of(st.floats(0, largest), st.sampled_from([0.0, 1e-12, 1e-7, 1e-5, 1e-4, 9.9e-3, 1.01e-2, largest]))
    return st.builds(lambda v, a: v / np.linalg.norm(v) * a, directions, angles)


def quats():
    return rotvecs().map(quat_from_rotvec)


def many(seed: int, count: int = 200) -> np.ndarray:
    return Rotation.random(count, rng=np.random.default_rng(seed)).as_quat(scalar_first=True)


@given(rotvecs())
def test_exponential_agrees_with_scipy(w):
    expected = Rotation.from_rotvec(w)
    np.testing.assert_allclose(matrix_from_rotvec(w), expected.as_matrix(), atol=1e-14)
    assert geodesic_angle(quat_from_rotvec(w), expected.as_quat(scalar_first=True)) < 1e-14


@given(rotvecs())
def test_logarithm_undoes_the_exponential(w):
    np.testing.assert_allclose(rotvec_from_quat(quat_from_rotvec(w)), w, atol=1e-14)
    np.testing.assert_allclose(rotvec_from_matrix(matrix_from_rotvec(w)), w, atol=2e-14)


@given(rotvecs(largest=20.0))
def test_any_rotation_vector_gives_a_rotation(w):
    matrix = matrix_from_rotvec(w)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_half_turns_have_a_logarithm():
    for axis in np.eye(3):
        for sign in (1.0, -1.0):
            found = rotvec_from_matrix(matrix_from_rotvec(sign * np.pi * axis))
            np.testing.assert_allclose(np.abs(found), np.pi * axis, atol=1e-12)


def test_quaternions_and_matrices_are_the_same_rotations():
    first, second = many(1), many(2)
    np.testing.assert_allclose(
        matrix_from_quat(quat_multiply(first, second)), matrix_from_quat(first) @ matrix_from_quat(second), atol=1e-14
    )
    vector = np.random.default_rng(3).normal(size=(200, 3))
    np.testing.assert_allclose(
        quat_rotate(first, vector), np.einsum("nij,nj->ni", matrix_from_quat(first), vector), atol=1e-13
    )
    np.testing.assert_allclose(
        matrix_from_quat(quat_conjugate(first)), np.swapaxes(matrix_from_quat(first), 1, 2), atol=1e-14
    )
    back = quat_from_matrix(matrix_from_quat(first))
    assert (back[:, 0] >= 0).all()
    np.testing.assert_allclose(np.abs(np.sum(back * first, axis=1)), 1.0, atol=1e-14)


@given(quats(), quats())
def test_geodesic_angle_is_symmetric_and_that_of_the_relative_rotation(a, b):
    angle = geodesic_angle(a, b)
    assert angle == pytest.approx(float(geodesic_angle(b, a)), abs=1e-12)
    relative = rotvec_from_quat(quat_multiply(quat_conjugate(a), b))
    assert angle == pytest.approx(np.linalg.norm(relative), abs=1e-12)
    assert geodesic_angle(a, -a) == pytest.approx(0.0, abs=1e-12)


@given(rotvecs(largest=6.0), arrays(np.float64, 3, elements=st.floats(-1, 1)))
def test_jacobians_of_the_exponential_against_finite_differences(w, d):
    step = 1e-6
    turned = matrix_from_rotvec(w + step * d) @ matrix_from_rotvec(w - step * d).T
    np.testing.assert_allclose(left_jacobian(w) @ d, rotvec_from_matrix(turned) / (2 * step), atol=3e-9)
    turned = matrix_from_rotvec(w - step * d).T @ matrix_from_rotvec(w + step * d)
    np.testing.assert_allclose(right_jacobian(w) @ d, rotvec_from_matrix(turned) / (2 * step), atol=3e-9)


@given(rotvecs(largest=2.8), arrays(np.float64, 3, elements=st.floats(-1, 1)))
def test_jacobians_of_the_logarithm_against_finite_differences(w, d):
    step, matrix = 1e-6, matrix_from_rotvec(w)
    left = [rotvec_from_matrix(matrix_from_rotvec(sign * step * d) @ matrix) for sign in (1, -1)]
    np.testing.assert_allclose(left_jacobian_inverse(w) @ d, (left[0] - left[1]) / (2 * step), atol=2e-8)
    right = [rotvec_from_matrix(matrix @ matrix_from_rotvec(sign * step * d)) for sign in (1, -1)]
    np.testing.assert_allclose(right_jacobian_inverse(w) @ d, (right[0] - right[1]) / (2 * step), atol=2e-8)


@given(rotvecs(largest=6.0))
def test_jacobians_and_their_inverses(w):
    np.testing.assert_allclose(left_jacobian(w) @ left_jacobian_inverse(w), np.eye(3), atol=1e-10)
    np.testing.assert_allclose(right_jacobian(w) @ right_jacobian_inverse(w), np.eye(3), atol=1e-10)
    np.testing.assert_allclose(matrix_from_rotvec(w) @ right_jacobian(w), left_jacobian(w), atol=1e-13)


@given(rotvecs(largest=6.2))
def test_kernels_agree_with_the_array_functions(w):
    matrix, jacobian, back = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    exp_matrix(*w, matrix)
    left_jacobian_matrix(*w, jacobian)
    log_rotation(matrix, back)
    np.testing.assert_allclose(matrix, matrix_from_rotvec(w), atol=1e-14)
    np.testing.assert_allclose(jacobian, left_jacobian(w), atol=1e-11)
    np.testing.assert_allclose(matrix_from_rotvec(back), matrix, atol=1e-13)


def test_slerp_agrees_with_scipy():
    a, b = many(4), many(5)
    for fraction in (0.0, 0.25, 0.7, 1.0):
        found = slerp(a, b, np.full(len(a), fraction))
        for i in range(0, len(a), 20):
            pair = Rotation.from_quat(np.stack([a[i], b[i]]), scalar_first=True)
            expected = Slerp([0, 1], pair)(fraction).as_quat(scalar_first=True)
            assert geodesic_angle(found[i], expected) < 1e-7


@given(quats(), quats(), st.floats(0, 1))
def test_slerp_turns_at_constant_speed_along_the_shorter_way(a, b, fraction):
    middle = slerp(a, b, np.array(fraction))
    whole = float(geodesic_angle(a, b))
    assert geodesic_angle(a, middle) == pytest.approx(fraction * whole, abs=1e-9)
    assert geodesic_angle(middle, b) == pytest.approx((1 - fraction) * whole, abs=1e-9)


def test_mean_agrees_with_scipy_and_ignores_signs():
    rng = np.random.default_rng(6)
    quat = quat_from_rotvec(rng.normal(scale=0.8, size=(30, 3)))
    weights = rng.uniform(0.1, 1.0, 30)
    expected = Rotation.from_quat(quat, scalar_first=True).mean(weights).as_quat(scalar_first=True)
    signs = rng.choice([-1.0, 1.0], size=(30, 1))
    assert geodesic_angle(mean_quat(quat * signs, weights), expected) < 1e-7


@given(quats(), rotvecs(largest=1.0))
def test_mean_lies_in_the_middle_of_two(a, w):
    b = quat_multiply(a, quat_from_rotvec(w))
    mean = mean_quat(np.stack([a, b]), np.ones(2))
    assert geodesic_angle(mean, slerp(a, b, np.array(0.5))) < 1e-7


@given(rotvecs(), rotvecs(largest=15.0))
def test_nearest_branch_turns_the_same_and_no_other_branch_is_nearer(w, reference):
    found = nearest_branch(w, reference)
    np.testing.assert_allclose(matrix_from_rotvec(found), matrix_from_rotvec(w), atol=1e-9)
    size = np.linalg.norm(w)
    if size > 1e-9:
        for turns in range(-4, 5):
            other = w + w / size * 2 * np.pi * turns
            assert np.linalg.norm(found - reference) <= np.linalg.norm(other - reference) + 1e-9


def test_unwrapping_follows_a_spin_over_several_turns():
    angles = np.linspace(0.3, 25.0, 400)
    axis = np.array([1.0, 2.0, -2.0]) / 3
    wrapped = rotvec_from_quat(quat_from_rotvec(angles[:, None] * axis))
    assert np.linalg.norm(np.diff(wrapped, axis=0), axis=1).max() > 5
    np.testing.assert_allclose(unwrap_rotvec(wrapped), angles[:, None] * axis, atol=1e-9)


@settings(max_examples=30)
@given(arrays(np.float64, (40, 2, 3), elements=st.floats(-0.2, 0.2)))
def test_unwrapping_is_continuous_and_turns_the_same(steps):
    walk = np.cumsum(steps, axis=0) + 3.0
    wrapped = rotvec_from_quat(quat_from_rotvec(walk))
    smooth = unwrap_rotvec(wrapped)
    np.testing.assert_allclose(matrix_from_rotvec(smooth), matrix_from_rotvec(walk), atol=1e-9)
    again = unwrap_rotvec(smooth)
    np.testing.assert_array_equal(again, smooth)


@pytest.mark.parametrize("axes", ORDERS)
def test_euler_angles_agree_with_scipy(axes):
    angles = np.random.default_rng(7).uniform(-1.5, 1.5, (100, 3))
    expected = Rotation.from_euler(axes, angles).as_matrix()
    np.testing.assert_allclose(matrix_from_euler(angles, axes), expected, atol=1e-14)
    np.testing.assert_allclose(euler_from_matrix(expected, axes), angles, atol=1e-10)


@given(quats(), st.sampled_from(ORDERS))
def test_euler_round_trip(quat, axes):
    matrix = matrix_from_quat(quat)
    np.testing.assert_allclose(matrix_from_euler(euler_from_matrix(matrix, axes), axes), matrix, atol=1e-8)


@pytest.mark.parametrize("axes", ORDERS)
@pytest.mark.parametrize("middle", [np.pi / 2, -np.pi / 2])
def test_euler_round_trip_at_the_gimbal_lock(axes, middle):
    matrix = matrix_from_euler(np.array([0.4, middle, -1.1]), axes)
    angles = euler_from_matrix(matrix, axes)
    assert angles[2] == 0.0
    np.testing.assert_allclose(matrix_from_euler(angles, axes), matrix, atol=1e-9)


def test_euler_takes_any_number_of_axes():
    np.testing.assert_allclose(
        matrix_from_euler(np.array([0.3]), "Y"), Rotation.from_euler("Y", 0.3).as_matrix(), atol=1e-15
    )
    np.testing.assert_allclose(matrix_from_euler(np.zeros((2, 0)), ""), np.tile(np.eye(3), (2, 1, 1)))


@given(st.floats(-3.1, 3.1), st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))
def test_heading_is_what_a_turn_about_up_adds(turn, pitch, roll):
    tilt = matrix_from_rotvec(np.array([pitch, 0.0, roll]))
    quat = quat_from_matrix(heading_matrix(np.array(turn)) @ tilt)
    assert float(heading_angle(quat)) == pytest.approx(turn, abs=1e-9)


@given(rotvecs(), rotvecs())
def test_aligning_is_the_smallest_turn(a, b):
    source, target = (
        quat_rotate(quat_from_rotvec(a), np.array([1.0, 0, 0])),
        quat_rotate(quat_from_rotvec(b), np.array([0, 2.0, 0])),
    )
    matrix = aligning_matrix(source, target)
    np.testing.assert_allclose(matrix @ source, target / 2, atol=1e-9)
    angle = np.arctan2(np.linalg.norm(np.cross(source, target)), source @ target)
    assert np.linalg.norm(rotvec_from_matrix(matrix)) == pytest.approx(angle, abs=1e-7)


def test_aligning_opposite_directions():
    for axis in np.eye(3):
        np.testing.assert_allclose(aligning_matrix(axis, -axis) @ axis, -axis, atol=1e-12)
