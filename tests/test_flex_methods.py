"""The contract, over the flex methods; other rates, missing channels, and the model that travels along."""

import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.errors import FormatError, MethodError, PoseloomError
from poseloom.formats.artefact import write_artefact
from poseloom.methods import HealthState, make_method, needs_library, needs_model, reconstruct
from poseloom.methods.flex.angles import FLEX_JOINTS, angle_columns
from poseloom.methods.flex.hearing import UNHEARD, carried_on, hear_first, hear_next
from poseloom.methods.flex.model_file import VERSION, read_flex_model, write_flex_model
from poseloom.methods.flex.network_method import RATE, SHIPPED_MODEL, FlexNetwork
from poseloom.methods.flex.onnx_network import OnnxNetwork
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, layout, make_recording
from poseloom.skeleton.body import BODY_BONES
from poseloom.synthesis import simulate_flex


@pytest.fixture(scope="module")
def method() -> FlexNetwork:
    return FlexNetwork(read_flex_model(SHIPPED_MODEL, "flex-scales"))


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate_flex(sample_motions()["walk"].cut(0, 180), layout("flex-four"), seed=3)


def _counts(recording: Recording, counts: np.ndarray) -> Recording:
    return make_recording(
        recording.layout, recording.placements, recording.skeleton, recording.times, counts=counts,
        truth=recording.truth,
    )  # fmt: skip


def test_it_needs_nothing_but_the_recording() -> None:
    assert not needs_library("flex-scales")
    assert needs_model("flex-scales")
    with pytest.raises(MethodError, match="poseloom fit flex-lstm"):
        make_method("flex-lstm", layout("flex-four"))


def test_no_truth_enters(method: FlexNetwork, recording: Recording) -> None:
    blind = reconstruct(method, replace(recording, truth=None)).motion.q
    np.testing.assert_array_equal(reconstruct(method, recording).motion.q, blind)


def test_missing_channels_survive_and_are_named(method: FlexNetwork, recording: Recording) -> None:
    counts = recording.counts.copy()
    counts[30:60, 1] = np.nan
    counts[80:90] = np.nan
    result = reconstruct(method, _counts(recording, counts))
    assert np.isfinite(result.motion.q).all()
    assert np.isfinite(result.spread).all()
    assert all("rightKnee" in result.health[index].sensors for index in range(30, 60))
    assert {result.health[index].state for index in range(35, 60)} == {HealthState.DEGRADED}
    assert {result.health[index].state for index in range(80, 90)} == {HealthState.COASTING}
    assert result.health[100].state is HealthState.OK


def test_nothing_heard_at_all_is_a_pose_and_lost_in_the_end(method: FlexNetwork, recording: Recording) -> None:
    counts = np.full_like(recording.counts, np.nan)
    result = reconstruct(method, _counts(recording, counts))
    assert np.isfinite(result.motion.q).all()
    assert result.health[-1].state is HealthState.LOST
    silent = recording.counts.copy()
    silent[20:] = np.nan
    states = [health.state for health in reconstruct(method, _counts(recording, silent)).health]
    assert states[30] is HealthState.COASTING
    assert states[-1] is HealthState.LOST


@pytest.mark.parametrize("rate", [20.0, 33.0, 100.0, 200.0])
def test_other_rates_say_the_same(method: FlexNetwork, recording: Recording, rate: float) -> None:
    quiet = sample_motions()["walk"].cut(0, 180)
    usual = reconstruct(method, simulate_flex(quiet, layout("flex-four"), seed=3))
    other = simulate_flex(quiet, replace(layout("flex-four"), rate=rate), seed=3)
    result = reconstruct(method, other)
    assert len(result.motion) == len(other)
    nearest = [int(np.argmin(np.abs(usual.times - time))) for time in result.times]
    columns = angle_columns()
    apart = np.degrees(np.abs(result.motion.q[:, columns] - usual.motion.q[nearest][:, columns]))
    assert apart.mean() < 2.5


def test_the_future_is_not_heard(method: FlexNetwork, recording: Recording) -> None:
    counts = recording.counts.copy()
    counts[50:] = counts[50:][::-1]
    changed = reconstruct(method, _counts(recording, counts)).motion.q
    np.testing.assert_array_equal(changed[:50], reconstruct(method, recording).motion.q[:50])


def test_what_is_not_observed_says_so(method: FlexNetwork, recording: Recording) -> None:
    result = reconstruct(method, recording)
    spread = result.spread.mean(axis=0)
    hips = spread[3:6]
    told = spread[angle_columns()]
    assert (hips > np.radians(90)).all()
    assert told.max() < hips.min()
    assert (spread[[0, 2]] >= 1.0).all()
    assert np.ptp(result.motion.q[:, :6], axis=0).max() == 0.0
    assert len(BODY_BONES) > len(FLEX_JOINTS)


def test_a_walk_moves_the_legs_as_it_should(method: FlexNetwork, recording: Recording) -> None:
    assert recording.truth is not None
    result = reconstruct(method, recording)
    for side in ("left", "right"):
        knee = 3 + 3 * BODY_BONES.index(f"{side}LowerLeg")
        told, truth = result.motion.q[50:, knee], recording.truth.q[50:, knee]
        assert np.corrcoef(told, truth)[0, 1] > 0.8


