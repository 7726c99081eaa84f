"""Clocks of small devices: units that nobody wrote down, counters that wrap, restarts, and stamps that are garbage."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.errors import FormatError

_UNITS = (1.0, 1e-3, 1e-6)
_FASTEST, _SLOWEST = 500.0, 5.0
"""Samples a second between which a device's rate is looked for."""

_WRAPS = (2.0**16, 2.0**32, 86_400.0, 43_200.0)
"""Numbers of ticks after which clocks begin again: counters of 16 and 32 bits, and a day or half of it in seconds."""

_LONGEST = 3600.0
"""Seconds that a stamp may lie after the one before; from there on it is garbage."""


@dataclass(frozen=True, eq=False)
class Clock:
    """Times made out of stamps.

    Attributes:
        times: Seconds from the first sample, increasing.
        kept: Index of the stamp of each.
        rate: Samples a second: one over the median step.
        unit: Seconds of one tick.
        events: What happened to the clock: wraps, restarts, in words.
    """

    times: Floats[Array, "samples"]
    kept: Ints[Array, "samples"]
    rate: float
    unit: float
    events: tuple[str, ...]


def read_clock(stamps: Floats[Array, "stamps"], unit: float | None = None, file: Path | None = None) -> Clock:
    """Makes increasing times of a device's stamps.

    A stamp that goes back and is followed by others from there on is a counter that wrapped, if it was near one's end,
    or else a restart, after which time goes on by one median step. A single stamp out of order is left out.

    Args:
        stamps: In the device's ticks.
        unit: Seconds of one tick; found from the median step if left out.
        file: For the error's message.

    Raises:
        FormatError: if no unit gives a rate between 5 and 500 Hz, or fewer than three stamps can be used.
    """
    steps = np.diff(stamps)
    forward = steps[steps > 0]
    if len(forward) < 2:
        raise FormatError(
            "the times do not increase",
            remedy="Give a time column that does, or leave it out and give the rate",
            file=file,
        )
    usual = float(np.median(forward))
    tick = unit if unit is not None else _find_unit(usual, file)
    kept, shifts, events = [0], [0.0], list[str]()
    shift = 0.0
    for at in range(1, len(stamps)):
        last = float(stamps[kept[-1]])
        step = float(stamps[at]) + shift - (last + shifts[-1])
        if 0 < step <= _LONGEST / tick:
            if _returns(stamps, at, last, step, usual):
                continue
        elif step > 0 or not _goes_on(stamps, at, last, usual):
            continue
        else:
            shift += _wrap(-step, usual, tick, events)
        kept.append(at)
        shifts.append(shift)
    times = (stamps[kept] + np.array(shifts)) * tick
    if len(times) < 3:
        raise FormatError("fewer than three times are in order", remedy="Give the rate instead", file=file)
    return Clock(times - times[0], np.array(kept, dtype=np.int64), _rate(times), tick, tuple(events))


def _find_unit(usual: float, file: Path | None) -> float:
    for unit in _UNITS:
        if _SLOWEST <= 1 / (usual * unit) <= _FASTEST:
            return unit
    raise FormatError(
        f"times {usual:g} apart are neither seconds, nor milli-, nor microseconds",
        cause=f"none gives between {_SLOWEST:g} and {_FASTEST:g} lines a second",
        remedy="Say the unit (--unit 0.001 for milliseconds)",
        file=file,
    )


def _returns(stamps: Floats[Array, "stamps"], at: int, last: float, step: float, usual: float) -> bool:
    """Whether a stamp leaps ahead and the next ones are back where they should be: it is garbage."""
    later = stamps[at + 1 : at + 3]
    if step <= 3 * usual or len(later) == 0:
        return False
    return bool(((later > last) & (later < stamps[at])).all())


def _goes_on(stamps: Floats[Array, "stamps"], at: int, last: float, usual: float) -> bool:
    """Whether the clock goes on from a stamp that lies behind, and not from the one before it."""
    steps = np.diff(stamps[at : at + 4])
    if len(steps) == 0 or 0 < stamps[at + 1] - last < 20 * usual:
        return False
    return bool((steps > 0).all() and (steps < 20 * usual).all())


def _wrap(back: float, usual: float, tick: float, events: list[str]) -> float:
    """Ticks to add after a clock went `back` by so many."""
    for wrap in _WRAPS:
        length = wrap if wrap in _WRAPS[:2] else wrap / tick
        if 0 < length - back < 50 * usual:
            events.append(f"the counter wrapped after {length:.6g} ticks")
            return length
    events.append("the device restarted")
    return back + usual


def _rate(times: Floats[Array, "samples"]) -> float:
    """One over the median step, rounded to four digits: the stamps of a slow clock are coarse."""
    step = float(np.median(np.diff(times)))
    near = np.diff(times)[np.abs(np.diff(times) - step) < 0.5 * step]
    rate = 1 / (float(near.mean()) if len(near) else step)
    digits = 3 - math.floor(math.log10(rate))
    return round(rate, digits)
