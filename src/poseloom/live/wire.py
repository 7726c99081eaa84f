"""poseloom's own datagrams, for any device: lines of JSON, or a compact binary form. Units and frames as in `Sample`.

JSON, one object a line, several lines a datagram at will; every part of a sensor may be left out:

    {"time": 12.345, "sensors": {"leftHand": {"position": [x, y, z], "quat": [w, x, y, z]},
                                 "hips": {"force": [x, y, z], "rate": [x, y, z]}, "leftKnee": {"count": 512}}}

Binary, little-endian: the bytes `PLOM`, version 1 (u8), flags (u8, 0), number of sensors (u16), time (f64); then for
each sensor its index in the layout (u8), which parts follow (u8: 1 position, 2 quaternion, 4 force, 8 rate, 16 count),
two zero bytes, and the parts in this order as f32. A time that is NaN means that the device has no clock.
"""

import json
import math
import struct
from collections.abc import Sequence
from typing import Any, cast

from poseloom.live.readings import (
    LIMITS,
    MalformedPacket,
    Packet,
    Reading,
    Vector,
    checked_quat,
    checked_time,
    checked_vector,
)

WIRE_PORT = 9870
"""The port at which poseloom listens for its own datagrams by default."""

LONGEST_DATAGRAM = 16384
"""Bytes. Three hundred sensors fit; anything longer is dropped unread."""

_MAGIC = b"PLOM"
_VERSION = 1
_HEAD = struct.Struct("<4sBBHd")
_SENSOR = struct.Struct("<BBH")
_SIZES = (3, 4, 3, 3, 1)
_KEYS = ("position", "quat", "force", "rate", "count")


def parse_datagram(data: bytes, names: Sequence[str]) -> tuple[Packet, ...]:
    """The packets of a datagram, in either form.

    Args:
        data: Its bytes.
        names: The layout's sensors in order, for the binary form. Sensors of other names in JSON are kept: who hears
            the packet leaves out what it does not know.

    Raises:
        MalformedPacket: if anything in it is wrong; then none of it is taken.
    """
    if len(data) > LONGEST_DATAGRAM:
        raise MalformedPacket(f"a datagram of {len(data)} bytes")
    if data[: len(_MAGIC)] == _MAGIC:
        return (_parse_binary(data, names),)
    packets = tuple(_parse_line(line) for line in data.split(b"\n") if line.strip())
    if not packets:
        raise MalformedPacket("an empty datagram")
    return packets


def encode_json(packet: Packet) -> bytes:
    """A packet as one line of JSON."""
    sensors = {
        name: {key: value for key, value in zip(_KEYS, _parts(reading), strict=True) if value is not None}
        for name, reading in packet.readings.items()
    }
    content: dict[str, Any] = {} if packet.time is None else {"time": packet.time}
    return json.dumps({**content, "sensors": sensors}, allow_nan=False).encode() + b"\n"


def encode_binary(packet: Packet, names: Sequence[str]) -> bytes:
    """A packet in the binary form; its sensors must be among `names`, the layout's in order."""
    out = [_HEAD.pack(_MAGIC, _VERSION, 0, len(packet.readings), math.nan if packet.time is None else packet.time)]
    for name, reading in packet.readings.items():
        parts = _parts(reading)
        bits = sum(1 << place for place, part in enumerate(parts) if part is not None)
        out.append(_SENSOR.pack(names.index(name), bits, 0))
        for part in parts:
            if part is not None:
                values = part if isinstance(part, tuple) else (part,)
                out.append(struct.pack(f"<{len(values)}f", *values))
    return b"".join(out)


def _parts(reading: Reading) -> tuple[Vector | float | None, ...]:
    return (reading.position, reading.quat_wxyz, reading.specific_force, reading.angular_rate, reading.count)


def _parse_line(line: bytes) -> Packet:
    try:
        content: Any = json.loads(line)
        return _packet(content)
    except MalformedPacket:
        raise
    # RecursionError: brackets within brackets; OverflowError: numbers too long for a float.
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise MalformedPacket(f"no line of JSON as documented ({type(error).__name__})") from None


def _packet(content: Any) -> Packet:
    sensors = cast(dict[str, Any], content["sensors"])
    readings: dict[str, Reading] = {}
    for name, parts in sensors.items():
        unknown = set(parts) - set(_KEYS)
        if unknown:
            raise MalformedPacket("an unknown part of a sensor")
        readings[name] = _reading([parts.get(key) for key in _KEYS])
    time = content.get("time")
    return Packet(readings, None if time is None else checked_time(_number(time)))


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MalformedPacket("no number where one should stand")
    return float(value)


def _reading(parts: Sequence[Any]) -> Reading:
    position, quat, force, rate, count = parts
    return Reading(
        None if position is None else checked_vector(map(_number, position), 3, LIMITS.position),
        None if quat is None else checked_quat(map(_number, quat)),
        None if force is None else checked_vector(map(_number, force), 3, LIMITS.specific_force),
        None if rate is None else checked_vector(map(_number, rate), 3, LIMITS.angular_rate),
        None if count is None else checked_count(_number(count)),
    )


def checked_count(value: float) -> float:
    """A converter's count. Raises MalformedPacket."""
    if not 0 <= value <= LIMITS.count:
        raise MalformedPacket("a count that no converter gives")
    return value


def _parse_binary(data: bytes, names: Sequence[str]) -> Packet:
    try:
        _, version, flags, count, time = _HEAD.unpack_from(data)
        if version != _VERSION or flags:
            raise MalformedPacket("another version of the binary form")
        readings: dict[str, Reading] = {}
        at = _HEAD.size
        for _ in range(count):
            index, bits, zero = _SENSOR.unpack_from(data, at)
            if index >= len(names) or bits >= 1 << len(_SIZES) or zero or names[index] in readings:
                raise MalformedPacket("a sensor that is none of the layout's, or comes twice")
            at += _SENSOR.size
            reading, at = _binary_reading(data, at, bits)
            readings[str(names[index])] = reading
    except struct.error:
        raise MalformedPacket("it ends too early") from None
    if at != len(data):
        raise MalformedPacket("bytes after its end")
    return Packet(readings, None if math.isnan(time) else checked_time(time))


def _binary_reading(data: bytes, at: int, bits: int) -> tuple[Reading, int]:
    parts: list[Any] = []
    for place, size in enumerate(_SIZES):
        part: Vector | None = None
        if bits >> place & 1:
            part = struct.unpack_from(f"<{size}f", data, at)
            at += 4 * size
        parts.append(part)
    parts[4] = None if parts[4] is None else parts[4][0]
    return _reading(parts), at
