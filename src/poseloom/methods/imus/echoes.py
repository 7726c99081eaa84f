"""A second opinion: the frames of the examples whose last signals are most like those just heard.

The posterior of the HMM remembers which segment one was in, and errs by staying in it; the nearest frames remember
nothing but the last fraction of a second, and err by leaping. Their errors differ, so the mean of both is nearer to the
truth than either. The distances run along with the signal (see `_echo_kernels.follow`): a sample costs what comparing
one sample with every frame costs, whatever the length of the window.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints, frozen
from poseloom.methods.imus import _echo_kernels
from poseloom.methods.imus.model import HmmModel


class Echoes(NamedTuple):
    """How far off each frame is.

    Attributes:
        distances: Weighted sums of squared differences, one a state.
        weight: Sum of the weights.
    """

    distances: Floats32[Array, "states"]
    weight: float


@dataclass(frozen=True, eq=False)
class EchoSearch:
    """The frames that are compared. Make one with `echo_search`.

    Attributes:
        model: Whose.
        begins: Which states begin a clip.
        weights: One over the mean square of each channel's quantity, over channels: axes share one, directions stay.
        kept: What a distance is faded by in each sample.
        count: Frames that are sought.
    """

    model: HmmModel
    begins: Bools[Array, "states"]
    weights: Floats32[Array, "channels"]
    kept: float
    count: int

    def none(self) -> Echoes:
        """Before anything was heard."""
        return Echoes(np.zeros(len(self.model), dtype=np.float32), 0.0)

    def heard(self, echoes: Echoes, said: Floats[Array, "channels"]) -> Echoes:
        """A sample later; nothing is done where no frame is sought."""
        if self.count == 0:
            return echoes
        out = np.empty_like(echoes.distances)
        _echo_kernels.follow(
            echoes.distances, self.model.signals, self.begins, said.astype(np.float32), self.weights, self.kept, out
        )
        return Echoes(out, self.kept * echoes.weight + 1.0)

    def nearest(
        self, echoes: Echoes, strangeness: Floats32[Array, "segments"]
    ) -> tuple[Ints[Array, "found"], Ints[Array, "found"]]:
        """The nearest states and their segments.

        Args:
            echoes: The distances.
            strangeness: Added to the mean squared difference of a channel (in its variances), for each segment.
        """
        rows, owners = np.empty(self.count, dtype=np.int64), np.empty(self.count, dtype=np.int64)
        found = _echo_kernels.nearest(
            echoes.distances, 1 / max(echoes.weight, 1.0), strangeness, self.model.first, self.model.stop, rows, owners
        )
        return rows[:found], owners[:found]


def echo_search(model: HmmModel, kept: float, count: int) -> EchoSearch:
    """The search among a model's states."""
    follows = np.zeros(len(model.first), dtype=np.bool_)
    follows[model.successor[model.successor >= 0]] = True
    begins = np.zeros(len(model), dtype=np.bool_)
    begins[model.first[~follows]] = True
    variance = model.signals.var(axis=0, dtype=np.float64).reshape(-1, 3).mean(axis=1)
    weights = np.repeat(1 / np.maximum(variance, 1e-12), 3) / model.signals.shape[1]
    return EchoSearch(model, frozen(begins), frozen(weights.astype(np.float32)), kept, count)
