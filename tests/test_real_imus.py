"""The measures of real inertial sensors: hand-eye calibration, cadence, bands, legs, and the real walk itself."""

import math
from pathlib import Path

import numpy as np
import pytest

from poseloom.benchmark.one_imu.alignment_check import alignment_error, hand_eye, stand_before, walks_on
from poseloom.benchmark.one_imu.bands import BANDS_HZ, band_powers
from poseloom.benchmark.one_imu.cadence import compare_cadences, stride_seconds
from poseloom.benchmark.one_imu.optical import read_optical_walk
from poseloom.benchmark.one_imu.real_page import real_imus_figures
from poseloom.benchmark.one_imu.real_walk import (
    estimated_legs,
    leg_angles_deg,
    leg_rows,
    neura_recording,
    optical_legs,
    optical_motion,
    real_walk,
    way_rows,
)
from poseloom.cli._app import run
from poseloom.evaluation.rows import Results, Row
from poseloom.rotations import heading_matrix, matrix_from_rotvec, rotvec_from_matrix
from poseloom.samples import sample_motions
from poseloom.sensors import imu_layout
from poseloom.skeleton.motion import make_motion
from poseloom.skeleton.resample import resample
from poseloom.synthesis import NO_IMU_NOISE, simulate_imus


def test_hand_eye_finds_mounting_and_world():
    rng = np.random.default_rng(0)
    mounting = matrix_from_rotvec(np.array([0.4, -1.2, 2.0]))
    world = matrix_from_rotvec(np.array([0.0, 2.5, 0.0]))
    bones = matrix_from_rotvec(0.8 * rng.normal(size=(300, 3)))
    noise = matrix_from_rotvec(0.02 * rng.normal(size=(300, 3)))
    found, left = hand_eye(bones, world.T @ bones @ mounting @ noise)
    assert np.degrees(np.linalg.norm(rotvec_from_matrix(found @ mounting.T))) < 0.5
    assert left == pytest.approx(math.degrees(0.02 * math.sqrt(8 / math.pi)), rel=0.15)


def test_alignment_errors_are_split_into_tilt_and_heading():
    true = matrix_from_rotvec(np.array([0.3, 0.5, -0.9]))
    tilt, heading = alignment_error(matrix_from_rotvec(np.array([0.0, 0.4, 0.0])) @ true, true)
    assert (tilt, heading) == pytest.approx((0.0, math.degrees(0.4)), abs=1e-5)
    tilt, heading = alignment_error(matrix_from_rotvec(np.array([0.2, 0.0, 0.0])) @ true, true)
    assert (tilt, heading) == pytest.approx((math.degrees(0.2), 0.0), abs=1e-6)


def test_strides_are_found_in_noise_and_not_doubled():
    rate, stride = 60.0, 1.1
    times = np.arange(300) / rate
    wave = np.stack([np.sin(2 * np.pi * times / stride), np.cos(4 * np.pi * times / stride)], axis=1)
    found, clear = stride_seconds(wave + 0.1 * np.random.default_rng(0).normal(size=wave.shape), rate)
    assert found == pytest.approx(stride, abs=0.02)
    assert clear > 0.9
    assert stride_seconds(np.random.default_rng(1).normal(size=(300, 3)), rate)[1] < 0.5
    assert math.isnan(stride_seconds(np.linspace(0, 1, 300)[:, None], rate)[0])


def test_a_walk_has_the_cadence_of_its_signal():
    walk = resample(sample_motions()["walk"], 60.0)
    recording = simulate_imus(walk, imu_layout("right-foot"), NO_IMU_NOISE)
    found = compare_cadences(recording, walk)
    assert len(found.times) >= 1
    assert found.agreeing == 1.0
    assert 80 < np.median(found.signal) < 140
    slower = make_motion(walk.skeleton, np.repeat(walk.q, 2, axis=0)[: len(walk)], 60.0)
    assert compare_cadences(recording, slower).agreeing == 0.0
    still = make_motion(walk.skeleton, np.tile(walk.q[0], (len(walk), 1)), 60.0)
    assert compare_cadences(simulate_imus(still, imu_layout("hips"), NO_IMU_NOISE), still).times.size == 0


def test_power_lies_in_the_band_of_its_frequency():
    times = np.arange(2000) / 100
    for index, (low, high) in enumerate(BANDS_HZ):
        wave = 3.0 * np.sin(math.pi * (low + high) * times)[:, None] * np.array([1.0, 0.0, 0.0])
        powers = band_powers(wave, 100.0)
        assert int(np.argmax(powers)) == index
        assert powers.sum() == pytest.approx(4.5, rel=0.1)


