"""What stands in an artefact, checked before anything uses it: a stranger may have written it.

Compiled kernels check no index: a number from a file that reaches one unchecked is read or written anywhere in memory.
So every array is taken through `ArtefactArrays`, which asks for its type, its shape, its range, and settings through
`plain_settings`.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from poseloom.arrays import frozen
from poseloom.errors import FormatError

Settings = TypeVar("Settings")

LARGEST = 1e9
"""Beyond any number that a model or calibration holds, and far below where products of two become infinite."""

RATES = (0.1, 100_000.0)
"""Samples a second that a file may state."""


class ArtefactArrays:
    """The arrays of an artefact, by name.

    Axes have names too: `floats("features", "states columns")`. An axis has one length throughout; a number stands for
    itself.

    Args:
        arrays: The arrays.
        sizes: Lengths of axes that are known already.
    """

    def __init__(self, arrays: Mapping[str, NDArray[Any]], **sizes: int) -> None:
        self._arrays = arrays
        self.sizes = dict(sizes)
        """Lengths of the axes so far."""

    def floats(
        self,
        name: str,
        axes: str,
        dtype: DTypeLike = np.float64,
        low: float = -LARGEST,
        high: float = LARGEST,
        missing: bool = False,
    ) -> NDArray[Any]:
        """An array of finite numbers from `low` to `high`; with `missing`, NaN may stand for one that is not known.

        Raises:
            FormatError: where it is missing or another.
        """
        array = self._shaped(name, axes, np.dtype(dtype))
        known = array[~np.isnan(array)] if missing else array
        if known.size and not low <= float(known.min()) <= float(known.max()) <= high:  # never so with a NaN
            raise FormatError(f"array {name!r} holds numbers that are not between {low:g} and {high:g}")
        return array

    def indices(self, name: str, axes: str, below: int, low: int = 0) -> NDArray[np.int64]:
        """An array of whole numbers from `low` to `below` - 1.

        Raises:
            FormatError: where it is missing or another.
        """
        array = self._shaped(name, axes, np.dtype(np.int64))
        if array.size and not (low <= int(array.min()) <= int(array.max()) < below):
            raise FormatError(f"array {name!r} points outside of {low} to {below - 1}")
        return array

    def booleans(self, name: str, axes: str) -> NDArray[np.bool_]:
        """An array of truth values.

        Raises:
            FormatError: where it is missing or another.
        """
        array = self._shaped(name, axes, np.dtype(np.bool_))
        # A byte that is neither 0 nor 1 is a truth value to numpy, and 255 to arithmetic.
        if array.size and int(array.view(np.uint8).max()) > 1:
            raise FormatError(f"array {name!r} holds something else than true and false")
        return array

    def numbers(self, name: str, axes: str, dtype: DTypeLike) -> NDArray[Any]:
        """An array of any numbers of a type.

        Raises:
            FormatError: where it is missing or another.
        """
        return self._shaped(name, axes, np.dtype(dtype))

    def _shaped(self, name: str, axes: str, dtype: np.dtype[Any]) -> NDArray[Any]:
        array = self._arrays.get(name)
        if array is None:
            raise FormatError(f"the array {name!r} is missing")
        if array.dtype != dtype:
            raise FormatError(f"array {name!r} is of {array.dtype}, not of {dtype}")
        wanted = axes.split()
        lengths = [int(axis) if axis.isdigit() else self.sizes.get(axis) for axis in wanted]
        if array.ndim != len(wanted) or any(
            known not in (None, length) for known, length in zip(lengths, array.shape, strict=False)
        ):
            told = ", ".join(
                axis if known is None or axis.isdigit() else f"{axis} = {known}"
                for axis, known in zip(wanted, lengths, strict=True)
            )
            raise FormatError(f"array {name!r} has shape {array.shape}, not ({told})")
        for axis, length in zip(wanted, array.shape, strict=True):
            if not axis.isdigit():
                self.sizes[axis] = length
                if length == 0:
                    raise FormatError(f"array {name!r} is empty")
        return frozen(array)


def plain_settings(usual: Settings, stated: Any, ranges: Mapping[str, tuple[float, float]] | None = None) -> Settings:
    """Settings with what a file states of them: each of the type of the usual value, finite and in its range.

    Args:
        usual: A dataclass of numbers, truth values, words, tuples of numbers and such dataclasses.
        stated: By name; what it leaves out stays as usual.
        ranges: Least and greatest value by name; 0 to a million for other numbers.

    Raises:
        FormatError: for another type, an unknown name or a number out of range.
    """
    if not isinstance(stated, Mapping):
        raise FormatError("the settings are no list of names and values")
    values = cast(Mapping[Any, Any], stated)
    known = {field.name: getattr(usual, field.name) for field in fields(cast(Any, usual))}
    unknown = [str(name) for name in values if name not in known]
    if unknown:
        raise FormatError(f"there is no setting {unknown[0][:40]!r}")
    changes = {name: _plain(name, known[name], value, ranges or {}) for name, value in values.items()}
    return replace(cast(Any, usual), **changes)


def rate(value: Any) -> float:
    """A rate in Hz. Raises FormatError for what is none."""
    return checked_number("the rate", value, *RATES)


def checked_number(name: str, value: Any, low: float, high: float) -> float:
    """A finite number in a range. Raises FormatError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise FormatError(f"{name} is {str(value)[:40]}, not a number from {low:g} to {high:g}")
    return float(value)


def _plain(name: str, usual: Any, value: Any, ranges: Mapping[str, tuple[float, float]]) -> Any:
    if is_dataclass(usual):
        return plain_settings(usual, value, ranges)
    if isinstance(usual, bool | str):
        if type(value) is not type(usual):
            wanted = "text" if isinstance(usual, str) else "true or false"
            raise FormatError(f"the setting {name!r} is {str(value)[:40]}, not {wanted}")
        return value
    if isinstance(usual, tuple):
        return _tuple(name, cast("tuple[Any, ...]", usual), value, ranges)
    number = checked_number(f"the setting {name!r}", value, *ranges.get(name, (0.0, 1e6)))
    if isinstance(usual, int):
        if not number.is_integer():
            raise FormatError(f"the setting {name!r} is {number:g}, not a whole number")
        return int(number)
    return number


def _tuple(name: str, usual: tuple[Any, ...], value: Any, ranges: Mapping[str, tuple[float, float]]) -> tuple[Any, ...]:
    is_list = isinstance(value, (list, tuple))
    items: list[Any] | None = list(cast("list[Any]", value)) if is_list else None
    # Tuples of numbers have a fixed length; those of tuples are lists of any length, each like the first.
    nested = bool(usual) and isinstance(usual[0], tuple)
    if items is None or (not nested and len(items) != len(usual)) or len(items) > 100:
        raise FormatError(f"the setting {name!r} is {str(value)[:40]}, not {len(usual)} values")
    models: list[Any] = [usual[0]] * len(items) if nested else list(usual)
    return tuple(_plain(name, model, item, ranges) for model, item in zip(models, items, strict=True))
