"""Table 2, figures 5 and 7, and three trackers: how far each method is from the truth."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.six_trackers.plan import CONTESTANTS, OURS, PAPERS, Contestant, Plan, Progress
from poseloom.benchmark.six_trackers.sequences import BenchmarkSequence, is_covered
from poseloom.benchmark.six_trackers.trials import CHANNELS, Trial, opened, recording_of, run_trial
from poseloom.evaluation import profiles
from poseloom.evaluation.cases import Case, Conditions
from poseloom.evaluation.results import MethodResult, truth_of
from poseloom.evaluation.rows import Row
from poseloom.library.pool import in_order
from poseloom.methods import needs_library
from poseloom.skeleton.body import moving_dofs
from poseloom.skeleton.motion import Motion

METRICS = ("joint_angle_deg", "joint_rotation_deg", "joint_position_cm", "jitter_over_truth")
DRAWN = ("walking_1", "basketball_1", "HDM_dg_kickLFront1Reps_013_120")
"""Sequences of figure 7: a walk, a game, and a kick, which no other take of the library resembles as much."""


@dataclass(frozen=True, eq=False)
class Sequences:
    """The sequences of the tables.

    Attributes:
        cases: Read.
        named: The same, as they are named.
        seeds: Of each one's sensors: the same in every table.
    """

    cases: tuple[Case, ...]
    named: tuple[BenchmarkSequence, ...]
    seeds: tuple[int, ...]


class Curve(NamedTuple):
    """Errors of one method on one sequence, frame by frame.

    Attributes:
        sequence: Its name.
        method: The method's label.
        rate: Frames a second.
        samples: Frame of the truth of each value.
        errors: Mean absolute joint angle error, degrees.
    """

    sequence: str
    method: str
    rate: float
    samples: Floats[Array, "frames"]
    errors: Floats[Array, "frames"]


@dataclass(frozen=True)
class Question:
    """One method on all sequences.

    Attributes:
        contestant: The method and its settings.
        library: Folder of the library.
        by_subject: Whether the people of each sequence are left out too.
        channels: One of `CHANNELS`.
        conditions: Sensors; the plan's where None.
    """

    contestant: Contestant
    library: Path
    by_subject: bool = False
    channels: str = CHANNELS[0]
    conditions: Conditions | None = None


def table_two(plan: Plan, sequences: Sequences, tell: Progress) -> tuple[list[Row], list[Curve]]:
    """Errors of all methods, by library and split, on the densely covered sequences and on all; and figure 7."""
    questions = [
        Question(contestant, library, by_subject)
        for number, library in enumerate(plan.libraries)
        for by_subject in ((False,) if plan.quick else (False, True))
        for contestant in CONTESTANTS
        if needs_library(contestant.method) or not (number or by_subject)
    ]
    rows: list[Row] = []
    curves: list[Curve] = []
    for question, results in zip(questions, _answers(plan, sequences, questions, tell, "table 2"), strict=True):
        split = "by-subject" if question.by_subject else "by-sequence"
        label = question.contestant.label
        for what, some in _by_coverage(question, sequences, results):
            rows += _rows("2", label, f"{_named(question)}, {what}", split, some, plan.conditions.seed)
        if question.library == plan.libraries[0] and not question.by_subject:
            curves += _curves(plan, sequences, question, results)
    return rows, curves


def figure_five(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    """Positions alone, orientations alone, and both, by behaviour; the recommended method and the paper's."""
    questions = [
        Question(Contestant(method, method), plan.libraries[0], channels=channels)
        for method in ((OURS,) if plan.quick else (OURS, PAPERS))
        for channels in CHANNELS
    ]
    rows: list[Row] = []
    behaviours = [sequence.behaviour for sequence in sequences.named]
    for question, results in zip(questions, _answers(plan, sequences, questions, tell, "figure 5"), strict=True):
        for behaviour in ("all", *dict.fromkeys(behaviours)):
            chosen = [r for r, what in zip(results, behaviours, strict=True) if behaviour in ("all", what)]
            setting = f"{_named(question)}, {question.channels}, {behaviour}"
            label = question.contestant.label
            rows += _rows("5", label, setting, "by-sequence", chosen, plan.conditions.seed, METRICS[:1])
    return rows


