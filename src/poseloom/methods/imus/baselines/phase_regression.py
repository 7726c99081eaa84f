"""Eom et al. 2014: one sensor, phases by their order in time, and a nonlinear regression onto latent poses in each."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Ints
from poseloom.methods.imus.baselines.driving import Guess, SignalComparator, WindowSettings
from poseloom.methods.imus.baselines.examples import FEATURES, Examples
from poseloom.methods.imus.baselines.windows import index_windows, principal_directions
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True)
class RegressionSettings(WindowSettings):
    """Settings of `PhaseRegression`.

    Attributes:
        samples: Length of the windows of signals.
        phases: Phases of each behaviour.
        latent: Dimensions of the latent poses.
        width: Width of the kernel, in median distances of a phase's windows.
        ridge: Variance of the regression's noise, in variances of the target.
        dulling: Divides the log likelihood of a moment: the moments of a window are not independent.
        examples: Most windows that a phase keeps.
        seed: Of the first guess of the phases.
    """

    samples: int = 12
    phases: int = 16
    latent: int = 16
    width: float = 1.0
    ridge: float = 0.1
    dulling: float = 12.0
    examples: int = 600
    seed: int = 0


class _Phase(NamedTuple):
    """One phase of one behaviour.

    Attributes:
        mean: Of its windows, in principal directions.
        whitening: Turns and scales a window's distance from the mean to unit variance.
        log_scale: Logarithm of the density at the mean.
        places: Windows of its examples.
        width: Of the kernel.
        weights: Of each example for each latent dimension and step.
        offset: Mean latent pose and step.
        variance: Of what the regression leaves, of each latent dimension.
    """

    mean: Floats[Array, "directions"]
    whitening: Floats[Array, "directions directions"]
    log_scale: float
    places: Floats[Array, "examples directions"]
    width: float
    weights: Floats[Array, "examples targets"]
    offset: Floats[Array, "targets"]
    variance: Floats[Array, "targets"]


class _Memory(NamedTuple):
    """Log probabilities of the phases, and through a silence the example that plays on (else -1)."""

    logs: Floats[Array, "phases"]
    row: int


class PhaseRegression(SignalComparator[RegressionSettings]):
    """Behaviour-specific motion models: the phase by a filter over time, the pose by its nonlinear regression.

    Source: Eom, Choi, Noh, Data-driven reconstruction of human locomotion using a single smartphone, Computer Graphics
    Forum 33 (2014). As there, poses are embedded in few dimensions, locomotion is decomposed into phases, and within a
    phase a nonlinear regression maps the sensor's readings to latent poses. Simplified: principal components instead of
    a Gaussian process latent variable model; phases by clustering latent poses and their velocities; kernel ridge
    regression (the mean of a Gaussian process) from windows of readings. More than there: models of all behaviours
    stand side by side, and the filter chooses among them; fitted to pairs of one behaviour it is theirs. Through a
    silence the example nearest to the last window plays on.

    Args:
        examples: What it learns from.
        settings: Its settings; tuned ones unless given.
    """

    kind: ClassVar[str] = "phase-regression"

    def __init__(self, examples: Examples, settings: RegressionSettings | None = None) -> None:
        super().__init__(examples, settings or RegressionSettings())
        own = self.settings
        self._index = index_windows(examples, own.samples)
        self._mean = examples.features.mean(axis=0)
        self._directions = principal_directions(examples.features - self._mean, own.latent)
        latent = ((examples.features - self._mean) @ self._directions).astype(np.float64)
        labels = _phase_labels(examples, latent, own)
        self._transitions = _transitions(examples, labels)
        targets = np.concatenate([latent, examples.steps], axis=1)
        places = self._index.places.astype(np.float64)
        self._phases = [
            _fit_phase(places[labels == phase], targets[labels == phase], own) for phase in range(labels.max() + 1)
        ]

    def _begin(self, skeleton: Skeleton) -> _Memory:
        count = len(self._phases)
        return _Memory(np.full(count, -np.log(count)), -1)

    def _estimate(self, memory: _Memory, window: Floats[Array, "samples channels"]) -> tuple[_Memory, Guess]:
        logs = _log_product(memory.logs, self._transitions)
        if not np.isfinite(window[0]).any():
            row = self._playing(memory, window)
            return _Memory(logs, row), self._guess_of_row(row)
        place = _filled(window).reshape(-1) @ self._index.directions
        likelihood = np.array([_log_density(phase, place) for phase in self._phases])
        logs = logs + likelihood / self.settings.dulling
        logs = logs - np.logaddexp.reduce(logs)
        chosen = np.flatnonzero(logs > np.log(0.02))
        weights = np.exp(logs[chosen]) / np.exp(logs[chosen]).sum()
        predictions = np.stack([_predicted(self._phases[phase], place) for phase in chosen])
        mean = weights @ predictions
        left = np.stack([self._phases[phase].variance for phase in chosen])
        spread = weights @ (left + (predictions - mean) ** 2)
        return _Memory(logs, -1), self._guess(mean, spread)

    def _guess(self, target: Floats[Array, "targets"], variance: Floats[Array, "targets"]) -> Guess:
        latent = self.settings.latent
        directions = self._directions.astype(np.float64)
        return Guess(self._mean + directions @ target[:latent], target[latent:], directions**2 @ variance[:latent])

    def _playing(self, memory: _Memory, window: Floats[Array, "samples channels"]) -> int:
        if memory.row >= 0:
            return int(self.examples.followers(np.array([memory.row]))[0])
        return int(self._index.nearest(window, 1, np.zeros(len(self.examples), dtype=np.float32)).rows[0])

    def _guess_of_row(self, row: int) -> Guess:
        features = self.examples.features[row].astype(np.float64)
        return Guess(features, self.examples.steps[row].astype(np.float64), np.zeros(FEATURES))


def _phase_labels(
    examples: Examples, latent: Floats[Array, "frames latent"], settings: RegressionSettings
) -> Ints[Array, "frames"]:
    """A phase for each example: poses and velocities of each behaviour fall into clusters; none is empty."""
    clips = examples.clip_of_frame
    before = np.maximum(np.arange(len(examples)) - 1, examples.starts[clips])
    velocity = latent - latent[before]
    described = np.concatenate([latent / latent.std(), velocity / max(velocity.std(), 1e-9)], axis=1)
    behaviour = np.array(examples.behaviours)[clips]
    labels = np.zeros(len(examples), dtype=np.int64)
    count = 0
    for name in dict.fromkeys(examples.behaviours):
        own = np.flatnonzero(behaviour == name)
        found = k_means(described[own], min(settings.phases, len(own)), settings.seed)
        kinds, labels[own] = np.unique(found, return_inverse=True)
        labels[own] += count
        count += len(kinds)
    return labels


def k_means(rows: Floats[Array, "rows columns"], count: int, seed: int, rounds: int = 20) -> Ints[Array, "rows"]:
    """The cluster of each row (Lloyd's algorithm, from centres that are drawn far apart: k-means++)."""
    draw = np.random.default_rng(seed)
    centres = rows[[int(draw.integers(len(rows)))]]
    nearest = np.square(rows - centres[0]).sum(axis=1)
    while len(centres) < count:
        total = float(nearest.sum())
        pick = int(draw.choice(len(rows), p=nearest / total)) if total > 0 else int(draw.integers(len(rows)))
        centres = np.concatenate([centres, rows[pick][None]])
        nearest = np.minimum(nearest, np.square(rows - rows[pick]).sum(axis=1))
    labels = np.zeros(len(rows), dtype=np.int64)
    for _ in range(rounds):
        squares = np.square(centres).sum(axis=1) - 2 * rows @ centres.T
        labels = squares.argmin(axis=1)
        centres = np.stack(
            [rows[labels == i].mean(axis=0) if (labels == i).any() else centres[i] for i in range(count)]
        )
    return labels


def _transitions(examples: Examples, labels: Ints[Array, "frames"]) -> Floats[Array, "phases phases"]:
    """Log probabilities of going from phase to phase in one frame, as counted; a little to every phase."""
    count = int(labels.max()) + 1
    counts = np.full((count, count), 0.02)
    inside = np.ones(len(labels) - 1, dtype=np.bool_)
    inside[examples.starts[1:] - 1] = False
    np.add.at(counts, (labels[:-1][inside], labels[1:][inside]), 1.0)
    return np.log(counts / counts.sum(axis=1, keepdims=True))


def _fit_phase(
    places: Floats[Array, "rows directions"], targets: Floats[Array, "rows targets"], settings: RegressionSettings
) -> _Phase:
    mean = places.mean(axis=0)
    apart = places - mean
    covariance = apart.T @ apart / len(apart)
    average = float(np.trace(covariance)) / len(covariance)
    covariance = 0.9 * covariance + (0.1 * average + 1e-3) * np.eye(len(covariance))
    lower = cast(NDArray[np.float64], np.linalg.cholesky(covariance))
    kept = np.linspace(0, len(places) - 1, min(len(places), settings.examples)).astype(np.int64)
    chosen, wanted = places[kept], targets[kept]
    offset = wanted.mean(axis=0)
    squares = _squares(chosen, chosen)
    median = float(np.median(squares[np.triu_indices(len(chosen), 1)])) if len(chosen) > 1 else 1.0
    width = settings.width * np.sqrt(max(median, 1e-6))
    kernel = np.exp(-0.5 * squares / width**2)
    system = kernel + settings.ridge * np.eye(len(kernel))
    inverse = cast(NDArray[np.float64], np.linalg.inv(system))
    weights = inverse @ (wanted - offset)
    # Leaving each out in turn (Rasmussen and Williams, eq. 5.12) tells what the regression leaves of unseen ones.
    left = weights / np.diag(inverse)[:, None]
    return _Phase(
        mean,
        cast(NDArray[np.float64], np.linalg.inv(lower)),
        -float(np.log(np.diag(lower)).sum()),
        chosen,
        width,
        weights,
        offset,
        np.square(left).mean(axis=0),
    )


def _log_density(phase: _Phase, place: Floats[Array, "directions"]) -> float:
    away = phase.whitening @ (place - phase.mean)
    return phase.log_scale - 0.5 * float(away @ away)


def _predicted(phase: _Phase, place: Floats[Array, "directions"]) -> Floats[Array, "targets"]:
    squares = _squares(place[None], phase.places)[0]
    return phase.offset + np.exp(-0.5 * squares / phase.width**2) @ phase.weights


def _squares(
    first: Floats[Array, "rows columns"], second: Floats[Array, "others columns"]
) -> Floats[Array, "rows others"]:
    both = np.square(first).sum(axis=1)[:, None] + np.square(second).sum(axis=1) - 2 * first @ second.T
    return np.maximum(both, 0.0)


def _log_product(logs: Floats[Array, "phases"], transitions: Floats[Array, "phases phases"]) -> Floats[Array, "phases"]:
    return np.logaddexp.reduce(logs[:, None] + transitions, axis=0)


def _filled(window: Floats[Array, "samples channels"]) -> Floats[Array, "samples channels"]:
    """The window with each gap filled by the next newer value of its channel, as clips' starts are continued back.

    A channel that never spoke is taken to be at its mean.
    """
    filled = window.copy()
    for row in range(1, len(filled)):
        gaps = ~np.isfinite(filled[row])
        filled[row, gaps] = filled[row - 1, gaps]
    for row in range(len(filled) - 2, -1, -1):
        gaps = ~np.isfinite(filled[row])
        filled[row, gaps] = filled[row + 1, gaps]
    return np.where(np.isfinite(filled), filled, 0.0)
