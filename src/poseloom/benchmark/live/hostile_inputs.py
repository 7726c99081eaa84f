"""Hostile inputs by kind: whole packets that somebody got wrong, and bad parts beside sound ones in one packet."""

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from numpy.random import Generator

from poseloom.live.devices import binary_datagram, json_datagram, vmc_datagram
from poseloom.live.lines import LineBuffer, encode_counts, parse_counts
from poseloom.live.osc import encode_bundle, encode_message
from poseloom.live.readings import MalformedPacket
from poseloom.live.virtual import virtual_recording
from poseloom.live.vmc import parse_devices
from poseloom.live.wire import parse_datagram
from poseloom.sensors import layout

_SIX, _FLEX = layout("six-trackers"), layout("flex-four")
_COUNTS = (512.0, 498.0, 601.0, 580.0)
_IDENTITY = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Protocol:
    """A protocol's parser and a sound packet of it.

    Attributes:
        name: What it is called.
        sound: A sound packet.
        heard: Names of the sensors or devices that the parser makes of bytes. Raises MalformedPacket.
    """

    name: str
    sound: bytes
    heard: Callable[[bytes], frozenset[str]]

    def spoils(self, kind: str) -> bool:
        """Whether a packet of this protocol can have bad parts of a kind beside sound ones."""
        return kind in _PARTS[self.name]


def protocols() -> tuple[Protocol, ...]:
    """All protocols that sources receive."""
    sample = virtual_recording("sample:walk", _SIX, endless=False).sample(0)
    return (
        Protocol("vmc", vmc_datagram(sample, _SIX, 0.0), _vmc),
        Protocol("udp, JSON", json_datagram(sample, _SIX, 1.0), _udp),
        Protocol("udp, binary", binary_datagram(sample, _SIX, 1.0), _udp),
        Protocol("serial", encode_counts(_COUNTS, 5), _line),
    )


def _vmc(data: bytes) -> frozenset[str]:
    return frozenset(device.serial for device in parse_devices(data))


def _udp(data: bytes) -> frozenset[str]:
    return frozenset(name for packet in parse_datagram(data, _SIX.names) for name in packet.readings)


def _line(data: bytes) -> frozenset[str]:
    heard: set[str] = set()
    lines = list(LineBuffer(midway=False).feed(data + b"\n"))
    if not lines:
        raise MalformedPacket("a line without end")
    for line in lines:
        packet = parse_counts(line, _FLEX.names)
        heard |= set() if packet is None else set(packet.readings)
    return frozenset(heard)


# Whole packets


def _random(sound: bytes, rng: Generator) -> bytes:
    return rng.bytes(int(rng.integers(0, 400)))


def _changed(sound: bytes, rng: Generator) -> bytes:
    data = bytearray(sound)
    for _ in range(int(rng.integers(1, 8))):
        data[int(rng.integers(len(data)))] = int(rng.integers(256))
    return bytes(data)


def _truncated(sound: bytes, rng: Generator) -> bytes:
    return sound[: int(rng.integers(len(sound)))]


def _doubled(sound: bytes, rng: Generator) -> bytes:
    start, stop = sorted(rng.integers(0, len(sound), size=2).tolist())
    return sound[:stop] + sound[start:stop] * int(rng.integers(1, 4)) + sound[stop:]


def _nested(sound: bytes, rng: Generator) -> bytes:
    if sound[:1] == b"#":
        data = sound
        for _ in range(int(rng.integers(5, 40))):
            data = encode_bundle([data])
        return data
    return sound[: int(rng.integers(len(sound)))] + b"[{"[int(rng.integers(2)) :][:1] * int(rng.integers(100, 8000))


