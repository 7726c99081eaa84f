"""The time column of a table: which it is, in what unit it counts, and what it says in seconds."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats.column_names import COUNT, TIME, TIME_UNITS, Column
from poseloom.formats.text_tables import Table, is_number

INDEX = "index"
"""As a unit of time: rows are counted, and the rate is given."""

_SLOWEST, _FASTEST = 4.0, 2500.0
"""Samples a second between which the rate is looked for where nobody says the unit: never true of two units."""
_LEAST, _MOST = 0.5, 20_000.0
"""Samples a second that a sensor may have."""
_REPEATED = 0.05
"""Share of samples that may repeat the time before; more means that the clock is too coarse."""
_ROUNDED = 0.01
"""Difference of median and mean step, as a share, above which the stamps are coarse and the mean is nearer."""
_WRAPS = (2.0**16, 2.0**32)
_CLOCK = re.compile(
    r"(?:\S*\d[T ]\s*)?(?:(\d{1,2}):)?(\d{1,2}):(\d{2})(?:[.,:](\d{1,9}))?\s*(?:(am|pm)|z|utc|[+-]\d{2}:?\d{2})?",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class TimeChoice:
    """What the user says about times.

    Attributes:
        rate: Samples a second, for tables that count samples.
        unit: A key of TIME_UNITS, `index`, or seconds of one tick as a number; empty where it is to be found.
        column: The column's name; empty where it is to be found.
        stated: Samples a second as the file's comments say.
    """

    rate: float | None = None
    unit: str = ""
    column: str = ""
    stated: float | None = None


NO_CHOICE = TimeChoice()


def table_times(
    table: Table, columns: Sequence[Column], choice: TimeChoice = NO_CHOICE
) -> tuple[Floats[Array, "rows"], str]:
    """Seconds of each row, and a sentence that says how they were found.

    Raises:
        FormatError: where there is no time and no rate, a unit makes an impossible rate, or many times repeat.
    """
    rate = choice.rate
    if rate is not None and not _LEAST <= rate <= _MOST:
        raise FormatError(f"{rate:g} samples a second", remedy=f"Give {_LEAST:g} to {_MOST:g}", file=table.file)
    told, counted = _candidates(table, columns, choice)
    if told is not None and choice.unit != INDEX:
        place, stamps, clock = told
        unit, how = _unit(table, place, stamps, columns[place].unit, choice.unit, clock)
        if unit:
            return _seconds(table, place, stamps, unit, how, rate)
    pace = rate if rate is not None else choice.stated
    if pace is None or not _LEAST <= pace <= _MOST:
        named = f"{_label(table, told[0])} goes up by one a row" if told else "no column holds a time"
        raise FormatError(
            "the table counts samples, and does not say how many come a second",
            cause=named,
            remedy="Name the rate (--source-rate HZ)" + (", or the unit (--time-unit ms)" if told else ""),
            file=table.file,
        )
    rows = np.arange(len(table.rows), dtype=np.float64) if counted is None else counted
    said = "as given" if rate is not None else "as the file says"
    return (rows - rows[0]) / pace, f"time from the samples' number: {pace:g} samples a second, {said}"


def usual_step(times: Floats[Array, "_"]) -> float:
    """Seconds between samples: the median, or the mean of what is near it where stamps are rounded coarsely."""
    steps = np.diff(times)
    forward = steps[steps > 0]
    if forward.size == 0:
        return 1.0
    median = float(np.median(forward))
    near = forward[np.abs(forward - median) < 0.5 * median]
    if near.size == 0:  # two steps that have nothing in common
        return median
    mean = float(near.mean())
    return median if abs(mean / median - 1) < _ROUNDED else mean


def parse_unit(text: str, units: Mapping[str, float], what: str) -> float:
    """The size of a unit that the user names, or gives as a number.

    Raises:
        FormatError: for another name, or a number that is not positive and finite.
    """
    if text in units:
        return units[text]
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not (np.isfinite(value) and value > 0):
        raise FormatError(f"{text!r} is no unit of {what}", remedy=f"Give {', '.join(units)}, or a number")
    return value


def clock_seconds(text: str) -> float | None:
    """Seconds since midnight of a wall clock's time, with or without a date before it; None for anything else."""
    found = _CLOCK.fullmatch(text.strip())
    if found is None:
        return None
    hours, minutes, seconds, fraction, half = found.groups()
    hour = int(hours or 0)
    if half:
        hour = hour % 12 + (12 if half.lower() == "pm" else 0)
    if hour > 24 or int(minutes) > 59 or int(seconds) > 60:
        return None
    return hour * 3600.0 + int(minutes) * 60.0 + int(seconds) + (float(f"0.{fraction}") if fraction else 0.0)


