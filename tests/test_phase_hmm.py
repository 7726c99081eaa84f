"""The phase HMM as a method: contract, gaps, mounting, ground, files and commands."""

import gc
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from poseloom.benchmark.one_imu.endurance import state_bytes
from poseloom.cli._app import run
from poseloom.errors import FormatError, MethodError
from poseloom.formats.recording import write_recording
from poseloom.library import build_library
from poseloom.methods import HealthState, make_method, reconstruct
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.model_file import read_phase_hmm, write_phase_hmm
from poseloom.methods.imus.mounting import aligned, misaligned, observe_mounting, unknown_mounting
from poseloom.methods.imus.pairs import WELL_MOUNTED, SignalPair, pair_of_recording
from poseloom.methods.imus.phase_hmm import PhaseHmm, fit_phase_hmm
from poseloom.methods.imus.settings import PAPER_SETTINGS, PhaseHmmSettings
from poseloom.rotations import geodesic_angle, matrix_from_rotvec, quat_from_matrix
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, imu_layout, layout, make_recording
from poseloom.skeleton import Motion, average_body, contacts, mirror_motion, motion_frames, retarget, sole_positions
from poseloom.synthesis import Fault, ImuNoise, simulate_imus

FOOT = layout("right-foot-imu")
TWO = imu_layout("left-shank", "right-hand")


@cache
def motion(name: str) -> Motion:
    return retarget(sample_motions()[name], average_body())


@cache
def pairs(sensors: str) -> tuple[SignalPair, ...]:
    kinds = (("walk", Behaviour.WALKING), ("run", Behaviour.RUNNING), ("jump", Behaviour.JUMPING))
    return tuple(
        pair_of_recording(simulate_imus(moved, layout(sensors), WELL_MOUNTED, seed=1), behaviour, take=name)
        for name, behaviour in kinds
        for moved in (motion(name), mirror_motion(motion(name)))
    )


@cache
def fitted(sensors: str, paper: bool = False) -> PhaseHmm:
    return fit_phase_hmm(pairs(sensors), layout(sensors), PAPER_SETTINGS if paper else None)


def worn(name: str = "walk", sensors: str = FOOT.name, **more: object) -> Recording:
    return simulate_imus(motion(name), layout(sensors), seed=5, **more)


def position_error(recording: Recording, estimate: Motion) -> np.ndarray:
    """Distances of joints from the hips in the hips' own frame, metres, frame by frame."""
    places = []
    for each in (recording.truth, estimate):
        frames = motion_frames(each)
        away = frames.positions - frames.positions[:, :1]
        places.append(np.einsum("fji,fbj->fbi", frames.rotations[:, 0], away))
    return np.linalg.norm(places[0] - places[1], axis=-1).mean(axis=1)


def test_a_known_motion_comes_back() -> None:
    for name in ("walk", "run"):
        heard = worn(name).cut(0, 130)
        result = reconstruct(fitted(FOOT.name), heard)
        assert position_error(heard, result.motion)[30:].mean() < 0.03
        assert (result.spread > 0).all()
        assert np.isfinite(result.motion.q).all()


def test_the_phases_are_told() -> None:
    method, heard = fitted(FOOT.name), worn("run")
    state = method.start(heard.skeleton, heard.placements)
    assert method.phase_probabilities(state) == {}
    for index in range(60):
        state, _ = method.step(state, heard.sample(index))
    told = method.phase_probabilities(state)
    assert sum(told.values()) == pytest.approx(1)
    assert max(told, key=told.__getitem__).startswith("running")


def test_a_silence_is_coasted_through_and_left_without_a_jump() -> None:
    heard = worn(faults=[Fault("rightFoot", 1.0, 2.0)]).cut(0, 170)
    result = reconstruct(fitted(FOOT.name), heard)
    states = [health.state for health in result.health]
    assert states[70] is HealthState.COASTING
    assert states[140] is HealthState.OK
    frames = motion_frames(result.motion)
    away = frames.positions - frames.positions[:, :1]
    steps = np.linalg.norm(np.diff(away, axis=0), axis=-1)
    assert steps[55:].max() < 0.1
    settings = replace(fitted(FOOT.name).settings, lost_after=0.5)
    impatient = PhaseHmm(FOOT, fitted(FOOT.name).model, settings)
    assert reconstruct(impatient, heard.cut(0, 100)).health[99].state is HealthState.LOST


def test_one_silent_sensor_of_two_is_said_to_be_missing() -> None:
    heard = worn(sensors=TWO.name, faults=[Fault("rightHand", 0.8, 1.4)]).cut(0, 84)
    result = reconstruct(fitted(TWO.name), heard)
    assert result.health[60].state is HealthState.DEGRADED
    assert result.health[60].sensors == ("rightHand",)
    assert position_error(heard, result.motion)[48:].mean() < 0.06


def test_nothing_is_said_before_the_sensors_have_spoken() -> None:
    heard = worn(faults=[Fault("rightFoot", 0.0, 0.2)]).cut(0, 30)
    result = reconstruct(fitted(FOOT.name), heard)
    assert result.samples[0] == int(np.flatnonzero(np.isfinite(heard.specific_forces[:, 0, 0]))[0])


def test_no_truth_and_no_place_in_the_room_enters() -> None:
    heard = worn().cut(0, 40)
    blind = make_recording(
        heard.layout,
        heard.placements,
        heard.skeleton,
        heard.times,
        specific_forces=heard.specific_forces,
        angular_rates=heard.angular_rates,
    )
    method = fitted(FOOT.name)
    np.testing.assert_array_equal(reconstruct(method, heard).motion.q, reconstruct(method, blind).motion.q)


