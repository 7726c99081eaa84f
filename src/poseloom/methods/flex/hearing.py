"""From counts at any rate to what a network hears fifty times a second, causally."""

from dataclasses import dataclass, replace

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import MethodError

UNHEARD = 0.3
"""What stands for a channel that has never spoken: a usual bend, as a share of the range."""

LONGEST_GAP = 1.0
"""Seconds: over a longer silence of the whole device nothing is filled in; the network goes on from where it was."""

_NEAR = 0.1
"""Instants this near to a tick, in ticks, count as the tick: devices stamp with jitter."""


@dataclass(frozen=True, eq=False)
class Hearing:
    """Where the clock of a network stands.

    Attributes:
        tick: Device time of the network's last tick, seconds.
        time: Device time of the last sample.
        values: What was heard then of each channel.
        measured: 1 where it was measured, 0 where it was carried on.
    """

    tick: float
    time: float
    values: Floats[Array, "channels"]
    measured: Floats[Array, "channels"]


@dataclass(frozen=True, eq=False)
class Moment:
    """What a network is to hear.

    Attributes:
        values: Of each channel, as a share of its range.
        measured: 1 where it was measured, 0 where it was carried on.
    """

    values: Floats[Array, "channels"]
    measured: Floats[Array, "channels"]


def carried_on(values: Floats[Array, "frames channels"]) -> Floats[Array, "frames channels"]:
    """Values with each gap filled by the last one before it, and `UNHEARD` before the first."""
    rows = np.where(np.isfinite(values), np.arange(len(values))[:, None], -1)
    last = np.maximum.accumulate(rows, axis=0)
    held = np.take_along_axis(values, np.maximum(last, 0), axis=0)
    return np.where(last >= 0, held, UNHEARD)


def hear_first(time: float, values: Floats[Array, "channels"]) -> tuple[Hearing, tuple[Moment, ...]]:
    """Begins the clock with the first sample, which is a tick."""
    measured = np.isfinite(values).astype(np.float64)
    moment = Moment(np.where(measured > 0, values, UNHEARD), measured)
    return Hearing(time, time, moment.values, measured), (moment,)


def hear_next(
    hearing: Hearing, time: float, values: Floats[Array, "channels"], rate: float
) -> tuple[Hearing, tuple[Moment, ...], Moment | None]:
    """Takes in one sample.

    Args:
        hearing: Where the clock stood.
        time: Device time of the sample, later than the last one.
        values: NaN where nothing is believed.
        rate: Ticks a second.

    Returns:
        Where the clock stands now; the moments at the ticks since, on straight lines between the samples; and the
        sample itself where it lies between two ticks, for a network to look ahead to without moving its clock.

    Raises:
        MethodError: if the time does not increase.
    """
    if not time > hearing.time:
        raise MethodError(
            f"a sample of {time:g} s came after one of {hearing.time:g} s",
            remedy="Give the samples in the order of their times",
        )
    measured = np.isfinite(values).astype(np.float64)
    now = Moment(np.where(measured > 0, values, hearing.values), measured)
    if time - hearing.time > LONGEST_GAP:
        return Hearing(time, time, now.values, measured), (now,), None
    ahead = (time - hearing.tick) * rate
    ticks = int(np.floor(ahead + _NEAR))
    moments = tuple(_between(hearing, now, time, hearing.tick + (k + 1) / rate) for k in range(ticks))
    on_tick = abs(ahead - ticks) <= _NEAR and ticks > 0
    # A device's clock that runs a little fast or slow pulls the ticks along; without that they would drift apart.
    tick = time if on_tick else hearing.tick + ticks / rate
    after = replace(hearing, tick=tick, time=time, values=now.values, measured=measured)
    return after, (*moments[:-1], now) if on_tick else moments, None if on_tick else now


def _between(hearing: Hearing, now: Moment, time: float, tick: float) -> Moment:
    way = min(max((tick - hearing.time) / (time - hearing.time), 0.0), 1.0)
    values = (1 - way) * hearing.values + way * now.values
    return Moment(values, np.minimum(hearing.measured, now.measured) if way < 1 else now.measured)