def three_trackers(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    """A headset and two controllers, nothing else."""
    conditions = Conditions("three-trackers", plan.conditions.noise, plan.conditions.seed)
    questions = [
        Question(Contestant(method, method), plan.libraries[0], conditions=conditions)
        for method in ((OURS,) if plan.quick else (OURS, PAPERS, "inverse-kinematics"))
    ]
    rows: list[Row] = []
    for question, results in zip(questions, _answers(plan, sequences, questions, tell, "three trackers"), strict=True):
        for what, some in _by_coverage(question, sequences, results):
            setting = f"{_named(question)}, {what}"
            label = question.contestant.label
            rows += _rows("three trackers", label, setting, "by-sequence", some, plan.conditions.seed)
    return rows


def rows_of(
    table: str,
    method: str,
    setting: str,
    split: str,
    values: Iterable[tuple[str, Sequence[float]]],
    frames: int,
    seed: int,
) -> list[Row]:
    """Means and standard deviations over sequences; values that are not defined are left out."""
    rows: list[Row] = []
    for metric, each in values:
        known = np.array([value for value in each if np.isfinite(value)])
        if len(known):
            spread = float(known.std(ddof=1)) if len(known) > 1 else None
            rows.append(
                Row(table, method, setting, split, metric, float(known.mean()), spread, len(known), frames, seed)
            )
    return rows


def frame_errors(result: MethodResult, truth: Motion) -> Floats[Array, "frames"]:
    """Mean absolute joint angle error of each frame, degrees."""
    moving = moving_dofs()[3:].reshape(-1, 3)
    errors = profiles.angle_errors(truth_of(truth, result.samples), result.motion)
    return np.asarray(errors[:, moving].mean(axis=1))


def _answers(
    plan: Plan, sequences: Sequences, questions: Sequence[Question], tell: Progress, label: str
) -> list[list[MethodResult]]:
    """Results of each question on all sequences, by one pool."""
    trials = [
        Trial(
            question.contestant.method, case, seed, question.conditions or plan.conditions, question.library,
            question.by_subject, plan.limit, question.channels, changes=question.contestant.changes,
        )
        for question in questions
        for case, seed in zip(sequences.cases, sequences.seeds, strict=True)
    ]  # fmt: skip
    results: list[MethodResult] = []
    tell(label, 0, len(trials))
    for result in in_order(run_trial, trials, plan.workers):
        results.append(result)
        tell(label, len(results), len(trials))
    each = len(sequences.cases)
    return [results[each * i : each * (i + 1)] for i in range(len(questions))]


def _named(question: Question) -> str:
    if not needs_library(question.contestant.method):
        return "no library"
    return f"{len(opened(question.library).poses):,} poses"


def _by_coverage(
    question: Question, sequences: Sequences, results: Sequence[MethodResult]
) -> list[tuple[str, Sequence[MethodResult]]]:
    """The results on sequences that the library covers densely, if there are any, and all."""
    library = opened(question.library)
    covered = [r for case, r in zip(sequences.cases, results, strict=True) if is_covered(library, case)]
    return [*([("densely covered", covered)] if covered else []), ("all sequences", results)]


def _rows(
    table: str,
    method: str,
    setting: str,
    split: str,
    results: Sequence[MethodResult],
    seed: int,
    metrics: Sequence[str] = METRICS,
) -> list[Row]:
    values: list[tuple[str, list[float]]] = []
    for metric in metrics:
        if metric == "jitter_over_truth":
            each = [r.metrics["jitter_deg_s3"] / r.metrics["truth_jitter_deg_s3"] for r in results]
        else:
            each = [r.metrics[metric] for r in results]
        values.append((metric, each))
    return rows_of(table, method, setting, split, values, sum(len(r.motion) for r in results), seed)


def _curves(plan: Plan, sequences: Sequences, question: Question, results: Sequence[MethodResult]) -> list[Curve]:
    curves: list[Curve] = []
    for case, seed, result in zip(sequences.cases, sequences.seeds, results, strict=True):
        if case.name in DRAWN:
            method = question.contestant.method
            recording = recording_of(Trial(method, case, seed, plan.conditions, question.library, limit=plan.limit))
            truth = recording.truth
            assert truth is not None  # it was simulated
            samples = result.samples.astype(np.float64)
            curves.append(Curve(case.name, question.contestant.label, truth.rate, samples, frame_errors(result, truth)))
    return curves
