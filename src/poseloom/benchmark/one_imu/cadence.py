"""Cadence: how often someone steps, told by a signal, and by the motion that was made of it."""

from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.methods.imus.phases import ankle_lead
from poseloom.sensors.recording import Recording
from poseloom.skeleton.motion import Motion

_WINDOW_SECONDS, _HOP_SECONDS = 5.0, 1.0
_STRIDE_SECONDS = (0.6, 2.4)
"""From running to strolling."""
_CLEAR = 0.6
"""Correlation of a signal with itself one stride later from which on it is a walk's."""


@dataclass(frozen=True, eq=False)
class Cadences:
    """Steps a minute in windows of five seconds, second by second, where the signal repeats itself.

    Attributes:
        times: Middle of each window, seconds.
        signal: Told by the sensor.
        motion: Told by the motion; NaN where that does not repeat itself.
    """

    times: Floats[Array, "windows"]
    signal: Floats[Array, "windows"]
    motion: Floats[Array, "windows"]

    @property
    def agreeing(self) -> float:
        """Share of windows in which the motion's cadence is within 5 % of the signal's; NaN for no window."""
        if len(self.times) == 0:
            return float("nan")
        close = np.asarray(np.abs(self.motion / self.signal - 1) < 0.05, dtype=np.float64)
        return float(close.mean())


def stride_seconds(series: Floats[Array, "samples channels"], rate: float) -> tuple[float, float]:
    """After how long a series repeats itself best, between 0.6 and 2.4 s, and its correlation with itself then.

    All channels count together, each by its variance. The shortest lag whose peak is nearly the highest is taken: a
    walk repeats itself after two strides as well.
    """
    moving = series - series.mean(axis=0)
    lags = np.arange(int(_STRIDE_SECONDS[0] * rate), min(int(_STRIDE_SECONDS[1] * rate), len(series) - 2) + 1)
    likeness = np.empty(len(lags))
    for i, lag in enumerate(lags):
        first, second = moving[:-lag], moving[lag:]
        size = np.sqrt(np.sum(first**2) * np.sum(second**2))
        likeness[i] = np.sum(first * second) / max(float(size), 1e-12)
    inner = np.flatnonzero((likeness[1:-1] >= likeness[:-2]) & (likeness[1:-1] >= likeness[2:])) + 1
    if inner.size == 0:
        return float("nan"), 0.0
    good = inner[likeness[inner] > 0.9 * likeness[inner].max()]
    best = int(good[0]) if good.size else int(inner[np.argmax(likeness[inner])])
    return float(lags[best] / rate), float(likeness[best])


def compare_cadences(recording: Recording, motion: Motion, first: int = 0) -> Cadences:
    """Cadences of a recording's first sensor and of what a method made of it.

    Args:
        recording: Of IMUs.
        motion: Frame i belongs to sample `first` + i.
        first: The sample of the motion's first frame.
    """
    rate = recording.layout.rate
    said = np.concatenate([recording.specific_forces[:, 0] / 9.81, recording.angular_rates[:, 0]], axis=1)
    known = np.asarray(np.isfinite(said).all(axis=1))
    places = np.arange(len(said))
    bridged = np.stack([np.interp(places, places[known], said[known, c]) for c in range(said.shape[1])], axis=1)
    steps = _steps(motion)
    width, hop = round(_WINDOW_SECONDS * rate), round(_HOP_SECONDS * rate)
    times: list[float] = []
    pairs: list[tuple[float, float]] = []
    for begin in range(first, first + len(motion) - width + 1, hop):
        stride, clear = stride_seconds(bridged[begin : begin + width], rate)
        if clear < _CLEAR or np.count_nonzero(known[begin : begin + width]) < 0.7 * width:
            continue
        made, _ = stride_seconds(steps[begin - first : begin - first + width], rate)
        times.append(float(recording.times[begin + width // 2]))
        pairs.append((120 / stride, 120 / made))
    both = np.array(pairs).reshape(-1, 2)
    return Cadences(np.array(times), both[:, 0], both[:, 1])


def _steps(motion: Motion) -> Floats[Array, "frames 3"]:
    """What a stride repeats: how far one ankle leads, and the bend of both knees; each in units of its own spread."""
    skeleton = motion.skeleton
    knees = [np.linalg.norm(motion.rotvecs[:, skeleton.index(f"{side}LowerLeg")], axis=1) for side in ("left", "right")]
    series = np.stack([ankle_lead(motion), *knees], axis=1)
    return series / np.maximum(series.std(axis=0), 1e-6)