def test_times_must_increase(method: FlexNetwork, recording: Recording) -> None:
    state = method.start(recording.skeleton, recording.placements)
    state, _ = method.step(state, recording.sample(5))
    with pytest.raises(MethodError, match="order of their times"):
        method.step(state, recording.sample(5))


def test_a_long_gap_is_not_filled(method: FlexNetwork, recording: Recording) -> None:
    state = method.start(recording.skeleton, recording.placements)
    state, _ = method.step(state, recording.sample(0))
    late = replace(recording.sample(1), time=1000.0)
    state, frame = method.step(state, late)
    assert frame is not None
    assert frame.time == 1000.0
    assert state.hearing is not None
    assert state.hearing.tick == 1000.0


# The clock.


@settings(deadline=None, max_examples=60)
@given(
    rate=st.floats(20.0, 200.0),
    jitter=st.floats(0.0, 0.3),
    seed=st.integers(0, 1000),
)
def test_ticks_come_fifty_times_a_second_whatever_the_rate(rate: float, jitter: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    times = (np.arange(120) + jitter * generator.uniform(-0.5, 0.5, 120)) / rate
    # A value that is the time itself must come out as the tick's time.
    hearing, moments = hear_first(times[0], np.array([times[0]]))
    heard, ticks = [moments[0].values[0]], [hearing.tick]
    for time in times[1:]:
        before = hearing.tick
        hearing, moments, between = hear_next(hearing, time, np.array([time]), RATE)
        assert moments or between is not None
        heard += [moment.values[0] for moment in moments]
        ticks += [before + (number + 1) * (hearing.tick - before) / len(moments) for number in range(len(moments))]
        assert hearing.tick <= time + 0.1 / RATE + 1e-9
    np.testing.assert_allclose(heard, np.minimum(ticks, times[-1]), atol=0.11 / RATE)
    assert abs(len(heard) - (times[-1] - times[0]) * RATE) <= 0.15 * len(heard) + 2
    assert (np.diff(heard) > 0).all()


def test_gaps_are_carried_on() -> None:
    values = np.array([[np.nan, 1.0], [2.0, np.nan], [np.nan, 3.0]])
    np.testing.assert_array_equal(carried_on(values), [[UNHEARD, 1.0], [2.0, 1.0], [2.0, 3.0]])


# The model's file.


def test_the_shipped_model_says_what_it_is(tmp_path: Path) -> None:
    assert SHIPPED_MODEL.stat().st_size < 5e6
    model = read_flex_model(SHIPPED_MODEL, "flex-scales")
    assert "cmu" in model.card["learnt from"]
    assert "hdm05" not in model.card["learnt from"]
    write_flex_model(model, tmp_path / "again.npz", 0, "")
    again = read_flex_model(tmp_path / "again.npz")
    np.testing.assert_array_equal(again.rest, model.rest)
    with pytest.raises(FormatError, match="for the method"):
        read_flex_model(SHIPPED_MODEL, "flex-lstm")


def test_a_damaged_model_is_refused(tmp_path: Path) -> None:
    model = read_flex_model(SHIPPED_MODEL)
    rests = {"rest": model.rest, "rest_spread": model.rest_spread}
    weights = {f"network.{name}": weight for name, weight in model.network.weights.items()}
    header = {"method": "flex-scales", "card": {}, "bank": {**asdict(model.network.bank), "smoothing": 1.0}}

    def refused(name: str, header: dict, arrays: dict, reason: str) -> None:
        write_artefact(tmp_path / name, "flex-network", VERSION, header, arrays)
        with pytest.raises(FormatError, match=reason) as caught:
            read_flex_model(tmp_path / name)
        assert caught.value.file == str(tmp_path / name)

    refused("bare.npz", header, weights, "array 'rest' is missing")
    refused("nobank.npz", {"method": "flex-scales", "card": {}}, {**weights, **rests}, "bank")
    refused("nowhere.npz", {**header, "bank": {**header["bank"], "swift": 6}}, {**weights, **rests}, "no mean number 6")
    refused("short.npz", header, {**weights, **rests, "network.input": model.network.weights["input"][:5]}, "input is")
    spoilt = model.network.weights["bias"].copy()
    spoilt[7] = np.nan
    refused("nan.npz", header, {**weights, **rests, "network.bias": spoilt}, "finite")


def test_a_damaged_onnx_model_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed (extra `onnx`)")
    model = read_flex_model(SHIPPED_MODEL)
    header = {"method": "flex-lstm", "card": {}, "memory": []}
    arrays = {"graph": np.zeros(50, np.uint8), "rest": model.rest, "rest_spread": model.rest_spread}
    write_artefact(tmp_path / "cut.npz", "flex-network", VERSION, header, arrays)
    with pytest.raises(FormatError, match="onnxruntime cannot open"):
        read_flex_model(tmp_path / "cut.npz")


def test_a_model_that_needs_onnxruntime_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    read_flex_model(SHIPPED_MODEL)  # the shipped one needs none
    with pytest.raises(PoseloomError, match=r"poseloom\[onnx\]"):
        OnnxNetwork(b"", ())
