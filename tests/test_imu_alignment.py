"""Sensor-to-bone alignment: known mountings of virtual sensors are found, a real walk's agree with the optical ones."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.calibration.imu_alignment import align_imus, turn_to_bones
from poseloom.calibration.imu_episodes import find_standing, find_walking
from poseloom.calibration.imu_headings import HEADINGS, LevelWalk
from poseloom.errors import SensorError
from poseloom.formats.recording import read_recording
from poseloom.rotations import heading_angle, matrix_from_quat, matrix_from_rotvec, quat_from_matrix, quat_from_rotvec
from poseloom.samples import sample_motions
from poseloom.samples.looping import loop
from poseloom.sensors import Placement, Recording, default_placements, imu_layout, make_placement
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors
from poseloom.synthesis import ImuNoise, simulate_imus

LEGS_AND_HIPS = ("left-foot", "right-foot", "left-shank", "right-shank", "left-thigh", "right-thigh", "hips")
MOUNTED = replace(ImuNoise(), placement_rad=0.0, placement_m=0.0)


def stand_and_walk(stand_s: float = 2.5, blend_s: float = 0.6) -> Motion:
    """Someone who stands upright, walks eight metres, and stands again."""
    walk = sample_motions()["walk"]
    walk = loop(walk.cut(0, len(walk) - 1), 2) if walk.duration < 8 else walk
    rate = walk.rate

    def standing(q: np.ndarray) -> np.ndarray:
        still = np.zeros_like(q)
        still[:3] = q[:3]
        heading = float(heading_angle(quat_from_rotvec(q[3:6])))
        still[3:6] = [0.0, heading, 0.0]
        return still

    parts = []
    for q, goes in ((walk.q[0], True), (walk.q[-1], False)):
        still = np.tile(standing(q), (round(stand_s * rate), 1))
        count = round(blend_s * rate)
        way = np.linspace(0, 1, count + 2)[1:-1]
        eased = way**2 * (3 - 2 * way)
        ends = (np.tile(still[0], (count, 1)), np.tile(q, (count, 1)))
        bridge = interpolate_pose_vectors(*(ends if goes else ends[::-1]), eased)
        parts.append(np.concatenate([still, bridge] if goes else [bridge, still]))
    return make_motion(walk.skeleton, np.concatenate([parts[0], walk.q, parts[1]]), rate, "stand, walk, stand")


@pytest.fixture(scope="module")
def walk() -> Motion:
    return stand_and_walk()


def anyhow(layout_words: tuple[str, ...], motion: Motion, seed: int) -> list[Placement]:
    """Sensors at their places, turned in any way."""
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(len(layout_words), 4))
    layout = imu_layout(*layout_words)
    return [
        make_placement(usual.bone, usual.p_bone_sensor, matrix_from_quat(quat / np.linalg.norm(quat)))
        for usual, quat in zip(default_placements(layout, motion.skeleton), quats, strict=True)
    ]


def errors_deg(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Tilt and heading of the error, degrees: how far up is off, and how far it is turned about up."""
    turn = found @ true.T
    tilt = math.degrees(math.acos(np.clip(turn[1, 1], -1, 1)))
    return tilt, math.degrees(math.atan2(turn[0, 2] - turn[2, 0], turn[0, 0] + turn[2, 2]))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("word", LEGS_AND_HIPS)
def test_known_mountings_are_found(walk: Motion, word: str, seed: int):
    worn = anyhow((word,), walk, seed)
    recording = simulate_imus(walk, imu_layout(word), MOUNTED, seed=seed, placements=worn)
    (found,) = align_imus(recording)
    tilt, heading = errors_deg(found.R_bone_sensor, worn[0].R_bone_sensor)
    assert tilt < 2.0
    assert abs(heading) < 12.0
    assert found.forward_trust > 0.3
    assert found.axis_trust > 0.3
    np.testing.assert_allclose(found.R_bone_sensor @ found.R_bone_sensor.T, np.eye(3), atol=1e-12)


def test_signals_are_turned_to_the_bones(walk: Motion):
    words = ("right-foot", "hips")
    worn = anyhow(words, walk, 5)
    still = replace(MOUNTED, rate_bias_rad_s=0.03)
    recording = simulate_imus(walk, imu_layout(*words), still, seed=1, placements=worn)
    turned = turn_to_bones(recording, align_imus(recording))
    usual = simulate_imus(walk, imu_layout(*words), replace(still, rate_bias_rad_s=0.0), seed=1)
    for index in range(2):
        difference = turned.specific_forces[:, index] - usual.specific_forces[:, index]
        assert np.sqrt(np.mean(difference**2)) < 0.25 * np.sqrt(np.mean(usual.specific_forces[:, index] ** 2))
        slow = np.abs(turned.angular_rates[:60, index]).mean()
        assert slow < 0.01
    assert [p.bone for p in turned.placements] == ["rightFoot", "hips"]
    np.testing.assert_array_equal(turned.placements[0].R_bone_sensor, np.eye(3))
    assert turned.settings["aligned"].startswith("rightFoot (forward")
    with pytest.raises(SensorError, match="the alignment is of hips"):
        turn_to_bones(recording, align_imus(simulate_imus(walk, imu_layout("hips"), MOUNTED)))


