"""Virtual trackers: exact without noise, noisy as asked, the same for the same seed, faulty only where told."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.errors import SensorError
from poseloom.rotations import geodesic_angle, quat_conjugate, quat_from_matrix, quat_multiply, rotvec_from_quat
from poseloom.sensors import Recording, SensorStatus, default_placements, layout, make_layout, place_sensors
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.synthesis import NO_NOISE, Fault, FaultKind, TrackerNoise, simulate_trackers, true_placements

SIX = layout("six-trackers")


def smooth_motion(seconds: float = 5.0, rate: float = 120.0, seed: int = 0) -> Motion:
    """Each pose-vector entry swings at its own slow frequency."""
    rng = np.random.default_rng(seed)
    body = average_body()
    times = np.arange(round(seconds * rate) + 1) / rate
    swing = np.sin(times[:, None] * rng.uniform(0.5, 6.0, body.size) + rng.uniform(0, 6, body.size))
    return make_motion(body, 0.4 * swing, rate, "swing")


@pytest.fixture(scope="module")
def motion() -> Motion:
    return smooth_motion()


@pytest.fixture(scope="module")
def long_still() -> Motion:
    body = average_body()
    return make_motion(body, np.tile(np.linspace(-0.3, 0.3, body.size), (8001, 1)), 40.0, "still")


def errors(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Position errors in metres and orientation errors as rotation vectors about the sensors' own axes."""
    assert recording.truth is not None
    exact = simulate_trackers(recording.truth, recording.layout, NO_NOISE, placements=recording.placements)
    turns = rotvec_from_quat(quat_multiply(quat_conjugate(exact.quats_wxyz), recording.quats_wxyz))
    return recording.positions - exact.positions, turns


def test_without_noise_samples_are_forward_kinematics(motion: Motion):
    recording = simulate_trackers(motion, SIX, NO_NOISE)
    body = motion.skeleton
    placements = default_placements(SIX, body)
    assert len(recording) == 201
    assert recording.truth is not None
    assert recording.truth.rate == 40.0
    np.testing.assert_array_equal(recording.truth.q, motion.q[::3])
    np.testing.assert_allclose(recording.times, np.arange(201) / 40.0, atol=1e-15)
    np.testing.assert_array_equal(recording.arrivals, recording.times)
    for frame in (0, 77, 200):
        bones = forward_kinematics(body, motion.q[3 * frame])
        for index, placement in enumerate(placements):
            bone = body.index(placement.bone)
            place = bones.positions[bone] + bones.rotations[bone] @ placement.p_bone_sensor
            np.testing.assert_allclose(recording.positions[frame, index], place, atol=1e-12)
            quat = quat_from_matrix(bones.rotations[bone] @ placement.R_bone_sensor)
            assert geodesic_angle(recording.quats_wxyz[[frame], index], quat[None]).max() < 1e-12
    assert (recording.status == SensorStatus.OK).all()


def test_white_noise_has_the_asked_size_and_no_memory(long_still: Motion):
    shifts, turns = errors(simulate_trackers(long_still, SIX, seed=1))
    assert shifts.std() == pytest.approx(0.003, rel=0.02)
    assert turns.std() == pytest.approx(math.radians(0.5), rel=0.02)
    for each in (shifts, turns):
        assert np.abs(each.mean(axis=0)).max() < 5 * each.std() / math.sqrt(len(each))
        flat = each.reshape(len(each), -1)
        assert np.abs(np.corrcoef(flat.T) - np.eye(18)).max() < 0.06
        assert np.abs([np.corrcoef(column[1:], column[:-1])[0, 1] for column in flat.T]).max() < 0.06


def test_bias_is_constant_and_differs_between_sensors(long_still: Motion):
    many = make_layout("many", [replace(SIX.sensors[0], name=f"s{i}") for i in range(80)], 40.0)
    recording = simulate_trackers(long_still.cut(0, 4), many, replace(NO_NOISE, bias_m=0.02, bias_rad=0.1), seed=2)
    shifts, turns = errors(recording)
    np.testing.assert_allclose(shifts, shifts[:1].repeat(4, axis=0), atol=1e-12)
    np.testing.assert_allclose(turns, turns[:1].repeat(4, axis=0), atol=1e-12)
    assert shifts[0].std() == pytest.approx(0.02, rel=0.15)
    assert turns[0].std() == pytest.approx(0.1, rel=0.15)


