"""Arrays as `.npy` bytes: read from a stranger's, whose shape may ask for no more than the bytes that follow, and
written so that a full disk is noticed."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

_LONGEST_EMPTY = 100_000
"""Longest axis of an array that holds nothing: whoever loops over it must come to an end."""


def read_npy(stream: Any, size: int, name: str) -> NDArray[Any]:
    """An array of numbers, truth values or text, in memory, row by row.

    Args:
        stream: Binary, at its first byte.
        size: Bytes from there to its end.
        name: For errors.

    Raises:
        ValueError: for anything else than such an array that fills the bytes.
    """
    begin = stream.tell()
    version = npy.read_magic(stream)
    if version == (1, 0):
        shape, by_column, dtype = npy.read_array_header_1_0(stream)
    elif version == (2, 0):
        shape, by_column, dtype = npy.read_array_header_2_0(stream)
    else:
        raise ValueError(f"array {name!r} has version {version}")
    room = size - (stream.tell() - begin)
    if dtype.kind not in "biufU" or dtype.itemsize == 0:
        raise ValueError(f"array {name!r} of type {dtype} holds no numbers, truth values or text")
    fits = all(length >= 0 for length in shape) and math.prod(shape) * dtype.itemsize == room
    if not fits or max(shape, default=0) > max(room, _LONGEST_EMPTY):
        raise ValueError(f"array {name!r} of shape {shape} does not fit its {room} bytes")
    content = bytearray(room)
    at, view = 0, memoryview(content)
    while at < room:
        count = stream.readinto(view[at:])
        if not count:
            raise ValueError(f"array {name!r} is cut off")
        at += int(count)
    stream.read(1)  # a packed member checks its sum at its end
    array = np.frombuffer(content, dtype).reshape(shape, order="F" if by_column else "C")
    array = np.asarray(array, order="C")
    array.flags.writeable = False
    return array


def write_npy(path: Path, array: NDArray[Any]) -> None:
    """Writes an array row by row.

    Not by `numpy.save`: that writes through a buffer of C's, and where the disk is full at its end, the last bytes are
    lost without a word.

    Raises:
        OSError: where not all of it can be written.
    """
    rows = np.asarray(array, order="C")
    with path.open("wb") as stream:
        npy.write_array_header_1_0(stream, npy.header_data_from_array_1_0(rows))
        stream.write(rows.reshape(-1).view(np.uint8).data)
