"""Drop-outs: all sensors fall silent for a second, or the hand's alone."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseloom.benchmark.one_imu.accuracy import question_of
from poseloom.benchmark.one_imu.measures import largest_jump_cm, pose_errors_cm
from poseloom.benchmark.one_imu.plan import FOOT, FOOT_AND_HAND, OURS, Plan, Progress
from poseloom.benchmark.one_imu.sequences import Take
from poseloom.benchmark.one_imu.trials import Run, by_fold, fitted, pooled, run_on, sequence
from poseloom.evaluation.rows import Row
from poseloom.synthesis.faults import Fault

_START, _STOP, _AFTER = 0.8, 1.8, 0.5
"""Seconds between which nothing is said, and seconds afterwards in which a jump still counts."""

_SETTLED, _SETTLED_CM, _HELD = 1.2, 0.5, 5
"""An error is back to normal once it is, over so many frames, at most this share of, and so many cm above, what it is
without the drop-out."""

_METHODS = (OURS, "nearest-window")


class _Figures(NamedTuple):
    """Of one sequence with a drop-out, beside the same without."""

    during: float
    usual: float
    jump: float
    usual_jump: float
    settled: float


def dropouts(plan: Plan, tell: Progress) -> list[Row]:
    """Jumps, errors and recovery of all sequences that are long enough."""
    pool = pooled(plan.data)
    long_enough = [take for take in pool.tables if take.motion.duration >= _STOP + _AFTER]
    settings = [
        (FOOT, "all silent", None),
        (FOOT_AND_HAND, "all silent", None),
        (FOOT_AND_HAND, "hand silent", "rightHand"),
    ]
    if plan.quick:
        settings = settings[:1]
    rows: list[Row] = []
    methods = plan.chosen(_METHODS)
    total = len(settings) * len(methods)
    for number, (sensors, what, sensor) in enumerate(settings):
        for index, method in enumerate(methods):
            tell("drop-outs", len(methods) * number + index, total)
            figures = [
                each for fold in by_fold(plan, pool, long_enough) for each in _fold(plan, sensors, method, sensor, fold)
            ]
            rows += _rows(plan, method, f"{sensors}, {what}", figures)
    tell("drop-outs", total, total)
    return rows


def _fold(plan: Plan, sensors: str, method: str, sensor: str | None, fold: Sequence[Take]) -> list[_Figures]:
    pool = pooled(plan.data)
    question = question_of(plan, method, sensors, fold, left_out=pool.fold_of(fold[0]))
    fit = fitted(question)
    names = fit.layout.names if sensor is None else (sensor,)
    faults = tuple(Fault(name, _START, _STOP) for name in names)
    return [
        _figures(run_on(fit, sequence(question, take)), run_on(fit, sequence(question, take, faults))) for take in fold
    ]


def _figures(sound: Run, spoilt: Run) -> _Figures:
    rate = sound.truth.rate
    start, stop, after = (round(second * rate) for second in (_START, _STOP, _STOP + _AFTER))
    usual = pose_errors_cm(sound.truth, sound.made.motion)
    errors = pose_errors_cm(spoilt.truth, spoilt.made.motion)
    return _Figures(
        float(errors[start:stop].mean()),
        float(usual[start:stop].mean()),
        largest_jump_cm(spoilt.truth, spoilt.made.motion, start - 1, after),
        largest_jump_cm(sound.truth, sound.made.motion, start - 1, after),
        _settled(errors[stop:], usual[stop:]) / rate,
    )


def _settled(errors: np.ndarray, usual: np.ndarray) -> int:
    """Frames until the error is back to normal and stays so for a while."""
    good = errors <= _SETTLED * usual + _SETTLED_CM
    run = 0
    for frame, yes in enumerate(good):
        run = run + 1 if yes else 0
        if run == _HELD:
            return frame + 1 - _HELD
    return len(good)


def _rows(plan: Plan, method: str, setting: str, figures: Sequence[_Figures]) -> list[Row]:
    values = (
        ("joint_position_cm_during", [each.during for each in figures]),
        ("joint_position_cm_without", [each.usual for each in figures]),
        ("largest_jump_cm", [each.jump for each in figures]),
        ("largest_jump_cm_without", [each.usual_jump for each in figures]),
        ("settled_after_s", [each.settled for each in figures]),
    )
    rows: list[Row] = []
    for name, column in values:
        each = np.array(column)
        spread = float(each.std(ddof=1)) if len(each) > 1 else None
        rows.append(
            Row("drop-outs", method, setting, "by-sequence", name, float(each.mean()), spread, len(each), 0, plan.seed)
        )
    worst = max(each.jump for each in figures)
    return [
        *rows,
        Row("drop-outs", method, setting, "by-sequence", "worst_jump_cm", worst, None, len(figures), 0, plan.seed),
    ]