def _extreme(sound: bytes, rng: Generator) -> bytes:
    """Lengths and counts at the ends of their range: four bytes of all ones, of the largest or the least integer."""
    at = 4 * int(rng.integers(max(len(sound) // 4, 1)))
    ends = (b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x80\0\0\0", b"\xff\xff\xff\x7f", bytes(4))
    return sound[:at] + ends[int(rng.integers(len(ends)))] + sound[at + 4 :]


WHOLE: Mapping[str, Callable[[bytes, Generator], bytes]] = {
    "random bytes": _random,
    "changed bytes": _changed,
    "truncated": _truncated,
    "parts repeated": _doubled,
    "nested": _nested,
    "extreme lengths": _extreme,
}
"""How whole packets are spoilt, by kind: from a sound one and what is drawn."""


def hostile(sound: bytes, rng: Generator) -> bytes:
    """A packet that somebody got wrong, or made so, of any kind."""
    return list(WHOLE.values())[int(rng.integers(len(WHOLE)))](sound, rng)


# Bad parts beside sound ones


def _vmc_part(arguments: list[object]) -> bytes:
    return encode_message("/VMC/Ext/Tra/Pos", arguments)  # pyright: ignore[reportArgumentType]


_VMC_PARTS: Mapping[str, Callable[[Generator], bytes]] = {
    "no fix": lambda rng: _vmc_part(["bad", 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    "no name": lambda rng: _vmc_part(["", 0.0, 1.0, 0.0, *_IDENTITY]),
    "not finite": lambda rng: _vmc_part(["bad", math.nan, math.inf, 0.0, *_IDENTITY]),
    "out of range": lambda rng: _vmc_part(["bad", 1e30, 1.0, 0.0, *_IDENTITY]),
    "too few parts": lambda rng: _vmc_part(["bad", *[1.0] * int(rng.integers(0, 7))]),
    "other types": lambda rng: _vmc_part([7, "x", True, None, b"blob", 0.0, 0.0, 1.0]),
    "unknown": lambda rng: encode_message("/VMC/Ext/Whatever", [int(rng.integers(1000))]),
    "random bytes": lambda rng: rng.bytes(4 * int(rng.integers(1, 30))),
}
_OTHER_TYPES: tuple[object, ...] = ({"position": "abc"}, 7, None, [], {"count": True})
_JSON_PARTS: Mapping[str, Callable[[Generator], object]] = {
    "no fix": lambda rng: {"position": [0, 1, 0], "quat": [0, 0, 0, 0]},
    "not finite": lambda rng: {"position": [math.nan, math.inf, 0]},
    "out of range": lambda rng: {"position": [1e30, 0, 0], "count": -1},
    "too few parts": lambda rng: {"position": [1.0] * int(rng.integers(0, 3))},
    "other types": lambda rng: _OTHER_TYPES[int(rng.integers(len(_OTHER_TYPES)))],
    "unknown": lambda rng: {"accel": [0, 0, 1]},
}
_BINARY_PARTS: Mapping[str, bytes] = {
    "no fix": struct.pack("<7f", 0, 1, 0, 0, 0, 0, 0),
    "not finite": struct.pack("<7f", math.nan, math.inf, 0, 1, 0, 0, 0),
    "out of range": struct.pack("<7f", 1e30, 1, 0, 1, 0, 0, 0),
}
_LINE_PARTS: Mapping[str, tuple[bytes, ...]] = {
    "no fix": (b"-", b"nan", b""),
    "not finite": (b"inf", b"-inf", b"ovf"),
    "out of range": (b"-1", b"99999999999", b"1e99"),
    "other types": (b"x", b"0x10", b"\xff\xfe"),
}
_PARTS: Mapping[str, Mapping[str, object]] = {
    "vmc": _VMC_PARTS,
    "udp, JSON": _JSON_PARTS,
    "udp, binary": _BINARY_PARTS,
    "serial": _LINE_PARTS,
}


def _beside(kind: str, protocol: Protocol, rng: Generator) -> tuple[bytes, frozenset[str]]:
    """A packet with sound and bad parts, and the names of the sound ones."""
    if protocol.name == "vmc":
        names = [f"device {index}" for index in range(5)]
        messages = [_vmc_part([name, 0.1 * index, 1.0, 0.0, *_IDENTITY]) for index, name in enumerate(names)]
        messages.insert(int(rng.integers(6)), _VMC_PARTS[kind](rng))
        return encode_bundle(messages), frozenset(names)
    if protocol.name == "serial":
        at, choices = int(rng.integers(3)), _LINE_PARTS[kind]
        fields = [b"%d" % count for count in _COUNTS]
        fields[at] = choices[int(rng.integers(len(choices)))]
        sound = frozenset(name for index, name in enumerate(_FLEX.names) if index != at)
        return b",".join((b"40210", *fields)), sound
    at = int(rng.integers(len(_SIX)))
    sound = frozenset(name for index, name in enumerate(_SIX.names) if index != at)
    if protocol.name == "udp, JSON":
        parts = {name: {"position": [0.5, 1.0, 0.0], "quat": [1, 0, 0, 0]} for name in _SIX.names}
        line = {"time": 1.0, "sensors": {**parts, _SIX.names[at]: _JSON_PARTS[kind](rng)}}
        return json.dumps(line).encode(), sound
    data = bytearray(protocol.sound)
    start = 16 + 32 * at + 4
    data[start : start + 28] = _BINARY_PARTS[kind]
    return bytes(data), sound


def _maker(kind: str) -> Callable[[Protocol, Generator], tuple[bytes, frozenset[str]]]:
    return lambda protocol, rng: _beside(kind, protocol, rng)


BESIDE: Mapping[str, Callable[[Protocol, Generator], tuple[bytes, frozenset[str]]]] = {
    kind: _maker(kind) for kind in dict.fromkeys(kind for parts in _PARTS.values() for kind in parts)
}
"""How bad parts are put beside sound ones, by kind: the packet, and the names that must come out of it."""
