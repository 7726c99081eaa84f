"""Whether a flex log's numbers are counts of a converter, volts or percent, and what they are in counts."""

from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, unknown_name

TOP = 4095.0
"""Highest count: the methods know sensors on converters of 12 bits."""

KINDS = ("counts", "volts", "millivolts", "percent", "degrees")
_SUPPLIES = (3.3, 5.0)
_FRACTIONS = 0.02
"""Share of numbers with decimals above which they are no single readings of a converter."""
_SWING = 20.0
"""Range of a channel from which whole numbers up to 100 are percent: counts of a bent sensor swing further."""


class FlexValues(NamedTuple):
    """Counts, and a sentence that says what they were."""

    counts: Floats[Array, "samples channels"]
    said: str


def as_counts(
    values: Floats[Array, "samples channels"], named: str = "", chosen: str = "", full_scale: float | None = None
) -> FlexValues:
    """Counts of 12 bits from what a log holds.

    Args:
        values: As written; NaN = missing.
        named: The kind that the header says; empty where it does not.
        chosen: The kind that the user gives.
        full_scale: The value at the converter's upper end, in the log's own unit; found if left out.

    Raises:
        FormatError: for degrees, which no converter reads, and for values that may be of several kinds.
    """
    if chosen and chosen not in KINDS:
        raise unknown_name("kind of values", chosen, KINDS, FormatError)
    known = values[np.isfinite(values)]
    if known.size == 0:
        return FlexValues(values, "counts: all missing")
    kind = chosen or named or _kind(values, known)
    how = (
        "as given" if chosen else "as the header says" if named else f"for they are {known.min():g} to {known.max():g}"
    )
    if kind == "degrees":
        raise FormatError(
            f"the values are degrees, {how}: they are no counts of a converter",
            cause="methods learn each sensor's own curve from counts to bends",
            remedy="Log the converter's counts or volts; where these are counts, say so (--values counts)",
        )
    if kind == "counts":
        return FlexValues(values, f"counts, {how}")
    if full_scale is not None and not (np.isfinite(full_scale) and full_scale > 0):
        raise FormatError(f"a full scale of {full_scale:g}", remedy="Give a positive number")
    top = full_scale or _full_scale(kind, known)
    counts = values * (TOP / top)
    counts[(values >= 0) & (values > top * 0.9995) & (values <= top * 1.02)] = TOP
    return FlexValues(counts, f"{kind}, {how}; {top:g} is taken as the converter's upper end ({TOP:g})")


def _full_scale(kind: str, known: Floats[Array, "_"]) -> float:
    if kind == "percent":
        return 100.0
    size = 1000.0 if kind == "millivolts" else 1.0
    top = next((supply for supply in _SUPPLIES if known.max() <= 1.02 * supply * size), 0.0) * size
    if top == 0.0:
        raise FormatError(
            f"the {kind} reach {known.max():g}",
            cause="converters are fed 3.3 or 5 volts",
            remedy="Name the value at the converter's upper end (--full-scale VALUE)",
        )
    return top


def _kind(values: Floats[Array, "samples channels"], known: Floats[Array, "_"]) -> str:
    fractions = np.count_nonzero(known % 1) / known.size > _FRACTIONS
    top = float(np.percentile(known, 99.9))
    with np.errstate(invalid="ignore"):
        ranges = [np.ptp(column[np.isfinite(column)]) for column in values.T if np.isfinite(column).any()]
    swings = max(float(swing) for swing in ranges)
    if known.min() < 0 and top <= 180.5:
        return "degrees"
    if fractions and 1.05 < top <= 5.1:
        return "volts"
    if not fractions and (top > 180.5 or swings <= _SWING):
        return "counts"
    if fractions and top > 180.5:
        return "counts"  # means of several readings
    if not fractions and 50 < top <= 100:
        return "percent"
    raise FormatError(
        f"what the values are cannot be told: they are {known.min():g} to {top:g}",
        cause="they may be percent, degrees, volts or counts",
        remedy="Say it (--values counts, volts, millivolts or percent); the converter's counts are best",
    )
