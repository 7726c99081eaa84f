"""Recovery: one sensor lies or falls silent for a second, and how far the pose follows, and for how long."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.six_trackers.accuracy import Sequences, frame_errors, rows_of
from poseloom.benchmark.six_trackers.plan import OURS, Plan, Progress
from poseloom.benchmark.six_trackers.trials import Outcome, Trial, opened, run_trial_whole
from poseloom.evaluation.rows import Row
from poseloom.library.pool import in_order
from poseloom.skeleton.kinematics import motion_frames
from poseloom.synthesis.faults import Fault, FaultKind

START, STOP = 1.0, 2.0
"""Seconds between which the sensor fails."""

LASTS = 4.0
"""Seconds of each sequence."""

SETTLED_SHARE, SETTLED_DEG, SETTLED_FRAMES = 1.2, 0.25, 5
"""An error counts as back to normal once it is, over so many frames, at most this share of what it is without the
fault, and so many degrees."""

FAULTS = {
    "30 % outliers of 0.3 m and 29°": (FaultKind.OUTLIERS, 0.3),
    "silent": (FaultKind.SILENT, 1.0),
}


class Course(NamedTuple):
    """One run.

    Attributes:
        errors: Joint angle error of each frame, degrees.
        jumps: Largest movement of any joint from the frame before that the truth does not make, cm.
        rate: Frames a second.
    """

    errors: Floats[Array, "frames"]
    jumps: Floats[Array, "frames"]
    rate: float


def recovery(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    """Every sensor fails in every way on some sequences; the same sequences without a fault stand beside."""
    library = plan.libraries[0]
    rate = plan.conditions.worn.rate
    long_enough = [
        (case, seed)
        for case, seed in zip(sequences.cases, sequences.seeds, strict=True)
        if len(case.truth) >= (STOP + 0.5) * rate
    ][: plan.fault_sequences]
    sensors = plan.conditions.worn.names
    limit = int(LASTS * rate)
    sound = [Trial(OURS, case, seed, plan.conditions, library, limit=limit) for case, seed in long_enough]
    kinds = [(name, sensor) for name in FAULTS for sensor in sensors]
    trials = [
        Trial(
            OURS, case, seed, plan.conditions, library, limit=limit,
            faults=(Fault(sensor, START, STOP, FAULTS[name][0], share=FAULTS[name][1]),),
        )
        for name, sensor in kinds
        for case, seed in long_enough
    ]  # fmt: skip
    courses: list[Course] = []
    total = len(sound) + len(trials)
    for course in in_order(run_course, [*sound, *trials], plan.workers):
        courses.append(course)
        tell("recovery after faults", len(courses), total)
    normal, spoilt = courses[: len(sound)], courses[len(sound) :]
    size = f"{len(opened(library).poses):,} poses"
    rows = _rows_of_runs("without a fault", size, normal, normal, plan.conditions.seed)
    count = len(sound)
    for name in FAULTS:
        start = [i for i, kind in enumerate(kinds) if kind[0] == name]
        some = [course for i in start for course in spoilt[count * i : count * (i + 1)]]
        rows += _rows_of_runs(f"{name}, any sensor", size, some, normal * len(start), plan.conditions.seed)
    for i, (name, sensor) in enumerate(kinds):
        some = spoilt[count * i : count * (i + 1)]
        rows += _rows_of_runs(f"{name}, {sensor}", size, some, normal, plan.conditions.seed)
    return rows


def run_course(trial: Trial) -> Course:
    """Runs one trial and keeps what recovery needs."""
    return course_of(run_trial_whole(trial))


def course_of(outcome: Outcome) -> Course:
    """Errors and jumps of a run; every frame has one (the methods wait for no sample)."""
    truth = outcome.recording.truth
    assert truth is not None  # it was simulated
    moved = np.diff(motion_frames(outcome.result.motion).positions, axis=0)
    really = np.diff(motion_frames(truth).positions, axis=0)[-len(moved) :]
    jumps = 100 * np.linalg.norm(moved - really, axis=-1).max(axis=1)
    return Course(frame_errors(outcome.result, truth), np.concatenate([[0.0], jumps]), truth.rate)


def seconds_to_settle(course: Course, normal: Course) -> float:
    """Seconds after the fault until the error is back to what it is without one; the rest of the run if it never is."""
    stop = round(STOP * course.rate)
    length = min(len(course.errors), len(normal.errors))
    bound = SETTLED_SHARE * normal.errors[stop:length] + SETTLED_DEG
    sound = course.errors[stop:length] <= bound
    run = 0
    for index, yes in enumerate(sound):
        run = run + 1 if yes else 0
        if run == SETTLED_FRAMES:
            return (index + 1 - SETTLED_FRAMES) / course.rate
    return len(sound) / course.rate


def _rows_of_runs(what: str, size: str, courses: Sequence[Course], normal: Sequence[Course], seed: int) -> list[Row]:
    rate = courses[0].rate
    start, stop, after = round(START * rate), round(STOP * rate), round((STOP + 0.5) * rate)
    during = [float(c.errors[start:stop].mean()) for c in courses]
    usual = [float(c.errors[start:stop].mean()) for c in normal]
    before = [float(c.errors[max(0, start - round(0.5 * rate)) : start].mean()) for c in courses]
    settle = [seconds_to_settle(c, n) for c, n in zip(courses, normal, strict=True)]
    jumps = [float(c.jumps[start:after].max()) for c in courses]
    ratios = [a / b for a, b in zip(during, usual, strict=True)]
    values: list[tuple[str, Sequence[float]]] = [
        ("joint_angle_deg_during", during),
        ("joint_angle_deg_before", before),
        ("error_over_no_fault", ratios),
        ("settled_after_s", settle),
        ("largest_jump_cm", jumps),
    ]
    frames = sum(len(c.errors) for c in courses)
    rows = rows_of("faults", OURS, f"{size}, {what}", "by-sequence", values, frames, seed)
    extremes = [
        ("pooled_error_over_no_fault", float(np.mean(during) / np.mean(usual))),
        ("worst_settled_after_s", max(settle)),
        ("share_settled_in_half_a_second", float(np.mean([s <= 0.5 for s in settle]))),
        ("worst_jump_cm", max(jumps)),
    ]
    return rows + [
        Row("faults", OURS, f"{size}, {what}", "by-sequence", metric, value, None, len(courses), frames, seed)
        for metric, value in extremes
    ]
