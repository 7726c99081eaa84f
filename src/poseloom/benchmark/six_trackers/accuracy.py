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


def table_two(plan: Plan, sequences: Sequences, tell: Progress) -> tuple[list[Row], list[Curve]]:
    """Errors of all methods, by library and split, on the densely covered sequences and on all; and figure 7."""
    rows: list[Row] = []
    curves: list[Curve] = []
    splits = (False,) if plan.quick else (False, True)
    for number, library in enumerate(plan.libraries):
        size = f"{len(opened(library).poses):,} poses"
        covered = [is_covered(opened(library), case) for case in sequences.cases]
        for by_subject in splits:
            for contestant in CONTESTANTS:
                if not needs_library(contestant.method) and (number or by_subject):
                    continue
                split = "by-subject" if by_subject else "by-sequence"
                label = f"table 2, {size}, {split}"
                results = _run(plan, sequences, library, contestant, tell, f"{label}: {contestant.label}", by_subject)
                chosen = [r for r, yes in zip(results, covered, strict=True) if yes]
                named = size if needs_library(contestant.method) else "no library"
                seed = plan.conditions.seed
                if chosen:
                    rows += _rows("2", contestant.label, f"{named}, densely covered", split, chosen, seed)
                rows += _rows("2", contestant.label, f"{named}, all sequences", split, results, seed)
                if not by_subject and not number:
                    curves += _curves(plan, sequences, contestant, results, library)
    return rows, curves


def figure_five(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    """Positions alone, orientations alone, and both, by behaviour; the recommended method and the paper's."""
    library = plan.libraries[0]
    size = f"{len(opened(library).poses):,} poses"
    rows: list[Row] = []
    behaviours = [sequence.behaviour for sequence in sequences.named]
    for method in (OURS,) if plan.quick else (OURS, PAPERS):
        for channels in CHANNELS:
            results = _run(
                plan, sequences, library, Contestant(method, method), tell, f"figure 5, {method}: {channels}",
                channels=channels,
            )  # fmt: skip
            for behaviour in ("all", *dict.fromkeys(behaviours)):
                chosen = [r for r, what in zip(results, behaviours, strict=True) if behaviour in ("all", what)]
                setting = f"{size}, {channels}, {behaviour}"
                rows += _rows("5", method, setting, "by-sequence", chosen, plan.conditions.seed, ("joint_angle_deg",))
    return rows


def three_trackers(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    """A headset and two controllers, nothing else."""
    rows: list[Row] = []
    conditions = Conditions("three-trackers", plan.conditions.noise, plan.conditions.seed)
    for library in plan.libraries[:1]:
        for method in (OURS,) if plan.quick else (OURS, PAPERS, "inverse-kinematics"):
            results = _run(
                plan, sequences, library, Contestant(method, method), tell, f"three trackers: {method}",
                conditions=conditions,
            )  # fmt: skip
            covered = [is_covered(opened(library), case) for case in sequences.cases]
            chosen = [r for r, yes in zip(results, covered, strict=True) if yes]
            size = f"{len(opened(library).poses):,} poses" if needs_library(method) else "no library"
            for what, some in (("densely covered", chosen), ("all sequences", results)):
                if some:
                    rows += _rows(
                        "three trackers", method, f"{size}, {what}", "by-sequence", some, plan.conditions.seed
                    )
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


def frame_errors(result: MethodResult, truth: object) -> Floats[Array, "frames"]:
    """Mean absolute joint angle error of each frame, degrees."""
    from poseloom.skeleton.motion import Motion

    assert isinstance(truth, Motion)
    moving = moving_dofs()[3:].reshape(-1, 3)
    errors = profiles.angle_errors(truth_of(truth, result.samples), result.motion)
    return np.asarray(errors[:, moving].mean(axis=1))


def _run(
    plan: Plan,
    sequences: Sequences,
    library: Path,
    contestant: Contestant,
    tell: Progress,
    label: str,
    by_subject: bool = False,
    channels: str = CHANNELS[0],
    conditions: Conditions | None = None,
) -> list[MethodResult]:
    trials = [
        Trial(
            contestant.method, case, seed, conditions or plan.conditions, library, by_subject, plan.limit, channels,
            changes=contestant.changes,
        )
        for case, seed in zip(sequences.cases, sequences.seeds, strict=True)
    ]  # fmt: skip
    results: list[MethodResult] = []
    tell(label, 0, len(trials))
    for result in in_order(run_trial, trials, plan.workers):
        results.append(result)
        tell(label, len(results), len(trials))
    return results


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


def _curves(
    plan: Plan, sequences: Sequences, contestant: Contestant, results: Sequence[MethodResult], library: Path
) -> list[Curve]:
    curves: list[Curve] = []
    for case, seed, result in zip(sequences.cases, sequences.seeds, results, strict=True):
        if case.name in DRAWN:
            trial = Trial(contestant.method, case, seed, plan.conditions, library, limit=plan.limit)
            recording = recording_of(trial)
            curves.append(
                Curve(
                    case.name,
                    contestant.label,
                    recording.layout.rate,
                    result.samples.astype(np.float64),
                    frame_errors(result, recording.truth),
                )
            )
    return curves
