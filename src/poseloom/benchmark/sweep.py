"""Chooses every method's settings on sequences that no table reports, with as many trials for each method.

A seeded local search: the first round tries the present settings and changes of one of them, each further round changes
one to three settings of the best so far. The grids are equally rich for all methods, the rule of choice is the same.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from poseloom.benchmark.six_trackers.sequences import (
    check_apart,
    motions_folder,
    read_sequences,
    table_sequences,
    validation_sequences,
)
from poseloom.benchmark.six_trackers.trials import Trial, opened, run_trial
from poseloom.evaluation.cases import Case, Conditions
from poseloom.evaluation.rows import Results, Row, motions_digest
from poseloom.library.pool import in_order
from poseloom.methods import METHODS
from poseloom.methods.trackers.inverse_kinematics import InverseKinematicsSettings

Setting = Mapping[str, Any]
Progress = Callable[[str, int, int], object]

TIE = 0.01
"""Settings whose error is within this share of the least count as equal; the steadier one is chosen."""

_FLOORS = {
    "angle_floor": tuple(math.radians(value) for value in (0.25, 0.5, 1.0, 2.0)),
    "place_floor": (0.002, 0.005, 0.01),
}
_NEIGHBOURS = {
    "neighbours": (16, 24, 32, 48, 64, 96, 128, 192),
    "bandwidth": (0.4, 0.7, 1.0, 1.5, math.inf),
    "persistence": (0.0, 0.2, 0.3, 0.4, 0.5),
    **_FLOORS,
    "query": ("history", "history+sensors"),
    "history": (1, 2, 3, 5),
}
_REGRESSION = {
    "energy": (0.8, 0.9, 0.95, 0.97, 0.99),
    "ridge": (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0),
    "full_covariance": (False, True),
}

SPACES: Mapping[str, Mapping[str, tuple[Any, ...]]] = MappingProxyType(
    {
        "local-filter": {
            **{name: values for name, values in _NEIGHBOURS.items() if name != "persistence"},
            "shrinkage": (0.0, 0.1, 0.2, 0.3, 0.5, 0.7),
            "memory": (2.0, 4.0, 8.0, 14.0),
            "drift_scale": (1.0, 2.0, 3.0, 4.0, 6.0),
            "drift_shrinkage": (0.3, 0.5, 0.6, 0.7, 0.9),
            "drift_floor": tuple(math.radians(value) for value in (0.1, 0.2, 0.4)),
        },
        "local-gaussian": {**_NEIGHBOURS, "shrinkage": (0.0, 0.1, 0.2, 0.3, 0.5, 0.7)},
        "local-regression": {**_NEIGHBOURS, **_REGRESSION},
        "local-pcr": {**_NEIGHBOURS, **_REGRESSION},
        "local-pca": {**_NEIGHBOURS, "energy": (0.8, 0.9, 0.95, 0.97, 0.99, 0.999)},
        "nearest-example": {**_NEIGHBOURS, "neighbours": (4, 8, 16, 32, 64, 128)},
        "inverse-kinematics": {
            "joint_step": (0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
            "root_step": (0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
            "first_joint": (0.1, 0.2, 0.3, 0.5, 1.0),
            "first_root": (0.2, 0.5, 1.0),
        },
    }
)
"""What is varied: values in order, so that a change is a step along them."""


class Score(NamedTuple):
    """How good a setting is.

    Attributes:
        error: Joint angle error, degrees: mean over sequences.
        spread: Its standard deviation over sequences.
        jitter: Third derivative of the joint angles over the truth's own; mean over sequences.
        place: Joint place error, cm.
        step_ms: Median compute of a step, on a machine that did other things too.
        frames: Frames behind it.
    """

    error: float
    spread: float
    jitter: float
    place: float
    step_ms: float
    frames: int


@dataclass(frozen=True)
class Tried:
    """A setting and its score."""

    method: str
    setting: Setting
    score: Score


@dataclass(frozen=True)
class SweepPlan:
    """How much to try.

    Attributes:
        rounds: Rounds of trials.
        trials: Trials a round and method.
        limit: Samples of each sequence.
        seed: Of what is tried, and of the sensors' noise.
        methods: Which.
        workers: Processes.
    """

    rounds: int = 3
    trials: int = 6
    limit: int = 60
    seed: int = 0
    methods: tuple[str, ...] = tuple(SPACES)
    workers: int = 2


@dataclass(frozen=True, eq=False)
class SettingTrial:
    """A question for a process of the pool: one setting of one method on all sequences."""

    method: str
    setting: Setting
    cases: tuple[Case, ...] = field(repr=False)
    conditions: Conditions
    library: Path
    limit: int


def sweep(
    library: Path, data: Path, plan: SweepPlan | None = None, progress: Progress | None = None
) -> tuple[tuple[Tried, ...], Results]:
    """Tries settings of every method on the validation sequences.

    Args:
        library: Folder of the motion library.
        data: Folder of the recordings.
        plan: How much to try.
        progress: Told how far it is.

    Returns:
        All that was tried, in order, and the same as rows; the chosen settings stand in rows of the table "chosen".

    Raises:
        PoseloomError: where recordings are missing, or a sequence is among those of the tables.
    """
    how, tell = plan or SweepPlan(), progress or _silent
    motions, conditions = motions_folder(data), Conditions(seed=(plan or SweepPlan()).seed)
    cases = read_sequences(motions, validation_sequences(motions), conditions, tell)
    check_apart(opened(library), cases, read_sequences(motions, table_sequences(motions), conditions))
    tried: list[Tried] = []
    rng = np.random.default_rng(how.seed)
    for number in range(how.rounds):
        questions = [
            SettingTrial(method, setting, cases, conditions, library, how.limit)
            for method in how.methods
            for setting in propose(method, [t for t in tried if t.method == method], how.trials, rng)
        ]
        label = f"round {number + 1} of {how.rounds}"
        tell(label, 0, len(questions))
        for question, score in zip(questions, in_order(score_setting, questions, how.workers), strict=True):
            tried.append(Tried(question.method, question.setting, score))
            tell(label, len(tried) - number * len(questions), len(questions))
    digest = motions_digest(case.truth for case in cases)
    return tuple(tried), Results("sweep", digest, _rows(tried, how, len(cases)))


def score_setting(question: SettingTrial) -> Score:
    """Runs one setting over all sequences."""
    errors: list[float] = []
    jitters: list[float] = []
    places: list[float] = []
    steps: list[float] = []
    frames = 0
    for index, case in enumerate(question.cases):
        trial = Trial(
            question.method, case, question.conditions.seed + index, question.conditions, question.library,
            limit=question.limit, changes=question.setting,
        )  # fmt: skip
        result = run_trial(trial)
        errors.append(result.metrics["joint_angle_deg"])
        jitters.append(result.metrics["jitter_deg_s3"] / result.metrics["truth_jitter_deg_s3"])
        places.append(result.metrics["joint_position_cm"])
        steps.append(result.metrics["step_ms_p50"])
        frames += len(result.motion)
    return Score(
        float(np.mean(errors)),
        float(np.std(errors, ddof=1)) if len(errors) > 1 else 0.0,
        float(np.mean(jitters)),
        float(np.mean(places)),
        float(np.median(steps)),
        frames,
    )


def best_of(tried: Sequence[Tried]) -> Tried:
    """The least error; among those within `TIE` of it the least jitter."""
    least = min(t.score.error for t in tried)
    return min((t for t in tried if t.score.error <= (1 + TIE) * least), key=lambda t: t.score.jitter)


def propose(method: str, tried: Sequence[Tried], count: int, rng: np.random.Generator) -> list[Setting]:
    """Settings to try next, none twice; fewer where the space is exhausted.

    A setting names what differs from the method's own: the first one, nothing.
    """
    space, own = SPACES[method], own_setting(method)
    known = {_key({**own, **each.setting}) for each in tried}
    proposed: list[Setting] = []
    base: Setting = {} if not tried else best_of(tried).setting
    if not tried:
        proposed.append({})
        known.add(_key(own))
    for _ in range(500):
        if len(proposed) >= count:
            break
        setting = dict(base)
        changes = 1 if not tried else int(rng.integers(1, 4))
        for name in rng.choice(list(space), size=changes, replace=False).tolist():
            setting[name] = _another(space[name], setting.get(name, own[name]), rng)
        whole = {**own, **setting}
        if _key(whole) not in known:
            known.add(_key(whole))
            proposed.append({name: value for name, value in setting.items() if value != own[name]})
    return proposed


def own_setting(method: str) -> dict[str, Any]:
    """The present settings of a method, of all that is varied."""
    kind = METHODS[method].kind
    if kind is None:
        return {name: getattr(InverseKinematicsSettings(), name) for name in SPACES[method]}
    parts = (kind.default_model, kind.default_neighbours)
    own = {name: getattr(part, name) for part in parts for name in SPACES[method] if hasattr(part, name)}
    return own | {"query": str(kind.default_query), "history": kind.default_features.history}


def in_words(setting: Setting) -> str:
    """A setting for people: angles in degrees, places in mm."""

    def told(name: str, value: Any) -> str:
        if name in ("angle_floor", "drift_floor"):
            return f"{name.replace('_', ' ')} {math.degrees(value):g}°"
        if name == "place_floor":
            return f"place floor {1e3 * value:g} mm"
        return (
            f"{name.replace('_', ' ')} {value:g}" if isinstance(value, float) else f"{name.replace('_', ' ')} {value}"
        )

    return ", ".join(told(name, setting[name]) for name in sorted(setting)) or "as it was"


def _another(values: tuple[Any, ...], present: Any, rng: np.random.Generator) -> Any:
    """As likely a neighbouring value on the grid as any; never the present one."""
    others = [value for value in values if value != present]
    if present in values and rng.random() < 0.5:
        at = values.index(present)
        others = [values[i] for i in (at - 1, at + 1) if 0 <= i < len(values)]
    return others[int(rng.integers(len(others)))]


def _key(setting: Setting) -> tuple[tuple[str, Any], ...]:
    return tuple(sorted(setting.items()))


def _rows(tried: Sequence[Tried], plan: SweepPlan, sequences: int) -> tuple[Row, ...]:
    rows: list[Row] = []
    chosen = {
        id(best_of([t for t in tried if t.method == method])) for method in dict.fromkeys(t.method for t in tried)
    }
    for each in tried:
        score = each.score
        for metric, value, spread in (
            ("joint_angle_deg", score.error, score.spread),
            ("jitter_over_truth", score.jitter, None),
            ("joint_position_cm", score.place, None),
            ("step_ms_p50", score.step_ms, None),
        ):
            table = "chosen" if id(each) in chosen else "tried"
            words = in_words(each.setting)
            rows.append(
                Row(table, each.method, words, "by-sequence", metric, value, spread, sequences, score.frames, plan.seed)
            )
    return tuple(rows)


def _silent(what: str, done: int, total: int) -> None:
    pass
