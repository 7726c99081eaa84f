"""Registration of segments: ground, heading and time."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.errors import MethodError
from poseloom.methods.imus.registration import grounded, medoid, register, time_warp
from poseloom.rotations import (
    heading_angle,
    heading_matrix,
    matrix_from_rotvec,
    quat_from_matrix,
    quat_from_rotvec,
    rotvec_from_quat,
)
from poseloom.samples import sample_motions
from poseloom.skeleton import average_body, forward_kinematics, retarget


def cheapest_by_enumeration(first: np.ndarray, second: np.ndarray) -> float:
    """The least cost over every monotonous path, one by one."""
    n, m = len(first), len(second)
    apart = ((first[:, None] - second[None]) ** 2).sum(axis=2)
    best = np.inf
    for length in range(max(n, m), n + m):
        for moves in itertools.product(((1, 0), (0, 1), (1, 1)), repeat=length - 1):
            places = np.cumsum([(0, 0), *moves], axis=0)
            if (places[-1] == (n - 1, m - 1)).all():
                best = min(best, float(apart[places[:, 0], places[:, 1]].sum()))
    return best


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 1000))
def test_the_warp_is_the_cheapest_of_all_paths(n: int, m: int, seed: int) -> None:
    draw = np.random.default_rng(seed)
    first, second = draw.normal(size=(n, 2)), draw.normal(size=(m, 2))
    warp = time_warp(first, second)
    assert warp.cost * len(warp.path) == pytest.approx(cheapest_by_enumeration(first, second))
    assert (warp.path[0] == 0).all()
    assert (warp.path[-1] == (n - 1, m - 1)).all()
    steps = np.diff(warp.path, axis=0)
    assert ((steps >= 0) & (steps <= 1)).all()
    assert (steps.sum(axis=1) >= 1).all()


def test_a_slowed_series_is_led_back_to_its_times() -> None:
    times = np.linspace(0, 1, 21)
    curve = np.stack([np.sin(5 * times), times], axis=1)
    slowed = np.repeat(curve, 2, axis=0)
    warp = time_warp(slowed, curve)
    assert warp.cost == pytest.approx(0)
    np.testing.assert_array_equal(warp.of_segment(42), np.repeat(np.arange(21), 2))
    np.testing.assert_allclose(slowed[warp.of_reference(21)], curve)


def test_signal_and_motion_stay_together_under_the_warp() -> None:
    draw = np.random.default_rng(1)
    motion, other = draw.normal(size=(12, 3)), draw.normal(size=(9, 3))
    index = time_warp(motion, other).of_reference(9)
    signal = motion @ draw.normal(size=(3, 6))
    mixing = np.linalg.lstsq(motion, signal, rcond=None)[0]
    np.testing.assert_allclose(motion[index] @ mixing, signal[index], atol=1e-9)


def test_the_medoid_is_nearest_to_all() -> None:
    base = np.linspace(0, 1, 10)[:, None]
    segments = [base + shift for shift in (0.0, 0.1, 0.2, 0.3, 0.5)]
    assert medoid(segments) == 2
    warps = register(segments, 2)
    assert warps[2].cost == pytest.approx(0)
    assert np.argmax([warp.cost for warp in warps]) == 4
    many = [base + 0.01 * k for k in range(100)]
    assert medoid(many, seed=3) == medoid(many, seed=3)
    with pytest.raises(MethodError, match="no segment"):
        medoid([])


def test_grounded_segments_start_at_the_origin_and_keep_their_shape() -> None:
    walk = retarget(sample_motions()["walk"], average_body()).q[10:30]
    turn = heading_matrix(np.array(1.2))
    moved = walk.copy()
    moved[:, :3] = walk[:, :3] @ turn.T + [3.0, 0.0, -2.0]
    moved[:, 3:6] = rotvec_from_quat(quat_from_matrix(turn @ matrix_from_rotvec(walk[:, 3:6])))
    out = grounded(moved)
    np.testing.assert_allclose(out, grounded(walk), atol=1e-9)
    np.testing.assert_allclose(out[0, [0, 2]], 0, atol=1e-12)
    assert heading_angle(quat_from_rotvec(out[0, 3:6])) == pytest.approx(0, abs=1e-9)
    for frame in (0, 19):
        before = forward_kinematics(average_body(), moved[frame]).positions
        after = forward_kinematics(average_body(), out[frame]).positions
        np.testing.assert_allclose(
            np.linalg.norm(before - before[:1], axis=1), np.linalg.norm(after - after[:1], axis=1), atol=1e-9
        )


def test_series_that_do_not_fit_are_refused() -> None:
    with pytest.raises(MethodError, match="warped"):
        time_warp(np.zeros((0, 2)), np.zeros((3, 2)))
