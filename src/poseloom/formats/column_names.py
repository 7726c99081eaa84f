"""What columns of sensor tables are called: quantity, axis, unit and sensor, out of any usual name.

`acc_x`, `AccX`, `Accelerometer X (g)`, `left foot gyr z [deg/s]`, `ax`, `linear_acceleration.x`, `qw`, `Quat_q0`,
`ori_1`, `Timestamp (us)`, `time_ms`: the words decide, in any order and case.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

FORCE, RATE, QUAT, POSITION, TIME, COUNT, OTHER = "force", "rate", "quat", "position", "time", "count", "other"
"""Quantities of columns."""

FORCE_UNITS: Mapping[str, float] = {"m/s2": 1.0, "g": 9.80665, "mg": 9.80665e-3}
"""m/s^2 in one of each."""
RATE_UNITS: Mapping[str, float] = {"rad/s": 1.0, "deg/s": 0.017453292519943295, "mdps": 1.7453292519943296e-5}
"""rad/s in one of each."""
TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in one of each."""
LENGTH_UNITS: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
"""Metres in one of each."""


class Column(NamedTuple):
    """What a column's name says.

    Attributes:
        quantity: One of the quantities above.
        axis: "x", "y", "z", "w", or the digits of a numbered component; empty for times.
        unit: A key of the quantity's units; empty where the name does not say.
        sensor: What is left of the name.
        linear: Whether the name says that gravity was taken off.
    """

    quantity: str
    axis: str = ""
    unit: str = ""
    sensor: str = ""
    linear: bool = False


_WORDS: Mapping[str, str] = {
    **dict.fromkeys(("acc", "accel", "acceleration", "accelerations", "accelerometer", "accelerometers"), FORCE),
    **dict.fromkeys(("gyr", "gyro", "gyros", "gyroscope", "angvel", "omega", "angrate"), RATE),
    **dict.fromkeys(("quat", "quats", "quaternion", "quaternions", "q", "ori", "orientation"), QUAT),
    **dict.fromkeys(("rot", "rotation", "attitude"), QUAT),
    **dict.fromkeys(("pos", "position", "translation", "location", "loc"), POSITION),
    **dict.fromkeys(("mag", "magn", "magnetometer", "magnetic", "field", "mfield"), OTHER),
    **dict.fromkeys(("euler", "eul", "roll", "pitch", "yaw", "heading", "temp", "temperature", "pressure"), OTHER),
    **dict.fromkeys(("status", "battery", "accuracy", "baro", "altitude", "rssi", "mat", "matrix"), OTHER),
}
_PAIRS: Mapping[tuple[str, str], str] = {
    **{(turn, rate): RATE for turn in ("angular", "rotation", "rotational") for rate in ("velocity", "rate", "speed")},
    ("rot", "rate"): RATE,
    ("turn", "rate"): RATE,
    ("specific", "force"): FORCE,
    ("delta", "q"): OTHER,
    ("delta", "v"): OTHER,
}
_LINEAR = frozenset(("linear", "lin", "free", "user"))
_SHORT: Mapping[str, str] = {"a": FORCE, "g": RATE, "w": RATE, "q": QUAT, "m": OTHER, "p": POSITION, "t": POSITION}
"""First letters of names such as ax, gy, qz."""
_TIMES = {
    "time",
    "t",
    "timestamp",
    "timestamps",
    "stamp",
    "epoch",
    "datetime",
    "clock",
    "elapsed",
    "sampletimefine",
} | {
    *("s", "sec", "secs", "seconds", "ms", "millis", "milliseconds", "us", "micros", "microseconds", "ns", "nanos"),
    "nanoseconds",
}
_COUNTS = {"sample", "samples", "index", "idx", "frame", "n", "counter", "packetcounter", "packet", "row", "count"} | {
    *("number", "no", "nr", "id", "unnamed", "i", "samplenumber", "framenumber"),
}
_AXES = frozenset("xyzw")

_SPELLINGS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    FORCE: {
        "m/s2": ("ms2", "mss", "mps2", "mpers2", "ms^2", "mpss", "meterspersecondsquared"),
        "mg": ("mg", "millig", "mgs"),
        "g": ("g", "gs", "gn", "g0"),
    },
    RATE: {
        "mdps": ("mdps", "mdegs", "millidps"),
        "deg/s": ("degs", "dps", "degps", "degsec", "degreess", "degreespersecond", "degpersec", "degsecond"),
        "rad/s": ("rads", "radps", "radsec", "radianss", "radianspersecond", "radpersec", "radsecond"),
    },
    TIME: {
        "ms": ("ms", "millis", "millisec", "milliseconds", "millisecond", "msec", "msecs"),
        "us": ("us", "micros", "microsec", "microseconds", "microsecond", "usec", "usecs"),
        "ns": ("ns", "nanos", "nanosec", "nanoseconds", "nanosecond", "nsec"),
        "s": ("s", "sec", "secs", "seconds", "second"),
    },
    POSITION: {unit: (unit,) for unit in LENGTH_UNITS},
}
_SIGNS = str.maketrans({"°": "deg", "²": "2", "µ": "u", "μ": "u", "⁻": "", "·": " "})


