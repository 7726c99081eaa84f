"""One method, with any settings, on one sequence, with the sequence left out of the library."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from poseloom.benchmark.six_trackers.sequences import forbidden_takes
from poseloom.evaluation.cases import Case, Conditions
from poseloom.evaluation.results import MethodResult, compare
from poseloom.library import MotionLibrary, open_library
from poseloom.methods import METHODS, InverseKinematics, Query, Reconstructor, reconstruct
from poseloom.methods.trackers.inverse_kinematics import InverseKinematicsSettings
from poseloom.sensors import Recording
from poseloom.synthesis import simulate_trackers
from poseloom.synthesis.faults import Fault

WARM_UP = 5
"""Samples that a method hears before the clock starts."""

CHANNELS = ("position and orientation", "position only", "orientation only")


@dataclass(frozen=True, eq=False)
class Trial:
    """A question for a process of the pool.

    Attributes:
        method: Name of the method.
        case: The sequence.
        seed: Of its sensors' noise.
        conditions: Layout and noise.
        library: Folder of the library.
        by_subject: Whether the sequence's people are left out too.
        limit: Samples after which the sequence is cut; None: all.
        channels: One of `CHANNELS`.
        faults: What goes wrong.
        changes: Settings that differ from the method's own (see `changed_method`).
    """

    method: str
    case: Case
    seed: int
    conditions: Conditions
    library: Path
    by_subject: bool = False
    limit: int | None = None
    channels: str = CHANNELS[0]
    faults: tuple[Fault, ...] = ()
    changes: Mapping[str, Any] = field(default_factory=dict[str, Any])


class Outcome(NamedTuple):
    """What a method made of a recording.

    Attributes:
        result: The estimate and its metrics.
        recording: What it was made of, truth included.
    """

    result: MethodResult
    recording: Recording


def run_trial(trial: Trial) -> MethodResult:
    """Runs one trial; `in_order` sends it to a process."""
    return run_trial_whole(trial).result


def run_trial_whole(trial: Trial) -> Outcome:
    """The same, with the recording beside the result."""
    recording = recording_of(trial)
    truth = recording.truth
    assert truth is not None  # it was simulated just now
    library = opened(trial.library)
    allowed = library.rows_excluding(forbidden_takes(library, trial.case, trial.by_subject))
    method = changed_method(trial.method, recording, library, allowed, trial.changes)
    warm_up(method, recording)
    made = reconstruct(method, recording)
    return Outcome(compare(trial.method, truth, made.motion, made.samples, made.step_seconds, method.delay), recording)


def recording_of(trial: Trial) -> Recording:
    """What the trial's sensors say."""
    motion = trial.case.motion
    assert motion is not None  # sequences are motion files
    conditions = trial.conditions
    whole = simulate_trackers(motion, conditions.worn, conditions.noise, trial.faults, seed=trial.seed)
    recording = whole if trial.limit is None or trial.limit >= len(whole) else whole.cut(0, trial.limit)
    if trial.channels == "position only":
        return replace(recording, quats_wxyz=np.full_like(recording.quats_wxyz, np.nan))
    if trial.channels == "orientation only":
        return replace(recording, positions=np.full_like(recording.positions, np.nan))
    return recording


def changed_method(
    name: str, recording: Recording, library: MotionLibrary, allowed: Any, changes: Mapping[str, Any]
) -> Reconstructor[Any]:
    """A method with some settings changed: those of its model, of its neighbours, `query` and `history`, by name."""
    kind = METHODS[name].kind
    if kind is None:
        return InverseKinematics(recording.layout, replace(InverseKinematicsSettings(), **changes))
    left = dict(changes)
    query = Query(left.pop("query", kind.default_query))
    features = None
    if "history" in left:
        from poseloom.library.features import FeatureSettings

        features = FeatureSettings(history=left.pop("history"))
    model, neighbours = kind.default_model, kind.default_neighbours
    own = {key: left.pop(key) for key in list(left) if hasattr(model, key)}
    return kind(
        library,
        recording.layout,
        model=replace(model, **own),  # pyright: ignore[reportArgumentType, reportCallIssue, reportUnknownArgumentType]
        neighbours=replace(neighbours, **left),
        query=query,
        allowed=allowed,
        features=features,
    )


def warm_up(method: Reconstructor[Any], recording: Recording) -> None:
    """Lets a method hear a few samples, so that compiling is not timed."""
    state = method.start(recording.skeleton, recording.placements)
    for index in range(min(WARM_UP, len(recording))):
        state, _ = method.step(state, recording.sample(index))


@lru_cache(maxsize=2)
def opened(folder: Path) -> MotionLibrary:
    """A process opens a library once for all its trials."""
    return open_library(folder)
