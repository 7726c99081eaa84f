"""One method, fitted without some sequences, on these sequences."""

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from poseloom.arrays import Array, Floats
from poseloom.benchmark.one_imu.measures import (
    foot_skate_cm_s,
    jitter_km_s3,
    path_errors_m,
    pose_errors_cm,
    standing_soles,
    turned_path_errors_m,
    way_m,
)
from poseloom.benchmark.one_imu.plan import OURS, PAPERS, Plan
from poseloom.benchmark.one_imu.sequences import Pool, Take, read_pool
from poseloom.benchmark.six_trackers.sequences import motions_folder
from poseloom.methods import Reconstruction, Reconstructor, reconstruct
from poseloom.methods.imus.baselines.examples import Examples, examples_of
from poseloom.methods.imus.baselines.fitting import COMPARATORS, comparator_of, fit_comparator
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.pairs import WELL_MOUNTED, SignalPair, pair_of_recording
from poseloom.methods.imus.phase_hmm import fit_phase_hmm
from poseloom.methods.imus.settings import PAPER_SETTINGS, PhaseHmmSettings
from poseloom.sensors import Recording, layout
from poseloom.skeleton.mirror import mirror_motion
from poseloom.skeleton.motion import Motion
from poseloom.synthesis import simulate_imus
from poseloom.synthesis.faults import Fault
from poseloom.synthesis.imus import ImuNoise

_WARM_UP = 5
"""Samples that a method hears before the clock starts."""


@dataclass(frozen=True)
class Question:
    """A method on some sequences.

    Attributes:
        data: Folder of the recordings.
        method: Its name.
        sensors: Name of the layout.
        asked: Sources of the sequences; what trains are all other takes of the pool.
        left_out: Sources of further sequences that are left out.
        by_subject: Whether the people of the sequences are left out too.
        behaviour: The one that a specialist learns; empty for the joint model.
        limit: Samples of each sequence; None asks it whole.
        seed: Of the sensors' errors.
        mirrored: Whether mirror images train too.
        changes: Settings that differ from the tuned ones, as pairs of name and value.
    """

    data: Path
    method: str
    sensors: str
    asked: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    by_subject: bool = False
    behaviour: str = ""
    limit: int | None = None
    seed: int = 0
    mirrored: bool = False
    changes: tuple[tuple[str, Any], ...] = ()


@dataclass(frozen=True)
class Answer:
    """One sequence's figures.

    Attributes:
        source: The sequence.
        behaviour: What happens in it.
        errors: Error of each frame, cm (see `measures.pose_errors_cm`).
        jitter: Third derivative over the truth's.
        skate: Foot skate, cm/s.
        true_skate: The truth's own.
        path_m: Where the way ends, distance from the truth's end, metres, both begun with one heading.
        turned_path_m: The same once the whole way is turned so as to fit best: its heading is not observed.
        gone_m: Length of the estimated way.
        way_m: Length of the true way.
        step_ms: Compute of each step.
    """

    source: str
    behaviour: str
    errors: Floats[Array, "frames"]
    jitter: float
    skate: float
    true_skate: float
    path_m: float
    turned_path_m: float
    gone_m: float
    way_m: float
    step_ms: Floats[Array, "steps"]


class Run(NamedTuple):
    """What a method made of a sequence.

    Attributes:
        truth: The frames that it speaks of.
        made: The estimate.
    """

    truth: Motion
    made: Reconstruction


def answer(question: Question) -> list[Answer]:
    """Fits the method and runs it on every sequence."""
    method = fitted(question)
    pool = pooled(question.data)
    return [measured(take, run_on(method, sequence(question, take))) for take in takes_of(pool, question.asked)]


def fitted(question: Question) -> Reconstructor[Any]:
    """The method, fitted to what the question allows."""
    pool = pooled(question.data)
    out = takes_of(pool, (*question.asked, *question.left_out))
    allowed = tuple(
        take.source for take in pool.without(out, question.by_subject) if question.behaviour in ("", take.behaviour)
    )
    return _fitted(
        question.data, question.method, question.sensors, allowed, question.seed, question.mirrored, question.changes
    )


@lru_cache(maxsize=12)
def _fitted(
    data: Path,
    method: str,
    sensors: str,
    allowed: tuple[str, ...],
    seed: int,
    mirrored: bool,
    changes: tuple[tuple[str, Any], ...],
) -> Reconstructor[Any]:
    if method in COMPARATORS:
        return comparator_of(method, _examples(data, sensors, allowed, seed, mirrored), dict(changes))
    pairs = training_pairs(takes_of(pooled(data), allowed), sensors, seed, mirrored)
    return fit_method(method, pairs, sensors, dict(changes), seed)


