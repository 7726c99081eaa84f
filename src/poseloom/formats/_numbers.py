"""Numbers and words of a text file with the lines they stand in."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Ints
from poseloom.errors import FormatError
from poseloom.formats import _numbers_kernels as kernels


@dataclass(frozen=True, eq=False)
class Tokens:
    """Tokens of a text, in order.

    Attributes:
        text: The bytes that were scanned.
        values: Each token's number, correctly rounded; NaN for a word. A number too large for a double is infinite.
        begins: Place of each token's first byte.
        ends: Place after each token's last byte.
        lines: Line of each token, counted from 1.
        words: A hash of each word; zero for numbers.
    """

    text: bytes
    values: Floats[Array, "tokens"]
    begins: Ints[Array, "tokens"]
    ends: Ints[Array, "tokens"]
    lines: Ints[Array, "tokens"]
    words: Ints[Array, "tokens"]

    def __len__(self) -> int:
        return len(self.values)

    def word(self, token: int) -> str:
        """A token as it stands in the file."""
        return self.text[int(self.begins[token]) : int(self.ends[token])].decode("latin-1")


_ROOM = 1 << 30
"""Bytes beyond the text's own that its tokens may take."""
_TOKEN_BYTES = 41


def scan(text: bytes, first_line: int = 1, file: Path | None = None) -> Tokens:
    """Splits text at blanks and commas into numbers and words.

    Raises:
        FormatError: where the tokens would take more than 1 GiB beyond the text's own size.
    """
    characters = np.frombuffer(text, dtype=np.uint8)
    room = kernels.count_tokens(characters)
    if room * _TOKEN_BYTES > _ROOM + len(text):
        raise FormatError(
            f"the file holds {room:,} numbers, more than memory is taken for",
            cause="it holds many takes, or is no motion",
            remedy="Split it",
            file=file,
        )
    values, words = np.empty(room), np.empty(room, dtype=np.int64)
    begins, ends, lines = (np.empty(room, dtype=np.int64) for _ in range(3))
    kinds: NDArray[np.int8] = np.empty(room, dtype=np.int8)
    count = kernels.scan(characters, first_line, values, kinds, begins, ends, lines, words)
    inexact = np.flatnonzero(kinds[:count] == kernels.INEXACT)
    places = zip(begins[inexact].tolist(), ends[inexact].tolist(), strict=True)
    values[inexact] = [float(text[begin:end]) for begin, end in places]
    return Tokens(text, values[:count], begins[:count], ends[:count], lines[:count], words[:count])
