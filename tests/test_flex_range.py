"""Range, baseline and faults of flex channels, learnt on line."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from poseloom.errors import SensorError
from poseloom.formats.bend_tables import read_bend_tables
from poseloom.samples import sample_motions
from poseloom.sensors import SensorStatus, layout
from poseloom.sensors.flex_range import FlexRange, FlexReadings
from poseloom.synthesis import Fault, FaultKind, FlexSensors, Spread, simulate_flex

FOUR = layout("flex-four")
PLAIN = FlexRange()
SOUND = replace(FlexSensors(), opens=Spread(0.0), spikes=Spread(0.0), lost_lines=0.0)


def times_of(samples: int, rate: float = 50.0) -> np.ndarray:
    return np.arange(samples) / rate


def bending(samples: int, low: float = 1000.0, span: float = 1500.0, rate: float = 50.0) -> np.ndarray:
    """A joint that bends and straightens once a second, with a little noise, one channel."""
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * times_of(samples, rate))
    return np.floor(low + span * wave + np.random.default_rng(0).normal(size=samples))[:, None]


def follow(counts: np.ndarray, times: np.ndarray | None = None, ranges: FlexRange = PLAIN) -> FlexReadings:
    moments = times_of(len(counts)) if times is None else times
    return ranges.follow(ranges.start(counts.shape[1]), moments, counts)[1]


@settings(max_examples=25, deadline=None)
@given(
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(1, 30), st.integers(1, 2)),
        elements=st.one_of(
            st.just(math.nan), st.integers(-5, 5000).map(float), st.sampled_from([900.0, 910.0, 4095.0])
        ),
    ),
    st.integers(0, 30),
    st.lists(st.floats(1e-4, 3.0), min_size=30, max_size=30),
)
def test_whatever_comes_whole_is_split_is_step_by_step(counts: np.ndarray, at: int, gaps: list[float]) -> None:
    ranges = FlexRange()
    times = np.cumsum(gaps)[: len(counts)]
    at = min(at, len(counts))
    end, whole = ranges.follow(ranges.start(counts.shape[1]), times, counts)
    middle, first = ranges.follow(ranges.start(counts.shape[1]), times[:at], counts[:at])
    before = middle.columns.copy()
    last, second = ranges.follow(middle, times[at:], counts[at:])
    np.testing.assert_array_equal(before, middle.columns)  # the argument stays
    np.testing.assert_array_equal(end.columns, last.columns)
    state, stepped = ranges.start(counts.shape[1]), []
    for time, row in zip(times, counts, strict=True):
        state, read = ranges.step(state, float(time), row)
        stepped.append(read)
    for name in ("values", "low", "high", "status", "replaced"):
        columns = getattr(whole, name)
        np.testing.assert_array_equal(columns, np.concatenate([getattr(first, name), getattr(second, name)]))
        np.testing.assert_array_equal(columns, np.stack([getattr(read, name) for read in stepped]))
    believed = whole.status == SensorStatus.OK
    np.testing.assert_array_equal(believed, np.isfinite(whole.values))
    assert (whole.low[believed] <= whole.high[believed]).all()


def test_the_range_is_learnt_and_the_future_not_looked_at() -> None:
    counts = bending(1000)
    read = follow(counts)
    assert read.low[-1, 0] == pytest.approx(1000, abs=15)
    assert read.high[-1, 0] == pytest.approx(2500, abs=15)
    assert (read.status == SensorStatus.OK).all()
    np.testing.assert_array_equal(follow(counts[:300]).values, read.values[:300])


def test_a_small_movement_does_not_fill_the_range() -> None:
    assert np.nanmax(follow(bending(1000, span=200.0)).values) < 0.15
    assert np.nanmax(follow(bending(1000, span=200.0), ranges=FlexRange(typical_span=200.0)).values) > 0.9


def test_the_low_end_follows_a_creeping_baseline() -> None:
    counts = bending(50 * 60 * 20)
    creep = 200.0 * times_of(len(counts)) / 1200.0
    read = follow(counts + np.floor(creep)[:, None])
    assert read.low[-1, 0] == pytest.approx(1200, abs=40)


def test_a_single_spike_is_doubted_and_teaches_nothing() -> None:
    counts = bending(1000)
    spoilt = counts.copy()
    spoilt[500] += 1200
    spoilt[700] = 30.0
    read = follow(spoilt)
    assert read.status[500, 0] == read.status[700, 0] == SensorStatus.MISSING
    assert (read.status == SensorStatus.MISSING).sum() <= 6
    assert not read.replaced.any()
    assert read.low[-1, 0] == pytest.approx(follow(counts).low[-1, 0], abs=5)


def test_rails_are_saturated_and_come_back() -> None:
    counts = bending(1000)
    counts[300:400] = 4095.0
    counts[600:620] = 0.0
    read = follow(counts)
    assert (read.status[300:400] == SensorStatus.SATURATED).all()
    assert (read.status[600:620] == SensorStatus.SATURATED).all()
    assert (read.status[405:600] == SensorStatus.OK).all()
    assert not read.replaced.any()


@pytest.mark.parametrize("rate", [20.0, 50.0, 200.0])
def test_a_stuck_channel_is_noticed_but_not_a_person_who_stands_still(rate: float) -> None:
    samples = int(20 * rate)
    counts = bending(samples, rate=rate)
    begin = int(10 * rate)
    counts[begin:] = counts[begin]
    read = follow(counts, times_of(samples, rate))
    assert (read.status[: begin - 1] == SensorStatus.OK).all()
    assert (read.status[begin + int(1.5 * rate) :] == SensorStatus.STUCK).all()
    still = np.floor(1000.5 + np.random.default_rng(1).normal(size=(samples, 1)))
    assert (follow(still, times_of(samples, rate)).status == SensorStatus.OK).all()


def test_a_quiet_board_is_not_stuck_when_its_joint_rests() -> None:
    """Less noise than a count: long runs of one value are what this channel does."""
    counts = np.floor(1000.3 + 0.2 * np.random.default_rng(1).normal(size=(6000, 1)))
    read = follow(counts)
    assert (read.status[1500:] == SensorStatus.OK).mean() > 0.99


@pytest.mark.parametrize("rate", [50.0, 100.0])
@pytest.mark.parametrize("step", [-400.0, 250.0, 1200.0])
def test_another_sensor_is_noticed_and_its_range_learnt(rate: float, step: float) -> None:
    samples = int(20 * rate)
    counts = bending(samples, rate=rate)
    at = int(10.3 * rate)
    counts[at:] += step
    read = follow(counts, times_of(samples, rate))
    (when,) = np.flatnonzero(read.replaced[:, 0])
    assert at < when <= at + 0.5 * rate
    assert read.low[-1, 0] == pytest.approx(1000 + step, abs=60)


def test_another_sensor_after_an_outage_is_noticed_if_its_level_is_another() -> None:
    counts = bending(1000, low=700.0, span=300.0)
    counts[400:500] = np.nan
    same = follow(counts)
    counts[500:] += 2800.0
    other = follow(counts)
    assert not same.replaced.any()
    assert (same.status[510:] == SensorStatus.OK).all()
    assert other.replaced.sum() == 1
    assert (other.status[530:] == SensorStatus.OK).all()


def test_sound_sensors_on_real_motions_are_believed() -> None:
    samples = seen = replaced = 0
    for name in ("walk", "run", "jump", "kick"):
        for seed in range(3):
            recording = simulate_flex(sample_motions()[name], FOUR, SOUND, seed=seed)
            read = follow(recording.counts, recording.times)
            samples += read.status.size
            seen += int((read.status == SensorStatus.OK).sum())
            replaced += int(read.replaced.sum())
    assert seen / samples > 0.99
    assert replaced <= 3  # these clips have 30 poses a second, so their speed leaps at each


def test_faults_of_the_simulator_are_named() -> None:
    motion = sample_motions()["dance_a"]
    faults = [Fault("leftKnee", 1.0, 3.0, FaultKind.SATURATED), Fault("leftElbow", 1.0, 3.5, FaultKind.STUCK)]
    recording = simulate_flex(motion, FOUR, SOUND, faults=faults, seed=3)
    read = follow(recording.counts, recording.times)
    hit = (recording.times >= 1.0) & (recording.times < 3.0)
    assert (read.status[hit, 0] == SensorStatus.SATURATED).all()
    assert (read.status[hit & (recording.times > 2.0), 2] == SensorStatus.STUCK).all()
    assert (read.status[:, [1, 3]] == SensorStatus.OK).mean() > 0.97


def test_real_sensors_with_their_kinks_are_not_replaced_all_the_time(recordings: Path) -> None:
    """Six real sensors on a fast elbow; one has a loose contact, which runs to the lower rail."""
    ranges = FlexRange(typical_span=60.0, least=300.0, most=1300.0)
    replaced = believed = channels = 0
    for table in read_bend_tables(recordings / "flex" / "elbow"):
        sound = [at for at in range(6) if (np.abs(table.counts[:, at] - np.median(table.counts[:, at])) < 250).all()]
        read = follow(table.counts[:, sound], ranges=ranges)
        replaced += int(read.replaced.sum())
        believed += float((read.status == SensorStatus.OK).mean()) * len(sound)
        channels += len(sound)
    assert channels > 35
    assert replaced < 0.5 * channels  # in 110 s each
    assert believed / channels > 0.97


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(SensorError, match="typical_span"):
        FlexRange(typical_span=0.0).start(4)
