"""What a method made of a sequence, set beside the truth; and the means over sequences."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.errors import PoseloomError
from poseloom.evaluation.metrics import EVERYTHING, evaluate_motion, latency
from poseloom.evaluation.observed import Observed, begun_as, facing_as
from poseloom.skeleton.motion import Motion, make_motion


@dataclass(frozen=True, eq=False)
class MethodResult:
    """One method on one sequence.

    Attributes:
        name: The method's name.
        motion: The estimate.
        samples: For each frame of the estimate the frame of the truth that it belongs to, increasing.
        step_seconds: Wall time of each step; empty where the method was not timed.
        metrics: All metrics by name, those of `metrics.METRICS` and of `metrics.Latency`; NaN where one is not defined.
        observed: What the sensors observe; the motion begins where the truth does in what they do not.
    """

    name: str
    motion: Motion
    samples: Ints[Array, "frames"]
    step_seconds: Floats[Array, "steps"]
    metrics: Mapping[str, float]
    observed: Observed = EVERYTHING

    def pose_motion(self, truth: Motion) -> Motion:
        """The estimate as its poses are measured, with the truth's heading where no sensor observes one.

        Args:
            truth: The frames of the truth that the estimate speaks of.
        """
        return self.motion if self.observed.heading else facing_as(truth, self.motion)


@dataclass(frozen=True, eq=False)
class SequenceResult:
    """One sequence: its truth and what each method made of it.

    Attributes:
        name: The sequence's name.
        truth: The true motion, on the body, at the sensors' rate.
        results: One a method, in the order in which they were asked for.
    """

    name: str
    truth: Motion
    results: tuple[MethodResult, ...]


def compare(
    name: str,
    truth: Motion,
    estimate: Motion,
    samples: Ints[Array, "frames"] | None = None,
    step_seconds: Floats[Array, "steps"] | None = None,
    delay: int = 0,
    observed: Observed = EVERYTHING,
) -> MethodResult:
    """Sets an estimate beside the truth and measures it.

    Args:
        name: The method's name.
        truth: The true motion, on the body.
        estimate: What was made of it, at the same rate.
        samples: Which frame of the truth each frame of the estimate belongs to; all in order where None.
        step_seconds: Wall time of each step.
        delay: Samples between hearing a moment and speaking of it.
        observed: What the sensors observe.

    Raises:
        PoseloomError: where the two cannot be compared.
    """
    frames = np.arange(len(estimate)) if samples is None else samples
    if frames.min() < 0 or frames.max() >= len(truth):
        raise PoseloomError(
            f"{name!r} speaks of frames {frames.min()} to {frames.max()}, the truth has {len(truth)}",
            remedy="Give the truth of the same recording",
        )
    seconds = np.empty(0) if step_seconds is None else step_seconds
    own = truth_of(truth, frames)
    values = evaluate_motion(own, estimate, observed)
    values |= asdict(latency(seconds, delay, truth.rate))
    return MethodResult(name, begun_as(own, estimate, observed), frames, seconds, values, observed)


def truth_of(truth: Motion, samples: Ints[Array, "frames"]) -> Motion:
    """The truth's frames that an estimate speaks of."""
    if len(samples) == len(truth):
        return truth
    return make_motion(truth.skeleton, truth.q[samples], truth.rate, truth.name)


class Mean(NamedTuple):
    """A metric over sequences.

    Attributes:
        value: Mean over the sequences that define it, each counting once.
        spread: Standard deviation over them (of a sample: n - 1); None for a single one.
        sequences: How many they are.
        frames: How many frames they have.
    """

    value: float
    spread: float | None
    sequences: int
    frames: int


def mean_over_sequences(sequences: Sequence[SequenceResult]) -> dict[str, dict[str, Mean]]:
    """For each method each metric's mean over sequences; a metric that no sequence defines is left out."""
    names = dict.fromkeys(result.name for sequence in sequences for result in sequence.results)
    return {
        name: _means([result for sequence in sequences for result in sequence.results if result.name == name])
        for name in names
    }


def _means(results: Iterable[MethodResult]) -> dict[str, Mean]:
    figures: dict[str, list[tuple[float, int]]] = {}
    for result in results:
        for metric, value in result.metrics.items():
            if np.isfinite(value):
                figures.setdefault(metric, []).append((value, len(result.motion)))
    return {metric: _mean(pairs) for metric, pairs in figures.items()}


def _mean(pairs: Sequence[tuple[float, int]]) -> Mean:
    values = np.array([value for value, _ in pairs])
    spread = float(values.std(ddof=1)) if len(values) > 1 else None
    return Mean(float(values.mean()), spread, len(values), sum(frames for _, frames in pairs))
