"""Min and Chai 2012: the primitive, its timing and its coefficients that explain the signals best."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.methods.imus.baselines.driving import Guess, SignalComparator, WindowSettings
from poseloom.methods.imus.baselines.examples import STEP, Examples
from poseloom.methods.imus.baselines.primitives import fit_primitives
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True)
class PrimitiveSettings(WindowSettings):
    """Settings of `MotionPrimitives`.

    Attributes:
        samples: Samples of the window, of which this method needs the newest only: it keeps what it heard as beliefs.
        canonical: Samples of a primitive's canonical time.
        coefficients: Functional principal components.
        mixture: Most Gaussians of a kind.
        dulling: Factor on the signals' variance: neighbouring samples are not independent.
        beam: Hypotheses that are kept.
        averaged: Most hypotheses whose poses are averaged; 1 is the most probable alone.
        seed: Of the mixtures' first guess.
    """

    samples: int = 1
    canonical: int = 12
    coefficients: int = 5
    mixture: int = 1
    dulling: float = 2.0
    beam: int = 192
    averaged: int = 8
    seed: int = 0


class _Beliefs(NamedTuple):
    """Hypotheses of which primitive is under way, how long it lasts and how old it is.

    Attributes:
        kinds: Its kind.
        durations: Its length in frames.
        ages: Frames since it began.
        logs: Log probability of the hypothesis and of each Gaussian of its mixture.
        centres: Of each Gaussian, given the signals heard.
        covariances: Of the same.
    """

    kinds: Ints[Array, "beam"]
    durations: Floats[Array, "beam"]
    ages: Floats[Array, "beam"]
    logs: Floats[Array, "beam mixture"]
    centres: Floats[Array, "beam mixture coefficients"]
    covariances: Floats[Array, "beam mixture coefficients coefficients"]


class MotionPrimitives(SignalComparator[PrimitiveSettings]):
    """Primitives between foot strikes, their coefficients conditioned on the signals sample by sample.

    Source: Min, Chai, Motion graphs++: a compact generative model for semantic motion analysis and synthesis, ACM
    Transactions on Graphics 31 (2012). As there, motion is cut into primitives at contacts, brought to one canonical
    time, described by functional principal components with a mixture of Gaussians over the coefficients, joined by a
    graph of which follows which, and estimated by its maximum a posteriori. Simplified: time is warped linearly between
    the cuts, and timings are five quantiles of a primitive's length instead of a mixture over warps; transitions depend
    on the kinds alone, not by Gaussian processes on the coefficients; and the optimisation over a window is a beam of
    hypotheses (primitive, timing, age), each with its exact Gaussian posterior given all samples since it began. The
    components describe poses and signals together, which stands for their constraints. Through a silence the hypotheses
    go on without evidence.

    Args:
        examples: What it learns from.
        settings: Its settings; tuned ones unless given.
    """

    kind: ClassVar[str] = "motion-primitives"

    def __init__(self, examples: Examples, settings: PrimitiveSettings | None = None) -> None:
        super().__init__(examples, settings or PrimitiveSettings())
        own = self.settings
        self._primitives = fit_primitives(examples, own.canonical, own.coefficients, own.mixture, own.seed)

    def _begin(self, skeleton: Skeleton) -> _Beliefs:
        """Every kind, timing and quarter of its time."""
        kinds = len(self._primitives.durations)
        timings = self._primitives.durations.size // kinds
        quarters = np.arange(4) / 4
        kind = np.arange(kinds * timings * 4) // (timings * 4)
        durations = np.repeat(self._primitives.durations.reshape(-1), 4)
        ages = np.tile(quarters, kinds * timings) * durations
        return self._fresh(kind, durations, ages, self._primitives.first[kind])

    def _estimate(self, memory: _Beliefs, window: Floats[Array, "samples channels"]) -> tuple[_Beliefs, Guess]:
        moved = memory._replace(ages=memory.ages + 1)
        following = self._pruned(self._renewed(moved))
        heard = np.isfinite(window[0])
        if heard.any():
            following = self._conditioned(following, window[0], heard)
        return following, self._guess(following)

    def _fresh(
        self,
        kinds: Ints[Array, "beam"],
        durations: Floats[Array, "beam"],
        ages: Floats[Array, "beam"],
        logs: Floats[Array, "beam"],
    ) -> _Beliefs:
        own = self._primitives
        return _Beliefs(
            kinds, durations, ages, logs[:, None] + own.weights[kinds], own.centres[kinds], own.covariances[kinds]
        )

    def _renewed(self, beliefs: _Beliefs) -> _Beliefs:
        """Hypotheses whose time is over give way to all that may follow, in all timings."""
        ended = beliefs.ages >= beliefs.durations
        if not ended.any():
            return beliefs
        own = self._primitives
        total = np.logaddexp.reduce(beliefs.logs, axis=1)
        passed = np.full(len(own.first), -np.inf)
        np.logaddexp.at(passed, beliefs.kinds[ended], total[ended])
        arrived = np.logaddexp.reduce(passed[:, None] + own.transitions, axis=0)
        timings = own.durations.size // len(own.durations)
        kind = np.arange(own.durations.size) // timings
        begun = self._fresh(
            kind, own.durations.reshape(-1), np.zeros(len(kind)), np.repeat(arrived - np.log(timings), timings)
        )
        return _Beliefs(*(np.concatenate([old[~ended], new]) for old, new in zip(beliefs, begun, strict=True)))

    def _pruned(self, beliefs: _Beliefs) -> _Beliefs:
        total = np.logaddexp.reduce(beliefs.logs, axis=1)
        kept = np.argsort(-total, kind="stable")[: self.settings.beam]
        kept = kept[np.isfinite(total[kept])]
        best = _Beliefs(*(column[kept] for column in beliefs))
        return best._replace(logs=best.logs - np.logaddexp.reduce(total[kept]))

    def _conditioned(
        self, beliefs: _Beliefs, signal: Floats[Array, "channels"], heard: Bools[Array, "channels"]
    ) -> _Beliefs:
        """Kalman's update of every Gaussian of every hypothesis with one sample."""
        own = self._primitives
        mean = self._at(own.signal_mean, beliefs)[:, heard]
        maps = self._at(own.signal_map, beliefs)[:, heard]
        noise = self.settings.dulling * self._at(own.signal_noise, beliefs)[:, heard]
        crossed = np.einsum("hcm,hgmn->hgcn", maps, beliefs.covariances)
        innovation = np.einsum("hgcn,hdn->hgcd", crossed, maps)
        channels = np.arange(int(heard.sum()))
        innovation[..., channels, channels] += noise[:, None]
        away = signal[heard] - mean[:, None] - np.einsum("hcm,hgm->hgc", maps, beliefs.centres)
        sides = np.concatenate([crossed, away[..., None]], axis=-1)
        solved = cast(NDArray[np.float64], np.linalg.solve(innovation, sides))
        gained, explained = solved[..., :-1], solved[..., -1]
        fit = np.einsum("hgc,hgc->hg", away, explained) + np.linalg.slogdet(innovation)[1]
        logs = beliefs.logs - 0.5 * fit
        return beliefs._replace(
            logs=logs - np.logaddexp.reduce(logs, axis=None),
            centres=beliefs.centres + np.einsum("hgcn,hgc->hgn", crossed, explained),
            covariances=beliefs.covariances - np.einsum("hgcm,hgcn->hgmn", crossed, gained),
        )

    def _at(self, functions: Floats[Array, "kinds samples *rest"], beliefs: _Beliefs) -> Floats[Array, "beam *rest"]:
        """Functions of canonical time at the hypotheses' own times."""
        where = np.minimum(beliefs.ages / beliefs.durations, 1.0) * self._primitives.samples
        low = np.minimum(where.astype(np.int64), self._primitives.samples - 1)
        high = np.minimum(low + 1, self._primitives.samples - 1)
        share = (where - low).reshape(-1, *([1] * (functions.ndim - 2)))
        return (1 - share) * functions[beliefs.kinds, low] + share * functions[beliefs.kinds, high]

    def _guess(self, beliefs: _Beliefs) -> Guess:
        total = np.logaddexp.reduce(beliefs.logs, axis=1)
        kept = np.argsort(-total, kind="stable")[: self.settings.averaged]
        best = _Beliefs(*(column[kept] for column in beliefs))
        shares = np.exp(best.logs - np.logaddexp.reduce(best.logs, axis=None))
        mean, maps = self._at(self._primitives.pose_mean, best), self._at(self._primitives.pose_map, best)
        each = mean[:, None] + np.einsum("htm,hgm->hgt", maps, best.centres)
        target = np.einsum("hg,hgt->t", shares, each)
        own = np.einsum("htm,hgmn,htn->hgt", maps, best.covariances, maps, optimize=True)
        variance = np.einsum("hg,hgt->t", shares, own + (each - target) ** 2)
        latent = len(target) - STEP
        directions = self._primitives.directions.astype(np.float64)
        features = self._primitives.mean + directions @ target[:latent]
        return Guess(features, target[latent:], directions**2 @ np.maximum(variance[:latent], 0.0))