@lru_cache(maxsize=8)
def _examples(data: Path, sensors: str, allowed: tuple[str, ...], seed: int, mirrored: bool) -> Examples:
    return examples_of(training_pairs(takes_of(pooled(data), allowed), sensors, seed, mirrored), layout(sensors))


def fit_method(
    name: str, pairs: Sequence[SignalPair], sensors: str, changes: Mapping[str, Any] | None = None, seed: int = 0
) -> Reconstructor[Any]:
    """Any method of the benchmark, fitted to pairs.

    Raises:
        MethodError: for an unknown method, or pairs that do not fit the layout.
    """
    worn = layout(sensors)
    if name in (OURS, PAPERS):
        settings = PAPER_SETTINGS if name == PAPERS else PhaseHmmSettings()
        return fit_phase_hmm(pairs, worn, replace(settings, **(changes or {})), seed)
    return fit_comparator(name, pairs, worn, changes)


def training_pairs(takes: Iterable[Take], sensors: str, seed: int, mirrored: bool) -> tuple[SignalPair, ...]:
    """Pairs of takes, with sensors that sit where they should: methods learn without the errors of mounting."""
    return tuple(pair for take in takes for pair in _pairs_of_take(take, sensors, seed, mirrored))


@lru_cache(maxsize=4096)
def _pairs_of_take(take: Take, sensors: str, seed: int, mirrored: bool) -> tuple[SignalPair, ...]:
    motions = [take.motion, *([mirror_motion(take.motion)] if mirrored else [])]
    return tuple(
        pair_of_recording(
            simulate_imus(motion, layout(sensors), WELL_MOUNTED, seed=seed_of(take.source, seed, f"train {number}")),
            Behaviour(take.behaviour), take.person, take.take,
        )
        for number, motion in enumerate(motions)
    )  # fmt: skip


def sequence(question: Question, take: Take, faults: Sequence[Fault] = ()) -> Recording:
    """What the sensors say of a sequence, with noise, bias and errors of mounting."""
    recording = simulate_imus(
        take.motion, layout(question.sensors), ImuNoise(), faults, seed=seed_of(take.source, question.seed, "asked")
    )
    return recording if question.limit is None else recording.cut(0, min(len(recording), question.limit))


def run_on(method: Reconstructor[Any], recording: Recording) -> Run:
    """What the method makes of a recording whose truth is known; a first few samples warm it up."""
    state = method.start(recording.skeleton, recording.placements)
    for index in range(min(_WARM_UP, len(recording))):
        state, _ = method.step(state, recording.sample(index))
    made = reconstruct(method, recording)
    truth = recording.truth
    assert truth is not None  # it was simulated
    first = int(made.samples[0])
    return Run(truth.cut(first, first + len(made.motion)), made)


def measured(take: Take, run: Run) -> Answer:
    """The figures of a run."""
    truth, estimate = run.truth, run.made.motion
    standing = standing_soles(truth)
    return Answer(
        take.source,
        take.behaviour,
        pose_errors_cm(truth, estimate),
        jitter_km_s3(estimate) / jitter_km_s3(truth),
        foot_skate_cm_s(estimate, standing),
        foot_skate_cm_s(truth, standing),
        float(path_errors_m(truth, estimate)[-1]),
        float(turned_path_errors_m(truth, estimate)[-1]),
        way_m(estimate),
        way_m(truth),
        1000 * run.made.step_seconds,
    )


@lru_cache(maxsize=1)
def pooled(data: Path) -> Pool:
    """A process reads the recordings once."""
    return read_pool(motions_folder(data))


def takes_of(pool: Pool, sources: Iterable[str]) -> tuple[Take, ...]:
    """The pool's takes of these sources, in the order asked."""
    by_source = {take.source: take for take in (*pool.takes, *pool.tables, *pool.transitions, *pool.validation)}
    return tuple(by_source[source] for source in sources)


def by_fold(plan: Plan, pool: Pool, takes: Sequence[Take]) -> list[tuple[Take, ...]]:
    """The asked sequences in their folds; empty ones left out."""
    asked = {take.take for take in takes}
    folds = [tuple(take for take in fold if take.take in asked) for fold in pool.folds]
    return [fold for fold in folds if fold][: 1 if plan.quick else None]


def seed_of(source: str, seed: int, what: str) -> int:
    """A seed of its own for everything that is drawn."""
    return zlib.crc32(f"{source} {seed} {what}".encode())
