"""Open Sound Control 1.0 messages and bundles as bytes, both ways."""

import struct
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from poseloom.live.readings import MalformedPacket

OscValue = int | float | str | bytes | bool | None

_BUNDLE = b"#bundle\0"
_IMMEDIATELY = 1
_DEEPEST = 4
_MOST_MESSAGES = 1024


class OscMessage(NamedTuple):
    """An address and its arguments."""

    address: str
    arguments: tuple[OscValue, ...]


def encode_message(address: str, arguments: Sequence[OscValue] = ()) -> bytes:
    """A message as bytes: int as `i`, float as `f`, str as `s`, bytes as `b`; True, False and None by their tags."""
    tags, parts = ",", b""
    for value in arguments:
        tag, data = _encode(value)
        tags += tag
        parts += data
    return _padded(address.encode()) + _padded(tags.encode()) + parts


def encode_bundle(messages: Iterable[bytes]) -> bytes:
    """Encoded messages as a bundle to be taken at once."""
    return _BUNDLE + struct.pack(">Q", _IMMEDIATELY) + b"".join(struct.pack(">i", len(m)) + m for m in messages)


def decode_packet(data: bytes, refused: list[str] | None = None) -> tuple[OscMessage, ...]:
    """All messages of a packet, those within bundles too, in order.

    Args:
        data: The packet's bytes.
        refused: Collects the reason for each message that cannot be decoded, while the others are returned. Without
            it the first such message raises.

    Raises:
        MalformedPacket: for bytes that are no OSC, bundles within bundles within bundles, or very many messages.
    """
    messages: list[OscMessage] = []
    _decode(data, messages, 0, refused)
    return tuple(messages)


def _encode(value: OscValue) -> tuple[str, bytes]:
    if isinstance(value, bool):
        return ("T" if value else "F"), b""
    if value is None:
        return "N", b""
    if isinstance(value, int):
        return "i", struct.pack(">i", value)
    if isinstance(value, float):
        return "f", struct.pack(">f", value)
    if isinstance(value, str):
        return "s", _padded(value.encode())
    return "b", struct.pack(">i", len(value)) + value + bytes(-len(value) % 4)


def _padded(text: bytes) -> bytes:
    return text + bytes(4 - len(text) % 4)


def _decode(data: bytes, messages: list[OscMessage], depth: int, refused: list[str] | None) -> None:
    try:
        _decode_strictly(data, messages, depth, refused)
    except MalformedPacket as error:
        if refused is None:
            raise
        refused.append(str(error))


def _decode_strictly(data: bytes, messages: list[OscMessage], depth: int, refused: list[str] | None) -> None:
    if data[:8] != _BUNDLE:
        if len(messages) >= _MOST_MESSAGES:
            raise MalformedPacket("too many messages in one packet")
        messages.append(_decode_message(data))
        return
    if depth >= _DEEPEST:
        raise MalformedPacket("bundles too deep within bundles")
    at = 16
    if len(data) < at:
        raise MalformedPacket("a bundle without its time")
    while at < len(data):
        size = int(_number(data, at, ">i", 4))
        at += 4
        if size < 4 or size % 4 or at + size > len(data):
            raise MalformedPacket("a bundle's element of an impossible size")
        _decode(data[at : at + size], messages, depth + 1, refused)
        at += size


def _decode_message(data: bytes) -> OscMessage:
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise MalformedPacket("no OSC address")
    if at == len(data):
        return OscMessage(address, ())  # old senders leave the tags out
    tags, at = _text(data, at)
    if not tags.startswith(","):
        raise MalformedPacket("no type tags")
    values: list[OscValue] = []
    for tag in tags[1:]:
        value, at = _decode_value(data, at, tag)
        values.append(value)
    return OscMessage(address, tuple(values))


def _decode_value(data: bytes, at: int, tag: str) -> tuple[OscValue, int]:
    if tag in _NUMBERS:
        form, size = _NUMBERS[tag]
        return _number(data, at, form, size), at + size
    if tag in _WORDS:
        return _WORDS[tag], at
    if tag in "sS":
        return _text(data, at)
    if tag == "b":
        size = int(_number(data, at, ">i", 4))
        end = at + 4 + size
        if size < 0 or end > len(data):
            raise MalformedPacket("a blob longer than its packet")
        return data[at + 4 : end], end + -size % 4
    raise MalformedPacket("an unknown type tag")


_NUMBERS = {
    "i": (">i", 4), "f": (">f", 4), "h": (">q", 8), "d": (">d", 8), "t": (">Q", 8), "c": (">i", 4), "r": (">I", 4),
    "m": (">I", 4),
}  # fmt: skip
_WORDS: dict[str, OscValue] = {"T": True, "F": False, "N": None, "I": float("inf")}


def _number(data: bytes, at: int, form: str, size: int) -> int | float:
    if at + size > len(data):
        raise MalformedPacket("it ends within a number")
    return struct.unpack_from(form, data, at)[0]


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at)
    if end < 0:
        raise MalformedPacket("a text without its end")
    try:
        text = data[at:end].decode()
    except UnicodeDecodeError:
        raise MalformedPacket("a text that is not UTF-8") from None
    return text, end + 4 - (end - at) % 4
