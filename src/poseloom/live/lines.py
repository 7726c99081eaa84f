"""Lines of converter counts, as microcontrollers print them to a serial line or write them to a memory card.

`512,498,601,580` or `40210,512,498,601,580`: a count for each flex sensor of the layout in order, before them perhaps
the device's milliseconds. Commas, semicolons, blanks or tabs part the numbers; `-` or `nan` stands for a missing one;
lines that begin with `#` are remarks. An empty value between commas is missing, too. A comma at the end of a line is
passed over where the line has a time; without one, the line might as well have a time and lack its last value.
"""

import math
import re
from collections.abc import Iterator, Sequence

from poseloom.live.readings import MalformedPacket, Packet, Reading, Refusal, checked_time
from poseloom.live.wire import checked_count

LONGEST_LINE = 512
"""Bytes; a longer line is none."""

_LISTED = re.compile(rb"[,;]")
_SEPARATED = re.compile(rb"\s*[,;]\s*|\s+")
_MANY = 99
_NUMBER = re.compile(rb"[+-]?\d{1,12}(\.\d{1,9})?")
_MISSING = frozenset((b"", b"-", b"nan", b"NaN", b"NAN"))


def parse_counts(line: bytes, names: Sequence[str]) -> Packet | None:
    """The counts of one line; None for an empty line or a remark.

    Args:
        line: Without its end.
        names: The sensors that the numbers belong to, in order.

    Raises:
        MalformedPacket: for another number of values, a time that is none, or not one value that is a count. A value
            that is no count costs that sensor alone: it is in the packet's `refused`.
    """
    text = line.strip()
    if not text or text.startswith(b"#"):
        return None
    fields = _fields(text)
    if not fields[-1] and len(fields) > len(names) + 1:
        del fields[-1]
    if not fields[-1]:
        raise MalformedPacket("a separator at the end of a line that has no time before the values")
    if len(fields) not in (len(names), len(names) + 1):
        raise MalformedPacket(f"{min(len(fields), _MANY)} values for {len(names)} sensors")
    time = None
    if len(fields) > len(names):
        time = checked_time(_number(fields[0]) / 1e3)
    readings: dict[str, Reading] = {}
    refused: list[Refusal] = []
    for name, value in zip(names, fields[-len(names) :], strict=True):
        try:
            if value not in _MISSING:
                readings[name] = Reading(count=checked_count(_number(value)))
        except MalformedPacket as error:
            refused.append(Refusal(str(error), name))
    if refused and not readings:
        raise MalformedPacket(refused[0].reason)
    return Packet(readings, time, whole=True, refused=tuple(refused))


def _fields(text: bytes) -> list[bytes]:
    """The values of a line; between commas or semicolons an empty one is missing."""
    return _SEPARATED.split(text) if _LISTED.search(text) else text.split()


def encode_counts(counts: Sequence[float], milliseconds: int | None = None) -> bytes:
    """A line as a device prints it; NaN becomes `-`."""
    fields = [] if milliseconds is None else [str(milliseconds)]
    fields += ["-" if math.isnan(count) else str(round(count)) for count in counts]
    return ",".join(fields).encode() + b"\n"


def _number(field: bytes) -> float:
    if _NUMBER.fullmatch(field) is None:
        raise MalformedPacket("no number where one should stand")
    return float(field)


class LineBuffer:
    """Cuts a stream of bytes into lines, and forgets what is too long to be one.

    Args:
        midway: Whether the stream begins somewhere within a line, which is then thrown away: half a number is a
            number too.
    """

    def __init__(self, midway: bool) -> None:
        self._rest = b""
        self._skipping = midway
        self.overlong = 0

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The lines that these bytes complete, without their ends; `overlong` counts those that were dropped."""
        *lines, rest = (self._rest + data).split(b"\n")
        for line in lines:
            if self._skipping:
                self._skipping = False
            elif len(line) > LONGEST_LINE:
                self.overlong += 1
            else:
                yield line
        self._rest = rest
        if len(rest) > LONGEST_LINE:
            self.overlong += not self._skipping
            self._skipping, self._rest = True, b""
