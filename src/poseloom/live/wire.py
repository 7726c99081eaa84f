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
from dataclasses import replace
from typing import Any, cast

from poseloom.live.readings import (
    LIMITS,
    MalformedPacket,
    Packet,
    Reading,
    Refusal,
    Vector,
    checked_quat,
    checked_time,
    checked_vector,
    without_fix,
)

WIRE_PORT = 9870
"""The port at which poseloom listens for its own datagrams by default."""

LONGEST_DATAGRAM = 16384
"""Bytes. Three hundred sensors fit; anything longer is dropped unread."""

_LONGEST_NAME = 64
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

    Each line, and each sensor of a line or of a binary datagram, stands alone: what is wrong is in the packet's
    `refused`, and the rest is used. More parts of a sensor than are known are accepted, and named there.

    Raises:
        MalformedPacket: where something is wrong and no reading is left, or the datagram's structure is broken.
    """
    if len(data) > LONGEST_DATAGRAM:
        raise MalformedPacket(f"a datagram of more than {LONGEST_DATAGRAM} bytes")
    if data[: len(_MAGIC)] == _MAGIC:
        return (_something(_parse_binary(data, names)),)
    packets: list[Packet] = []
    refused: list[Refusal] = []
    for line in data.split(b"\n"):
        if line.strip():
            try:
                packets.append(_something(_parse_line(line)))
            except MalformedPacket as error:
                refused.append(Refusal(str(error)))
    if not packets:
        raise MalformedPacket(refused[0].reason if refused else "an empty datagram")
    return (*packets[:-1], replace(packets[-1], refused=(*packets[-1].refused, *refused)))


def _something(packet: Packet) -> Packet:
    """The packet, unless all of it is malformed."""
    wrong = next((refusal for refusal in packet.refused if not refusal.missing), None)
    if wrong is not None and not packet.readings:
        raise MalformedPacket(wrong.reason)
    return packet


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
    refused: list[Refusal] = []
    for name, parts in sensors.items():
        who = str(name)[:_LONGEST_NAME]
        try:
            if not isinstance(parts, dict):
                raise MalformedPacket("a sensor without parts")
            known = cast(dict[str, Any], parts)
            refused += [
                Refusal(f"unknown part {key[:_LONGEST_NAME]!r} of a sensor (known: {', '.join(_KEYS)})", who)
                for key in known
                if key not in _KEYS
            ]
            _add(readings, refused, name, [known.get(key) for key in _KEYS])
        except MalformedPacket as error:
            refused.append(Refusal(str(error), who))
        except (ValueError, TypeError, OverflowError):
            refused.append(Refusal("a part of a sensor that is not numbers", who))
    time = content.get("time")
    return Packet(
        readings, None if time is None else checked_time(_number(time)), refused=tuple(refused), messages={"JSON": 1}
    )


def _add(readings: dict[str, Reading], refused: list[Refusal], name: str, parts: Sequence[Any]) -> None:
    """Adds the reading of one sensor; one without a fix loses its pose, and keeps what its IMU measured."""
    position, quat, *others = parts
    if quat is not None:
        missing = without_fix(
            None if position is None else [_number(value) for value in position], [_number(value) for value in quat]
        )
        if missing:
            refused.append(Refusal(missing, name[:_LONGEST_NAME], missing=True))
            position = quat = None
    reading = _reading([position, quat, *others])
    if not reading.is_empty:
        readings[name] = reading


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
        refused: list[Refusal] = []
        seen: set[int] = set()
        at = _HEAD.size
        for _ in range(count):
            index, bits, zero = _SENSOR.unpack_from(data, at)
            if bits >= 1 << len(_SIZES) or zero:
                raise MalformedPacket("a sensor with unknown parts")
            at += _SENSOR.size
            parts, at = _binary_parts(data, at, bits)
            who = str(names[index]) if index < len(names) else f"sensor {index}"
            if index >= len(names) or index in seen:
                refused.append(Refusal("a sensor that is none of the layout's, or comes twice", who))
                continue
            seen.add(index)
            try:
                _add(readings, refused, who, parts)
            except MalformedPacket as error:
                refused.append(Refusal(str(error), who))
    except struct.error:
        raise MalformedPacket("it ends too early") from None
    if at != len(data):
        raise MalformedPacket("bytes after its end")
    return Packet(
        readings, None if math.isnan(time) else checked_time(time), refused=tuple(refused), messages={"binary": 1}
    )


def _binary_parts(data: bytes, at: int, bits: int) -> tuple[list[Any], int]:
    parts: list[Any] = []
    for place, size in enumerate(_SIZES):
        part: Vector | None = None
        if bits >> place & 1:
            part = struct.unpack_from(f"<{size}f", data, at)
            at += 4 * size
        parts.append(part)
    parts[4] = None if parts[4] is None else parts[4][0]
    return parts, at
