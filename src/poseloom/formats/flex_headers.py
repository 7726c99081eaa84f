"""What the columns of a flex sensors' log are called: which joint, which side, the time; in any usual wording."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from poseloom.errors import FormatError
from poseloom.formats.column_names import COUNT, TIME, read_column_name

TIME_COLUMN = "time"
"""Name of the time's column."""

PASSED_OVER = "-"
"""Name for a column that is of no interest."""

_SIDES = {"left": "left", "l": "left", "lft": "left", "lt": "left", "right": "right", "r": "right", "rgt": "right",
          "rt": "right"}  # fmt: skip
_JOINTS = {"knee": "knee", "kn": "knee", "elbow": "elbow", "elb": "elbow"}
_PIECES = re.compile(r"left|right|lft|rgt|lt|rt|knee|elbow|elb|kn|l|r")
_VALUES = {
    "v": "volts", "volt": "volts", "volts": "volts", "mv": "millivolts", "millivolts": "millivolts",
    "deg": "degrees", "degree": "degrees", "degrees": "degrees", "angle": "degrees", "percent": "percent",
    "pct": "percent", "%": "percent", "adc": "counts", "raw": "counts", "count": "counts", "counts": "counts",
}  # fmt: skip
_BRACKETS = re.compile(r"[\[(](.*?)[\])]")
_NUMBERED = re.compile(r"(c|ch|channel|chan|a|adc|ain|s|sensor|flex|f|r|x|pin|gpio|analog|an|v|in)?\s*(\d{1,2})")


class Heading(NamedTuple):
    """What one column is: a sensor's name, `time` or `-`; the unit of a time; the kind of a sensor's values."""

    name: str
    unit: str = ""
    values: str = ""


def read_heading(
    cells: Sequence[str], names: Sequence[str], file: object = None, line: int | None = None
) -> list[Heading]:
    """What a header's columns are.

    Args:
        cells: The header's cells.
        names: The sensors, such as leftKnee.
        file: For the error.
        line: For the error.

    Raises:
        FormatError: where the header does not name each sensor once, or names sensors that are not understood.
    """
    found = [_one(cell, names) for cell in cells]
    numbers = {
        i: number for i, cell in enumerate(cells) if found[i].name == PASSED_OVER and (number := _number(cell)) >= 0
    }
    named = [heading.name for heading in found if heading.name in names]
    if not named and numbers:
        for first in (0, 1):
            if sorted(numbers.values()) == list(range(first, first + len(names))):
                for i, number in numbers.items():
                    found[i] = found[i]._replace(name=names[number - first])
                return found
    doubled = [name for name in (*names, TIME_COLUMN) if sum(heading.name == name for heading in found) > 1]
    absent = [name for name in names if all(heading.name != name for heading in found)]
    if doubled or absent:
        raise FormatError(
            f"the header names {', '.join(cell.strip()[:30] for cell in cells)[:200]}",
            cause=f"{doubled[0]} is named twice" if doubled else f"none of them is understood as {', '.join(absent)}",
            remedy=f"Say what the columns are (--columns {TIME_COLUMN},{','.join(names)},{PASSED_OVER})",
            file=str(file) if file is not None else None,
            line=line,
        )
    return found


def is_sensor_word(text: str, names: Sequence[str]) -> bool:
    """Whether a word names a sensor, a numbered channel or the time, as headers and labels do."""
    return _one(text, names).name != PASSED_OVER or _number(text) >= 0


def _one(cell: str, names: Sequence[str]) -> Heading:
    text = cell.strip().strip('"').lower()
    plain = {name.lower(): name for name in names}
    values = _values(text)
    if text in plain:
        return Heading(plain[text])
    bare = _BRACKETS.sub(lambda found: "" if found[1].strip().lower() in _VALUES else found[0], cell.strip())
    words = [word for word in re.split(r"[^a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", bare).lower()) if word]
    words = [word for word in words if word not in _VALUES and word not in ("flex", "sensor", "bend", "value", "joint")]
    pieces = _PIECES.findall("".join(words)) if _PIECES.sub("", "".join(words)) == "" else []
    sides = {_SIDES[piece] for piece in pieces if piece in _SIDES}
    joints = {_JOINTS[piece] for piece in pieces if piece in _JOINTS}
    if len(sides) == 1 and len(joints) == 1:
        name = plain.get(next(iter(sides)) + next(iter(joints)))
        if name is not None:
            return Heading(name, values=values)
    column = read_column_name(cell)
    if column.quantity == TIME and _number(cell) < 0:
        return Heading(TIME_COLUMN, unit=column.unit)
    return Heading(PASSED_OVER, values=values if column.quantity != COUNT else "")


def _values(text: str) -> str:
    """The kind of values that a header's cell says: in brackets, or as its last word."""
    if "%" in text:
        return "percent"
    if "°" in text:
        return "degrees"
    words = [word for word in re.split(r"[^a-z]+", text) if word]
    return next((_VALUES[word] for word in reversed(words) if word in _VALUES), "")


def _number(cell: str) -> int:
    """The number of a channel, -1 where it has none."""
    plain = _BRACKETS.sub("", cell.strip().strip('"').lower()).strip()
    plain = re.sub(r"[\s_.-]+", "", re.sub(r"[\s_.-]+(raw|adc|v|mv|volts?|counts?|deg|percent|value)$", "", plain))
    found = _NUMBERED.fullmatch(plain)
    return int(found[2]) if found else -1
