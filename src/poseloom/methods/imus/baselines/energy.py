"""Riaz et al. 2015: nearest signal windows, and a pose that minimises an energy among them."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.methods.imus.baselines.driving import Guess, SignalComparator, WindowSettings, mean_guess
from poseloom.methods.imus.baselines.examples import Examples
from poseloom.methods.imus.baselines.windows import Found, index_windows
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True)
class EnergySettings(WindowSettings):
    """Settings of `SparseAccelerometers`.

    Attributes:
        samples: Length of the windows that are searched.
        neighbours: How many windows the local model is made of.
        components: Dimensions of the local model.
        control: Weight of what the sensors say now.
        smoothness: Weight of going on as the neighbours do.
        build: Weight of a differing build (see `NearestWindowSettings`).
        floor: Standard deviation of a feature (about a radian) that the prior allows beyond the local model's.
    """

    samples: int = 45
    neighbours: int = 6
    components: int = 8
    control: float = 1.0
    smoothness: float = 0.3
    build: float = 0.1
    floor: float = 0.02


class _Memory(NamedTuple):
    """How strange the wearer is to the examples; the neighbours and the pose of the moment before."""

    strangeness: Floats32[Array, "frames"]
    found: Found
    features: Floats[Array, "features"] | None


class SparseAccelerometers(SignalComparator[EnergySettings]):
    """Nearest neighbours over windows of the signal, a local linear model of them, and the least energy in it.

    Source: Riaz, Tao, Krueger, Weber, Motion reconstruction using sparse accelerometer data, Sensors 15 (2015). As
    there, neighbours by windows of readings span a low-dimensional local model, and the pose minimises the sum of a
    prior (distance from the neighbours in their own spread), a control term (the sensors' readings against those that
    the pose would give) and smoothness. Simplified: neighbours by exact search instead of a tree and a graph over
    time; readings as a linear function of the pose, fitted over the neighbours, instead of second differences of
    places; the energy is quadratic then, and its least is found in one solve. More than there: gyroscopes are heard
    too, for every comparator has the same sensors. Through a silence the neighbours' clips play on.

    Args:
        examples: What it learns from.
        settings: Its settings; tuned ones unless given.
    """

    kind: ClassVar[str] = "sparse-accelerometers"

    def __init__(self, examples: Examples, settings: EnergySettings | None = None) -> None:
        super().__init__(examples, settings or EnergySettings())
        self._index = index_windows(examples, self.settings.samples)

    def _begin(self, skeleton: Skeleton) -> _Memory:
        strangeness = self.examples.strangeness(skeleton, self.settings.build)
        return _Memory(strangeness, Found(np.empty(0, dtype=np.int64), np.empty(0)), None)

    def _estimate(self, memory: _Memory, window: Floats[Array, "samples channels"]) -> tuple[_Memory, Guess]:
        heard = np.isfinite(window[0])
        if heard.any():
            found = self._index.nearest(window, self.settings.neighbours, memory.strangeness)
        else:
            found = Found(self.examples.followers(memory.found.rows), memory.found.squares)
        weights = _weights(found)
        guess = mean_guess(self.examples, found.rows, weights)
        features = self._least_energy(found.rows, weights, guess, memory.features, window[0])
        return _Memory(memory.strangeness, found, features), Guess(features, guess.step, guess.variances)

    def _least_energy(
        self,
        rows: Ints[Array, "rows"],
        weights: Floats[Array, "rows"],
        guess: Guess,
        before: Floats[Array, "features"] | None,
        signal: Floats[Array, "channels"],
    ) -> Floats[Array, "features"]:
        settings = self.settings
        root = np.sqrt(weights)[:, None]
        apart = self.examples.features[rows].astype(np.float64) - guess.features
        directions, spreads = _local_model(root * apart, settings.components)
        places = apart @ directions
        system = np.diag(1 / (spreads**2 + settings.floor**2))
        right = np.zeros(len(spreads))
        heard = np.isfinite(signal)
        if heard.any() and settings.control > 0:
            signals = self.examples.signals[rows].astype(np.float64)[:, heard]
            mean = weights @ signals
            slopes, noise = _regressed(root * places, root * (signals - mean), settings.floor)
            system += settings.control * slopes @ (slopes / noise).T
            right += settings.control * slopes @ ((signal[heard] - mean) / noise)
        if before is not None and settings.smoothness > 0:
            earlier = np.maximum(rows - 1, self.examples.starts[self.examples.clip_of_frame[rows]])
            onward = weights @ (self.examples.features[rows] - self.examples.features[earlier]).astype(np.float64)
            tightness = settings.smoothness / settings.floor**2
            system += tightness * np.eye(len(spreads))
            right += tightness * ((before + onward - guess.features) @ directions)
        return guess.features + directions @ np.linalg.solve(system, right)


def _weights(found: Found) -> Floats[Array, "found"]:
    """Weights that fall with the distance, in units of the median neighbour's, and sum to one."""
    scale = max(float(np.median(found.squares)), 1e-12)
    weights = np.exp(-0.5 * found.squares / scale)
    return weights / weights.sum()


def _local_model(
    rows: Floats[Array, "rows features"], components: int
) -> tuple[Floats[Array, "features components"], Floats[Array, "components"]]:
    """Principal directions of weighted rows (whose mean is zero) and the spread along each."""
    values, vectors = np.linalg.eigh(rows @ rows.T)
    kept = values[::-1][:components] > 1e-9
    chosen = vectors[:, ::-1][:, :components][:, kept]
    spreads = np.sqrt(values[::-1][:components][kept])
    return (rows.T @ chosen) / spreads, spreads


def _regressed(
    places: Floats[Array, "rows components"], signals: Floats[Array, "rows channels"], floor: float
) -> tuple[Floats[Array, "components channels"], Floats[Array, "channels"]]:
    """Slopes of the signals along the local model, and the variance that they leave, both of weighted rows."""
    scatter = places.T @ places + floor**2 * np.eye(places.shape[1])
    slopes = np.linalg.solve(scatter, places.T @ signals)
    left = signals - places @ slopes
    return slopes, np.einsum("ij,ij->j", left, left) + 0.01
