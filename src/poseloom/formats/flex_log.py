"""Logs of flex sensors as boards write them to a memory card or print them: lines of a time and a few counts.

Lines like `time,c1,c2,c3,c4`, with or without a header, parted by commas, semicolons, tabs or blanks, or with labels
(`t=812 c1:512 c2:498 ...`). Boards lose power, cards lose blocks, two writers share a line: what is no such line is
passed over and counted.
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
from poseloom.formats._files import decode, read_bytes
from poseloom.formats.clocks import Clock, read_clock
from poseloom.sensors.layout import SensorKind, SensorLayout, make_layout
from poseloom.sensors.placement import default_placements
from poseloom.sensors.recording import Recording, make_recording
from poseloom.sensors.sample import SensorStatus
from poseloom.skeleton.body import average_body
from poseloom.skeleton.skeleton import Skeleton

TIME = "time"
"""Name of the time's column."""

PASSED_OVER = "-"
"""Name for a column that is of no interest."""

_TOP = 4095.0
_PARTS = re.compile(r"[,;\s]+")
_LABELLED = re.compile(r"([A-Za-z_]\w*)\s*[:=]\s*([^\s,;]*)")
_NUMBER = re.compile(r"[+-]?\d{1,15}(\.\d{1,12})?")
_WALL_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d{1,9})?)")
_MISSING = frozenset(("", "-", "nan", "null", "none", "x"))
_TIME_NAMES: Mapping[str, float] = {
    **dict.fromkeys(("time", "t", "timestamp", "stamp", "clock"), 0.0),
    **dict.fromkeys(("s", "sec", "secs", "seconds", "time_s", "t_s"), 1.0),
    **dict.fromkeys(("ms", "millis", "milliseconds", "time_ms", "t_ms"), 1e-3),
    **dict.fromkeys(("us", "micros", "microseconds", "time_us", "t_us"), 1e-6),
}
"""What headers call the time, and its unit in seconds; 0 where they do not say."""


@dataclass(frozen=True)
class LogNotes:
    """What a log held besides good lines.

    Attributes:
        lines: Lines with something on them.
        good: Lines that became samples.
        passed_over: What was wrong with the others, and how often.
        clock: How the clock was read.
    """

    lines: int
    good: int
    passed_over: Mapping[str, int]
    clock: Clock


@dataclass
class _Lines:
    """Good lines so far, and a tally of the others."""

    times: list[float] = field(default_factory=list[float])
    counts: list[list[float]] = field(default_factory=list[list[float]])
    seen: int = 0
    wrong: Counter[str] = field(default_factory=Counter[str])


def read_flex_log(
    path: str | Path,
    layout: SensorLayout,
    columns: Sequence[str] = (),
    rate: float | None = None,
    unit: float | None = None,
    skeleton: Skeleton | None = None,
) -> tuple[Recording, LogNotes]:
    """A recording from a log.

    Args:
        path: The file.
        layout: Its flex sensors; others must not be in it.
        columns: What the columns are: `time`, sensors of the layout, or `-` for one to pass over. Left out, a header
            says it (`c1`, `c2` ... are the sensors in the layout's order), or else the time comes first.
        rate: Lines a second: needed if the lines carry no time; else found from the times.
        unit: Seconds in which the time counts; found if left out.
        skeleton: The wearer's body; the average one if left out.

    Returns:
        The recording, on times from zero, its layout at the log's own rate; and what was wrong with the log.

    Raises:
        FormatError: if hardly any line is one of counts, a column is unknown, or no time can be made out.
    """
    file = Path(path)
    names = _flex_names(layout, file)
    lines = decode(read_bytes(file)).replace("\0", "").splitlines()
    header, order, header_unit = _header(lines, names, file) if not columns else (-1, _named(columns, names, file), 0.0)
    found = _Lines()
    for at, line in enumerate(lines):
        text = line.strip()
        if text and at != header and not text.startswith("#"):
            found.seen += 1
            _take(text, order, names, found)
    _check_yield(found, names, file)
    counts = np.array(found.counts)
    if math.isnan(found.times[0]):
        if rate is None:
            raise FormatError("its lines carry no time", remedy="Say how many come a second (--rate 20)", file=file)
        clock = Clock(np.arange(len(counts)) / rate, np.arange(len(counts)), float(rate), 1 / rate, ())
    else:
        clock = read_clock(np.array(found.times), unit or header_unit or None, file)
        found.wrong["a time out of order"] += len(counts) - len(clock.kept)
    return _recording(file, layout, skeleton or average_body(), counts[clock.kept], clock, found), LogNotes(
        found.seen, len(clock.kept), {what: count for what, count in found.wrong.items() if count}, clock
    )