def test_orientations_are_turned_too(walk: Motion):
    worn = anyhow(("right-shank",), walk, 2)
    recording = simulate_imus(walk, imu_layout("right-shank"), MOUNTED, placements=worn)
    quats = np.tile(quat_from_matrix(worn[0].R_bone_sensor), (len(recording), 1, 1))  # the bone at rest
    recording = replace(recording, quats_wxyz=quats)
    found = align_imus(recording)
    at_rest = matrix_from_quat(turn_to_bones(recording, found).quats_wxyz[0, 0])
    np.testing.assert_allclose(at_rest, worn[0].R_bone_sensor @ found[0].R_bone_sensor.T, atol=1e-9)


def test_episodes_are_found_where_they_are(walk: Motion):
    recording = simulate_imus(walk, imu_layout("right-foot"), MOUNTED)
    start, stop = find_walking(recording)
    assert start == pytest.approx(2.5, abs=1.2)
    assert stop == pytest.approx(recording.duration - 2.5, abs=1.2)
    first, last = find_standing(recording, (start, stop))
    assert last - first == pytest.approx(1.0)
    assert last < 2.7 or first > recording.duration - 2.7


def test_lost_samples_do_not_matter(walk: Motion):
    recording = simulate_imus(walk, imu_layout("left-shank"), replace(MOUNTED, drop_out_probability=0.05), seed=3)
    tilt, heading = errors_deg(align_imus(recording)[0].R_bone_sensor, np.eye(3))
    assert tilt < 2.0
    assert abs(heading) < 12.0


@pytest.mark.parametrize("kind", HEADINGS)
def test_turning_the_axes_turns_the_heading(walk: Motion, kind: str):
    """Whatever the first guess of the heading, the same direction is found."""
    word = {"Foot": "right-foot", "LowerLeg": "right-shank", "UpperLeg": "right-thigh"}.get(kind, kind)
    recording = simulate_imus(walk, imu_layout(word), MOUNTED).cut(150, 500)
    forces, turns = recording.specific_forces[:, 0], recording.angular_rates[:, 0]
    for angle in (0.7, 2.5, -1.9):
        turn = matrix_from_rotvec(np.array([0.0, angle, 0.0]))
        straight = HEADINGS[kind](LevelWalk(60.0, forces, turns))
        turned = HEADINGS[kind](LevelWalk(60.0, forces @ turn.T, turns @ turn.T))
        off = (turned.angle - straight.angle - angle + math.pi) % (2 * math.pi) - math.pi
        assert abs(off) < 0.02


def with_channel(recording: Recording, **columns: np.ndarray) -> Recording:
    return replace(recording, **columns)


def test_what_cannot_be_aligned_is_refused(walk: Motion):
    with pytest.raises(SensorError, match="a sensor on an arm is turned: rightHand"):
        align_imus(simulate_imus(walk, imu_layout("right-hand"), MOUNTED))
    still = make_motion(walk.skeleton, np.tile(walk.q[0], (300, 1)), 60.0)
    with pytest.raises(SensorError, match="nobody walks"):
        align_imus(simulate_imus(still, imu_layout("hips"), MOUNTED))
    recording = simulate_imus(walk, imu_layout("right-shank"), MOUNTED)
    with pytest.raises(SensorError, match="nobody stands still"):
        align_imus(recording.cut(240, 480))
    with pytest.raises(SensorError, match="tells no specific forces"):
        align_imus(with_channel(recording, specific_forces=np.full_like(recording.specific_forces, np.nan)))
    with pytest.raises(SensorError, match="is missing while its wearer stands"):
        align_imus(recording, standing=(1000.0, 1001.0), walking=(3.0, 8.0))


@pytest.mark.recordings
def test_import_imu_writes_what_reconstruct_reads(recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from poseloom.cli._app import run

    folder = str(recordings / "imu" / "neura_walk" / "imu")
    assert run(["import-imu", folder]) == 0
    assert "00B40C48  2503     25.02    100.0" in capsys.readouterr().out
    one = f"{folder}/S02-Trial-Walk-1-000_00B40C48.txt"
    out = tmp_path / "walk.mcap"
    assert run(["import-imu", one, "--sensors", "right-foot=00B40C48", "-o", str(out), "--start", "10"]) == 0
    assert "rightFoot: forwards told with trust 0.9" in capsys.readouterr().out
    recording = read_recording(out)
    assert recording.layout.name == "right-foot-imu"
    assert len(recording) == 902
    assert recording.specific_forces[0, 0] == pytest.approx([0, 9.9, 0], abs=0.7)
    for arguments, message in (
        (["--sensors", "right-foot"], "PLACE=NAME"),
        (["--sensors", "right-foot=00B40C4"], "Did you mean '00B40C48'"),
        (["--sensors", "right-foot=00B40C48", "--align", "walking"], "Did you mean 'walk'"),
        (["--sensors", "right-foot=00B40C48", "--walking", "5"], "FROM:TO"),
        (["--sensors", "right-hand=00B40C48"], "on an arm"),
        (["--sensors", "right-foot=00B40C48", "--start", "40"], "lasts 25.02 s"),
    ):
        assert run(["import-imu", one, "-o", str(tmp_path / "no.mcap"), *arguments]) == 2
        assert message in capsys.readouterr().err.replace("\n", " ")
        assert not (tmp_path / "no.mcap").exists()
