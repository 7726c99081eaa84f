"""The comparators of the phase HMM: the contract over each, their searches and models against brute force, files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.errors import MethodError
from poseloom.evaluation.metrics import joint_position_cm
from poseloom.formats.artefact import write_artefact
from poseloom.methods import METHODS, HealthState, make_method, reconstruct
from poseloom.methods.imus.baselines.driving import mean_guess, save_comparator
from poseloom.methods.imus.baselines.examples import examples_of, leg_length, posed_rotvecs, posture_of
from poseloom.methods.imus.baselines.fitting import COMPARATORS, fit_comparator
from poseloom.methods.imus.baselines.motion_graph import MotionGraph
from poseloom.methods.imus.baselines.motion_primitives import MotionPrimitives, PrimitiveSettings
from poseloom.methods.imus.baselines.phase_regression import k_means
from poseloom.methods.imus.baselines.segments import segments_of
from poseloom.methods.imus.baselines.windows import index_windows
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.pairs import WELL_MOUNTED, SignalPair, pair_of_recording
from poseloom.rotations import heading_angle, quat_from_rotvec, rotvec_from_matrix
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, layout
from poseloom.skeleton.contacts import contacts
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_imus

FOOT = layout("right-foot+right-hand-imu")
SMALL = {"phase-regression": {"phases": 3}, "motion-primitives": {"coefficients": 4, "beam": 16}}


def motion(name: str) -> Motion:
    return resample(sample_motions()[name], FOOT.rate)


def pair(name: str, behaviour: Behaviour, seed: int) -> SignalPair:
    return pair_of_recording(
        simulate_imus(motion(name), FOOT, WELL_MOUNTED, seed=seed), behaviour, name, f"{name}{seed}"
    )


@pytest.fixture(scope="module")
def pairs() -> tuple[SignalPair, ...]:
    return (
        pair("walk", Behaviour.WALKING, 1),
        pair("walk", Behaviour.WALKING, 2),
        pair("run", Behaviour.RUNNING, 3),
        pair("jump", Behaviour.JUMPING, 4),
    )


@pytest.fixture(scope="module")
def methods(pairs: tuple[SignalPair, ...]) -> dict:
    return {name: fit_comparator(name, pairs, FOOT, SMALL.get(name)) for name in COMPARATORS}


@pytest.fixture(scope="module")
def recording() -> Recording:
    whole = simulate_imus(motion("walk"), FOOT, seed=9)
    return whole.cut(0, min(len(whole), 50))


@pytest.mark.parametrize("name", COMPARATORS)
def test_gaps_are_survived_and_told(name: str, methods: dict, recording: Recording) -> None:
    forces, rates = recording.specific_forces.copy(), recording.angular_rates.copy()
    forces[:2], rates[:2] = np.nan, np.nan
    forces[10:15], rates[10:15] = np.nan, np.nan
    forces[30:35, 1], rates[30:35, 1] = np.nan, np.nan
    result = reconstruct(methods[name], replace(recording, specific_forces=forces, angular_rates=rates))
    assert result.samples[0] == 2
    assert np.isfinite(result.motion.q).all()
    assert np.isfinite(result.spread).all()
    assert (result.spread >= 0).all()
    assert {result.health[i - 2].state for i in range(10, 15)} == {HealthState.COASTING}
    assert {result.health[i - 2].state for i in range(30, 35)} == {HealthState.DEGRADED}
    assert result.health[32 - 2].sensors == ("rightHand",)
    assert result.health[40].state is HealthState.OK


def test_long_silence_means_lost(methods: dict, recording: Recording) -> None:
    method = methods["nearest-window"]
    state, _ = method.step(method.start(recording.skeleton, recording.placements), recording.sample(0))
    sample = recording.sample(1)
    silent = replace(
        sample, specific_forces=np.full_like(sample.specific_forces, np.nan),
        angular_rates=np.full_like(sample.angular_rates, np.nan),
    )  # fmt: skip
    for _ in range(62):
        state, frame = method.step(state, silent)
    assert frame.health.state is HealthState.LOST


@pytest.mark.parametrize("name", COMPARATORS)
def test_a_known_walk_comes_back(name: str, methods: dict, recording: Recording) -> None:
    error = joint_position_cm(recording.truth, reconstruct(methods[name], recording).motion)
    still = np.tile(recording.truth.q[:1], (len(recording), 1))
    worst = joint_position_cm(recording.truth, replace(recording.truth, q=still))
    assert error < 0.75 * worst


@pytest.mark.parametrize("name", COMPARATORS)
def test_a_file_gives_the_same_method(name: str, methods: dict, recording: Recording, tmp_path: Path) -> None:
    file = tmp_path / "model.npz"
    save_comparator(methods[name], file)
    read = make_method(name, FOOT, model=file)
    assert name in METHODS
    assert read.settings == methods[name].settings
    short = recording.cut(0, 20)
    np.testing.assert_array_equal(reconstruct(read, short).motion.q, reconstruct(methods[name], short).motion.q)


def test_wrong_requests_are_explained(pairs: tuple[SignalPair, ...], tmp_path: Path) -> None:
    with pytest.raises(MethodError, match="no training pairs"):
        fit_comparator("nearest-window", (), FOOT)
    with pytest.raises(MethodError, match="12 channels"):
        fit_comparator("nearest-window", pairs, layout("right-foot-imu"))
    with pytest.raises(MethodError, match="samples"):
        fit_comparator("nearest-window", pairs, FOOT, {"sample": 3})
    with pytest.raises(MethodError, match="nearest-window"):
        fit_comparator("nearest", pairs, FOOT)


def test_a_file_of_another_layout_of_columns_is_refused(tmp_path: Path) -> None:
    write_artefact(tmp_path / "x.npz", "motion-graph", 1, {}, {})
    with pytest.raises(Exception, match="motion-graph"):
        make_method("nearest-window", FOOT, model=tmp_path / "x.npz")


def test_examples_hold_the_motion(pairs: tuple[SignalPair, ...]) -> None:
    examples = examples_of(pairs, FOOT)
    truth, start = pairs[2].motion, int(examples.starts[2])
    leg = leg_length(truth.skeleton)
    heading = heading_angle(quat_from_rotvec(truth.q[:, 3:6]))
    place = truth.q[0, [0, 2]].copy()
    facing = float(heading[0])
    for frame in range(1, len(truth)):
        left, ahead, turn = examples.steps[start + frame].astype(float) * [leg, leg, 1]
        place += [np.cos(facing) * left + np.sin(facing) * ahead, -np.sin(facing) * left + np.cos(facing) * ahead]
        facing += turn
        np.testing.assert_allclose(place, truth.q[frame, [0, 2]], atol=1e-4)
    posture = posture_of(examples.features[start + 7].astype(float))
    np.testing.assert_allclose(posture.height * leg, truth.q[7, 1], atol=1e-5)
    made = quat_from_rotvec(posed_rotvecs(posture, float(heading[7])))
    np.testing.assert_allclose(np.abs(np.sum(made * quat_from_rotvec(truth.rotvecs[7]), axis=1)), 1.0, atol=1e-6)


def test_features_are_made_rotations() -> None:
    features = np.concatenate([[1.0], np.random.default_rng(0).normal(size=132)])
    rotations = posture_of(features).rotations
    np.testing.assert_allclose(rotations @ np.swapaxes(rotations, -1, -2), np.tile(np.eye(3), (22, 1, 1)), atol=1e-12)
    assert np.isfinite(rotvec_from_matrix(rotations)).all()
    assert (np.linalg.det(rotations) > 0).all()


@pytest.mark.parametrize("holes", ["none", "prefix", "channels"])
def test_the_search_is_exact(holes: str, pairs: tuple[SignalPair, ...]) -> None:
    examples = examples_of(pairs, FOOT)
    index = index_windows(examples, 12)
    window = np.random.default_rng(1).normal(size=(12, 12))
    if holes == "prefix":
        window[5:] = np.nan
    if holes == "channels":
        window[2:6, 3:7] = np.nan
    strange = np.random.default_rng(2).random(len(examples)).astype(np.float32)
    there = np.isfinite(window).reshape(-1)
    brute = np.square(index.windows[:, there] - window.reshape(-1)[there]).mean(axis=1) + strange
    found = index.nearest(window, 5, strange)
    expected = np.sort(brute)[:5]
    if holes == "none":
        assert set(found.rows[:1]) == {int(brute.argmin())}
    else:
        np.testing.assert_allclose(found.squares, expected, rtol=1e-4)


def test_windows_do_not_cross_clips(pairs: tuple[SignalPair, ...]) -> None:
    examples = examples_of(pairs, FOOT)
    index = index_windows(examples, 4)
    first = int(examples.starts[1])
    np.testing.assert_array_equal(index.windows[first].reshape(4, 12), np.tile(examples.signals[first], (4, 1)))
    np.testing.assert_array_equal(
        index.windows[first + 2].reshape(4, 12)[:3], examples.signals[first : first + 3][::-1]
    )
    assert examples.followers(np.array([first - 1, first]))[0] == first - 1


def test_a_mean_of_examples(pairs: tuple[SignalPair, ...]) -> None:
    examples = examples_of(pairs, FOOT)
    guess = mean_guess(examples, np.array([3, 9]), np.array([0.25, 0.75]))
    np.testing.assert_allclose(guess.features, 0.25 * examples.features[3] + 0.75 * examples.features[9], rtol=1e-6)


def test_segments_cover_every_clip_once(pairs: tuple[SignalPair, ...]) -> None:
    examples = examples_of(pairs, FOOT)
    segments = segments_of(examples)
    np.testing.assert_array_equal(segments.starts, np.concatenate([[0], np.cumsum(segments.lengths)[:-1]]))
    assert segments.lengths.sum() == len(examples)
    assert segments.lengths.max() <= FOOT.rate
    assert set(examples.starts.tolist()) <= set(segments.starts.tolist())
    np.testing.assert_array_equal(
        np.flatnonzero(~segments.continues), np.searchsorted(segments.starts, examples.starts)
    )
    stands = contacts(pairs[0].motion)
    np.testing.assert_array_equal(examples.standing[: len(pairs[0])], np.stack([stands.left, stands.right], axis=1))


def test_clusters_are_those_that_one_sees() -> None:
    rng = np.random.default_rng(0)
    rows = np.concatenate([rng.normal(size=(20, 2)) + offset for offset in ([0, 0], [50, 0], [0, 50])])
    labels = k_means(rows, 3, 0).reshape(3, 20)
    assert (labels == labels[:, :1]).all()
    assert len(set(labels[:, 0])) == 3


def test_primitives_condition_as_a_gaussian_does(pairs: tuple[SignalPair, ...], recording: Recording) -> None:
    """One hypothesis after one sample, against the closed form of a joint Gaussian."""
    method = MotionPrimitives(
        examples_of(pairs, FOOT), PrimitiveSettings(coefficients=4, mixture=1, beam=1, canonical=6)
    )
    own = method._primitives
    beliefs = method._pruned(method._fresh(np.array([0]), own.durations[:1, 2], np.array([2.0]), np.array([0.0])))
    signal = method.examples.signals[5].astype(float)
    heard = np.ones(12, dtype=bool)
    heard[4] = False
    after = method._conditioned(beliefs, signal, heard)
    maps, mean = method._at(own.signal_map, beliefs)[0][heard], method._at(own.signal_mean, beliefs)[0][heard]
    noise = np.diag(method.settings.dulling * method._at(own.signal_noise, beliefs)[0][heard])
    prior = np.linalg.inv(own.covariances[0, 0])
    information = prior + maps.T @ np.linalg.inv(noise) @ maps
    centre = np.linalg.solve(
        information, prior @ own.centres[0, 0] + maps.T @ np.linalg.inv(noise) @ (signal[heard] - mean)
    )
    np.testing.assert_allclose(after.centres[0, 0], centre, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(after.covariances[0, 0], np.linalg.inv(information), rtol=1e-6, atol=1e-9)


def test_a_motion_graph_plays_recorded_frames(pairs: tuple[SignalPair, ...], recording: Recording) -> None:
    method = MotionGraph(examples_of(pairs, FOOT))
    state, rows = method.start(recording.skeleton, recording.placements), []
    for index in range(20):
        state, _ = method.step(state, recording.sample(index))
        rows.append(state.memory.row)
    steps = np.diff(rows)
    assert (steps == 1).mean() > 0.5
    near = np.abs(method._branches - np.arange(len(method.examples))[:, None]) < 15
    clips = method.examples.clip_of_frame
    assert not (near & (clips[method._branches] == clips[:, None])).any()