def test_drift_is_stationary_and_slow(long_still: Motion):
    noise = replace(NO_NOISE, drift_m=0.01, drift_rad=0.05, drift_seconds=2.0)
    ranges = [errors(simulate_trackers(long_still, SIX, noise, seed=seed)) for seed in range(3)]
    shifts = np.concatenate([each[0].reshape(8001, -1) for each in ranges], axis=1)
    turns = np.concatenate([each[1].reshape(8001, -1) for each in ranges], axis=1)
    assert shifts.std() == pytest.approx(0.01, rel=0.08)
    assert turns.std() == pytest.approx(0.05, rel=0.08)
    assert shifts[0].std() == pytest.approx(0.01, rel=0.35)
    after = 80  # samples in two seconds
    correlation = np.mean(shifts[after:] * shifts[:-after]) / np.mean(shifts**2)
    assert correlation == pytest.approx(math.exp(-1), abs=0.08)
    assert np.abs(np.diff(shifts, axis=0)).max() < 0.01


def test_outliers_come_at_their_rate_and_size(long_still: Motion):
    noise = replace(NO_NOISE, outlier_probability=0.05, outlier_m=0.4, outlier_rad=0.7)
    shifts, turns = errors(simulate_trackers(long_still, SIX, noise))
    far = np.linalg.norm(shifts, axis=-1) > 1e-6
    assert far.mean(axis=0) == pytest.approx(0.05, abs=0.012)
    np.testing.assert_allclose(np.linalg.norm(shifts[far], axis=-1), 0.4, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(turns[far], axis=-1), 0.7, rtol=1e-9)
    assert np.abs(turns[~far]).max() < 1e-9
    assert np.abs(shifts[far].mean(axis=0)).max() < 0.03


def test_drop_outs_are_missing_and_marked(long_still: Motion):
    recording = simulate_trackers(long_still, SIX, TrackerNoise(drop_out_probability=0.1))
    gone = recording.status == SensorStatus.MISSING
    assert gone.mean(axis=0) == pytest.approx(0.1, abs=0.015)
    np.testing.assert_array_equal(np.isnan(recording.positions).all(axis=-1), gone)
    np.testing.assert_array_equal(np.isnan(recording.quats_wxyz).all(axis=-1), gone)
    assert (recording.status[~gone] == SensorStatus.OK).all()
    assert np.abs(np.corrcoef(gone.T.astype(float)) - np.eye(6)).max() < 0.05


def test_bursts_last_as_long_as_asked(long_still: Motion):
    noise = replace(NO_NOISE, burst_rate_hz=0.1, burst_seconds=0.5)
    recording = simulate_trackers(long_still, SIX, noise)
    gone = recording.status == SensorStatus.MISSING
    begins = (np.diff(gone.astype(int), axis=0) == 1).sum()
    assert begins == pytest.approx(0.1 * 200 * 6, rel=0.3)
    assert gone.sum() / begins == pytest.approx(0.5 * 40, rel=0.35)


def test_samples_arrive_late_and_in_order(motion: Motion):
    late = simulate_trackers(motion, SIX, TrackerNoise(latency_s=0.02, jitter_s=0.03))
    delays = late.arrivals - late.times
    assert delays.min() >= 0.02
    assert 0.03 < delays.mean() < 0.07
    assert (np.diff(late.arrivals) >= 0).all()
    steady = simulate_trackers(motion, SIX, TrackerNoise(latency_s=0.02))
    np.testing.assert_allclose(steady.arrivals - steady.times, 0.02, atol=1e-12)
    np.testing.assert_array_equal(steady.positions, late.positions)


def test_a_lag_shows_an_older_pose(motion: Motion):
    now = simulate_trackers(motion, SIX, NO_NOISE)
    old = simulate_trackers(motion, SIX, replace(NO_NOISE, lag_s=2 / 40))
    np.testing.assert_allclose(old.positions[2:], now.positions[:-2], atol=1e-9)
    np.testing.assert_allclose(old.positions[:2], now.positions[[0, 0]], atol=1e-9)
    assert geodesic_angle(old.quats_wxyz[2:], now.quats_wxyz[:-2]).max() < 1e-9
    assert now.truth is not None
    assert old.truth is not None
    np.testing.assert_array_equal(old.truth.q, now.truth.q)


