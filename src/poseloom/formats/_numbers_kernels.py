"""The scanner under all text formats: bytes to numbers at the speed of memory."""

import numpy as np

from poseloom.arrays import Array, Floats, Ints, compiled

NUMBER, INEXACT, WORD = 0, 1, 2
"""Kinds of tokens: a number, a number that needs exact arithmetic, anything else."""


@compiled
def scan(
    text: "np.ndarray[tuple[int], np.dtype[np.uint8]]",
    line: int,
    values: Floats[Array, "tokens"],
    kinds: "np.ndarray[tuple[int], np.dtype[np.int8]]",
    begins: Ints[Array, "tokens"],
    ends: Ints[Array, "tokens"],
    lines: Ints[Array, "tokens"],
    words: Ints[Array, "tokens"],
) -> int:
    """Splits text at blanks and commas; fills the value, kind, place, line and word hash of each token; counts them.

    A decimal number of at most 2^53 times or over a power of ten up to 10^22 is one correctly rounded operation on two
    exact doubles (Clinger, How to read floating point numbers accurately, 1990); others are marked INEXACT and left to
    the caller. A word's value is NaN and its hash is FNV-1a; a number's hash is zero.
    """
    powers = np.empty(23)
    powers[0] = 1.0
    for i in range(1, 23):
        powers[i] = powers[i - 1] * 10.0
    size = text.shape[0]
    count = 0
    i = 0
    while i < size:
        c = text[i]
        if c == 10:
            line += 1
        if c == 32 or (9 <= c <= 13) or c == 44:
            i += 1
            continue
        begin = i
        negative = c == 45
        if c == 45 or c == 43:
            i += 1
        mantissa = np.int64(0)
        digits = 0  # significant ones, as far as they fit
        seen = 0
        exponent = 0
        exact = True
        while i < size and 48 <= text[i] <= 57:
            seen += 1
            if digits < 18:
                mantissa = mantissa * 10 + np.int64(text[i] - 48)
                if mantissa > 0:
                    digits += 1
            else:
                exponent += 1
                exact = False
            i += 1
        if i < size and text[i] == 46:
            i += 1
            while i < size and 48 <= text[i] <= 57:
                seen += 1
                if digits < 18:
                    mantissa = mantissa * 10 + np.int64(text[i] - 48)
                    exponent -= 1
                    if mantissa > 0:
                        digits += 1
                elif text[i] != 48:
                    exact = False
                i += 1
        number = seen > 0
        if number and i < size and (text[i] == 101 or text[i] == 69):
            i += 1
            down = i < size and text[i] == 45
            if i < size and (text[i] == 45 or text[i] == 43):
                i += 1
            figures = 0
            power = 0
            while i < size and 48 <= text[i] <= 57:
                if power < 100000:
                    power = power * 10 + np.int64(text[i] - 48)
                figures += 1
                i += 1
            number = figures > 0
            exponent += -power if down else power
        if i < size and not (text[i] == 32 or (9 <= text[i] <= 13) or text[i] == 44):
            number = False
        begins[count] = begin
        lines[count] = line
        if number:
            words[count] = 0
            if exact and mantissa <= 9007199254740992 and -22 <= exponent <= 22:
                value = float(mantissa)
                value = value * powers[exponent] if exponent >= 0 else value / powers[-exponent]
                values[count] = -value if negative else value
                kinds[count] = 0
            elif exact and mantissa == 0:
                values[count] = -0.0 if negative else 0.0
                kinds[count] = 0
            else:
                values[count] = np.nan
                kinds[count] = 1
        else:
            i = begin
            code = np.uint64(14695981039346656037)
            while i < size and not (text[i] == 32 or (9 <= text[i] <= 13) or text[i] == 44):
                code = (code ^ np.uint64(text[i])) * np.uint64(1099511628211)
                i += 1
            words[count] = np.int64(code >> np.uint64(1))
            values[count] = np.nan
            kinds[count] = 2
        ends[count] = i
        count += 1
    return count


@compiled
def count_tokens(text: "np.ndarray[tuple[int], np.dtype[np.uint8]]") -> int:
    """How many tokens `scan` will find."""
    count = 0
    inside = False
    for i in range(text.shape[0]):
        c = text[i]
        apart = c == 32 or (9 <= c <= 13) or c == 44
        if not apart and not inside:
            count += 1
        inside = not apart
    return count
