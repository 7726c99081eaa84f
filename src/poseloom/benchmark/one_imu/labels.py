"""The phases that the model tells, against those of the true motion."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Ints
from poseloom.benchmark.one_imu.accuracy import question_of
from poseloom.benchmark.one_imu.plan import FOOT, OURS, Plan, Progress
from poseloom.benchmark.one_imu.sequences import BEHAVIOURS, Take
from poseloom.benchmark.one_imu.trials import by_fold, fitted, pooled, sequence
from poseloom.evaluation.rows import Row
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.phase_hmm import PhaseHmm
from poseloom.methods.imus.phases import Phase, label_phases
from poseloom.sensors import Recording

_NEAR = 0.25
"""Seconds within which a phase that begins in truth and one that begins in the estimate are the same."""

_TITLES = {phase.title: int(phase) for phase in Phase}


class _Labels(NamedTuple):
    """Phases of one sequence, -1 where the model names none."""

    behaviour: str
    true: Ints[Array, "frames"]
    told: Ints[Array, "frames"]
    same_behaviour: float
    rate: float


def phase_labels(plan: Plan, tell: Progress) -> list[Row]:
    """Share of frames in the right phase, in it or a neighbouring one, and how far off in time phases begin."""
    pool = pooled(plan.data)
    folds = by_fold(plan, pool, pool.tables)
    found: list[_Labels] = []
    for number, fold in enumerate(folds):
        tell("phase labels", number, len(folds))
        question = question_of(plan, OURS, FOOT, fold, left_out=pool.fold_of(fold[0]))
        method = fitted(question)
        assert isinstance(method, PhaseHmm)
        found += [_labelled(method, sequence(question, take), take) for take in fold]
    tell("phase labels", len(folds), len(folds))
    return [row for what in ("all", *BEHAVIOURS) for row in _rows(plan, what, found)]


def _labelled(method: PhaseHmm, recording: Recording, take: Take) -> _Labels:
    truth = label_phases(take.motion, Behaviour(take.behaviour)).phases[: len(recording)]
    state = method.start(recording.skeleton, recording.placements)
    told = np.full(len(recording), -1)
    right = 0
    for index in range(len(recording)):
        state, _ = method.step(state, recording.sample(index))
        phases = method.phase_probabilities(state)
        if not phases:
            continue
        by_title: dict[str, float] = {}
        by_behaviour: dict[str, float] = {}
        for name, share in phases.items():
            behaviour, _, title = name.partition(": ")
            by_title[title] = by_title.get(title, 0.0) + share
            by_behaviour[behaviour] = by_behaviour.get(behaviour, 0.0) + share
        told[index] = _TITLES.get(max(by_title, key=lambda name: by_title[name]), -1)
        right += max(by_behaviour, key=lambda name: by_behaviour[name]) == take.behaviour
    return _Labels(take.behaviour, np.asarray(truth), told, right / len(recording), recording.layout.rate)


def _rows(plan: Plan, what: str, found: Sequence[_Labels]) -> list[Row]:
    some = [each for each in found if what in ("all", each.behaviour)]
    if not some:
        return []
    frames = sum(len(each.true) for each in some)
    right = [float((each.true == each.told).mean()) for each in some]
    near = [float(_beside(each).mean()) for each in some]
    offsets = np.concatenate([_offsets(each) for each in some])
    missed = sum(int(np.isnan(_offsets(each)).sum()) for each in some) / max(len(offsets), 1)
    known = offsets[np.isfinite(offsets)]
    values = [
        ("right_behaviour_percent", 100 * float(np.mean([each.same_behaviour for each in some]))),
        ("right_phase_percent", 100 * float(np.mean(right))),
        ("right_or_adjacent_phase_percent", 100 * float(np.mean(near))),
        ("phase_begins_off_ms", 1000 * float(np.median(np.abs(known))) if len(known) else float("nan")),
        ("phase_begins_late_ms", 1000 * float(np.median(known)) if len(known) else float("nan")),
        ("phases_missed_percent", 100 * missed),
    ]
    return [
        Row("phases", OURS, f"{FOOT}, {what}", "by-sequence", name, value, None, len(some), frames, plan.seed)
        for name, value in values
        if np.isfinite(value)
    ]


def _beside(labels: _Labels) -> np.ndarray:
    """Frames whose phase is right, or the one that comes before or after it in the truth."""
    changes = np.flatnonzero(np.diff(labels.true)) + 1
    edges = np.concatenate([[0], changes, [len(labels.true)]])
    good = labels.true == labels.told
    for number in range(len(edges) - 1):
        part = slice(edges[number], edges[number + 1])
        for beside in (number - 1, number + 1):
            if 0 <= beside < len(edges) - 1:
                good[part] |= labels.told[part] == labels.true[edges[beside]]
    return good


def _offsets(labels: _Labels) -> np.ndarray:
    """Seconds from each beginning of a phase in truth to the same phase's in the estimate; NaN if none is near."""
    true = np.flatnonzero(np.diff(labels.true)) + 1
    told = np.flatnonzero(np.diff(labels.told)) + 1
    out = np.full(len(true), np.nan)
    for index, frame in enumerate(true):
        same = told[labels.told[told] == labels.true[frame]] - frame
        if len(same):
            nearest = same[np.argmin(np.abs(same))] / labels.rate
            out[index] = nearest if abs(nearest) <= _NEAR else np.nan
    return out
