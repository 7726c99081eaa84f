"""What is believed of one flex channel, sample by sample, compiled (see `flex_range`)."""

import math

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import compiled

OK, MISSING, SATURATED, STUCK = 0, 1, 3, 4
"""Values of `SensorStatus`."""

DOUBT, BELIEVE, NEW = 0, 1, 2
"""Verdicts on a reading."""

# Columns of a channel's state. "Odd" readings are those that no joint's motion explains.
LOW, HIGH, VALUE, BEFORE, TIME, SPEED, BORN, ODD_SAMPLES, ODD_SINCE, ODD_VALUE = range(10)
STEP, STEP_SINCE, STEP_LOW, KINK, RAW, RAW_TIME, RAW_2, RAW_TIME_2, RAW_3, RAW_TIME_3 = range(10, 20)
RUN_VALUE, RUN_LENGTH, RUN_SINCE, MEAN_RUN, HEARD = range(20, 25)
COLUMNS = 25

# Columns of the settings, in the order of `FlexRange`'s attributes.
TYPICAL, LEAST, MOST, LEAP, ACCELERATION, STRIDE, JERK, BEYOND = range(8)
ODD_SECONDS, NEW_SECONDS, STUCK_SECONDS, STUCK_RUNS, LEAK_LEAST, LEAK_MOST, HIGH_LEAK = range(8, 15)

_LONGEST_STEP = 0.2
"""Seconds: what a longer gap hides teaches nothing."""

_KINK_SECONDS = 60.0
"""Seconds after which a kink is two thirds forgotten."""

_KINKS = 2.0
"""How many times larger than the kinks of the last minute a step must be."""

_LARGEST_KINK = 0.15
"""Share of the span above which a kink counts no more: a glitch must not hide a replaced sensor for minutes."""

_INWARDS = 0.1
"""Share of the span that pulls the ends inwards at most."""


@compiled
def _restart(state: NDArray[np.float64], now: float, low: float, count: float) -> None:
    """Begins to learn a sensor that stands at `count` and, as far as is known, at `low` when straight."""
    state[LOW] = low
    state[HIGH] = count
    state[VALUE] = count
    state[BEFORE] = count
    state[TIME] = now
    state[SPEED] = 0.0
    state[BORN] = now
    state[ODD_SAMPLES] = 0.0
    state[STEP] = 0.0


@compiled
def _step_between(
    settings: NDArray[np.float64], state: NDArray[np.float64], now: float, count: float, span: float
) -> bool:
    """Whether the readings went on at another level some time ago, and stayed there.

    Between the last reading but one and the last there is a step as far as no speed between those before and after
    leads from one to the other. Of smooth motion only the jerk remains in that difference. A channel whose readings
    have kinks all the time must make a far larger step to be noticed; a step that another follows soon is none.
    """
    before, middle, after = (
        state[RAW_TIME_2] - state[RAW_TIME_3],
        state[RAW_TIME] - state[RAW_TIME_2],
        now - state[RAW_TIME],
    )
    if max(before, middle, after) < _LONGEST_STEP:  # not so as long as one is NaN
        earlier, later = (state[RAW_2] - state[RAW_3]) / before, (count - state[RAW]) / after
        speed = (state[RAW] - state[RAW_2]) / middle
        step = (speed - min(max(speed, min(earlier, later)), max(earlier, later))) * middle
        state[KINK] *= math.exp(-middle / _KINK_SECONDS)
        usual = span * (settings[STRIDE] + settings[JERK] * middle * middle * middle)
        if state[STEP] != 0.0 and abs(step) > 0.5 * abs(state[STEP]):
            state[KINK] = max(state[KINK], min(abs(state[STEP]), _LARGEST_KINK * span))
            state[STEP] = 0.0
        elif state[STEP] == 0.0 and abs(step) > max(usual, _KINKS * state[KINK]):
            state[STEP] = step
            state[STEP_SINCE] = now
            state[STEP_LOW] = state[LOW]
        else:
            state[KINK] = max(state[KINK], min(abs(step), _LARGEST_KINK * span))
    state[RAW_3], state[RAW_TIME_3] = state[RAW_2], state[RAW_TIME_2]
    state[RAW_2], state[RAW_TIME_2] = state[RAW], state[RAW_TIME]
    state[RAW], state[RAW_TIME] = count, now
    return state[STEP] != 0.0 and now - state[STEP_SINCE] >= settings[NEW_SECONDS]


@compiled
def _repeats(settings: NDArray[np.float64], state: NDArray[np.float64], now: float, count: float) -> bool:
    """Whether the same count comes again and again, longer than this channel's noise and stillness explain."""
    if count == state[RUN_VALUE]:
        state[RUN_LENGTH] += 1.0
    else:
        if state[RUN_LENGTH] > 0.0:
            length = min(state[RUN_LENGTH], settings[STUCK_RUNS] * state[MEAN_RUN])
            state[MEAN_RUN] += 0.02 * (length - state[MEAN_RUN])
        state[RUN_VALUE] = count
        state[RUN_LENGTH] = 1.0
        state[RUN_SINCE] = now
    long = state[RUN_LENGTH] > settings[STUCK_RUNS] * state[MEAN_RUN]
    return long and now - state[RUN_SINCE] >= settings[STUCK_SECONDS]


