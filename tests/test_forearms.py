"""Sharing of an arm's twist between upper arm and forearm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poseloom.formats import read_motion
from poseloom.rotations import geodesic_angle, quat_from_matrix
from poseloom.skeleton import BODY_BONES, average_body, forward_kinematics, make_motion, motion_frames, retarget
from poseloom.skeleton.forearms import BENT, FREEDOM, NEUTRAL, STRAIGHT, share_arm_twist

ARMS = {side: (BODY_BONES.index(f"{side}UpperArm"), BODY_BONES.index(f"{side}LowerArm")) for side in ("left", "right")}


def posed(upper: Rotation, lower: Rotation, side: str = "left") -> np.ndarray:
    """A series of pose vectors of the body in which one arm moves; the other is bent, its roll in the middle."""
    frames = len(upper.as_rotvec())
    q = np.zeros((frames, average_body().size))
    for _, lower_arm in ARMS.values():
        q[:, 3 + 3 * lower_arm : 6 + 3 * lower_arm] = forearm(np.ones(frames), np.full(frames, NEUTRAL)).as_rotvec()
    for bone, turn in zip(ARMS[side], (upper, lower), strict=True):
        q[:, 3 + 3 * bone : 6 + 3 * bone] = turn.as_rotvec()
    return q


def forearm(bend: np.ndarray, roll: np.ndarray) -> Rotation:
    """A forearm that bends forward (about -Y on the left) and rolls about itself."""
    return Rotation.from_rotvec(np.outer(bend, [0, -1, 0])) * Rotation.from_rotvec(np.outer(roll, [1, 0, 0]))


def bend_and_roll(q: np.ndarray, side: str = "left") -> tuple[np.ndarray, np.ndarray]:
    """Independent of the kernel: the angle between the bones, and the turn about X that is left without the swing."""
    at = 3 + 3 * ARMS[side][1]
    turn = Rotation.from_rotvec(np.array(q[:, at : at + 3]))
    ways = turn.apply([1.0, 0.0, 0.0])
    bend = np.arccos(np.clip(ways[:, 0], -1, 1))
    axis = np.cross([1.0, 0.0, 0.0], ways)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    swing = Rotation.from_rotvec(np.divide(axis, length, out=np.zeros_like(axis), where=length > 0) * bend[:, None])
    matrix = (swing.inv() * turn).as_matrix()
    return bend, np.arctan2(matrix[:, 2, 1], matrix[:, 1, 1])


def allowed(bend: np.ndarray) -> np.ndarray:
    """How far a roll may be from its middle."""
    return np.interp(bend, [0.0, STRAIGHT, BENT], [0.0, FREEDOM * STRAIGHT, np.pi])


angles = st.floats(-3.1, 3.1)


@settings(deadline=None)
@given(st.lists(st.tuples(angles, angles, angles, st.floats(0.01, 2.5), angles), min_size=1, max_size=8))
def test_no_joint_moves_and_only_upper_arms_turn(rows):
    values = np.array(rows)
    q = posed(Rotation.from_rotvec(0.5 * values[:, :3]), forearm(values[:, 3], values[:, 4]))
    shared = share_arm_twist(q)
    before, after = (motion_frames(make_motion(average_body(), each, 60.0)) for each in (q, shared))
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-9)
    turned = geodesic_angle(quat_from_matrix(before.rotations), quat_from_matrix(after.rotations))
    turned[:, ARMS["left"][0]] = 0.0
    assert turned.max() < 1e-6
    bend, roll = bend_and_roll(shared)
    off = np.abs((roll - NEUTRAL + np.pi) % (2 * np.pi) - np.pi)
    assert (off <= allowed(bend) + 1e-6).all()
    np.testing.assert_allclose(bend, bend_and_roll(q)[0], atol=1e-6)
    np.testing.assert_allclose(share_arm_twist(shared), shared, atol=1e-7)


def test_what_lies_within_the_bounds_stays_bit_for_bit():
    bend = np.linspace(0.3, 2.0, 30)
    q = posed(Rotation.from_rotvec(np.full((30, 3), 0.2)), forearm(bend, NEUTRAL + 0.9 * allowed(bend)))
    np.testing.assert_array_equal(share_arm_twist(q), q)


def test_a_roll_that_passes_half_a_turn_goes_on_the_same_way():
    roll = NEUTRAL + np.radians(np.linspace(120.0, 230.0, 111))
    q = posed(Rotation.identity(111), forearm(np.full(111, np.radians(10.0)), roll))
    shared = share_arm_twist(q)
    changes = np.abs(np.diff(shared, axis=0))
    assert np.degrees(changes.max()) < 1.5
    assert np.degrees(bend_and_roll(shared)[1]) == pytest.approx(np.full(111, 50.0), abs=1e-6)


def test_both_sides_are_treated_as_mirror_images():
    bend, roll = np.full(5, 0.1), np.linspace(1.0, 3.0, 5)
    left = share_arm_twist(posed(Rotation.identity(5), forearm(bend, roll)))
    mirrored = forearm(bend, roll).as_rotvec() * [1, -1, -1]
    right = share_arm_twist(posed(Rotation.identity(5), Rotation.from_rotvec(mirrored), "right"))
    for one, other in zip(ARMS["left"], ARMS["right"], strict=True):
        ours, theirs = left[:, 3 + 3 * one : 6 + 3 * one], right[:, 3 + 3 * other : 6 + 3 * other]
        np.testing.assert_allclose(ours, theirs * [1, -1, -1], atol=1e-12)


@pytest.mark.parametrize("take", ["HDM_bd_depositFloorR_001_120.amc", "HDM_mm_sneak2StepsLStart_011_120.amc"])
def test_recorded_forearms_do_what_forearms_can(recordings, take):
    found = list((recordings / "mocap" / "hdm05").rglob(take))
    if not found:
        pytest.skip(f"no recording {take}")
    body = retarget(read_motion(found[0]), average_body())
    for side in ARMS:
        bend, roll = bend_and_roll(body.q, side)
        assert (np.abs((roll - NEUTRAL + np.pi) % (2 * np.pi) - np.pi) <= allowed(bend) + 1e-6).all()
    assert np.isfinite(forward_kinematics(body.skeleton, body.q[0]).positions).all()
