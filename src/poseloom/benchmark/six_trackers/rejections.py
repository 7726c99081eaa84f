"""Rejections: how often a sound sensor is named in the health, on people and motions that the library never saw."""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools
from poseloom.benchmark.six_trackers.accuracy import Sequences
from poseloom.benchmark.six_trackers.plan import Plan, Progress
from poseloom.benchmark.six_trackers.trials import Trial, changed_method, opened, recording_of
from poseloom.errors import PoseloomError
from poseloom.evaluation.cases import Case
from poseloom.evaluation.metrics import joint_position_cm
from poseloom.evaluation.rows import Row
from poseloom.library import MotionLibrary
from poseloom.library.pool import in_order
from poseloom.methods import reconstruct

METHODS_TRIED = ("local-filter", "local-gaussian", "inverse-kinematics")
"""The default, the one that predicts most tightly, and the one without a library."""

_CMU, _HDM05 = "CMU alone", "HDM05 alone"
_FOLDERS = {_CMU: "cmu_", _HDM05: "hdm05"}
_Z = 1.959964


class Rejected(NamedTuple):
    """One run.

    Attributes:
        library: What the library held, in words.
        named: Frames whose health names a sensor.
        frames: Frames.
        position_cm: Mean joint position error.
    """

    library: str
    named: int
    frames: int
    position_cm: float


def rejections(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    """Every sequence, its sensors sound, with a library of the other data set alone: CMU's for HDM05's, and so on."""
    trials = [
        Trial(method, case, seed, plan.conditions, plan.libraries[0], limit=plan.limit)
        for method in METHODS_TRIED
        for case, seed in zip(sequences.cases, sequences.seeds, strict=True)
    ]
    runs: list[Rejected] = []
    for run in in_order(run_with_other_people, trials, plan.workers):
        runs.append(run)
        tell("rejections of sound sensors", len(runs), len(trials))
    each = len(sequences.cases)
    rows: list[Row] = []
    for index, method in enumerate(METHODS_TRIED):
        mine = runs[each * index : each * (index + 1)]
        for library in dict.fromkeys(run.library for run in mine):
            some = [run for run in mine if run.library == library]
            rows += _rows(method, f"library of {library}", some, plan.conditions.seed)
    return rows


def run_with_other_people(trial: Trial) -> Rejected:
    """Runs one trial with nothing in the library but the other data set."""
    library = opened(trial.library)
    name, allowed = rows_of_other_people(library, trial.case)
    recording = recording_of(trial)
    result = reconstruct(changed_method(trial.method, recording, library, allowed, trial.changes), recording)
    truth = recording.truth
    assert truth is not None  # it was simulated
    named = sum(bool(health.sensors) for health in result.health)
    return Rejected(name, named, len(result.health), joint_position_cm(truth, result.motion))


def rows_of_other_people(library: MotionLibrary, case: Case) -> tuple[str, Bools[Array, "poses"]]:
    """The poses of the data set that the case is not from, and what it is called.

    Raises:
        PoseloomError: where the library does not know the case's file, or holds nothing of the other data set.
    """
    own = next((clip for clip in library.clips if clip.digest == case.digest), None)
    name = _CMU if own is not None and _is_of(own.source, _FOLDERS[_HDM05]) else _HDM05
    allowed = np.zeros(len(library.poses), dtype=bool)
    for clip in library.clips:
        if _is_of(clip.source, _FOLDERS[name]):
            allowed[clip.rows] = True
    if own is None or not allowed.any():
        raise PoseloomError(
            f"the library does not hold {case.name!r}, or nothing of {name.removesuffix(' alone')}",
            remedy="Build the library from the recordings of the benchmark: poseloom benchmark libraries",
            file=library.path,
        )
    return name, allowed


def _is_of(source: str, folder: str) -> bool:
    return any(part.startswith(folder) for part in source.split("/")[:-1])


def _rows(method: str, setting: str, runs: Sequence[Rejected], seed: int) -> list[Row]:
    named, frames = sum(run.named for run in runs), sum(run.frames for run in runs)
    low, high = wilson(named, frames)
    values = {
        "named_percent": 100 * named / frames,
        "named_percent_from": 100 * low,
        "named_percent_to": 100 * high,
        "sequences_with_one_named": float(sum(run.named > 0 for run in runs)),
        "joint_position_cm": float(np.mean([run.position_cm for run in runs])),
    }
    return [
        Row("rejections", method, setting, "by-subject", metric, value, None, len(runs), frames, seed)
        for metric, value in values.items()
    ]


def wilson(hits: int, of: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    share, scale = hits / of, 1.0 + _Z**2 / of
    middle = (share + _Z**2 / (2 * of)) / scale
    half = _Z * sqrt(share * (1.0 - share) / of + _Z**2 / (4.0 * of**2)) / scale
    return max(middle - half, 0.0), min(middle + half, 1.0)
