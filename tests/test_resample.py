"""Motions at other rates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.errors import PoseloomError
from poseloom.rotations import geodesic_angle, matrix_from_rotvec, quat_from_rotvec, slerp
from poseloom.skeleton import average_body, make_motion, make_skeleton, resample

BODY = average_body()


def wandering(frames: int, rate: float, seed: int = 0):
    rng = np.random.default_rng(seed)
    return make_motion(BODY, np.cumsum(rng.normal(scale=0.05, size=(frames, BODY.size)), axis=0), rate, "clip")


@pytest.mark.parametrize(
    ("old", "new"), [(120.0, 40.0), (120.0, 60.0), (60.0, 20.0), (1 / 0.0083333, 40.0), (119.9999, 40.0)]
)
def test_lower_rates_take_the_frames_that_coincide(old, new):
    motion = wandering(3001, old)
    lower = resample(motion, new)
    every = round(old / new)
    np.testing.assert_array_equal(lower.q, motion.q[::every])
    assert (lower.rate, lower.name) == (new, "clip")


@pytest.mark.parametrize(("old", "new"), [(30.0, 60.0), (30.0, 120.0), (24.0, 60.0), (25.0, 40.0), (60.0, 24.0)])
def test_coinciding_instants_keep_their_values(old, new):
    motion = wandering(121, old)
    other = resample(motion, new)
    times = np.arange(len(other)) / new
    frames = times * old
    same = np.abs(frames - np.rint(frames)) < 1e-9
    assert same.sum() >= 10
    np.testing.assert_array_equal(other.q[same], motion.q[np.rint(frames[same]).astype(int)])
    assert abs(other.duration - motion.duration) < 1 / new
    assert other.duration <= motion.duration + 1e-9


def test_frames_between_are_on_the_straight_line_and_the_shorter_way():
    motion = wandering(20, 30.0)
    other = resample(motion, 75.0)
    for i, row in enumerate(other.q):
        at = i * 30 / 75
        before, part = int(at + 1e-9), at - int(at + 1e-9)
        after = min(before + 1, 19)
        np.testing.assert_allclose(row[:3], (1 - part) * motion.q[before, :3] + part * motion.q[after, :3], atol=1e-12)
        ends = [quat_from_rotvec(motion.rotvecs[frame]) for frame in (before, after)]
        expected = slerp(ends[0], ends[1], np.full(22, part))
        assert geodesic_angle(quat_from_rotvec(row[3:].reshape(-1, 3)), expected).max() < 1e-9


def test_a_steady_turn_over_many_rounds_stays_steady():
    skeleton = make_skeleton(["a"], [-1], np.zeros((1, 3)))
    angles = np.linspace(0, 40, 200)
    q = np.zeros((200, 6))
    q[:, 3:] = angles[:, None] * np.array([0.6, 0.0, 0.8])
    other = resample(make_motion(skeleton, q, 50.0), 80.0)
    expected = np.arange(len(other)) / 80 * 50 * (angles[1] - angles[0])
    np.testing.assert_allclose(other.q[:, 3:], expected[:, None] * np.array([0.6, 0.0, 0.8]), atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 60), st.floats(5, 200), st.floats(5, 200))
def test_any_rates_give_a_motion_within_its_duration(frames, old, new):
    motion = wandering(frames, old)
    other = resample(motion, new)
    assert other.rate == new
    assert len(other) >= 1
    assert other.duration <= motion.duration + 2e-3 / old + 1e-4 * motion.duration
    np.testing.assert_array_equal(other.q[0], motion.q[0])
    np.testing.assert_allclose(np.linalg.det(matrix_from_rotvec(other.rotvecs)), 1.0)


def test_displacements_go_along():
    skeleton = make_skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [1, 0, 0]])
    moved = np.zeros((3, 2, 3))
    moved[:, 1, 0] = [0.0, 1.0, 4.0]
    other = resample(make_motion(skeleton, np.zeros((3, 9)), 10.0, displacements=moved), 20.0)
    assert other.displacements is not None
    np.testing.assert_allclose(other.displacements[:, 1, 0], [0, 0.5, 1, 2.5, 4])


def test_the_same_rate_is_the_same_motion():
    motion = wandering(5, 30.0)
    assert resample(motion, 30.0) is motion


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_rates_are_refused(rate):
    with pytest.raises(PoseloomError, match="positive, finite rate"):
        resample(wandering(5, 30.0), rate)
