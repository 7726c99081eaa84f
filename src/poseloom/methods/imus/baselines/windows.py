"""Search for the examples whose last signals are most like those just heard."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints
from poseloom.methods.imus.baselines.examples import Examples

_DIRECTIONS = 32
"""Principal directions of windows in which the search is done first; they hold 97 % of a window's movement or more."""

_CANDIDATES = 4
"""Times as many windows are taken from there as are wanted, and compared in full."""


class Found(NamedTuple):
    """The nearest windows, nearest first.

    Attributes:
        rows: Their last frames.
        squares: Mean squared difference of a channel, in squared standard deviations.
    """

    rows: Ints[Array, "found"]
    squares: Floats[Array, "found"]


@dataclass(frozen=True, eq=False)
class WindowIndex:
    """The windows of all examples, newest signal first; what lies before a clip's start is taken to be like its start.

    Attributes:
        windows: One row an example.
        squares: Squared length of each window's newest samples: of the newest, of the two newest ...
        directions: Principal directions of windows.
        places: Windows along these.
        place_squares: Their squared lengths.
    """

    windows: Floats32[Array, "frames columns"]
    squares: Floats32[Array, "frames samples"]
    directions: Floats32[Array, "columns directions"]
    places: Floats32[Array, "frames directions"]
    place_squares: Floats32[Array, "frames"]

    def nearest(
        self, window: Floats[Array, "samples channels"], count: int, strangeness: Floats32[Array, "frames"]
    ) -> Found:
        """The nearest windows; channels and moments that are NaN do not count.

        Args:
            window: Standardised signals, newest first.
            count: How many.
            strangeness: Added to each example's mean squared difference.
        """
        wanted = window.reshape(-1)
        there = np.isfinite(wanted)
        query = wanted[there].astype(np.float32)
        if len(query) == len(wanted):
            squares = self.place_squares - 2 * (self.places @ (query @ self.directions))
            rows = _least(squares + len(query) * strangeness, _CANDIDATES * count)
        else:
            rows = _least(self._partial(window, there, query) + len(query) * strangeness, count)
        apart = self.windows[rows][:, there] - query
        exact = np.einsum("ij,ij->i", apart, apart).astype(np.float64) / max(len(query), 1)
        exact += strangeness[rows]
        order = np.argsort(exact, kind="stable")[:count]
        return Found(rows[order].astype(np.int64), exact[order])

    def _partial(
        self, window: Floats[Array, "samples channels"], there: Bools[Array, "columns"], query: Floats32[Array, "known"]
    ) -> Floats32[Array, "frames"]:
        """Squared distances, but for a constant, over the columns that are there."""
        length = len(query) // window.shape[1]
        if length * window.shape[1] == len(query) and bool(np.all(there[: len(query)])):
            # A window that has only begun is a prefix: a view, not a copy.
            return self.squares[:, length - 1] - 2 * (self.windows[:, : len(query)] @ query)
        part = self.windows[:, there]
        return np.einsum("ij,ij->i", part, part) - 2 * (part @ query)


def index_windows(examples: Examples, samples: int) -> WindowIndex:
    """The windows of so many samples of all examples."""
    windows = windows_of(examples, samples)
    squares = np.square(windows).reshape(len(windows), samples, -1).sum(axis=2).cumsum(axis=1)
    directions = principal_directions(windows, _DIRECTIONS)
    places = windows @ directions
    return WindowIndex(windows, squares, directions, places, np.einsum("ij,ij->i", places, places))


def windows_of(examples: Examples, samples: int) -> Floats32[Array, "frames columns"]:
    """The last signals of each example, newest first."""
    frames = np.arange(len(examples))
    first = examples.starts[examples.clip_of_frame]
    back = [examples.signals[np.maximum(frames - shift, first)] for shift in range(samples)]
    return np.ascontiguousarray(np.concatenate(back, axis=1))


def principal_directions(rows: Floats32[Array, "rows columns"], count: int) -> Floats32[Array, "columns directions"]:
    """Directions, about the origin, along which rows reach farthest."""
    scatter = rows.T.astype(np.float64) @ rows.astype(np.float64)
    return np.linalg.eigh(scatter)[1][:, : -count - 1 : -1].astype(np.float32)


def _least(values: Floats32[Array, "values"], count: int) -> Ints[Array, "least"]:
    count = min(count, len(values))
    return np.argpartition(values, count - 1)[:count]
