"""Choosing settings on the validation sequences: the same search, as many trials for every method, ours included."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from poseloom.benchmark.one_imu.accuracy import rows_of
from poseloom.benchmark.one_imu.plan import LAYOUTS, OURS, Plan, Progress
from poseloom.benchmark.one_imu.trials import Answer, Question, answer, pooled
from poseloom.evaluation.rows import Row
from poseloom.library.pool import in_order

TRIALS = 40
"""Settings that are tried for each method."""

SPACES: Mapping[str, Mapping[str, tuple[Any, ...]]] = MappingProxyType(
    {
        OURS: {
            "tempering": (0.1, 0.03, 0.06, 0.2, 0.4, 1.0),
            "evenness": (4.0, 2.0, 3.0, 6.0, 8.0, 12.0),
            "neighbours": (16, 8, 32),
            "restart": (0.2, 0.05, 0.1, 0.4, 0.7),
            "continuity": (0.5, 0.0, 0.9),
            "reach": (3, 1, 6),
            "body_limit": (7.0, 3.0, 5.0, 10.0),
            "blend": (0.3, 0.2, 0.5),
            "start_blend": (0.7, 1.0),
        },
        "nearest-window": {
            "samples": (30, 12, 16, 20, 25, 37, 45, 60),
            "neighbours": (5, 2, 3, 4, 6, 9, 12, 16, 24),
            "build": (0.03, 0.0, 0.003, 0.01, 0.1, 0.3, 1.0),
        },
        "phase-regression": {
            "samples": (20, 12, 16, 30, 45),
            "phases": (32, 8, 16, 64),
            "width": (0.3, 0.15, 0.5, 1.0),
            "ridge": (0.1, 0.01, 0.03, 0.3, 1.0),
            "dulling": (1.0, 2.0, 4.0, 12.0),
        },
        "sparse-accelerometers": {
            "samples": (20, 12, 16, 30, 45),
            "neighbours": (8, 4, 6, 12, 16, 32, 64),
            "smoothness": (0.1, 0.03, 0.3, 1.0),
            "control": (0.3, 0.0, 0.1, 1.0),
            "build": (0.03, 0.0, 0.01, 0.1, 0.3),
        },
        "motion-primitives": {
            "dulling": (1.0, 0.5, 2.0, 6.0),
            "coefficients": (8, 5, 12, 16, 24),
            "mixture": (3, 1, 6),
            "canonical": (12, 8, 16, 24),
            "beam": (96, 48, 192),
        },
        "motion-graph": {
            "samples": (20, 12, 30, 45),
            "lost": (0.3, 0.03, 0.1, 1.0),
            "gain": (0.5, 0.3, 0.7, 0.9),
            "blend": (0.2, 0.1, 1 / 3),
            "build": (0.03, 0.0, 0.01, 0.1, 0.3),
        },
    }
)
"""What may be tried. The search begins with the first value of each setting, which were the settings before it."""


def settings_to_try(method: str, trials: int = TRIALS, seed: int = 0) -> list[dict[str, Any]]:
    """The first settings of a method, then others drawn evenly from its space, none twice.

    Half of the draws keep each setting at its first value with a probability of one half, so that the neighbourhood
    of what earlier searches found is looked at as well as the whole space.
    """
    space = SPACES[method]
    generator = np.random.default_rng(seed)
    found = [{name: values[0] for name, values in space.items()}]
    most = int(np.prod([len(values) for values in space.values()]))
    while len(found) < min(trials, most):
        near = len(found) % 2 == 0
        drawn = {
            name: values[0] if near and generator.random() < 0.5 else values[int(generator.integers(len(values)))]
            for name, values in space.items()
        }
        if drawn not in found:
            found.append(drawn)
    return found


def sweep(plan: Plan, tell: Progress) -> list[Row]:
    """Every method's settings tried on the validation sequences, with one sensor and with two."""
    methods = [method for method in SPACES if method in plan.only]
    trials = 4 if plan.quick else TRIALS
    asked = [(method, tried) for method in methods for tried in settings_to_try(method, trials, plan.seed)]
    scores: dict[str, list[tuple[float, list[Row]]]] = {method: [] for method in methods}
    for done, ((method, _), outcome) in enumerate(
        zip(asked, in_order(partial(_tried, plan), asked, plan.workers), strict=True)
    ):
        scores[method].append(outcome)
        tell("sweep", done + 1, len(asked))
    rows: list[Row] = []
    for outcomes in scores.values():
        rows += [row for _, some in outcomes for row in some]
        best = min(outcomes, key=lambda outcome: outcome[0])[1]
        rows += [replace(row, table="chosen") for row in best]
    return rows


def _tried(plan: Plan, asked: tuple[str, dict[str, Any]]) -> tuple[float, list[Row]]:
    """Mean over the layouts and behaviours of the mean over frames, and its rows."""
    method, setting = asked
    pool = pooled(plan.data)
    answers: list[Answer] = []
    scores: list[float] = []
    for sensors in LAYOUTS:
        mine: list[Answer] = []
        for part in (0, 1):
            takes = tuple(take.source for take in pool.validation[part::2])
            mine += answer(
                Question(
                    plan.data, method, sensors, takes, (), False, "", plan.limit, plan.seed, plan.mirrored,
                    tuple(sorted(setting.items())),
                )
            )  # fmt: skip
        scores.append(_score(mine))
        answers += mine
    words = ", ".join(f"{name} {value:.3g}" for name, value in sorted(setting.items()))
    rows = rows_of(plan, "tried", method, words, "by-sequence", answers)
    rows = [row for row in rows if row.metric in ("joint_position_cm", "jitter_over_truth")]
    score = float(np.mean(scores))
    told = ("mean_over_behaviours_cm", score), *zip(("one_sensor_cm", "two_sensors_cm"), scores, strict=True)
    rows += [
        Row("tried", method, words, "by-sequence", metric, value, None, len(answers), rows[0].frames, plan.seed)
        for metric, value in told
    ]
    return score, rows


def _score(answers: list[Answer]) -> float:
    """Mean over behaviours: the many walks do not decide alone."""
    names = dict.fromkeys(each.behaviour for each in answers)
    return float(np.mean([np.concatenate([a.errors for a in answers if a.behaviour == name]).mean() for name in names]))