def test_the_mounting_error_is_found() -> None:
    draw = np.random.default_rng(2)
    turn = np.array([0.1, -0.12, 0.08])
    known = unknown_mounting(1, np.deg2rad(10))
    for _ in range(400):
        felt = draw.normal(size=6) * [3, 3, 3, 2, 2, 2] + [0, 9.8, 0, 0, 0, 0]
        said = (felt.reshape(2, 3) @ matrix_from_rotvec(turn)).reshape(-1)
        known = observe_mounting(
            known, said + 0.1 * draw.normal(size=6), felt, np.array([True]), np.array([[3.0, 1.5]]), 1.0
        )
    away = geodesic_angle(quat_from_matrix(known.turns[0]), quat_from_matrix(matrix_from_rotvec(turn)))
    assert float(away) < 0.02
    np.testing.assert_allclose(aligned(known, misaligned(known, np.arange(6.0))), np.arange(6.0), atol=1e-12)


def test_mounting_is_learnt_while_walking() -> None:
    noise = replace(ImuNoise(), placement_rad=np.deg2rad(10.0), placement_m=0.0)
    heard = simulate_imus(motion("walk"), FOOT, noise, seed=8).cut(0, 150)
    method = fitted(FOOT.name)
    without = PhaseHmm(FOOT, method.model, replace(method.settings, mounting=0.0))
    errors = [position_error(heard, reconstruct(each, heard).motion)[75:].mean() for each in (method, without)]
    assert errors[0] < errors[1]


def test_feet_that_stand_hardly_slide_and_the_way_is_about_right() -> None:
    heard = worn().cut(0, 150)
    made = reconstruct(fitted(FOOT.name), heard).motion
    stands = contacts(heard.truth)
    standing = np.stack([stands.left_heel, stands.left_toe, stands.right_heel, stands.right_toe], axis=1)
    both = standing[1:] & standing[:-1]
    speeds = [
        np.linalg.norm(np.diff(sole_positions(each)[..., [0, 2]], axis=0), axis=-1)[both].mean() * 60
        for each in (made, heard.truth)
    ]
    assert speeds[0] < 2 * speeds[1] + 0.05
    ways = [np.linalg.norm(each.q[-1, [0, 2]] - each.q[0, [0, 2]]) for each in (made, heard.truth)]
    assert ways[0] == pytest.approx(ways[1], rel=0.1)


def test_a_long_session_neither_grows_the_state_nor_the_memory() -> None:
    method, heard = fitted(FOOT.name), worn()
    samples = [heard.sample(index) for index in range(len(heard))]
    state = method.start(heard.skeleton, heard.placements)
    sizes, held = [], []
    for index in range(1200):
        state, frame = method.step(state, samples[index % len(heard)])
        if index % 400 == 399:
            gc.collect()
            sizes.append(state_bytes(state))
            held.append(sys.getallocatedblocks())
    # The number of segments that are averaged varies a little; a sample or a frame a step would be 400 arrays.
    assert sizes[2] == pytest.approx(sizes[0], rel=0.1)
    assert held[2] - held[1] < 200
    assert frame is not None
    assert np.isfinite(frame.pose.q).all()


def test_a_model_file_gives_the_same_frames(tmp_path: Path) -> None:
    method, heard = fitted(FOOT.name), worn().cut(0, 25)
    write_phase_hmm(method, tmp_path / "model.npz")
    again = read_phase_hmm(tmp_path / "model.npz")
    np.testing.assert_array_equal(reconstruct(method, heard).motion.q, reconstruct(again, heard).motion.q)
    assert again.settings == method.settings
    assert again.data_digest == method.data_digest
    assert len(method.data_digest) == 64
    write_phase_hmm(again, tmp_path / "copy.npz")
    assert (tmp_path / "copy.npz").read_bytes() == (tmp_path / "model.npz").read_bytes()


def test_the_same_seed_fits_the_same_model() -> None:
    first, second = (fit_phase_hmm(pairs(FOOT.name)[:2], FOOT, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.model.emissions[-1].features, second.model.emissions[-1].features)
    np.testing.assert_array_equal(first.model.gains, second.model.gains)


def test_fit_and_reconstruct_from_the_command_line(tmp_path: Path) -> None:
    build_library(["samples"], tmp_path / "library", 60.0, workers=1)
    model, recording, made = tmp_path / "model.npz", tmp_path / "walk.mcap", tmp_path / "walk.npz"
    arguments = ["--library", str(tmp_path / "library"), "--layout", FOOT.name, "--behaviour", "walking"]
    assert run(["fit", "phase-hmm", *arguments, "-o", str(model)]) == 0
    write_recording(worn().cut(0, 30), recording)
    assert run(["reconstruct", str(recording), "--method", "phase-hmm", "--model", str(model), "-o", str(made)]) == 0
    assert made.exists()
    assert run(["reconstruct", str(recording), "--method", "phase-hmm", "-o", str(made)]) == 2
    assert run(["fit", "phase-hmm", *arguments[:-1], "swimming", "-o", str(model)]) == 2


def test_wrong_requests_are_explained(tmp_path: Path) -> None:
    with pytest.raises(MethodError, match="no pairs"):
        fit_phase_hmm((), FOOT)
    with pytest.raises(MethodError, match="channels"):
        fit_phase_hmm(pairs(FOOT.name), TWO)
    with pytest.raises(MethodError, match="layout"):
        reconstruct(fitted(FOOT.name), worn(sensors=TWO.name))
    with pytest.raises(MethodError, match="fitted to"):
        PhaseHmm(TWO, fitted(FOOT.name).model, PhaseHmmSettings())
    with pytest.raises(FormatError):
        read_phase_hmm(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no model")
    with pytest.raises(FormatError):
        make_method("phase-hmm", FOOT, model=tmp_path / "text.npz")
