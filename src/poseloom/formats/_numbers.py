"""Numbers and words of a text file with the lines they stand in."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Ints
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


def scan(text: bytes, first_line: int = 1) -> Tokens:
    """Splits text at blanks and commas into numbers and words."""
    room = len(text) // 2 + 1
    values, words = np.empty(room), np.empty(room, dtype=np.int64)
    begins, ends, lines = (np.empty(room, dtype=np.int64) for _ in range(3))
    kinds: NDArray[np.int8] = np.empty(room, dtype=np.int8)
    characters = np.frombuffer(text, dtype=np.uint8)
    count = kernels.scan(characters, first_line, values, kinds, begins, ends, lines, words)
    inexact = np.flatnonzero(kinds[:count] == kernels.INEXACT)
    places = zip(begins[inexact].tolist(), ends[inexact].tolist(), strict=True)
    values[inexact] = [float(text[begin:end]) for begin, end in places]
    return Tokens(text, values[:count], begins[:count], ends[:count], lines[:count], words[:count])
