"""Metrics against scipy's rotations and against cases worked out by hand."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poseloom.errors import FormatError, PoseloomError
from poseloom.evaluation import metrics, profiles
from poseloom.evaluation.rows import Results, Row, motions_digest, read_results, write_results
from poseloom.skeleton.body import BODY_BONES, average_body, moving_dofs
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion

RATE = 40.0


def motion_of(q: np.ndarray, rate: float = RATE, size: float = 1.0) -> Motion:
    body = average_body()
    return make_motion(body.with_offsets(size * body.offsets), q, rate, "made up")


def random_motion(seed: int, frames: int = 12, size: float = 1.0) -> Motion:
    draw = np.random.default_rng(seed)
    return motion_of(draw.normal(0, 0.5, (frames, average_body().size)), size=size)


def still_motion(frames: int = 10) -> Motion:
    return motion_of(np.zeros((frames, average_body().size)))


def column(bone: str, axis: int) -> int:
    return 3 + 3 * BODY_BONES.index(bone) + axis


def turned(bone: str, axis: int, degrees: float, frames: int = 10) -> Motion:
    q = np.zeros((frames, average_body().size))
    q[:, column(bone, axis)] = np.radians(degrees)
    return motion_of(q)


seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_a_motion_against_itself_has_no_error(seed: int) -> None:
    motion = random_motion(seed)
    values = metrics.evaluate_motion(motion, motion)
    for name, value in values.items():
        if "jitter" not in name and "per_metre" not in name and "skate" not in name:
            assert value == pytest.approx(0.0, abs=1e-6), name
    assert values["jitter_deg_s3"] == values["truth_jitter_deg_s3"] > 0
    assert values["jitter_km_s3"] == values["truth_jitter_km_s3"] > 0


@settings(max_examples=20, deadline=None)
@given(seeds, seeds)
def test_rotation_errors_agree_with_scipy(first: int, second: int) -> None:
    truth, estimate = random_motion(first), random_motion(second, size=1.1)
    local = [Rotation.from_rotvec(np.array(m.rotvecs).reshape(-1, 3)) for m in (truth, estimate)]
    assert np.allclose(
        profiles.rotation_errors(truth, estimate).ravel(), np.degrees((local[0].inv() * local[1]).magnitude())
    )
    world = []
    for rotvecs in (truth.rotvecs, estimate.rotvecs):
        chain: list[Rotation] = []
        for joint, parent in enumerate(average_body().parents):
            own = Rotation.from_rotvec(np.array(rotvecs[:, joint]))
            chain.append(own if parent < 0 else chain[parent] * own)
        world.append(chain)
    apart = np.degrees([(a.inv() * b).magnitude() for a, b in zip(*world, strict=True)]).T
    assert np.allclose(profiles.global_rotation_errors(truth, estimate), apart)
    assert metrics.global_rotation_deg(truth, estimate) == pytest.approx(apart.mean())
    hips_and_shoulders = [
        BODY_BONES.index(f"{side}Upper{limb}") for side in ("left", "right") for limb in ("Leg", "Arm")
    ]
    assert metrics.sip_deg(truth, estimate) == pytest.approx(apart[:, hips_and_shoulders].mean())


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(-2, 2))
def test_whole_turns_of_a_rotation_vector_are_no_error(seed: int, turns: int) -> None:
    truth = random_motion(seed)
    rotvecs = truth.rotvecs
    angle = np.linalg.norm(rotvecs, axis=-1, keepdims=True)
    other = np.concatenate(
        [truth.root_positions, (rotvecs * (1 + 2 * np.pi * turns / angle)).reshape(len(truth), -1)], 1
    )
    assert metrics.joint_angle_deg(truth, motion_of(other)) == pytest.approx(0.0, abs=1e-9)
    assert metrics.joint_rotation_deg(truth, motion_of(other)) == pytest.approx(0.0, abs=1e-6)


def test_joint_angle_counts_moving_degrees_of_freedom_only() -> None:
    truth, moving = still_motion(), int(moving_dofs().sum())
    assert moving == 3 * 22 - 6 - 2 * 3
    assert metrics.joint_angle_deg(truth, turned("leftLowerLeg", 0, 30)) == pytest.approx(30 / moving)
    assert metrics.joint_angle_deg(truth, turned("leftLowerLeg", 1, 30)) == 0.0
    assert metrics.joint_angle_deg(truth, turned("rightToes", 0, 30)) == 0.0
    assert metrics.joint_angle_deg(truth, turned("hips", 1, 30)) == pytest.approx(30 / moving)


def test_one_turned_bone_by_hand() -> None:
    truth, estimate = still_motion(), turned("leftUpperArm", 2, 60)
    assert metrics.joint_rotation_deg(truth, estimate) == pytest.approx(60 / 22)
    assert metrics.global_rotation_deg(truth, estimate) == pytest.approx(3 * 60 / 22)  # upper arm, forearm and hand
    assert metrics.sip_deg(truth, estimate) == pytest.approx(60 / 4)
    # The elbow is 29 cm, the wrist 47.8 cm from the shoulder; a turn of 60 degrees moves each by its own distance.
    assert metrics.joint_position_cm(truth, estimate) == pytest.approx((29.0 + 47.8) / 20)
    assert metrics.joint_position_rms_cm(truth, estimate) == pytest.approx(np.sqrt((29.0**2 + 47.8**2) / 20))


def test_the_root_place_counts_in_the_root_metrics_only() -> None:
    truth = still_motion()
    moved = motion_of(truth.q + np.eye(average_body().size)[0] * 0.25)
    values = metrics.evaluate_motion(truth, moved)
    assert values["root_position_cm"] == pytest.approx(25.0)
    assert values["root_drift_m"] == pytest.approx(0.25)
    assert np.isnan(values["root_drift_per_metre"])
    assert values["joint_position_cm"] == pytest.approx(0.0, abs=1e-9)
    assert values["joint_angle_deg"] == 0.0


def test_drift_per_metre_of_a_straight_walk() -> None:
    q = np.zeros((81, average_body().size))
    q[:, 2] = np.linspace(0, 4, 81)
    truth = motion_of(q)
    q = q.copy()
    q[:, 2] *= 0.9
    assert metrics.root_drift_m(truth, motion_of(q)) == pytest.approx(0.4)
    assert metrics.root_drift_per_metre(truth, motion_of(q)) == pytest.approx(0.1)


@pytest.mark.parametrize("rate", [20.0, 120.0])
def test_jitter_is_the_third_derivative(rate: float) -> None:
    time = np.arange(30) / rate
    q = np.zeros((30, average_body().size))
    q[:, column("spine", 0)] = 0.4 * time**3
    moving = int(moving_dofs().sum())
    assert metrics.jitter_deg_s3(motion_of(q, rate)) == pytest.approx(np.degrees(6 * 0.4) / moving)
    q = np.zeros((30, average_body().size))
    q[:, 0] = 5.0 * time**3
    assert metrics.jitter_km_s3(motion_of(q, rate)) == pytest.approx(30.0 / 1000)
    assert np.isnan(metrics.jitter_deg_s3(motion_of(q[:3], rate)))


def test_jitter_ignores_a_change_of_branch() -> None:
    q = np.zeros((40, average_body().size))
    q[:, column("hips", 1)] = np.linspace(2.5, 3.8, 40)
    smooth = metrics.jitter_deg_s3(motion_of(q))
    q[:, column("hips", 1)] = np.where(q[:, column("hips", 1)] > np.pi, q[:, column("hips", 1)] - 2 * np.pi, q[:, 4])
    assert metrics.jitter_deg_s3(motion_of(q)) == pytest.approx(smooth, abs=1e-5)


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_positions_come_from_the_motions_own_bones(seed: int) -> None:
    truth, estimate = random_motion(seed), random_motion(seed, size=1.2)
    places = motion_frames(truth).positions
    distance = 100 * 0.2 * np.linalg.norm(places - places[:, :1], axis=-1)
    assert np.allclose(profiles.position_errors(truth, estimate), distance)


def test_feet_skate_only_while_the_truth_stands() -> None:
    """The truth stands, then swings its left leg far up; the estimate slides at 10 cm/s all the time."""
    q = np.zeros((120, average_body().size))
    q[:, 1] = 0.93
    q[60:, column("leftUpperLeg", 0)] = np.linspace(0, -1.2, 60)
    truth = motion_of(q)
    sliding = q.copy()
    sliding[:, 0] = 0.10 * np.arange(120) / RATE
    assert metrics.foot_skate_cm_s(truth, motion_of(sliding)) == pytest.approx(10.0, abs=0.5)
    assert metrics.foot_skate_cm_s(truth, truth) < 0.5
    flying = q.copy()
    flying[:, 1] += np.linspace(0, 200, 120)
    assert np.isnan(metrics.foot_skate_cm_s(motion_of(flying), truth))


def test_latency_keeps_its_parts_apart() -> None:
    seconds = np.append(np.arange(1, 101) / 1000, np.nan)
    late = metrics.latency(seconds, delay=3, rate=40.0)
    assert late.look_ahead_ms == pytest.approx(75.0)
    assert late.step_ms_p50 == pytest.approx(50.5)
    assert late.step_ms_p95 == pytest.approx(np.percentile(np.arange(1, 101), 95))
    assert late.step_ms_p99 == pytest.approx(np.percentile(np.arange(1, 101), 99))


def test_motions_that_cannot_be_compared_are_refused() -> None:
    with pytest.raises(PoseloomError, match="truth has 10 frames, estimate 9"):
        metrics.evaluate_motion(still_motion(10), still_motion(9))
    with pytest.raises(PoseloomError, match="frames a second"):
        metrics.evaluate_motion(still_motion(), motion_of(still_motion().q, 30.0))


def test_rows_come_back_as_they_were_written(tmp_path) -> None:
    row = Row("evaluate", "ik", "six-trackers", "by-sequence", "joint_angle_deg", 2.5, 0.5, 3, 900, 7)
    results = Results("evaluate", motions_digest([still_motion()]), (row, Row("speed", "fk", "", "none", "us", 3.6)))
    path = tmp_path / "rows.json"
    write_results(results, path)
    again = read_results(path)
    assert again.rows == results.rows
    assert again.version
    content = json.loads(path.read_text())
    assert set(content) == {"benchmark", "version", "data_digest", "rows"}
    assert list(content["rows"][0]) == [
        *("table", "method", "setting", "split", "metric", "value", "spread", "sequences", "frames", "seed")
    ]


def test_rows_that_are_no_numbers_are_refused_and_leave_the_old_file(tmp_path) -> None:
    path = tmp_path / "rows.json"
    path.write_text("old")
    row = Row("evaluate", "ik", "", "none", "joint_angle_deg", float("nan"))
    with pytest.raises(FormatError, match="joint_angle_deg"):
        write_results(Results("evaluate", "", (row,)), path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["rows.json"]
    with pytest.raises(FormatError, match=r"rows\.json"):
        read_results(path)


def test_the_digest_sees_every_number() -> None:
    still = still_motion()
    other = still.q.copy()
    other[3, 3] = 1e-12
    assert motions_digest([still]) == motions_digest([still_motion()])
    assert motions_digest([still]) != motions_digest([motion_of(other)])
    assert motions_digest([still]) != motions_digest([motion_of(still.q, 41.0)])
