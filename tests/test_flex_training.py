"""Flex networks: the published program's three faults stay away, training repeats, ONNX says what torch says."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.errors import FormatError, LibraryError, PoseloomError
from poseloom.library import MotionLibrary, build_library, open_library
from poseloom.methods import reconstruct
from poseloom.methods.flex.angles import ANGLES, angle_columns, angle_errors, mirrored_angles, moving_angles
from poseloom.methods.flex.network_method import load_flex_model
from poseloom.sensors import layout
from poseloom.sensors.flex_range import FlexRange
from poseloom.skeleton.body import average_body
from poseloom.synthesis import simulate_flex
from poseloom.synthesis.flex import bend_angles

torch = pytest.importorskip("torch", reason="torch is not installed (extra `train`)")
pytest.importorskip("onnx", reason="onnx is not installed (extra `train`)")

from poseloom.training.draws import (  # noqa: E402
    DrawSettings,
    draw_counts,
    draw_inputs,
    draw_inputs_at_first_range,
    hear,
    silence,
)
from poseloom.training.examples import Stretches, Windows, heard_pieces  # noqa: E402
from poseloom.training.export import export, to_step_network  # noqa: E402
from poseloom.training.fitting import (  # noqa: E402
    FitSettings,
    Fitted,
    draw_sets,
    fit,
    held_out_takes,
    make_network,
    median,
    paper_settings,
    parts_of,
    scales_settings,
    smoothed,
)
from poseloom.training.from_library import fit_to_library, flex_settings  # noqa: E402
from poseloom.training.loop import LoopSettings, rate_in, stalled, tell, train  # noqa: E402
from poseloom.training.networks import BiLstm, Calibrator, Kind, NetworkSettings, median_of_three  # noqa: E402
from poseloom.training.scales import BankSettings, Scales, bank_series  # noqa: E402
from poseloom.training.sessions import Session, chosen_clips, make_sessions, mean_angles, mirrored  # noqa: E402
from poseloom.training.splits import (  # noqa: E402
    Divided,
    Part,
    Piece,
    by_person,
    check_disjoint,
    within_takes,
)

torch.set_num_threads(1)
TAKES = ("walk", "run", "punch", "dance_a")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    folder = tmp_path_factory.mktemp("library") / "samples"
    build_library(["samples"], folder, rate=50.0, workers=1)
    return open_library(folder)


@pytest.fixture(scope="module")
def sessions(library: MotionLibrary) -> tuple[Session, ...]:
    clips = chosen_clips(library, lambda clip: clip.name.removeprefix("samples/") in TAKES)
    assert len(clips) >= 3
    return make_sessions(library, clips, mean_angles(library, clips), lambda clip: clip.name)


@pytest.fixture(scope="module")
def inputs(sessions: tuple[Session, ...]) -> tuple[np.ndarray, ...]:
    return tuple(draw_inputs(session, 3, DrawSettings(), minutes=10.0) for session in sessions)


def _small(kind: Kind = Kind.BILSTM_C) -> FitSettings:
    settings = paper_settings(kind, hidden=16)
    return replace(settings, loop=replace(settings.loop, epochs=2, half=False), stride=8, draws=2, size=16)


def _divided(sessions: tuple[Session, ...]) -> Divided:
    names = [session.person for session in sessions]
    return by_person(sessions, lambda person: Part.VALIDATE if person == names[0] else Part.TRAIN)


@pytest.fixture(scope="module")
def fitted(sessions: tuple[Session, ...]) -> Fitted:
    return fit(sessions, _divided(sessions), _small(), seed=1)


@pytest.fixture(scope="module")
def scales(sessions: tuple[Session, ...]) -> Fitted:
    settings = scales_settings(epochs=2, hidden=16)
    return fit(sessions, _divided(sessions), replace(settings, draws=2, size=4), seed=1)


# The three faults of the published program.


def test_the_calibrators_weights_move_in_training(fitted: Fitted) -> None:
    before = make_network(fitted.settings.network, fitted.seed).state_dict()
    after = fitted.network.state_dict()
    calibrator = [name for name in before if name.startswith("calibrator.")]
    assert len(calibrator) == 6
    for name in calibrator:
        assert not torch.equal(before[name], after[name]), name


def test_the_calibrators_output_changes_the_prediction(fitted: Fitted) -> None:
    heard = torch.rand(3, 100, 8)
    with torch.no_grad():
        told = fitted.network(heard)
        # The baseline comes from the whole window; the LSTM hears the last five samples, which stay.
        heard[:, :90, :4] += 0.3
        assert (fitted.network(heard) - told).abs().max() > 1e-4
        other = make_network(replace(fitted.settings.network, kind=Kind.BILSTM), 1)
        told = other(heard)
        heard[:, :95, :4] += 0.3
        torch.testing.assert_close(other(heard), told)


def test_no_layer_is_created_in_a_call(fitted: Fitted) -> None:
    heard = torch.rand(2, 100, 8)
    with torch.no_grad():
        torch.manual_seed(0)
        first = fitted.network(heard)
        torch.manual_seed(1)
        torch.testing.assert_close(fitted.network(heard), first, rtol=0, atol=0)


def test_the_median_mixes_time_only() -> None:
    told = torch.from_numpy(np.random.default_rng(0).normal(size=(40, 5)))
    filtered = median_of_three(told)
    for frame in range(2, 40):
        for angle in range(5):
            assert filtered[frame, angle] == told[frame - 2 : frame + 1, angle].median()
    # Another angle, and the future, change nothing.
    changed = told.clone()
    changed[:, 2] += 5.0
    changed[30:] = 9.0
    others = [0, 1, 3, 4]
    torch.testing.assert_close(median_of_three(changed)[:30, others], filtered[:30, others], rtol=0, atol=0)


# The network.


def test_one_backward_step_is_what_a_bidirectional_layer_says_of_the_last_sample() -> None:
    network = BiLstm(NetworkSettings(Kind.BILSTM, hidden=12), ANGLES)
    whole = torch.nn.LSTM(100, 12, batch_first=True, bidirectional=True)
    ours = {**{f"{k}": v for k, v in network.forwards.state_dict().items()}}
    ours |= {f"{name}_reverse": value for name, value in network.backwards.state_dict().items()}
    whole.load_state_dict(ours)
    heard = torch.rand(4, 100, 8)
    with torch.no_grad():
        entered = network.dense_in(heard[:, -5:, :4])
        expected = network.head(whole(entered)[0][:, -1])
        torch.testing.assert_close(network(heard), expected)


@pytest.mark.parametrize("window", [40, 60, 80, 100, 120])
def test_the_baseline_is_the_pools_of_equation_2(window: int) -> None:
    calibrator = Calibrator(window, 15, 10)
    series = np.random.default_rng(window).random((window, 4)).astype(np.float32)
    minima = [series[start : start + 15].min(axis=0) for start in range(0, window - 14, 15)]
    padded = np.array([minima[0]] * 8 + minima + [minima[-1]] * 8)
    means = np.array([padded[start : start + 10].mean(axis=0) for start in range(0, len(padded) - 9, 10)])
    layer = calibrator.spread_out
    with torch.no_grad():
        expected = layer.weight.numpy() @ means + layer.bias.numpy()[:, None]
        told = calibrator.baseline(torch.from_numpy(series)[None])[0].numpy()
    np.testing.assert_allclose(told, expected, atol=1e-5)


@pytest.mark.parametrize("kind", [Kind.TRANSFORMER, Kind.FCN, Kind.TCN])
def test_comparators_hear_five_samples_and_no_more(kind: Kind) -> None:
    network = make_network(NetworkSettings(kind), 0).eval()
    heard = torch.rand(2, 100, 8)
    with torch.no_grad():
        told = network(heard)
        assert told.shape == (2, ANGLES)
        heard[:, :95] = 0.9
        torch.testing.assert_close(network(heard), told)
        for sample in range(95, 100):
            changed = heard.clone()
            changed[:, sample, :4] += 0.5
            assert (network(changed) - told).abs().max() > 1e-6


def test_the_bank_hears_the_past_only_and_begins_anywhere() -> None:
    generator = np.random.default_rng(2)
    heard = np.concatenate([generator.random((80, 4)), np.ones((80, 4))], axis=1).astype(np.float32)
    features = bank_series(heard, BankSettings())
    assert features.shape == (80, BankSettings().features)
    changed = heard.copy()
    changed[50:, :4] = 0.0
    np.testing.assert_array_equal(bank_series(changed, BankSettings())[:50], features[:50])
    still = np.concatenate([np.full((30, 4), 0.4), np.ones((30, 4))], axis=1).astype(np.float32)
    spread = np.ptp(bank_series(still, BankSettings()), axis=0)
    np.testing.assert_allclose(spread, 0, atol=1e-6)


# Training.


def test_a_seed_repeats_and_another_does_not(sessions: tuple[Session, ...], fitted: Fitted) -> None:
    heard = draw_inputs(sessions[1], 9, DrawSettings(), minutes=5.0)
    again = fit(sessions, _divided(sessions), _small(), seed=1)
    np.testing.assert_allclose(again.tell(heard), fitted.tell(heard), atol=1e-4)
    other = fit(sessions, _divided(sessions), _small(), seed=2)
    assert np.abs(other.tell(heard) - fitted.tell(heard)).max() > 1e-3


@pytest.mark.parametrize("kind", [Kind.BILSTM_C, Kind.SCALES])
def test_a_killed_training_goes_on_as_if_nothing_had_happened(
    kind: Kind, sessions: tuple[Session, ...], tmp_path: Path
) -> None:
    settings = replace(scales_settings(3, 12), draws=2, size=4) if kind is Kind.SCALES else _small()
    settings = replace(settings, loop=replace(settings.loop, epochs=3))
    whole = fit(sessions, _divided(sessions), settings, seed=4)

    class KilledError(Exception):
        pass

    def kill(done: int, most: int, error: float) -> None:
        if done == 1:
            raise KilledError

    checkpoint = tmp_path / "training"
    with pytest.raises(KilledError):
        fit(sessions, _divided(sessions), settings, seed=4, checkpoint=checkpoint, progress=kill)
    resumed: list[int] = []
    again = fit(
        sessions, _divided(sessions), settings, 4, checkpoint=checkpoint, progress=lambda done, *_: resumed.append(done)
    )
    assert resumed == [2, 3]
    assert again.history == whole.history
    heard = draw_inputs(sessions[1], 9, DrawSettings(), minutes=5.0)
    np.testing.assert_allclose(again.tell(heard), whole.tell(heard), atol=1e-6)
    with pytest.raises(FormatError, match="other settings"):
        fit(sessions, _divided(sessions), settings, seed=5, checkpoint=checkpoint)
    checkpoint.write_bytes(b"nothing")
    with pytest.raises(FormatError, match="cannot be gone on from"):
        fit(sessions, _divided(sessions), settings, seed=4, checkpoint=checkpoint)


def test_training_lowers_the_error(sessions: tuple[Session, ...]) -> None:
    settings = _small(Kind.FCN)
    settings = replace(settings, loop=replace(settings.loop, epochs=8, decay_every=0), stride=2)
    everyone = by_person(sessions, lambda person: Part.TRAIN)
    history = fit(sessions, everyone, settings, seed=0).history
    assert min(history.errors) < 0.8 * history.errors[0]


def test_the_rate_falls_tenfold_every_ten_epochs() -> None:
    settings = LoopSettings()
    assert [rate_in(epoch, settings) for epoch in (0, 9, 10, 25)] == pytest.approx([1e-3, 1e-3, 1e-4, 1e-5])


def test_training_stops_when_ten_epochs_bring_less_than_a_tenth_of_a_degree() -> None:
    falling = [10 - 0.005 * epoch for epoch in range(11)]
    assert stalled(falling, 10, 0.1)
    assert not stalled(falling[:10], 10, 0.1)
    assert not stalled([10 - 0.02 * epoch for epoch in range(11)], 10, 0.1)


class Nothing(Stretches):
    """Batches that hold nothing."""

    def __init__(self, batches: int) -> None:
        self._heard, self._count = (), batches

    @property
    def batches(self) -> int:
        return self._count

    def order(self, generator):
        return np.zeros(1, dtype=np.int64)

    def batch(self, generator, index, order):
        return None


def test_training_keeps_the_best_epoch() -> None:
    network = torch.nn.Linear(1, 1)
    errors = iter([3.0, 1.0, 2.0])
    kept: list[dict[str, torch.Tensor]] = []

    def judge(judged: torch.nn.Module) -> float:
        kept.append({name: value.clone() for name, value in judged.state_dict().items()})
        return next(errors)

    history = train(
        network, Nothing(1), lambda judged, batch: judged(torch.ones(1, 1)).sum(), judge, LoopSettings(epochs=3), 0
    )
    assert history.best == 1
    torch.testing.assert_close(dict(network.state_dict()), kept[1])


def test_the_running_mean_of_the_weights_is_judged_and_kept() -> None:
    network = torch.nn.Linear(1, 1, bias=False)
    weights: list[float] = []
    judged: list[float] = []

    def loss(trained: torch.nn.Module, batch: object) -> torch.Tensor:
        weights.append(float(trained.weight.detach()))
        return trained(torch.ones(1, 1)).sum()

    def judge(averaged: torch.nn.Module) -> float:
        judged.append(float(averaged.weight.detach()))
        return -float(len(judged))

    settings = LoopSettings(epochs=2, average=0.6, decay_every=0)
    train(network, Nothing(5), loss, judge, settings, 0)
    # weights[k] is what the k-th batch began with, and weights[k + 1] what it made of that.
    mean = weights[0]
    for batch in range(5):
        taken = 1 - min(0.6, (1 + batch) / (10 + batch))
        mean += taken * (weights[batch + 1] - mean)
    assert judged[0] == pytest.approx(mean, abs=1e-6)
    assert weights[5] != pytest.approx(mean, abs=1e-6)
    assert float(network.weight.detach()) == pytest.approx(judged[1])


# Splits.


def test_windows_of_one_take_never_stand_on_both_sides(sessions: tuple[Session, ...]) -> None:
    gap, window = 30, 30
    divided = within_takes(sessions, gap, least=2)
    assert divided.validate
    assert divided.test
    heard: dict[Part, set[tuple[int, int]]] = {}
    for part in Part:
        frames = {
            (piece.session, frame)
            for piece in divided.part(part)
            for end in range(piece.start, piece.stop)
            for frame in range(max(end - window + 1, piece.heard), end + 1)
        }
        heard[part] = frames
        assert all(piece.take.start <= piece.heard <= piece.start < piece.stop for piece in divided.part(part))
    assert not heard[Part.TRAIN] & heard[Part.TEST]
    assert not heard[Part.TRAIN] & heard[Part.VALIDATE]
    assert not heard[Part.VALIDATE] & heard[Part.TEST]


def test_a_split_that_shares_frames_or_copies_is_refused(sessions: tuple[Session, ...]) -> None:
    take = sessions[0].takes[0]
    train_piece = Piece(0, take, take.start, take.start, take.start + 20)
    late = Piece(0, take, take.start + 10, take.start + 25, take.stop)
    with pytest.raises(PoseloomError, match="both sides"):
        check_disjoint(Divided((train_piece,), (), (late,)))
    copy = replace(sessions[1].takes[0], take=take.take)
    with pytest.raises(PoseloomError, match="copies"):
        check_disjoint(Divided((train_piece,), (), (Piece(1, copy, copy.start, copy.start, copy.stop),)))


def test_people_are_whole_and_somebody_trains(sessions: tuple[Session, ...]) -> None:
    divided = _divided(sessions)
    assert {piece.session for piece in divided.train} == set(range(1, len(sessions)))
    assert {piece.session for piece in divided.validate} == {0}
    with pytest.raises(PoseloomError, match="train on"):
        by_person(sessions, lambda person: Part.TEST)


def test_parts_cover_a_piece_once() -> None:
    piece = Piece(0, _take(0, 1000), 0, 0, 1000)
    parts = parts_of([piece], 150)
    assert [part.heard for part in parts] == [part.start for part in parts]
    assert parts[0].start == 0
    assert parts[-1].stop == 1000
    assert all(first.stop == second.start for first, second in itertools.pairwise(parts))


def _take(start: int, stop: int):
    from poseloom.training.sessions import Take

    return Take("take", "take", (), start, stop)


# Examples.


def test_windows_repeat_the_first_frame_and_never_the_future(
    sessions: tuple[Session, ...], inputs: tuple[np.ndarray, ...]
) -> None:
    take = sessions[0].takes[0]
    piece = Piece(0, take, take.start, take.start, take.stop)
    heard = heard_pieces(sessions, [piece], inputs)
    windows = Windows(heard, window=20, stride=1, size=len(take))
    order = np.arange(len(windows))
    batch = windows.batch(np.random.default_rng(0), 0, order)
    own = inputs[0][take.start : take.stop]
    for end in (0, 3, 19, 25, len(take) - 1):
        expected = own[[max(0, frame) for frame in range(end - 19, end + 1)]]
        np.testing.assert_array_equal(batch.inputs[end], expected)
        np.testing.assert_array_equal(batch.angles[end, 0], sessions[0].angles[take.start + end])


def test_stretches_pad_what_is_short(sessions: tuple[Session, ...], inputs: tuple[np.ndarray, ...]) -> None:
    take = sessions[0].takes[0]
    short = Piece(0, take, take.start, take.start, take.start + 10)
    stretches = Stretches(heard_pieces(sessions, [short], inputs), length=30, size=2)
    generator = np.random.default_rng(0)
    batch = stretches.batch(generator, 0, stretches.order(generator))
    np.testing.assert_array_equal(batch.weights[0, :, 0], [1.0] * 10 + [0.0] * 20)
    np.testing.assert_array_equal(batch.inputs[0, :10], inputs[0][take.start : take.start + 10])


# Sensors and sessions.


def test_sessions_join_takes_and_mirror_sides(library: MotionLibrary) -> None:
    clips = chosen_clips(library, lambda clip: clip.name.removeprefix("samples/") in TAKES)
    (session,) = make_sessions(library, clips, mean_angles(library, clips), lambda clip: "somebody")
    assert len(session.takes) == len(clips)
    for take, clip in zip(session.takes, clips, strict=True):
        bends = bend_angles(library.motion(clip), layout("flex-four"))
        np.testing.assert_allclose(session.bends[take.start : take.stop], bends)
    assert np.abs(np.diff(session.bends, axis=0)).max() < 0.6
    twice = mirrored(mirrored(session))
    np.testing.assert_allclose(twice.angles, session.angles, atol=1e-6)
    np.testing.assert_array_equal(twice.bends, session.bends)
    with pytest.raises(LibraryError, match="no clip"):
        make_sessions(library, (), mean_angles(library, clips))


def test_drawn_sensors_repeat_and_age(sessions: tuple[Session, ...]) -> None:
    settings = DrawSettings(drop_outs=3.0)
    first = draw_inputs(sessions[0], 5, settings)
    np.testing.assert_array_equal(draw_inputs(sessions[0], 5, settings), first)
    assert np.isfinite(first).all()
    assert set(np.unique(first[:, 4:])) <= {0.0, 1.0}
    new = draw_inputs_at_first_range(sessions[0], 5, DrawSettings(), minutes=0.0)
    old = draw_inputs_at_first_range(sessions[0], 5, DrawSettings(), minutes=60.0)
    assert (old[:, :4].mean(axis=0) > new[:, :4].mean(axis=0)).all()
    on_line = draw_inputs(sessions[0], 5, DrawSettings(), minutes=60.0)
    assert (
        np.abs(on_line[:, :4].mean(axis=0) - new[:, :4].mean(axis=0)).mean()
        < np.abs(old[:, :4].mean(axis=0) - new[:, :4].mean(axis=0)).mean()
    )


def test_silences_take_single_channels_away(sessions: tuple[Session, ...]) -> None:
    counts = np.full((3000, 4), 1000.0)
    quiet = silence(counts, 50.0, DrawSettings(drop_outs=3.0), np.random.default_rng(0))
    share = np.isnan(quiet).mean()
    assert 0.05 < share < 0.5
    assert np.array_equal(quiet[np.isfinite(quiet)], counts[np.isfinite(quiet)])


# Export.


def _steps(fitted: Fitted, heard: np.ndarray, medians: bool = True) -> tuple[np.ndarray, np.ndarray]:
    network = to_step_network(fitted, medians)
    memory, told = network.start(), []
    for number, sample in enumerate(heard.astype(np.float64)):
        memory, angles, spread = network.step(memory, sample[:4], sample[4:], number == 0)
        told.append((angles, spread))
    return np.array([angles for angles, _ in told]), np.array([spread for _, spread in told])


def test_onnx_says_what_torch_says_of_windows(fitted: Fitted, inputs: tuple[np.ndarray, ...]) -> None:
    told, spread = _steps(fitted, inputs[1][:130])
    np.testing.assert_allclose(told, median(fitted.tell(inputs[1][:130])), atol=1e-5)
    np.testing.assert_allclose(spread, np.broadcast_to(fitted.spread, spread.shape), atol=1e-6)
    plain, _ = _steps(fitted, inputs[1][:20], medians=False)
    np.testing.assert_allclose(plain, fitted.tell(inputs[1][:20]), atol=1e-5)


def test_numpy_gives_what_torch_gives_of_the_filter_bank_lstm(scales: Fitted, inputs: tuple[np.ndarray, ...]) -> None:
    told, spread = _steps(scales, inputs[1][:130])
    np.testing.assert_allclose(told, smoothed(scales, scales.tell(inputs[1][:130])), atol=1e-5)
    assert (spread > 0).all()


def test_every_contestant_exports(fitted: Fitted, inputs: tuple[np.ndarray, ...]) -> None:
    for kind in (Kind.BILSTM, Kind.TRANSFORMER, Kind.FCN, Kind.TCN):
        settings = FitSettings(NetworkSettings(kind, 100, 8))
        network = make_network(settings.network, 0).eval()
        contestant = replace(fitted, network=network, settings=settings)
        told, _ = _steps(contestant, inputs[0][:12], medians=False)
        rows = np.maximum(np.arange(12)[:, None] + np.arange(-99, 1), 0)
        np.testing.assert_allclose(told, tell(network, inputs[0][:12][rows]), atol=1e-5)


def test_a_model_runs_live_as_it_was_trained(fitted: Fitted, sessions: Sequence[Session], tmp_path: Path) -> None:
    from poseloom.samples import sample_motions

    export(fitted, tmp_path / "model.npz", "flex-lstm", np.zeros(69), np.ones(69), {"data": "little"})
    method = load_flex_model(tmp_path / "model.npz", "flex-lstm")
    assert method.model.card == {"data": "little"}
    recording = simulate_flex(sample_motions()["walk"], layout("flex-four"), seed=3)
    told = reconstruct(method, recording).motion.q[:, angle_columns()]
    heard = hear(np.array(recording.counts), recording.layout.rate, FlexRange())
    np.testing.assert_allclose(told, median(fitted.tell(heard)), atol=1e-5)
    # A run that goes on from a kept state says what the whole run said.
    state = method.start(recording.skeleton, recording.placements)
    for index in range(60):
        state, _ = method.step(state, recording.sample(index))
    kept, rest = state, []
    for index in range(60, len(recording)):
        state, frame = method.step(state, recording.sample(index))
        rest.append(frame.pose.q[angle_columns()])
    np.testing.assert_array_equal(rest, told[60:])
    _, frame = method.step(kept, recording.sample(60))
    np.testing.assert_array_equal(frame.pose.q[angle_columns()], told[60])
    with pytest.raises(FormatError, match="for the method"):
        load_flex_model(tmp_path / "model.npz", "flex-scales")


@pytest.mark.parametrize("method", ["flex-lstm", "flex-scales"])
def test_fitting_to_a_library(method: str, library: MotionLibrary, tmp_path: Path) -> None:
    settings = replace(flex_settings(method, epochs=1, hidden=8), draws=2, stride=40, size=8)
    seen: list[int] = []
    report = fit_to_library(
        library, tmp_path / "model.npz", method, settings, 0, progress=lambda done, *_: seen.append(done)
    )
    assert seen == [1]
    assert report.takes > 5
    model = load_flex_model(tmp_path / "model.npz", method).model
    assert set(model.card) >= {"network", "learnt from", "sensors", "validation error", "limits"}
    assert model.rest.shape == (average_body().size,)


def test_a_library_at_another_rate_is_refused(tmp_path: Path) -> None:
    build_library(["samples"], tmp_path / "slow", rate=40.0, workers=1)
    with pytest.raises(LibraryError, match="40 poses a second"):
        fit_to_library(open_library(tmp_path / "slow"), tmp_path / "m.npz", "flex-lstm", _small())


def test_takes_held_out_are_whole(sessions: tuple[Session, ...]) -> None:
    divided = held_out_takes(sessions, 0.3, 0)
    assert divided.validate
    assert not {piece.take.take for piece in divided.train} & {piece.take.take for piece in divided.validate}


# Angles.


def test_angle_errors_know_that_a_whole_turn_is_none() -> None:
    truth = np.zeros((1, ANGLES))
    truth[0, :3] = (0.0, 3.0, 0.0)
    estimate = truth.copy()
    estimate[0, :3] = (0.0, 3.1 - 2 * np.pi, 0.0)
    np.testing.assert_allclose(angle_errors(truth, estimate)[0, 1], np.degrees(0.1))


def test_mirrored_angles_are_those_of_the_mirrored_motion(library: MotionLibrary) -> None:
    from poseloom.skeleton.mirror import mirror_pose_vectors

    q = library.poses[:50].astype(np.float64)
    np.testing.assert_allclose(
        mirrored_angles(q[:, angle_columns()]), mirror_pose_vectors(q)[:, angle_columns()], atol=1e-9
    )
    assert len(moving_angles()) == 27


def test_counts_stay_within_the_converter(sessions: tuple[Session, ...]) -> None:
    from poseloom.synthesis.flex_sensors import FlexSensors

    counts = draw_counts(sessions[0], 1, FlexSensors(), 30.0)
    known = counts[np.isfinite(counts)]
    assert known.min() >= 0
    assert known.max() <= 4095
    assert draw_sets(sessions, replace(_small(), draws=2), 0)[1][0][0].person.endswith("~mirror")
    assert isinstance(make_network(NetworkSettings(Kind.SCALES, hidden=8), 0), Scales)
