"""Motion primitives: segments as points of few dimensions, with a mixture of Gaussians over them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.methods.imus.baselines.examples import Examples
from poseloom.methods.imus.baselines.phase_regression import k_means
from poseloom.methods.imus.baselines.segments import Segments, canonical, segments_of
from poseloom.methods.imus.baselines.windows import principal_directions

_LATENT = 24
"""Dimensions of a pose."""

_QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Of the lengths of a kind's segments: the timings that a primitive can have."""


@dataclass(frozen=True, eq=False)
class Primitives:
    """All kinds of primitives; every array is padded to the widest kind.

    A primitive of kind k with coefficients a has at canonical time s the latent pose and step
    `pose_mean[k, s] + pose_map[k, s] @ a` and the signals `signal_mean[k, s] + signal_map[k, s] @ a`.

    Attributes:
        mean: Mean features.
        directions: Directions of latent poses.
        pose_mean: Mean functions of latent poses and steps.
        pose_map: Functional principal components of the same.
        signal_mean: Mean functions of the signals.
        signal_map: Functional principal components of the same.
        signal_noise: Variances of the signals about them.
        weights: Logarithms of the mixtures' weights; minus infinity where a kind has fewer components.
        centres: Means of the mixtures.
        covariances: Their covariances.
        durations: Lengths in frames that a primitive may have.
        transitions: Log probabilities of one kind following another.
        first: Log probabilities of the kinds.
    """

    mean: Floats32[Array, "features"]
    directions: Floats32[Array, "features latent"]
    pose_mean: Floats[Array, "kinds samples targets"]
    pose_map: Floats[Array, "kinds samples targets coefficients"]
    signal_mean: Floats[Array, "kinds samples channels"]
    signal_map: Floats[Array, "kinds samples channels coefficients"]
    signal_noise: Floats[Array, "kinds samples channels"]
    weights: Floats[Array, "kinds mixture"]
    centres: Floats[Array, "kinds mixture coefficients"]
    covariances: Floats[Array, "kinds mixture coefficients coefficients"]
    durations: Floats[Array, "kinds timings"]
    transitions: Floats[Array, "kinds kinds"]
    first: Floats[Array, "kinds"]

    @property
    def samples(self) -> int:
        """Samples of canonical time."""
        return self.pose_mean.shape[1]


def fit_primitives(examples: Examples, samples: int, coefficients: int, mixture: int, seed: int) -> Primitives:
    """Primitives of all examples.

    Args:
        examples: The examples.
        samples: Samples of canonical time.
        coefficients: Functional principal components of a kind.
        mixture: Most Gaussians of a kind; one for every forty segments.
        seed: Of the mixtures' first guess.
    """
    mean = examples.features.mean(axis=0)
    directions = principal_directions(examples.features - mean, _LATENT)
    latent = ((examples.features - mean) @ directions).astype(np.float64)
    posed = np.concatenate([latent, examples.steps.astype(np.float64)], axis=1)
    signals = examples.signals.astype(np.float64)
    segments = segments_of(examples)
    kinds = [
        _fit_kind(
            posed, signals, segments, np.flatnonzero(segments.kinds == kind), samples, coefficients, mixture, seed
        )
        for kind in range(segments.count)
    ]
    durations = np.stack(
        [np.quantile(segments.lengths[segments.kinds == kind], _QUANTILES) for kind in range(segments.count)]
    )
    counts = np.bincount(segments.kinds, minlength=segments.count).astype(np.float64)
    columns = {name: np.stack([getattr(kind, name) for kind in kinds]) for name in _Kind._fields}
    return Primitives(
        mean=mean,
        directions=directions,
        durations=np.maximum(durations, 2.0),
        transitions=_following(segments),
        first=np.log(counts / counts.sum()),
        **columns,
    )


