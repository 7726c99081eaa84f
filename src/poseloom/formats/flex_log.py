"""Logs of flex sensors as boards write them to a memory card or print them: lines of a time and a few counts.

Lines like `time,c1,c2,c3,c4`, with or without a header, parted by commas, semicolons, tabs or blanks, or with labels
(`t=812 c1:512 c2:498 ...`), with the Arduino IDE's time of arrival in front or not. A header's names decide, never the
order. Boards lose power, cards lose blocks, two writers share a line: what is no such line is passed over and counted,
up to 5 %.
"""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, unknown_name
from poseloom.formats._files import decode, read_bytes, reading, split_lines
from poseloom.formats.clocks import Clock, read_clock
from poseloom.formats.column_names import TIME_UNITS
from poseloom.formats.flex_headers import PASSED_OVER, TIME_COLUMN, Heading, is_sensor_word, read_heading
from poseloom.formats.flex_values import TOP, as_counts
from poseloom.formats.table_times import clock_seconds
from poseloom.formats.text_tables import find_delimiter, split_cells
from poseloom.sensors.layout import SensorKind, SensorLayout, make_layout
from poseloom.sensors.placement import default_placements
from poseloom.sensors.recording import Recording, make_recording
from poseloom.sensors.sample import SensorStatus
from poseloom.skeleton.body import average_body
from poseloom.skeleton.skeleton import Skeleton

TIME = TIME_COLUMN

_MOST_SKIPPED = 0.05
"""Share of lines that may be passed over."""
_HEADER_LINES = 50
_LABELLED = re.compile(r"(?<!\w)([A-Za-z_]\w*)\s*[:=]\s*([^\s,;]*)")
_NUMBER = re.compile(r"[+-]?(\d{1,15}([.,]\d{0,12})?|[.,]\d{1,12})([eE][+-]?\d{1,2})?")
_STAMPED = re.compile(r"(\d{1,2}:\d{2}:\d{2}(?:[.,]\d{1,9})?)\s*(?:->|\u2192)\s*(.*)")
"""How the Arduino IDE shows a line with its time of arrival."""
_MISSING = frozenset(("", "-", "nan", "null", "none", "x"))


@dataclass(frozen=True)
class LogNotes:
    """What a log held besides good lines.

    Attributes:
        lines: Lines with something on them.
        good: Lines that became samples.
        passed_over: What was wrong with the others, and how often.
        clock: How the clock was read.
        said: What the columns and values were taken for.
    """

    lines: int
    good: int
    passed_over: Mapping[str, int]
    clock: Clock
    said: str


@dataclass
class _Lines:
    """Good lines so far, and a tally of the others."""

    times: list[float] = field(default_factory=list[float])
    values: list[list[float]] = field(default_factory=list[list[float]])
    places: list[int] = field(default_factory=list[int])
    seen: int = 0
    skipped: int = 0
    first_skipped: int = 0
    wrong: Counter[str] = field(default_factory=Counter[str])

    def skip(self, why: str, line: int) -> None:
        """Counts a line that is passed over; those before the first good one are greetings."""
        self.wrong[why] += 1
        self.first_skipped = self.first_skipped or line
        self.skipped += bool(self.times)


@dataclass(frozen=True)
class _Layout:
    """How lines are read: what parts the cells, what each is, and the sensors."""

    delimiter: str
    headings: tuple[Heading, ...]
    names: tuple[str, ...]


def read_flex_log(
    path: str | Path,
    layout: SensorLayout,
    columns: Sequence[str] = (),
    rate: float | None = None,
    unit: float | None = None,
    skeleton: Skeleton | None = None,
    *,
    values: str = "",
    full_scale: float | None = None,
) -> tuple[Recording, LogNotes]:
    """A recording from a log.

    Args:
        path: The file.
        layout: Its flex sensors; others must not be in it.
        columns: What the columns are: `time`, sensors of the layout, or `-` for one to pass over. Left out, a header
            says it in any usual wording (`c1`, `A0` ... are the sensors in the layout's order); without one the time
            is the column that goes up, and the sensors stand in the layout's order.
        rate: Lines a second: needed if the lines carry no time; a line that is passed over takes its time all the same.
        unit: Seconds in which the time counts; found if left out.
        skeleton: The wearer's body; the average one if left out.
        values: What the values are: counts, volts, millivolts or percent; told from header and values if left out.
        full_scale: The value at the converter's upper end, where it is not counts.

    Returns:
        The recording, on times from zero, its layout at the log's own rate; and what was wrong with the log.

    Raises:
        FormatError: if more than 5 % of the lines cannot be used, a header or column is not understood, no time can be
            made out, or the values are no readings of a converter.
    """
    file = Path(path)
    with reading(file, "a log of flex sensors"):
        return _read(file, layout, columns, rate, unit, skeleton or average_body(), values, full_scale)


