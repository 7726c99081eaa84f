"""The parts of a MATLAB 5 file, looked over before a library reads them: none may ask for more memory than it fills.

The format, MathWorks, MAT-File Format, R2023b: a head of 128 bytes, then elements, each with its type, its length and
its bytes; a packed element (zlib) holds one other; the second element in a matrix is its size along each axis.
"""

import math
import struct
import zlib

_HEAD = 128
_MATRIX, _PACKED = 14, 15
_SPARSE = 5
_LAST_CLASS = 15
"""Classes up to the integers of 64 bits have their size in the second element; Java's objects and handles do not."""
_DEEPEST = 16
_UNPACKED = 1 << 28
"""Bytes beyond the file's own size to which its parts may unpack."""


def check_mat(content: bytes) -> None:
    """Raises ValueError where a file is no MATLAB 5 file, is cut off, or would fill more memory than it should."""
    mark = content[126:_HEAD]
    if mark not in (b"IM", b"MI"):
        raise ValueError("it is no MATLAB 5 file")
    _Parts("<" if mark == b"IM" else ">", _UNPACKED + len(content)).check(content[_HEAD:], 0)


class _Parts:
    """Walks through elements within elements."""

    def __init__(self, order: str, room: int) -> None:
        self._order = order
        self._room = room

    def check(self, data: bytes, depth: int) -> None:
        if depth > _DEEPEST:
            raise ValueError("its parts are nested without end")
        at = 0
        while at + 8 <= len(data):
            kind, length, begin = self._tag(data, at)
            end = begin + length
            if end > len(data):
                raise ValueError("a part is longer than what holds it")
            if kind == _PACKED:
                self.check(self._unpacked(data[begin:end]), depth + 1)
            elif kind == _MATRIX and length:
                self._check_matrix(data[begin:end], depth)
            at = end if kind == _PACKED else -(-end // 8) * 8

    def _check_matrix(self, data: bytes, depth: int) -> None:
        """A matrix has at least one byte for each of its values."""
        _, length, begin = self._tag(data, 0)
        number = data[begin] if self._order == "<" else data[begin + 3]
        _, many, after = self._tag(data, -(-(begin + length) // 8) * 8)
        axes = struct.unpack(f"{self._order}{many // 4}i", data[after : after + many // 4 * 4])
        plain = number <= _LAST_CLASS and number != _SPARSE
        if plain and (min(axes, default=0) < 0 or math.prod(axes) > len(data)):
            raise ValueError(f"an array of size {axes} does not fit its {len(data)} bytes")
        self.check(data, depth + 1)

    def _tag(self, data: bytes, at: int) -> tuple[int, int, int]:
        """Type and length of the element at a place, and where its bytes begin; small ones share four bytes."""
        kind, length = struct.unpack_from(f"{self._order}II", data, at)
        return (kind & 0xFFFF, kind >> 16, at + 4) if kind >> 16 else (kind, length, at + 8)

    def _unpacked(self, packed: bytes) -> bytes:
        reader = zlib.decompressobj()
        content = reader.decompress(packed, self._room)
        if reader.unconsumed_tail:
            raise ValueError("its parts would unpack to far more than the file holds")
        self._room -= len(content)
        return content