def test_a_placement_error_is_told_in_the_settings_only(motion: Motion):
    noise = replace(NO_NOISE, placement_m=0.02, placement_rad=0.2)
    recording = simulate_trackers(motion, SIX, noise, seed=4)
    body = motion.skeleton
    for said, sane in zip(recording.placements, default_placements(SIX, body), strict=True):
        np.testing.assert_array_equal(said.p_bone_sensor, sane.p_bone_sensor)
    worn = true_placements(recording)
    offsets = [w.p_bone_sensor - s.p_bone_sensor for w, s in zip(worn, recording.placements, strict=True)]
    assert 0.005 < np.std(offsets) < 0.06
    bones = forward_kinematics(body, motion.q[30])
    np.testing.assert_allclose(place_sensors(bones, body, worn).positions, recording.positions[10], atol=1e-12)
    assert true_placements(simulate_trackers(motion, SIX, NO_NOISE)) is not None


def test_the_same_seed_gives_the_same_and_another_gives_another(motion: Motion):
    noise = TrackerNoise(bias_m=0.01, drift_m=0.01, outlier_probability=0.1, drop_out_probability=0.1, placement_m=0.01)
    first, again = (simulate_trackers(motion, SIX, noise, seed=5) for _ in range(2))
    assert first.positions.tobytes() == again.positions.tobytes()
    assert first.quats_wxyz.tobytes() == again.quats_wxyz.tobytes()
    assert first.arrivals.tobytes() == again.arrivals.tobytes()
    other = simulate_trackers(motion, SIX, noise, seed=6)
    assert np.nanmin(np.abs(other.positions - first.positions)) > 0
    drawn = [simulate_trackers(motion, SIX, noise, seed=np.random.default_rng(7)) for _ in range(2)]
    assert drawn[0].positions.tobytes() == drawn[1].positions.tobytes()


def test_adding_a_sensor_or_a_kind_of_noise_leaves_the_rest_alone(motion: Motion):
    three = layout("three-trackers")
    all_six, some = simulate_trackers(motion, SIX, seed=8), simulate_trackers(motion, three, seed=8)
    for index, name in enumerate(three.names):
        np.testing.assert_array_equal(all_six.positions[:, SIX.index(name)], some.positions[:, index])
    gaps = simulate_trackers(motion, SIX, TrackerNoise(drop_out_probability=0.2, outlier_probability=0.1), seed=8)
    sound = np.linalg.norm(gaps.positions - all_six.positions, axis=-1) < 0.1
    assert sound.mean() > 0.6
    np.testing.assert_array_equal(gaps.positions[sound], all_six.positions[sound])
    short = simulate_trackers(motion.cut(0, 301), SIX, seed=8)
    np.testing.assert_array_equal(short.positions, all_six.positions[: len(short)])


@given(
    kind=st.sampled_from(["silent", "stuck", "outliers", "noise", "drift"]).map(FaultKind),
    sensor=st.sampled_from(SIX.names),
    start=st.floats(-1.0, 5.0),
    length=st.floats(0.2, 6.0),
)
@settings(max_examples=25, deadline=None)
def test_a_fault_touches_its_sensor_in_its_interval_only(kind: FaultKind, sensor: str, start: float, length: float):
    motion = _MOTION
    clean = simulate_trackers(motion, SIX, seed=9)
    faulty = simulate_trackers(motion, SIX, seed=9, faults=[Fault(sensor, start, start + length, kind)])
    same = (clean.positions == faulty.positions).all(axis=-1) & (clean.quats_wxyz == faulty.quats_wxyz).all(axis=-1)
    allowed = np.zeros_like(same)
    allowed[:, SIX.index(sensor)] = (clean.times >= start) & (clean.times < start + length)
    assert same[~allowed].all()
    # A drift begins at nothing, and a sensor that is stuck from the first sample on repeats that one.
    assert np.count_nonzero(same[allowed]) <= 1
    gone = faulty.status == SensorStatus.MISSING
    np.testing.assert_array_equal(gone, allowed if kind is FaultKind.SILENT else np.zeros_like(gone))


_MOTION = smooth_motion(seconds=4.0, rate=40.0, seed=1)