def _read(
    file: Path,
    layout: SensorLayout,
    columns: Sequence[str],
    rate: float | None,
    unit: float | None,
    body: Skeleton,
    values: str,
    full_scale: float | None,
) -> tuple[Recording, LogNotes]:
    names = _flex_names(layout, file)
    lines = [_stamp(line) for line in split_lines(decode(read_bytes(file)).replace("\0", ""))]
    found = _Lines()
    header, form = _reading(lines, columns, names, file)
    for at, (stamp, text) in enumerate(lines):
        if text and at != header and not text.startswith("#") and (header < 0 or text != lines[header][1]):
            found.seen += 1
            _take(stamp, text, form, found, at + 1)
    _check_yield(found, names, file)
    counted = as_counts(
        np.array(found.values),
        next((heading.values for heading in form.headings if heading.values and heading.name in names), ""),
        values,
        full_scale,
    )
    counts = counted.counts
    beyond = (counts < 0) | (counts > TOP)
    if beyond.any():
        found.wrong["a count beyond 0 to 4095 (taken as missing)"] += int(beyond.any(axis=1).sum())
        counts = np.where(beyond, np.nan, counts)
    clock = _clock(found, rate, unit, form, file)
    found.wrong["a time out of order"] += len(counts) - len(clock.kept)
    found.skipped += len(counts) - len(clock.kept)
    _check_skipped(found, file)
    told = {what: count for what, count in found.wrong.items() if count}
    notes = LogNotes(found.seen, len(clock.kept), told, clock, _said(form, counted.said))
    return _recording(file, layout, body, counts[clock.kept], notes), notes


def _flex_names(layout: SensorLayout, file: Path) -> tuple[str, ...]:
    if any(sensor.kind is not SensorKind.FLEX for sensor in layout.sensors):
        raise FormatError(
            f"layout {layout.name!r} has other sensors than flex sensors", remedy="Choose flex-four", file=file
        )
    return layout.names


def _stamp(line: str) -> tuple[str, str]:
    """A time of arrival that stands before a line, and the line."""
    text = line.strip()
    found = _STAMPED.fullmatch(text)
    return (found[1], found[2].strip()) if found else ("", text)


def _named(columns: Sequence[str], names: tuple[str, ...], file: Path) -> tuple[Heading, ...]:
    order = [column.strip() for column in columns]
    for column in order:
        if column not in (*names, TIME, PASSED_OVER):
            raise unknown_name("column", column, (*names, TIME, PASSED_OVER), FormatError).at(file)
    doubled = [name for name in (*names, TIME) if order.count(name) > 1]
    absent = [name for name in names if name not in order]
    if doubled or absent:
        raise FormatError(
            f"columns doubled: {', '.join(doubled)}" if doubled else f"no column for {', '.join(absent)}",
            remedy=f"Name each of {', '.join(names)} once, and {TIME} and {PASSED_OVER} for the others",
            file=file,
        )
    return tuple(Heading(column) for column in order)


def _reading(
    lines: list[tuple[str, str]], columns: Sequence[str], names: tuple[str, ...], file: Path
) -> tuple[int, _Layout]:
    """Index of the header (-1 for none), and how the lines are read."""
    filled = [text for _, text in lines if text and not text.startswith("#")]
    delimiter = find_delimiter(filled[: 4 * _HEADER_LINES])
    cells = [split_cells(text, delimiter) for text in filled[: 4 * _HEADER_LINES]]
    usual = Counter(len(row) for row in cells if sum(_value(cell) is not None for cell in row) >= len(names))
    width = usual.most_common(1)[0][0] if usual else 0
    header = next(
        (
            at
            for at, (_, text) in enumerate(lines[:_HEADER_LINES])
            if text and _is_header(split_cells(text.lstrip("#").strip(), delimiter), width, names)
        ),
        -1,
    )
    if columns:
        return header, _Layout(delimiter, _named(columns, names, file), names)
    if header >= 0:
        row = split_cells(lines[header][1].lstrip("#").strip(), delimiter)
        return header, _Layout(delimiter, tuple(read_heading(row, names, file, header + 1)), names)
    if width == len(names):
        return -1, _Layout(delimiter, tuple(Heading(name) for name in names), names)
    rows = [row for row in cells if len(row) == width]
    place = _rising(rows) if width == len(names) + 1 else 0
    order = [Heading(name) for name in names]
    return -1, _Layout(delimiter, (*order[:place], Heading(TIME), *order[place:]), names)


def _is_header(row: list[str], width: int, names: tuple[str, ...]) -> bool:
    """Whether a line of words names columns: as many as the lines of numbers have, or sensors among them."""
    filled = [cell for cell in row if cell]
    words = [cell for cell in filled if not _NUMBER.fullmatch(cell)]
    if len(filled) < 2 or any(_LABELLED.fullmatch(cell) for cell in filled):
        return False
    known = sum(is_sensor_word(cell, names) for cell in words)
    if len(words) < len(filled):  # `time,1,2,3,4`: channels may be bare numbers, a line of numbers is none
        return (
            len(row) == width and 0 < known == len(words) and all(len(cell) < 3 for cell in filled if cell not in words)
        )
    return known >= 2 if len(row) != width else known >= 1 or all(re.search("[A-Za-z]", cell) for cell in words)