def test_only_walks_straight_on_count_as_walks():
    walk = sample_motions()["walk"]
    assert walks_on(walk)
    assert not walks_on(walk.cut(0, 60))
    backwards = make_motion(walk.skeleton, walk.q[::-1].copy(), walk.rate)
    assert not walks_on(backwards)
    standing = stand_before(walk)
    assert len(standing) == len(walk) + round(2 * walk.rate) + round(0.5 * walk.rate)
    np.testing.assert_array_equal(standing.q[-len(walk) :], walk.q)


def test_legs_are_seen_from_the_hips_alone():
    walk = sample_motions()["walk"].cut(0, 120)
    turn = heading_matrix(np.array(1.3))
    moved = np.array(walk.q)
    moved[:, :3] = moved[:, :3] @ turn.T + np.array([3.0, 0.2, -1.0])
    moved[:, 3:6] = rotvec_from_matrix(turn @ matrix_from_rotvec(moved[:, 3:6]))
    legs, others = estimated_legs(walk), estimated_legs(make_motion(walk.skeleton, moved, walk.rate))
    np.testing.assert_allclose(others.joints, legs.joints, atol=1e-9)
    rows = {row.metric: row.value for row in leg_rows(legs, others, "m", "s")}
    assert rows["leg_position_cm"] == pytest.approx(0.0, abs=1e-6)
    assert rows["left_knee_correlation"] == pytest.approx(1.0)
    knees = leg_angles_deg(legs)["knee"]
    assert 0 <= knees.min() < 25
    assert 35 < knees.max() < 90


def test_a_way_too_short_is_told_whatever_its_heading():
    walk = sample_motions()["walk"]
    turn, short = heading_matrix(np.array(0.8)), np.array(walk.q)
    short[:, :3] = (short[:, :3] * [0.9, 1.0, 0.9]) @ turn.T
    rows = {row.metric: row.value for row in way_rows(walk, make_motion(walk.skeleton, short, walk.rate), "m", "s")}
    assert rows["way_length_error_percent"] == pytest.approx(10.0, abs=0.01)
    assert rows["turned_path_error_percent"] == pytest.approx(
        10.0, abs=3.0
    )  # of a way that is longer than its ends are apart


@pytest.mark.recordings
def test_the_cameras_motion_has_the_cameras_legs(recordings: Path):
    optical = read_optical_walk(recordings / "imu" / "neura_walk")
    assert len(optical) == 955
    for turns in optical.bones.values():
        np.testing.assert_allclose(turns @ turns.swapaxes(1, 2), np.tile(np.eye(3), (955, 1, 1)), atol=1e-5)
        assert turns[:, 1, 1].mean() > 0.75  # upright
    moments = np.arange(0.0, 955.0, 5.0)
    seen, drawn = optical_legs(optical, moments), estimated_legs(optical_motion(optical, moments))
    # Left and right bones of the wearer are alike, and segments bend a little: some millimetres.
    assert np.linalg.norm(seen.joints - drawn.joints, axis=-1).mean() < 0.02


@pytest.mark.recordings
def test_the_real_walk_is_measured_for_any_method(recordings: Path):
    recording = neura_recording(recordings)
    assert recording.layout.name == "right-foot-imu"
    assert recording.truth is None
    assert np.linalg.norm(recording.specific_forces[600, 0] - [0, 9.9, 0]) < 1.0
    rows, made = real_walk(recordings, {})
    assert not made
    figures = {(row.method, row.metric): row.value for row in rows}
    assert 12 < figures["standing still", "leg_position_cm"] < 18
    assert figures["mean of the truth itself", "leg_position_cm"] < figures["standing still", "leg_position_cm"]


def test_the_page_shows_what_is_there():
    rows = (
        Row("bands", "real, S02", "hips", "none", "rms_0.5_3_hz", 2.0, sequences=1),
        Row("alignment-simulated", "standing and walking", "hips", "none", "tilt_deg", 1.5, 0.5, sequences=3, seed=0),
        Row("alignment-real", "standing and walking", "hips", "none", "heading_deg", 3.25, sequences=1),
        Row("cadence", "phase-hmm", "gaitmap", "none", "signal_steps_min", 111.0, sequences=1),
    )
    page = real_imus_figures(Results("real-imus", "0123456789abcdef0", rows), "abc")
    assert "commit `abc`" in page
    assert "| hips | 1.50 ± 0.50 |" in page
    assert "| hips |  | 3.2 |  |" in page
    assert "| gaitmap |  | 111 |" in page


def test_the_command_says_what_it_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["benchmark", "real-imus", "--data", str(tmp_path)]) == 2
    assert "holds no imu/" in capsys.readouterr().err
    (tmp_path / "imu").mkdir()
    assert run(["benchmark", "real-imus", "--data", str(tmp_path), "--method", "phase-hm"]) == 2
    assert "Did you mean 'phase-hmm'" in capsys.readouterr().err
