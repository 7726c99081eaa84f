"""The one rule by which a recording of another rate is resampled: exact where it can be, causal, honest about gaps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.methods import reconstruct
from poseloom.methods.contract import Frame, Health, Reconstructor
from poseloom.rotations import quat_from_rotvec
from poseloom.sensors import Recording, SensorStatus, default_placements, layout, make_recording
from poseloom.sensors.rate import LONGEST_GAP, Resampler, ResamplerState, resample_recording
from poseloom.skeleton import Pose, average_body
from poseloom.skeleton.motion import make_motion

BODY = average_body()
THREE = layout("three-trackers")


def moving(times: np.ndarray, rate: float, missing: np.ndarray | None = None) -> Recording:
    """Trackers that go straight ahead and turn evenly about the vertical: what lies between samples is known."""
    moments = np.asarray(times)[:, None, None]
    positions = np.array([[0.0, 1.0, 0.0], [0.5, 1.0, 0.0], [-0.5, 1.0, 0.0]]) + moments * np.array([0.0, 0.0, 1.5])
    quats = np.repeat(quat_from_rotvec(np.stack([0 * times, 0.7 * times, 0 * times], axis=1))[:, None], 3, axis=1)
    if missing is not None:
        positions[missing], quats[missing] = np.nan, np.nan
    return make_recording(
        replace(THREE, rate=rate), default_placements(THREE, BODY), BODY, times, positions=positions, quats_wxyz=quats
    )


@pytest.mark.parametrize(("old", "new"), [(60.0, 40.0), (40.0, 60.0), (100.0, 60.0), (30.0, 40.0), (1000.0, 60.0)])
def test_what_moves_evenly_is_met_exactly(old: float, new: float) -> None:
    recording = moving(5.0 + np.arange(round(2 * old)) / old, old)
    made = resample_recording(recording, new)
    assert made.layout.rate == new
    np.testing.assert_allclose(made.times, 5.0 + np.arange(len(made)) / new, rtol=0, atol=1e-12)
    assert recording.times[-1] - made.times[-1] < 1 / new
    expected = moving(made.times, new)
    np.testing.assert_allclose(made.positions, expected.positions, atol=1e-9)
    np.testing.assert_allclose(made.quats_wxyz, expected.quats_wxyz, atol=1e-9)
    assert (made.status == SensorStatus.OK).all()
    # Causal: none arrives before the sample that it needs, nor later than the first one at or after its time.
    needed = recording.times[np.minimum(np.searchsorted(recording.times, made.times - 1e-6), len(recording) - 1)]
    np.testing.assert_array_equal(made.arrivals, needed)


def test_a_whole_multiple_takes_samples_untouched() -> None:
    recording = moving(np.round(np.arange(240) / 120, 4), 120.0)  # device times, rounded
    made = resample_recording(recording, 40.0)
    np.testing.assert_array_equal(made.positions, recording.positions[::3])
    np.testing.assert_array_equal(made.quats_wxyz, recording.quats_wxyz[::3])
    assert resample_recording(recording, 120.0) is recording


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_whole_and_in_parts_are_the_same(data: st.DataObject) -> None:
    """And what came later changes nothing that was there before."""
    old, new = (data.draw(st.floats(10.0, 240.0), label=name) for name in ("old", "new"))
    steps = data.draw(st.lists(st.sampled_from([1.0, 0.9, 1.1, 2.0, 7.0]), min_size=5, max_size=30), label="steps")
    times = np.cumsum([0.0, *steps]) / old
    missing = data.draw(st.lists(st.booleans(), min_size=len(times), max_size=len(times)), label="missing")
    recording = moving(times, old, np.stack([missing, np.zeros(len(times), bool), ~np.array(missing)], axis=1))
    resampler = Resampler(old, new)
    whole, state, states = [], ResamplerState(), []
    for index in range(len(recording)):
        states.append((state, len(whole)))
        state, made = resampler.step(state, recording.sample(index))
        whole += made
    cut = data.draw(st.integers(0, len(recording) - 1), label="cut")
    state, before = states[cut]
    again = whole[:before]
    for index in range(cut, len(recording)):
        state, made = resampler.step(state, recording.sample(index))
        again += made
    together = resample_recording(recording, new) if abs(old - new) > 1e-3 else None
    for each, other in zip(whole, again, strict=True):
        assert each.sample.time == other.sample.time
        np.testing.assert_array_equal(each.sample.positions, other.sample.positions)
    if together is not None:
        np.testing.assert_array_equal(together.positions, [each.sample.positions for each in whole])
        assert (np.diff(together.times) > 0).all()


def test_missing_stays_missing_and_a_slow_sensor_is_not_lost() -> None:
    times = np.arange(120) / 60
    missing = np.zeros((120, 3), bool)
    missing[30:60, 0] = True  # half a second away
    missing[1::2, 1] = True  # a sensor of half the rate
    made = resample_recording(moving(times, 60.0, missing), 40.0)
    gone = np.isnan(made.positions[:, 0, 0])
    inside = (made.times > 0.5) & (made.times < 0.975)
    assert gone[inside].all()
    assert not gone[(made.times < 0.49) | (made.times > 1.01)].any()
    assert (made.status[gone, 0] == SensorStatus.MISSING).all()
    came = np.isfinite(made.positions[:, 1, 0])
    assert came.mean() > 0.6
    late = made.positions[came, 1, 2] / 1.5 - made.times[came]
    assert np.abs(late).max() <= 0.5 / 40 + 1e-9
    assert not np.isnan(made.positions[:, 2]).any()


def test_nothing_is_made_up_across_a_gap() -> None:
    times = np.r_[np.arange(60) / 60, 3.0 + np.arange(60) / 60]
    made = resample_recording(moving(times, 60.0), 40.0)
    np.testing.assert_allclose(np.diff(made.times), 1 / 40, atol=1e-9)
    empty = np.isnan(made.positions).all(axis=(1, 2))
    assert empty[(made.times > 1.02) & (made.times < 2.98)].all()
    long = np.r_[np.arange(60) / 60, LONGEST_GAP + 2.0 + np.arange(60) / 60]
    made = resample_recording(moving(long, 60.0), 40.0)
    assert len(made) < 90
    assert (LONGEST_GAP + 2.0) in made.times


def test_the_truth_goes_along() -> None:
    times = np.arange(61) / 60
    q = np.zeros((61, BODY.size))
    q[:, 2], q[:, 4] = 1.5 * times, 0.7 * times
    recording = replace(moving(times, 60.0), truth=make_motion(BODY, q, 60.0))
    made = resample_recording(recording, 40.0)
    assert made.truth is not None
    assert made.truth.rate == 40.0
    np.testing.assert_allclose(made.truth.q[:, 2], 1.5 * made.times, atol=1e-9)
    np.testing.assert_allclose(made.truth.q[:, 4], 0.7 * made.times, atol=1e-9)


class Counting(Reconstructor[int]):
    """Counts samples; the height of the root is their number."""

    def __init__(self, rate: float, any_rate: bool) -> None:
        self.layout, self.any_rate = replace(THREE, rate=rate), any_rate

    def start(self, skeleton, placements) -> int:
        return 0

    def step(self, state, sample):
        q = np.zeros(BODY.size)
        q[1] = state
        return state + 1, Frame(sample.time, Pose(BODY, q), np.zeros(BODY.size), Health())


def test_a_method_of_one_rate_gets_its_rate_with_a_note_and_one_of_any_rate_what_there_is() -> None:
    recording = moving(np.arange(61) / 60, 60.0)
    bound, free = (reconstruct(Counting(40.0, any_rate), recording) for any_rate in (False, True))
    assert (len(bound.motion), bound.motion.rate) == (41, 40.0)
    assert bound.notes == ("the recording has 60 samples a second; they are resampled to the 40 that the method needs",)
    assert len(bound.recording) == 41
    assert (len(free.motion), free.motion.rate, free.notes) == (61, 60.0, ())