def _candidates(
    table: Table, columns: Sequence[Column], choice: TimeChoice
) -> tuple[tuple[int, Floats[Array, "rows"], bool] | None, Floats[Array, "rows"] | None]:
    """The column of times, its stamps and whether they are a wall clock's; and the numbers of samples."""
    if choice.column and choice.column not in table.names:
        table.find(choice.column)
    order = [table.names.index(choice.column)] if choice.column else []
    if not order:
        order = [i for i, column in enumerate(columns) if column.quantity == TIME]
        order += [i for i, column in enumerate(columns) if column.quantity == COUNT]
    counted = None
    for place in order:
        cells = [row[place] for row in table.rows]
        if not any(cells):
            continue
        clock = not is_number(cells[0]) and clock_seconds(cells[0]) is not None
        stamps = _unwrapped(_wall_clock(table, cells, place) if clock else table.columns([place])[:, 0], clock)
        steps = np.diff(stamps)
        whole = bool((steps % 1 == 0).all())
        if not np.isfinite(stamps).all() or not (steps > 0).any():
            if columns[place].quantity == TIME:
                return (place, stamps, clock), counted
            continue
        if columns[place].quantity == COUNT and choice.unit == INDEX:
            continue
        if columns[place].quantity == COUNT and whole and not choice.column:
            if (steps <= 0).any() and 2 * np.count_nonzero(steps == 1) > len(steps):
                raise FormatError(
                    f"{_label(table, place)} counts samples, and goes back or stands still",
                    cause="several recordings or sensors stand one below the other",
                    remedy="Take them apart, or count the rows (--time-unit index)",
                    file=table.file,
                    line=table.lines[int(np.flatnonzero(steps <= 0)[0]) + 1],
                )
            counted = stamps if counted is None and (steps > 0).all() else counted
        else:
            return (place, stamps, clock), counted
    return None, counted


def _wall_clock(table: Table, cells: Sequence[str], place: int) -> Floats[Array, "rows"]:
    times = [clock_seconds(cell) for cell in cells]
    wrong = next((i for i, time in enumerate(times) if time is None), None)
    if wrong is not None:
        raise FormatError(
            f"{cells[wrong][:40]!r} in {_label(table, place)} is no time of day",
            remedy="Mend or cut out that line",
            file=table.file,
            line=table.lines[wrong],
        )
    return np.array(times, dtype=np.float64)


def _unwrapped(stamps: Floats[Array, "rows"], clock: bool) -> Floats[Array, "rows"]:
    """Stamps that go on where a counter of 16 or 32 bits, or a day, begins again."""
    back = np.diff(stamps)
    for wrap in (86_400.0,) if clock else _WRAPS:
        if np.nanmax(stamps, initial=0.0) < wrap and (back < -0.5 * wrap).any():
            return stamps + wrap * np.concatenate([[0.0], np.cumsum(back < -0.5 * wrap)])
    return stamps


def _label(table: Table, place: int) -> str:
    return f"column {table.names[place][:40]!r}" if table.names[place] else f"column {place + 1}"


def _unit(
    table: Table, place: int, stamps: Floats[Array, "rows"], named: str, chosen: str, clock: bool
) -> tuple[float, str]:
    """Seconds of a tick and how that is known; 0 where the column only counts."""
    forward = np.diff(stamps)
    forward = forward[forward > 0]
    if forward.size == 0:
        raise FormatError(
            f"the times in {_label(table, place)} do not increase",
            remedy="Export the recording again, or give the rate (--source-rate HZ) with --time-unit index",
            file=table.file,
        )
    if clock:
        return 1.0, "a clock's time of day"
    usual = float(np.median(forward))
    if chosen:
        return parse_unit(chosen, TIME_UNITS, "time"), f"{chosen}, as given"
    if named:
        _check_rate(table, place, usual, named)
        return TIME_UNITS[named], f"{named}, as {_label(table, place)} says"
    if usual == 1 and (stamps % 1 == 0).all() and 2 * np.count_nonzero(np.diff(stamps) == 1) > len(stamps):
        return 0.0, ""
    for unit, size in TIME_UNITS.items():
        if _SLOWEST <= 1 / (usual * size) <= _FASTEST:
            return size, f"{unit}, for {_label(table, place)} goes up by {usual:.6g} a row"
    raise FormatError(
        f"times {usual:g} apart in {_label(table, place)} are in no unit of time",
        cause=f"none of {', '.join(TIME_UNITS)} gives {_SLOWEST:g} to {_FASTEST:g} samples a second",
        remedy="Name the unit (--time-unit UNIT)",
        file=table.file,
    )


def _check_rate(table: Table, place: int, usual: float, named: str) -> None:
    rate = 1 / (usual * TIME_UNITS[named])
    if not _LEAST <= rate <= _MOST:
        raise FormatError(
            f"{_label(table, place)} says {named}, but goes up by {usual:g} a row",
            cause=f"that would be {rate:g} samples a second",
            remedy="Name the unit (--time-unit UNIT)",
            file=table.file,
        )


def _seconds(
    table: Table, place: int, stamps: Floats[Array, "rows"], unit: float, how: str, rate: float | None
) -> tuple[Floats[Array, "rows"], str]:
    seconds = stamps * unit
    steps = np.diff(seconds)
    pace = 1 / usual_step(seconds)
    repeated = np.count_nonzero(steps == 0) / len(steps)
    if repeated > _REPEATED:
        raise FormatError(
            f"{repeated:.0%} of the times in {_label(table, place)} repeat the one before",
            cause="the clock is too coarse, or samples came in bundles",
            remedy="Give the rate (--source-rate HZ) and count samples (--time-unit index)",
            file=table.file,
        )
    if rate is not None and abs(rate / pace - 1) > 0.1:
        raise FormatError(
            f"the times say {pace:.4g} samples a second, but {rate:g} were given",
            remedy="Leave the rate out, or count samples (--time-unit index)",
            file=table.file,
        )
    return seconds, f"time in {how}: {pace:.4g} samples a second"
