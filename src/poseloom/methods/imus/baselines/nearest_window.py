"""The nearest signal windows: what their mean pose already gives."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.methods.imus.baselines.driving import Guess, SignalComparator, WindowSettings, mean_guess
from poseloom.methods.imus.baselines.examples import Examples
from poseloom.methods.imus.baselines.windows import index_windows
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True)
class NearestWindowSettings(WindowSettings):
    """Settings of `NearestWindow`.

    Attributes:
        neighbours: How many windows the mean is over.
        build: Weight of a differing build, in squared standard deviations of the signal a squared centimetre a bone.
    """

    samples: int = 30
    neighbours: int = 5
    build: float = 1.0


class _Memory(NamedTuple):
    """How strange the wearer is to the examples, and the nearest of them a moment ago."""

    strangeness: Floats32[Array, "frames"]
    rows: Ints[Array, "rows"]


class NearestWindow(SignalComparator[NearestWindowSettings]):
    """The mean pose of the examples whose last signals are most like those just heard.

    Source: the simplest use of paired examples (Slyper and Hodgins 2008 play back the best match), nothing simplified.
    Through a silence each neighbour's clip plays on.

    Args:
        examples: What it learns from.
        settings: Its settings; tuned ones unless given.
    """

    kind: ClassVar[str] = "nearest-window"

    def __init__(self, examples: Examples, settings: NearestWindowSettings | None = None) -> None:
        super().__init__(examples, settings or NearestWindowSettings())
        self._index = index_windows(examples, self.settings.samples)

    def _begin(self, skeleton: Skeleton) -> _Memory:
        return _Memory(self.examples.strangeness(skeleton, self.settings.build), np.empty(0, dtype=np.int64))

    def _estimate(self, memory: _Memory, window: Floats[Array, "samples channels"]) -> tuple[_Memory, Guess]:
        if np.isfinite(window[0]).any():
            rows = self._index.nearest(window, self.settings.neighbours, memory.strangeness).rows
        else:
            rows = self.examples.followers(memory.rows)
        return memory._replace(rows=rows), mean_guess(self.examples, rows, np.full(len(rows), 1 / len(rows)))