class _Kind(NamedTuple):
    """Of one kind, what `Primitives` has of all."""

    pose_mean: Floats[Array, "samples targets"]
    pose_map: Floats[Array, "samples targets coefficients"]
    signal_mean: Floats[Array, "samples channels"]
    signal_map: Floats[Array, "samples channels coefficients"]
    signal_noise: Floats[Array, "samples channels"]
    weights: Floats[Array, "mixture"]
    centres: Floats[Array, "mixture coefficients"]
    covariances: Floats[Array, "mixture coefficients coefficients"]


def _fit_kind(
    posed: Floats[Array, "frames targets"],
    signals: Floats[Array, "frames channels"],
    segments: Segments,
    own: Ints[Array, "own"],
    samples: int,
    coefficients: int,
    mixture: int,
    seed: int,
) -> _Kind:
    """Functional principal components of poses and signals together, and a mixture over the coefficients."""
    starts, lengths = segments.starts[own].tolist(), segments.lengths[own].tolist()
    poses = np.stack([canonical(posed, s, n, samples) for s, n in zip(starts, lengths, strict=True)])
    heard = np.stack([canonical(signals, s, n, samples) for s, n in zip(starts, lengths, strict=True)])
    pose_mean, signal_mean = poses.mean(axis=0), heard.mean(axis=0)
    away, aside = poses - pose_mean, heard - signal_mean
    # Both count alike: each is divided by how much it varies in all. Steps are small and count little.
    pose_scale = max(float(np.sqrt(np.square(away).sum(axis=(1, 2)).mean())), 1e-9)
    signal_scale = max(float(np.sqrt(np.square(aside).sum(axis=(1, 2)).mean())), 1e-9)
    rows = np.concatenate([away.reshape(len(own), -1) / pose_scale, aside.reshape(len(own), -1) / signal_scale], axis=1)
    values, vectors = np.linalg.eigh(rows @ rows.T)
    order = np.argsort(values)[::-1][:coefficients]
    kept = order[values[order] > 1e-9]
    places = np.zeros((len(own), coefficients))
    places[:, : len(kept)] = vectors[:, kept] * np.sqrt(values[kept])
    inverse = np.zeros((coefficients, len(own)))
    inverse[: len(kept)] = vectors[:, kept].T / np.sqrt(values[kept])[:, None]
    pose_map = np.einsum("cn,nst->stc", inverse, away)
    signal_map = np.einsum("cn,nst->stc", inverse, aside)
    left = aside - np.einsum("stc,nc->nst", signal_map, places)
    noise = np.square(left).mean(axis=0) + 0.02
    return _Kind(pose_mean, pose_map, signal_mean, signal_map, noise, *_mixture(places, mixture, seed))


def _mixture(
    places: Floats[Array, "segments coefficients"], most: int, seed: int
) -> tuple[Floats[Array, "mixture"], Floats[Array, "mixture coefficients"], Floats[Array, "mixture c c"]]:
    """A mixture of Gaussians: clusters, each with its covariance, shrunk towards that of all."""
    count = max(min(most, len(places) // 40), 1)
    labels = k_means(places, count, seed)
    width = places.shape[1]
    overall = np.cov(places.T, bias=True).reshape(width, width) + 1e-6 * np.eye(width)
    weights = np.full(most, -np.inf)
    centres = np.zeros((most, width))
    covariances = np.tile(overall, (most, 1, 1))
    for index in range(count):
        own = places[labels == index]
        if len(own) == 0:
            continue
        weights[index] = np.log(len(own) / len(places))
        centres[index] = own.mean(axis=0)
        share = len(own) / (len(own) + width)
        apart = own - centres[index]
        covariances[index] = share * (apart.T @ apart) / len(own) + (1 - share) * overall
    return weights, centres, covariances


def _following(segments: Segments) -> Floats[Array, "kinds kinds"]:
    counts = np.full((segments.count, segments.count), 0.02)
    later = np.flatnonzero(segments.continues)
    np.add.at(counts, (segments.kinds[later - 1], segments.kinds[later]), 1.0)
    return np.log(counts / counts.sum(axis=1, keepdims=True))