def test_each_fault_does_what_it_says():
    clean = simulate_trackers(_MOTION, SIX, NO_NOISE)
    head = SIX.index("head")
    hit = (clean.times >= 1.0) & (clean.times < 2.0)

    def spoilt(kind: FaultKind, **sizes: float | str) -> Recording:
        return simulate_trackers(_MOTION, SIX, NO_NOISE, [Fault("head", 1.0, 2.0, kind, **sizes)])  # type: ignore[arg-type]

    stuck = spoilt(FaultKind.STUCK)
    assert (stuck.positions[hit, head] == clean.positions[np.flatnonzero(hit)[0] - 1, head]).all()
    half = spoilt(FaultKind.OUTLIERS, size_m=0.5, share=0.5)
    off = np.linalg.norm(half.positions[hit, head] - clean.positions[hit, head], axis=-1)
    assert set(np.round(off, 9)) == {0.0, 0.5}
    noisy = spoilt(FaultKind.NOISE, size_m=0.1)
    assert (noisy.positions - clean.positions)[hit, head].std() == pytest.approx(0.1, rel=0.3)
    drift = np.linalg.norm(
        spoilt(FaultKind.DRIFT, size_m=0.4).positions[hit, head] - clean.positions[hit, head], axis=-1
    )
    np.testing.assert_allclose(drift, 0.4 * np.arange(40) / 40, atol=1e-9)
    swapped = spoilt(FaultKind.SWAP, other="leftHand")
    hand = SIX.index("leftHand")
    np.testing.assert_array_equal(swapped.positions[hit, head], clean.positions[hit, hand])
    np.testing.assert_array_equal(swapped.quats_wxyz[hit, hand], clean.quats_wxyz[hit, head])
    np.testing.assert_array_equal(swapped.positions[~hit], clean.positions[~hit])


def test_a_fault_leaves_other_faults_alone():
    one = Fault("head", 0.5, 1.5, FaultKind.OUTLIERS)
    two = Fault("leftHand", 1.0, 2.0, FaultKind.NOISE)
    alone = simulate_trackers(_MOTION, SIX, seed=3, faults=[one])
    both = simulate_trackers(_MOTION, SIX, seed=3, faults=[two, one])
    head = SIX.index("head")
    np.testing.assert_array_equal(alone.positions[:, head], both.positions[:, head])
    assert "leftHand" in both.settings["faults"]


@pytest.mark.parametrize("name", [each.name for each in fields(TrackerNoise)])
def test_impossible_noise_is_refused(name: str):
    for value in (-0.1, float("nan"), float("inf")):
        with pytest.raises(SensorError, match=name):
            simulate_trackers(_MOTION, SIX, TrackerNoise(**{name: value}))


def test_impossible_requests_are_refused():
    with pytest.raises(SensorError, match=r"outlier_probability is 1\.5"):
        simulate_trackers(_MOTION, SIX, TrackerNoise(outlier_probability=1.5))
    with pytest.raises(SensorError, match="no trackers: hips"):
        simulate_trackers(_MOTION, layout("hips-imu"))
    with pytest.raises(SensorError, match="unknown sensor 'foot'"):
        simulate_trackers(_MOTION, SIX, faults=[Fault("foot", 0.0, 1.0)])
    with pytest.raises(SensorError, match="unknown sensor ''"):
        simulate_trackers(_MOTION, SIX, faults=[Fault("head", 0.0, 1.0, FaultKind.SWAP)])
    with pytest.raises(SensorError, match="stop after its start"):
        simulate_trackers(_MOTION, SIX, faults=[Fault("head", 1.0, 1.0)])
    with pytest.raises(SensorError, match="share 2"):
        simulate_trackers(_MOTION, SIX, faults=[Fault("head", 0.0, 1.0, share=2.0)])
    with pytest.raises(SensorError, match="seed is -1"):
        simulate_trackers(_MOTION, SIX, seed=-1)
    apart = make_motion(_MOTION.skeleton, _MOTION.q, 40.0, displacements=np.zeros((len(_MOTION), 22, 3)))
    with pytest.raises(SensorError, match="joints apart"):
        simulate_trackers(apart, SIX)


def test_one_frame_is_enough():
    recording = simulate_trackers(_MOTION.cut(0, 1), SIX, TrackerNoise(drift_m=0.1, lag_s=0.1, burst_rate_hz=1.0))
    assert len(recording) == 1
