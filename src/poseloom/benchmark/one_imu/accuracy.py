"""Table 3 and figure 10: how far each method's poses are from the truth."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from poseloom.benchmark.one_imu.plan import LAYOUTS, OURS, PLACEMENTS, Plan, Progress
from poseloom.benchmark.one_imu.sequences import BEHAVIOURS, Take
from poseloom.benchmark.one_imu.trials import Answer, Question, answer, by_fold, pooled
from poseloom.evaluation.rows import Row
from poseloom.library.pool import in_order

COVERED, ALL = "covered", "all sequences"

_HALF_A_SECOND, _TWO_SECONDS = 30, 120
"""Samples, at 60 Hz."""


def table_three(plan: Plan, tell: Progress) -> list[Row]:
    """The joint model, one sensor and two, by-sequence."""
    return _table_three(plan, tell, ("",))


def specialists(plan: Plan, tell: Progress) -> list[Row]:
    """A model for each behaviour, one sensor and two, by-sequence."""
    return _table_three(plan, tell, BEHAVIOURS)


def _table_three(plan: Plan, tell: Progress, models: Sequence[str]) -> list[Row]:
    rows: list[Row] = []
    asked = [(sensors, method, model) for sensors in LAYOUTS for model in models for method in plan.methods]
    questions = [_questions(plan, *one) for one in asked]
    for (sensors, method, behaviour), answers in zip(asked, _answered(plan, questions, tell, "table 3"), strict=True):
        model = "specialist" if behaviour else "joint"
        for what in (behaviour,) if behaviour else ("all", *BEHAVIOURS):
            rows += _by_coverage(plan, "3", method, f"{sensors}, {model}, {what}", "by-sequence", answers, what)
    return rows


def by_subject(plan: Plan, tell: Progress) -> list[Row]:
    """The joint model, with everybody left out who is in a sequence."""
    pool = pooled(plan.data)
    people = list(dict.fromkeys(take.person for take in pool.tables))
    asked = [(sensors, method) for sensors in LAYOUTS for method in plan.methods]
    groups = [tuple(take for take in pool.tables if take.person == person) for person in people]
    questions = [
        [question_of(plan, method, sensors, group, by_subject=True) for group in groups] for sensors, method in asked
    ]
    rows: list[Row] = []
    for (sensors, method), answers in zip(asked, _answered(plan, questions, tell, "by subject"), strict=True):
        for what in ("all", *BEHAVIOURS):
            rows += _by_coverage(plan, "3", method, f"{sensors}, joint, {what}", "by-subject", answers, what)
    return rows


def figure_ten(plan: Plan, tell: Progress) -> list[Row]:
    """Every placement of one sensor, ours and the nearest windows."""
    methods = plan.chosen((OURS, "nearest-window"))
    asked = [(f"{placement}-imu", method) for placement in PLACEMENTS for method in methods]
    questions = [_questions(plan, sensors, method, "") for sensors, method in asked]
    rows: list[Row] = []
    for (sensors, method), answers in zip(asked, _answered(plan, questions, tell, "figure 10"), strict=True):
        for what in ("all", *BEHAVIOURS):
            rows += _by_coverage(plan, "10", method, f"{sensors}, joint, {what}", "by-sequence", answers, what)
    return rows


def pooled_mean(answers: Sequence[Answer], first: int = 0, stop: int | None = None) -> float:
    """Mean error over frames, as the paper's tables count, cm: of those from `first` up to `stop` of each sequence."""
    errors = np.concatenate([each.errors[first:stop] for each in answers])
    return float(errors.mean()) if len(errors) else float("nan")


