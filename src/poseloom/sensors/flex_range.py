"""What a flex sensor's counts mean, learnt on line: its range and baseline, and when not to believe it."""

import math
from dataclasses import astuple, dataclass, fields
from functools import cache

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.errors import SensorError
from poseloom.sensors import flex_range_kernels as kernels


@dataclass(frozen=True, eq=False)
class FlexRangeState:
    """What is known of each channel so far (opaque; see `flex_range_kernels`)."""

    columns: Floats[Array, "channels columns"]


@dataclass(frozen=True, eq=False)
class FlexReadings:
    """What is believed of samples; a leading axis of samples is missing for a single one.

    Attributes:
        values: Counts normalised by the range known at that time: 0 straight, 1 the range's end; NaN where nothing is
            believed. Above 1 and below 0 for a moment only.
        low: Baseline: the reading of the straight joint, as known then, counts; NaN before the first sound reading.
        high: The highest reading known then, counts.
        status: `SensorStatus`: OK, MISSING (nothing came, or a leap that no joint makes), SATURATED or STUCK.
        replaced: Where another sensor was noticed: its range is learnt afresh from here on.
    """

    values: Floats[Array, "*samples channels"]
    low: Floats[Array, "*samples channels"]
    high: Floats[Array, "*samples channels"]
    status: Ints[Array, "*samples channels"]
    replaced: Bools[Array, "*samples channels"]


@dataclass(frozen=True)
class FlexRange:
    """Learns each channel's range as samples come, and looks for faults. State is explicit: `start`, `step`.

    The low end is the lowest reading that two samples in a row confirmed; it rises slowly, for baselines creep with
    use. The high end is the highest one and sinks still more slowly. The span for normalising is the span seen, but
    not less than `typical_span`: a person who walks never bends an elbow fully.

    A leap that no joint's acceleration explains is doubted for a moment. If the readings go on as before but at another
    level, or outside all that was known, another sensor is worn (or this one has slipped), and its range is learnt
    afresh; if they come back, it was a glitch. Channels whose readings have kinks all the time must step further.

    Attributes:
        typical_span: Counts between a straight and a fully bent joint, for a usual sensor on this board.
        least: Counts up to which the reading is saturated (0: the converter's end).
        most: Counts from which on it is.
        leap: Leaps up to this share of the span are never doubted ...
        acceleration: ... nor those that joints make with this acceleration, spans a second squared; 100 is about 15,000
            degrees a second squared.
        stride: Steps from one level to another are noticed from this share of the span on ...
        jerk: ... and from what joints with this jerk make look like a step, spans a second cubed.
        beyond: Share of the span outside the known range from which on a reading is doubted.
        odd_seconds: Time for which doubt lasts at least.
        new_seconds: Time after which readings at another level are taken for another sensor's.
        stuck_seconds: Time for which the same count must repeat until it counts as stuck.
        stuck_runs: How much longer than the channel's mean run of equal counts that must be, in addition.
        leak_least: Seconds in which the low end rises to readings that stay above it (by 63 % of their distance if they
            are near, else by a tenth of the span), for a sensor just met.
        leak_most: The same for one long known.
        high_leak: How many times longer the high end takes to sink.
    """

    typical_span: float = 2000.0
    least: float = 0.0
    most: float = 4095.0
    leap: float = 0.05
    acceleration: float = 100.0
    stride: float = 0.06
    jerk: float = 1200.0
    beyond: float = 0.3
    odd_seconds: float = 0.06
    new_seconds: float = 0.3
    stuck_seconds: float = 0.5
    stuck_runs: float = 14.0
    leak_least: float = 10.0
    leak_most: float = 600.0
    high_leak: float = 6.0

    def start(self, channels: int) -> FlexRangeState:
        """The state before the first sample.

        Raises:
            SensorError: if a parameter makes no sense.
        """
        for each in fields(self):
            value = getattr(self, each.name)
            if not math.isfinite(value) or value < 0 or (value == 0 and each.name != "least"):
                raise SensorError(f"the flex range's {each.name} is {value}", remedy="Give a positive, finite number")
        columns = np.full((channels, kernels.COLUMNS), np.nan)
        columns[:, [kernels.ODD_SAMPLES, kernels.STEP, kernels.KINK, kernels.RUN_LENGTH]] = 0.0
        columns[:, kernels.MEAN_RUN] = 2.0
        return FlexRangeState(columns)

    def step(
        self, state: FlexRangeState, time: float, counts: Floats[Array, "channels"]
    ) -> tuple[FlexRangeState, FlexReadings]:
        """Takes in one sample; changes neither argument.

        Args:
            state: What was known before.
            time: Device time, seconds, later than the last one.
            counts: NaN where nothing came.
        """
        after, read = self.follow(state, np.array([time]), counts[None])
        return after, FlexReadings(read.values[0], read.low[0], read.high[0], read.status[0], read.replaced[0])

    def follow(
        self, state: FlexRangeState, times: Floats[Array, "samples"], counts: Floats[Array, "samples channels"]
    ) -> tuple[FlexRangeState, FlexReadings]:
        """Takes in many samples at once: the same as `step` after `step`, but fast."""
        columns = state.columns.copy()
        settings = _as_array(self)
        shape = counts.T.shape
        values, lows, highs = (np.empty(shape) for _ in range(3))
        status, replaced = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.bool_)
        by_channel = np.ascontiguousarray(counts.T)
        for i, column in enumerate(columns):
            kernels.follow_channel(
                settings, times, by_channel[i], column, values[i], lows[i], highs[i], status[i], replaced[i]
            )
        filled = (np.ascontiguousarray(each.T) for each in (values, lows, highs, status, replaced))
        return FlexRangeState(columns), FlexReadings(*filled)


@cache
def _as_array(ranges: FlexRange) -> Floats[Array, "settings"]:
    return np.array(astuple(ranges))  # kernels only read it