def words_of(name: str) -> list[str]:
    """The words of a name as they stand there, parted at signs, at capitals within a word and around numbers."""
    plain = re.sub(r"([a-z])([A-Z])", r"\1 \2", name.translate(_SIGNS))
    plain = re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1 \2", plain)
    plain = re.sub(r"(?<![A-Za-z0-9])([A-Za-z]+)(\d)(?![A-Za-z0-9])", r"\1 \2", plain)  # q0, acc1; no serial numbers
    return [word for word in re.split(r"[^A-Za-z0-9]+", plain) if word]


def read_column_name(name: str) -> Column:
    """What a name says; of quantity OTHER where it says nothing that is of use."""
    kept = words_of(name)
    lower = [word.lower() for word in kept]
    if not lower or lower in (["date"], ["unnamed", "0"]):
        return Column(COUNT if lower != ["date"] else OTHER)
    found = _quantity(lower)
    if found is None and any(word in _TIMES for word in lower):
        return _time(lower)
    if found is None and all(word in _COUNTS or word.isdigit() for word in lower):
        return Column(COUNT)
    if found is None:
        # `left_hand_x`: a place without the word for it, or nothing of use
        unit, used = _unit(lower, POSITION)
        kept, lower = kept[: len(kept) - used], lower[: len(lower) - used]
        axis = lower[-1] if lower and lower[-1] in "xyz" else ""
        return Column(OTHER, axis, unit if axis else "", _joined(kept[:-1], name) if axis else "")
    quantity, begin, end = found
    if quantity == OTHER:
        return Column(OTHER)
    rest, rest_lower = kept[:begin] + kept[end:], lower[:begin] + lower[end:]
    linear = quantity == FORCE and any(word in _LINEAR for word in rest_lower)
    short = "".join(lower[begin:end])
    if len(short) == 2 and short not in _WORDS:  # ax, gy, qz
        axis, at = short[1], -1
    else:
        axis, at = _axis(rest_lower, begin, quantity)
    if at >= 0:
        del rest[at], rest_lower[at]
    unit, used = _unit(rest_lower, quantity)
    rest = rest[: len(rest) - used]
    sensor = _joined([word for word in rest if word.lower() not in (*_LINEAR, "calibrated")], name)
    return Column(quantity if axis else OTHER, axis, unit, sensor, linear)


def unit_of(text: str, quantity: str) -> str:
    """The unit that a text spells, such as `m/s²`; empty for none."""
    joined = "".join(words_of(text)).lower()
    return next((unit for unit, spellings in _SPELLINGS[quantity].items() if joined in spellings), "")


def _time(lower: Sequence[str]) -> Column:
    if "fine" in lower:  # Xsens' SampleTimeFine counts microseconds of the sensor
        return Column(TIME, unit="us")
    for word in (*reversed(lower), "".join(lower)):
        unit = next((unit for unit, spellings in _SPELLINGS[TIME].items() if word in spellings), "")
        if unit:
            return Column(TIME, unit=unit)
    return Column(TIME)


def _quantity(lower: Sequence[str]) -> tuple[str, int, int] | None:
    """The quantity, and the words that say it, from and up to."""
    for at, pair in enumerate(pairwise(lower)):
        if pair in _PAIRS:
            return _PAIRS[pair], at, at + 2
    for at, word in enumerate(lower):
        if word in _WORDS:
            # `Quat_q0`, `acc q`: two words for one thing
            end = at + 2 if _WORDS[word] == QUAT and lower[at + 1 : at + 2] == ["q"] else at + 1
            return _WORDS[word], at, end
    for at, word in enumerate(lower):
        if len(word) == 2 and word[0] in _SHORT and (word[1] in "xyz" or word == "qw"):
            return _SHORT[word[0]], at, at + 1
        if word in _SHORT and word not in "tp" and lower[at + 1 : at + 2] and lower[at + 1] in "xyz":  # gZ
            return _SHORT[word], at, at + 2
    return None


def _joined(words: Sequence[str], name: str) -> str:
    """Words as one, with an underscore between them unless the name has them in one piece."""
    out = ""
    for word in words:
        out += word if not out or out + word in name else f"_{word}"
    return out


def _axis(rest: Sequence[str], begin: int, quantity: str) -> tuple[str, int]:
    """The axis, and its place among the other words: as near to the quantity as there is one."""
    marks = [
        i for i, word in enumerate(rest) if word in _AXES or (len(word) == 2 and word[0] == "q" and word[1] in _AXES)
    ]
    numbers = [i for i, word in enumerate(rest) if word.isdigit() and len(word) == 1 and i >= begin]
    places = marks or numbers
    if not places:
        return "", -1
    at = min(places, key=lambda i: (abs(i - begin + 0.25), i))
    word = rest[at][-1]
    return ("", -1) if word == "w" and quantity != QUAT else (word, at)


def _unit(rest: Sequence[str], quantity: str) -> tuple[str, int]:
    """The unit that the last words spell, and how many they are."""
    for count in (4, 3, 2, 1):
        joined = "".join(rest[-count:]) if count <= len(rest) else ""
        for unit, spellings in _SPELLINGS.get(quantity, {}).items():
            if joined in spellings:
                return unit, count
    return "", 0