def _rising(rows: list[list[str]]) -> int:
    """The column that goes up all the time; the first where none does, or several do."""
    rising: list[int] = []
    for place in range(len(rows[0]) if rows else 0):
        stamps = np.array([np.nan if (time := _moment(row[place])) is None else time for row in rows])
        with np.errstate(invalid="ignore"):
            if np.count_nonzero(np.diff(stamps) > 0) > 0.9 * (len(stamps) - 1):
                rising.append(place)
    return rising[0] if len(rising) == 1 else 0


def _take(stamp: str, text: str, form: _Layout, found: _Lines, line: int) -> None:
    """Adds one line to the good ones, or to the tally."""
    labels = _LABELLED.findall(text)
    names = form.names
    if len(labels) >= len(names):
        try:
            headings = read_heading([label for label, _ in labels], names)
        except FormatError:
            found.skip("a line of another length", line)
            return
        cells = {heading.name: value for heading, (_, value) in zip(headings, labels, strict=True)}
    else:
        parts = split_cells(text, form.delimiter)
        while len(parts) > len(form.headings) and not parts[-1]:
            parts.pop()
        if len(parts) != len(form.headings):
            found.skip("a line of another length", line)
            return
        cells = {heading.name: part for heading, part in zip(form.headings, parts, strict=True)}
    told = cells.get(TIME, stamp)
    time = _moment(told) if told or TIME in cells else math.nan
    values = [_value(cells[name]) for name in names]
    if time is None or None in values or (found.times and math.isnan(time) != math.isnan(found.times[0])):
        found.skip("something that is no number", line)
        return
    found.times.append(time)
    found.values.append([math.nan if value is None else value for value in values])
    found.places.append(found.seen)


def _value(text: str) -> float | None:
    """A value; NaN for one that is said to be missing; None for what is no number."""
    if text.lower() in _MISSING:
        return math.nan
    return float(text.replace(",", ".")) if _NUMBER.fullmatch(text) else None


def _moment(text: str) -> float | None:
    """A time in the log's own unit; a wall clock's in seconds."""
    return float(text.replace(",", ".")) if _NUMBER.fullmatch(text) else clock_seconds(text)


def _clock(found: _Lines, rate: float | None, unit: float | None, form: _Layout, file: Path) -> Clock:
    if math.isnan(found.times[0]):
        if rate is None:
            raise FormatError("its lines carry no time", remedy="Say how many come a second (--rate 20)", file=file)
        places = np.array(found.places)
        return Clock((places - places[0]) / rate, np.arange(len(places)), float(rate), 1 / rate, ())
    named = next((heading.unit for heading in form.headings if heading.unit), "")
    clock = read_clock(np.array(found.times), unit or TIME_UNITS.get(named), file)
    if unit is None and named and not 0.5 <= clock.rate <= 5000:
        raise FormatError(
            f"the header says that the time is in {named}, which would be {clock.rate:g} lines a second",
            remedy="Say the unit (--unit 0.001 for milliseconds)",
            file=file,
        )
    return clock


def _said(form: _Layout, values: str) -> str:
    order = ", ".join(heading.name for heading in form.headings)
    return f"columns {order}; values are {values}"


def _check_skipped(found: _Lines, file: Path) -> None:
    if found.skipped > _MOST_SKIPPED * found.seen:
        reasons = ", ".join(f"{count} x {what}" for what, count in found.wrong.most_common(3) if count)
        raise FormatError(
            f"{found.skipped} of {found.seen} lines cannot be used, more than {_MOST_SKIPPED:.0%}",
            cause=f"{reasons}; the first is line {found.first_skipped}" if found.first_skipped else reasons,
            remedy="Mend the log, or say what its columns are (--columns)",
            file=file,
        )


def _check_yield(found: _Lines, names: tuple[str, ...], file: Path) -> None:
    good = len(found.times)
    if good >= 3 and good >= 0.2 * found.seen:
        return
    most = found.wrong.most_common(1)
    raise FormatError(
        f"this is no log of {len(names)} flex sensors: {good} of {found.seen} lines hold their counts",
        cause=f"most often: {most[0][0]}" if most else "",
        remedy=f"Give lines of a time and {len(names)} counts, or say what the columns are (--columns)",
        file=file,
    )


def _recording(
    file: Path, layout: SensorLayout, skeleton: Skeleton, counts: Floats[Array, "samples channels"], notes: LogNotes
) -> Recording:
    status = np.where(np.isnan(counts), SensorStatus.MISSING, SensorStatus.OK).astype(np.int64)
    status[(counts <= 0) | (counts >= TOP)] = SensorStatus.SATURATED
    told = ", ".join(f"{count} x {what}" for what, count in notes.passed_over.items())
    return make_recording(
        make_layout(layout.name, layout.sensors, notes.clock.rate),
        default_placements(layout, skeleton),
        skeleton,
        notes.clock.times,
        counts=counts,
        status=status,
        name=file.stem,
        settings={
            "made by": "read_flex_log",
            "source": file.name,
            "lines passed over": told or "none",
            "clock": "; ".join((f"{notes.clock.rate:g} Hz", *notes.clock.events)),
            "read as": notes.said,
        },
    )