@compiled
def _accept(settings: NDArray[np.float64], state: NDArray[np.float64], now: float, count: float) -> None:
    """Lets a sound reading teach the range: at once outwards, if two in a row agree, and slowly inwards."""
    step = now - state[TIME]
    leak = min(step, _LONGEST_STEP) / min(max(now - state[BORN], settings[LEAK_LEAST]), settings[LEAK_MOST])
    lowest, highest = max(count, state[BEFORE]), min(count, state[BEFORE])
    # Not in proportion to the distance: a joint that swings widely would lift its low end between two swings.
    most = _INWARDS * max(state[HIGH] - state[LOW], settings[TYPICAL])
    state[LOW] += leak * min(max(count - state[LOW], 0.0), most)
    state[HIGH] -= leak / settings[HIGH_LEAK] * min(max(state[HIGH] - count, 0.0), most)
    state[HIGH] = max(state[HIGH], highest)
    state[LOW] = min(state[LOW], lowest, state[HIGH])
    state[SPEED] = (count - state[VALUE]) / step if step > 0.0 else 0.0
    state[BEFORE] = state[VALUE]
    state[VALUE] = count
    state[TIME] = now
    state[ODD_SAMPLES] = 0.0


@compiled
def _weigh_odd(
    settings: NDArray[np.float64], state: NDArray[np.float64], now: float, count: float, span: float, inside: bool
) -> int:
    """What to do with an odd reading: DOUBT it, BELIEVE it as quick motion, or take it for another sensor's (NEW)."""
    near = span * (2.0 * settings[LEAP] + 10.0 * (now - state[HEARD]))
    if state[ODD_SAMPLES] == 0.0 or abs(count - state[ODD_VALUE]) > near:
        state[ODD_SAMPLES] = 0.0
        state[ODD_SINCE] = now
    state[ODD_SAMPLES] += 1.0
    state[ODD_VALUE] = count
    lasted = now - state[ODD_SINCE]
    if inside:
        return BELIEVE if state[ODD_SAMPLES] >= 2.0 and lasted >= settings[ODD_SECONDS] else DOUBT
    return NEW if state[ODD_SAMPLES] >= 2.0 and lasted >= settings[NEW_SECONDS] else DOUBT


@compiled
def _judge(settings: NDArray[np.float64], state: NDArray[np.float64], now: float, count: float) -> int:
    """BELIEVE, DOUBT or NEW for a reading that is neither missing, nor saturated, nor stuck; teaches the range."""
    if math.isnan(state[VALUE]):
        _restart(state, now, count, count)
        return BELIEVE
    span = max(state[HIGH] - state[LOW], settings[TYPICAL])
    if _step_between(settings, state, now, count, span):
        # The joint went on as it was: as far as the level stepped, the straight joint's reading did.
        _restart(state, now, min(state[STEP_LOW] + state[STEP], count), count)
        return NEW
    since = now - state[TIME]
    leap = abs(count - state[VALUE] - state[SPEED] * min(since, 0.05))
    upper = max(state[HIGH], state[LOW] + span)
    inside = state[LOW] - settings[BEYOND] * span <= count <= upper + settings[BEYOND] * span
    verdict = BELIEVE
    if not inside or leap > span * (settings[LEAP] + settings[ACCELERATION] * since * since):
        verdict = _weigh_odd(settings, state, now, count, span, inside)
    if verdict == BELIEVE:
        _accept(settings, state, now, count)
    elif verdict == NEW:
        bent = min(max((state[VALUE] - state[LOW]) / span, 0.0), 1.0)
        _restart(state, now, count - bent * settings[TYPICAL], count)
    return verdict


@compiled
def follow_channel(
    settings: NDArray[np.float64],
    times: NDArray[np.float64],
    counts: NDArray[np.float64],
    state: NDArray[np.float64],
    values: NDArray[np.float64],
    lows: NDArray[np.float64],
    highs: NDArray[np.float64],
    status: NDArray[np.int64],
    replaced: NDArray[np.bool_],
) -> None:
    """Takes in `counts` (samples) of one channel and fills the five columns of the same length; `state` moves on."""
    for i in range(len(times)):
        now, count = times[i], counts[i]
        status[i] = OK
        replaced[i] = False
        values[i] = np.nan
        if math.isnan(count):
            status[i] = MISSING
        elif count <= settings[LEAST] or count >= settings[MOST]:
            status[i] = SATURATED
        elif _repeats(settings, state, now, count):
            status[i] = STUCK
        if status[i] == OK:
            verdict = _judge(settings, state, now, count)
            status[i] = MISSING if verdict == DOUBT else OK
            replaced[i] = verdict == NEW
        else:
            state[ODD_SAMPLES] = 0.0
        state[HEARD] = now
        lows[i], highs[i] = state[LOW], state[HIGH]
        if status[i] == OK:
            values[i] = (count - state[LOW]) / max(state[HIGH] - state[LOW], settings[TYPICAL])
