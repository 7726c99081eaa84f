"""A recording of another rate than a method's: the one rule by which it is resampled, everywhere.

The samples of the new rate lie evenly from the first sample on. Each is interpolated between the sample before it and
the sample after it: vectors and counts in straight lines, quaternions by slerp. It is causal: a new sample needs
nothing later than the first old sample at or after its own time, and arrives when that one does. A new time that
coincides with an old one takes the old values untouched, so 120 to 40 Hz takes every third sample. Nothing is smoothed.

Missing values stay missing. Where only one of the two samples has a sensor's value, that value is taken if it is at
most half a new period away. Across a gap in the times nothing is interpolated: the new samples in it are empty, and
after a gap of more than `LONGEST_GAP` seconds they begin again at the next sample.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import frozen, frozen_float
from poseloom.rotations import slerp
from poseloom.sensors.layout import SensorLayout
from poseloom.sensors.recording import CHANNEL_SHAPES, Recording
from poseloom.sensors.sample import Sample, SensorStatus
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors

LONGEST_GAP = 10.0
"""Seconds without any sample that are filled with empty ones."""

_COINCIDENCE = 1e-3
"""Times this near to an old sample's, in periods, count as that sample's: device times are rounded."""
_GAP = 2.5
"""Periods between two samples, of the slower rate, beyond which nothing is interpolated."""
_SAME = 1e-6
"""Rates that differ by less than this share are the same."""


def same_rate(one: float, other: float) -> bool:
    """Whether two rates, samples a second, are the same."""
    return abs(one - other) <= _SAME * max(one, other)


@dataclass(frozen=True, eq=False)
class ResamplerState:
    """What changes from sample to sample.

    Attributes:
        last: The newest sample; None before the first.
        origin: Time of the first new sample.
        count: New samples since then.
    """

    last: Sample | None = None
    origin: float = 0.0
    count: int = 0


@dataclass(frozen=True, eq=False)
class Resampled:
    """A new sample.

    Attributes:
        sample: The sample.
        fraction: Where it lies between the sample before, 0, and the newest one, 1.
    """

    sample: Sample
    fraction: float


@dataclass(frozen=True)
class Resampler:
    """Turns samples of one rate into samples of another, one at a time.

    Attributes:
        old: Samples a second that come.
        new: Samples a second that are wanted.
    """

    old: float
    new: float

    def step(self, state: ResamplerState, sample: Sample) -> tuple[ResamplerState, tuple[Resampled, ...]]:
        """Takes in one sample, later than the last; returns the new ones up to its time. Changes neither argument."""
        if state.last is None or sample.time - state.last.time > LONGEST_GAP:
            return ResamplerState(sample, sample.time, 1), (Resampled(sample, 1.0),)
        near = _COINCIDENCE / max(self.old, self.new)
        made: list[Resampled] = []
        count = state.count
        while (time := state.origin + count / self.new) <= sample.time + near:
            made.append(self._at(state.last, sample, time, near))
            count += 1
        return replace(state, last=sample, count=count), tuple(made)

    def _at(self, before: Sample, after: Sample, time: float, near: float) -> Resampled:
        if time >= after.time - near:
            return Resampled(replace(after, time=time), 1.0)
        fraction = (time - before.time) / (after.time - before.time)
        joined = after.time - before.time <= _GAP / min(self.old, self.new)
        reach = 0.5 / self.new * (1 + 1e-9)
        columns = {
            name: _between(
                name, getattr(before, name), getattr(after, name), fraction, joined,
                time - before.time <= reach, after.time - time <= reach,
            )
            for name in CHANNEL_SHAPES
        }  # fmt: skip
        status = _status(before, after, fraction, columns)
        return Resampled(Sample(time, after.arrival, **columns, status=status), fraction)


def resample_recording(recording: Recording, rate: float) -> Recording:
    """A recording at another rate by the rule above, with its ground truth; the same one where the rates are the same.

    Args:
        recording: The samples.
        rate: Samples a second.
    """
    old = recording.layout.rate
    if same_rate(old, rate):
        return recording
    resampler, state = Resampler(old, rate), ResamplerState()
    made: list[Resampled] = []
    owners: list[int] = []
    for index in range(len(recording)):
        state, new = resampler.step(state, recording.sample(index))
        made += new
        owners += [index] * len(new)
    samples = [each.sample for each in made]
    truth = recording.truth
    if truth is not None:
        truth = _truth(truth, np.array(owners), np.array([each.fraction for each in made]), rate)
    return replace(
        recording,
        layout=at_rate(recording.layout, rate),
        times=frozen_float([sample.time for sample in samples]),
        arrivals=frozen_float([sample.arrival for sample in samples]),
        **{name: frozen_float(np.stack([getattr(sample, name) for sample in samples])) for name in CHANNEL_SHAPES},
        status=frozen(np.stack([sample.status for sample in samples])),
        truth=truth,
    )


def at_rate(layout: SensorLayout, rate: float) -> SensorLayout:
    """The same sensors at another rate."""
    return replace(layout, rate=float(rate))


def _truth(truth: Motion, owners: NDArray[np.int64], fraction: NDArray[np.float64], rate: float) -> Motion:
    q = truth.q[owners].copy()
    between = np.flatnonzero(fraction < 1.0)
    if between.size:
        after = owners[between]
        q[between] = interpolate_pose_vectors(truth.q[after - 1], truth.q[after], fraction[between])
    return make_motion(truth.skeleton, q, rate, truth.name)


def _between(
    name: str,
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    fraction: float,
    joined: bool,
    near_before: bool,
    near_after: bool,
) -> NDArray[np.float64]:
    """One channel of all sensors at a fraction of the way."""
    flat = (len(before), -1)
    first, second = (np.isfinite(values.reshape(flat)).all(axis=1) for values in (before, after))
    out = np.full_like(before, np.nan)
    both = first & second & joined
    if both.any():
        if name == "quats_wxyz":
            out[both] = slerp(before[both], after[both], np.full(int(both.sum()), fraction))
        else:
            out[both] = (1 - fraction) * before[both] + fraction * after[both]
    alone = ~both
    if near_before and (not near_after or fraction <= 0.5):
        first_choice, second_choice = (before, first & near_before), (after, second & near_after)
    else:
        first_choice, second_choice = (after, second & near_after), (before, first & near_before)
    for values, there in (second_choice, first_choice):
        taken = alone & there
        out[taken] = values[taken]
    return out


def _status(
    before: Sample, after: Sample, fraction: float, columns: dict[str, NDArray[np.float64]]
) -> NDArray[np.int64]:
    """The nearer sample's status, or the other's where the nearer has none; missing where no value is."""
    nearer, other = (before, after) if fraction <= 0.5 else (after, before)
    status = np.where(nearer.status == SensorStatus.MISSING, other.status, nearer.status)
    came = np.zeros(len(status), dtype=np.bool_)
    for values in columns.values():
        came |= np.isfinite(values.reshape(len(status), -1)).any(axis=1)
    # A sensor that is late has no value, and keeps saying so.
    gone = ~came & (status != SensorStatus.LATE)
    return np.where(gone, int(SensorStatus.MISSING), np.where(came & (status == SensorStatus.MISSING), 0, status))