def rows_of(plan: Plan, table: str, method: str, setting: str, split: str, answers: Sequence[Answer]) -> list[Row]:
    """The figures of some sequences as rows: means over frames where errors are asked, else over sequences."""
    if not answers:
        return []
    frames = sum(len(each.errors) for each in answers)
    means = np.array([each.errors.mean() for each in answers])
    seconds = np.concatenate([each.step_ms for each in answers])
    values: list[tuple[str, float, float | None]] = [
        ("joint_position_cm", pooled_mean(answers), _spread(means)),
        ("joint_position_cm_first_two_seconds", pooled_mean(answers, 0, _TWO_SECONDS), None),
        ("joint_position_cm_after_half_a_second", pooled_mean(answers, _HALF_A_SECOND), None),
        ("joint_position_cm_of_sequences", float(means.mean()), _spread(means)),
        ("jitter_over_truth", *_mean(each.jitter for each in answers)),
        ("foot_skate_cm_s", *_mean(each.skate for each in answers)),
        ("foot_skate_over_truth", _ratio(answers), None),
        ("path_error_percent", _path(answers, lambda each: each.path_m), None),
        ("turned_path_error_percent", _path(answers, lambda each: each.turned_path_m), None),
        ("way_length_error_percent", _path(answers, lambda each: abs(each.gone_m - each.way_m)), None),
        ("step_ms_p50", float(np.percentile(seconds, 50)), None),
        ("step_ms_p99", float(np.percentile(seconds, 99)), None),
    ]
    return [
        Row(table, method, setting, split, metric, value, spread, len(answers), frames, plan.seed)
        for metric, value, spread in values
        if np.isfinite(value)
    ]


def _by_coverage(
    plan: Plan, table: str, method: str, setting: str, split: str, answers: Sequence[Answer], behaviour: str
) -> list[Row]:
    pool = pooled(plan.data)
    chosen = [each for each in answers if behaviour in ("all", each.behaviour)]
    covered = {take.source for take in pool.tables if pool.is_covered(take)}
    inside = [each for each in chosen if each.source in covered]
    return rows_of(plan, table, method, f"{setting}, {COVERED}", split, inside) + rows_of(
        plan, table, method, f"{setting}, {ALL}", split, chosen
    )


def _questions(plan: Plan, sensors: str, method: str, behaviour: str) -> list[Question]:
    """One question a fold; a specialist is asked its behaviour alone."""
    pool = pooled(plan.data)
    asked = [take for take in pool.tables if behaviour in ("", take.behaviour)]
    return [
        question_of(plan, method, sensors, fold, behaviour, pool.fold_of(fold[0]))
        for fold in by_fold(plan, pool, asked)
    ]


def question_of(
    plan: Plan,
    method: str,
    sensors: str,
    asked: Sequence[Take],
    behaviour: str = "",
    left_out: Sequence[Take] = (),
    by_subject: bool = False,
) -> Question:
    """A question of a plan."""
    return Question(
        plan.data, method, sensors, tuple(take.source for take in asked), tuple(take.source for take in left_out),
        by_subject, behaviour, plan.limit, plan.seed, plan.mirrored,
    )  # fmt: skip


def _answered(plan: Plan, questions: Sequence[Sequence[Question]], tell: Progress, label: str) -> list[list[Answer]]:
    """The answers of each group of questions."""
    flat = [question for group in questions for question in group]
    tell(label, 0, len(flat))
    found: list[list[Answer]] = []
    for answers in in_order(answer, flat, plan.workers):
        found.append(answers)
        tell(label, len(found), len(flat))
    grouped: list[list[Answer]] = []
    for group in questions:
        grouped.append([each for answers in found[: len(group)] for each in answers])
        del found[: len(group)]
    return grouped


def _ratio(answers: Sequence[Answer]) -> float:
    """Foot skate of all sequences in which a foot stands, over the truth's."""
    known = [each for each in answers if np.isfinite(each.skate) and each.true_skate > 0]
    return sum(each.skate for each in known) / sum(each.true_skate for each in known) if known else float("nan")


def _path(answers: Sequence[Answer], error: Callable[[Answer], float]) -> float:
    """An error of the ways in percent of them, over the sequences that go somewhere."""
    far = [each for each in answers if each.way_m >= 1.0]
    return 100 * sum(map(error, far)) / sum(each.way_m for each in far) if far else float("nan")


def _mean(values: Iterable[float]) -> tuple[float, float | None]:
    known = np.array([value for value in values if np.isfinite(value)])
    return (float(known.mean()), _spread(known)) if len(known) else (float("nan"), None)


def _spread(values: np.ndarray) -> float | None:
    return float(values.std(ddof=1)) if len(values) > 1 else None