def _flex_names(layout: SensorLayout, file: Path) -> tuple[str, ...]:
    if any(sensor.kind is not SensorKind.FLEX for sensor in layout.sensors):
        raise FormatError(
            f"layout {layout.name!r} has other sensors than flex sensors", remedy="Choose flex-four", file=file
        )
    return layout.names


def _named(columns: Sequence[str], names: tuple[str, ...], file: Path) -> list[str]:
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
    return order


def _header(lines: list[str], names: tuple[str, ...], file: Path) -> tuple[int, list[str], float]:
    """Index of the header (-1 for none), the columns' meanings, and the unit of time if the header says it."""
    plain = {name.lower(): name for name in names} | {f"c{i + 1}": name for i, name in enumerate(names)}
    for at, line in enumerate(lines[:50]):
        fields = [part.strip().lower() for part in _PARTS.split(line.strip().lstrip("#").strip()) if part.strip()]
        known = sum(part in plain or part in _TIME_NAMES for part in fields)
        if known < 2 or known < len(fields) - 2 or any(_NUMBER.fullmatch(part) for part in fields):
            continue
        order = [plain.get(part, TIME if part in _TIME_NAMES else PASSED_OVER) for part in fields]
        strange = [part for part in fields if re.fullmatch(r"c\d+", part) and part not in plain]
        if strange:
            raise FormatError(
                f"the header names {', '.join(strange)}, but there are {len(names)} sensors",
                remedy=f"Say what the columns are (--columns time,{','.join(names)},-)",
                file=file,
                line=at + 1,
            )
        unit = next((_TIME_NAMES[part] for part in fields if part in _TIME_NAMES), 0.0)
        return at, _named(order, names, file), unit
    return -1, [], 0.0


def _take(text: str, order: list[str], names: tuple[str, ...], found: _Lines) -> None:
    """Adds one line to the good ones, or to the tally."""
    labels = {label.lower(): value for label, value in _LABELLED.findall(text)}
    if len(labels) >= len(names):
        plain = {name.lower(): name for name in names} | {f"c{i + 1}": name for i, name in enumerate(names)}
        values = {plain.get(k, TIME if k in _TIME_NAMES else PASSED_OVER): v for k, v in labels.items()}
    else:
        parts = [part.strip() for part in re.split(r"[,;]" if "," in text or ";" in text else r"\s+", text)]
        meaning = order or ([TIME, *names] if len(parts) == len(names) + 1 else list(names))
        if len(parts) != len(meaning):
            found.wrong["a line of another length"] += 1
            return
        values = dict(zip(meaning, parts, strict=True))
    if any(name not in values for name in names):
        found.wrong["a line of another length"] += 1
        return
    time = _moment(values[TIME]) if TIME in values else math.nan
    counts = [_count(values[name]) for name in names]
    if time is None or None in counts or (found.times and math.isnan(time) != math.isnan(found.times[0])):
        found.wrong["something that is no number"] += 1
        return
    good = [math.nan if count is None or not 0 <= count <= _TOP else count for count in counts]
    if any(math.isnan(a) and not math.isnan(b or 0.0) for a, b in zip(good, counts, strict=True)):
        found.wrong["a count beyond 0 to 4095 (taken as missing)"] += 1
    found.times.append(time)
    found.counts.append(good)


def _count(text: str) -> float | None:
    """A count; NaN for one that is said to be missing; None for what is no number."""
    if text.lower() in _MISSING:
        return math.nan
    return float(text) if _NUMBER.fullmatch(text) else None


def _moment(text: str) -> float | None:
    """A time in the log's own unit; a wall clock's in seconds."""
    if _NUMBER.fullmatch(text):
        return float(text)
    wall = _WALL_CLOCK.fullmatch(text)
    return None if wall is None else int(wall[1]) * 3600.0 + int(wall[2]) * 60.0 + float(wall[3])


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
    file: Path,
    layout: SensorLayout,
    skeleton: Skeleton,
    counts: Floats[Array, "samples channels"],
    clock: Clock,
    found: _Lines,
) -> Recording:
    status = np.where(np.isnan(counts), SensorStatus.MISSING, SensorStatus.OK).astype(np.int64)
    status[(counts <= 0) | (counts >= _TOP)] = SensorStatus.SATURATED
    told = ", ".join(f"{count} x {what}" for what, count in found.wrong.items() if count)
    return make_recording(
        make_layout(layout.name, layout.sensors, clock.rate),
        default_placements(layout, skeleton),
        skeleton,
        clock.times,
        counts=counts,
        status=status,
        name=file.stem,
        settings={
            "made by": "read_flex_log",
            "source": file.name,
            "lines passed over": told or "none",
            "clock": "; ".join((f"{clock.rate:g} Hz", *clock.events)),
        },
    )
