"""Choosing the comparators' settings on the validation sequences, as many trials for each."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from poseloom.benchmark.one_imu.accuracy import rows_of
from poseloom.benchmark.one_imu.plan import FOOT, Plan, Progress
from poseloom.benchmark.one_imu.trials import Answer, Question, answer, pooled
from poseloom.evaluation.rows import Row
from poseloom.library.pool import in_order

SPACES: Mapping[str, Mapping[str, tuple[Any, ...]]] = MappingProxyType(
    {
        "nearest-window": {
            "samples": (20, 12, 30, 45),
            "neighbours": (5, 3, 9, 16),
            "build": (0.0, 0.01, 0.03, 0.1, 0.3),
        },
        "phase-regression": {
            "samples": (20, 30, 12),
            "phases": (8, 16, 32),
            "width": (1.0, 0.5, 0.3),
            "ridge": (0.03, 0.1),
            "dulling": (4.0, 1.0, 12.0),
        },
        "sparse-accelerometers": {
            "samples": (20, 30),
            "neighbours": (64, 16, 8),
            "smoothness": (1.0, 0.3, 0.1),
            "control": (0.3, 0.0),
            "build": (0.0, 0.03, 0.1, 0.3),
        },
        "motion-primitives": {
            "dulling": (6.0, 2.0, 1.0),
            "coefficients": (8, 16, 24),
            "mixture": (3, 6),
            "canonical": (12, 24),
            "beam": (48, 96),
        },
        "motion-graph": {
            "samples": (20, 30),
            "lost": (1.0, 0.3, 0.1),
            "gain": (0.7, 0.9, 0.5),
            "blend": (1 / 3, 0.2),
            "build": (0.0, 0.03, 0.1),
        },
    }
)
"""What is tried, each setting in turn: the first value of each is where it begins. Ten or eleven trials a method."""


def sweep(plan: Plan, tell: Progress) -> list[Row]:
    """One setting after the other, each value of it with the best so far of all others; one sensor on the foot."""
    rows: list[Row] = []
    total = sum(1 + sum(len(values) - 1 for values in space.values()) for space in SPACES.values())
    done = 0
    for method, space in SPACES.items():
        best: dict[str, Any] = {name: values[0] for name, values in space.items()}
        score, row = _tried(plan, method, best)
        rows += row
        done += 1
        for name, values in space.items():
            for value in values[1:]:
                now, row = _tried(plan, method, best | {name: value})
                rows += row
                done += 1
                tell("sweep", done, total)
                if now < score:
                    score, best = now, best | {name: value}
        rows += _tried(plan, method, best, "chosen")[1]
    return rows


def _tried(plan: Plan, method: str, setting: Mapping[str, Any], table: str = "tried") -> tuple[float, list[Row]]:
    """Mean over behaviours of the mean over frames, and its rows."""
    pool = pooled(plan.data)
    questions = [
        Question(
            plan.data, method, FOOT, tuple(take.source for take in pool.validation[part::2]), (), False, "",
            plan.limit, plan.seed, plan.mirrored, tuple(sorted(setting.items())),
        )
        for part in (0, 1)
    ]  # fmt: skip
    answers = [each for group in in_order(answer, questions, plan.workers) for each in group]
    words = ", ".join(f"{name} {value:.3g}" for name, value in sorted(setting.items()))
    rows = rows_of(plan, table, method, f"{FOOT}, {words}", "by-sequence", answers)
    rows = [row for row in rows if row.metric in ("joint_position_cm", "jitter_over_truth")]
    score = Row(table, method, rows[0].setting, "by-sequence", "mean_over_behaviours_cm", _score(answers), None,
                len(answers), rows[0].frames, plan.seed)  # fmt: skip
    return score.value, [score, *rows]


def _score(answers: list[Answer]) -> float:
    """Mean over behaviours: the many walks do not decide alone."""
    names = dict.fromkeys(each.behaviour for each in answers)
    return float(np.mean([np.concatenate([a.errors for a in answers if a.behaviour == name]).mean() for name in names]))
