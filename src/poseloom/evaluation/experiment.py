"""Runs methods over sequences, in a pool of processes, and measures what comes out."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import degrees
from pathlib import Path
from typing import Any

from poseloom.errors import PoseloomError
from poseloom.evaluation.cases import Case, Conditions, sensed
from poseloom.evaluation.results import MethodResult, SequenceResult, compare, mean_over_sequences
from poseloom.evaluation.rows import Results, Row, motions_digest
from poseloom.evaluation.splits import LeftOut, Split, allowed_poses, left_out
from poseloom.library import MotionLibrary, open_library
from poseloom.library.pool import in_order
from poseloom.library.store import HEADER_FILE
from poseloom.methods import Reconstructor, make_method, needs_library, reconstruct
from poseloom.sensors import Recording

Progress = Callable[[str, int, int], object]
"""Called with the name of what is being done, and how many of how many are."""

_WARM_UP = 5
"""Samples that a method hears before the clock starts, so that compiling its kernels is not timed."""


@dataclass(frozen=True)
class Experiment:
    """What to run.

    Attributes:
        methods: Names of methods.
        library: Folder of the motion library; None where no method needs one.
        split: What of the library a method may not see.
        conditions: The sensors.
        workers: Number of processes.
    """

    methods: tuple[str, ...]
    library: Path | None = None
    split: Split = Split.BY_SEQUENCE
    conditions: Conditions = field(default_factory=Conditions)
    workers: int = 1


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What came out.

    Attributes:
        experiment: What was run.
        sequences: One a sequence, with one result a method.
        left_out: What of the library each sequence's methods did not see.
        library_poses: Size of the library; 0 without one.
        setting: The sensors, in words.
        data_digest: Digest of the truths and of the library.
    """

    experiment: Experiment
    sequences: tuple[SequenceResult, ...]
    left_out: tuple[LeftOut, ...]
    library_poses: int
    setting: str
    data_digest: str

    @property
    def frames(self) -> int:
        """Frames of truth in all sequences."""
        return sum(len(sequence.truth) for sequence in self.sequences)

    def facts(self) -> dict[str, str]:
        """What every table says of itself: data, split, sensors, seeds."""
        experiment = self.experiment
        first, last = experiment.conditions.seed, experiment.conditions.seed + len(self.sequences) - 1
        count = len(self.sequences)
        data = f"{count} sequence{'s' * (count > 1)}, {self.frames} frames"
        facts = {"data": data, "sensors": self.setting}
        if self.library_poses:
            facts["library"] = f"{self.library_poses} poses"
            facts["split"] = f"{experiment.split}{self._left_out_in_words()}"
        return facts | {"seed": f"{first}" if first == last else f"{first} to {last}"}

    def _left_out_in_words(self) -> str:
        if self.experiment.split is Split.NONE:
            return ", nothing left out"
        poses = [entry.poses for entry in self.left_out]
        told = f"{min(poses)}" if min(poses) == max(poses) else f"{min(poses)} to {max(poses)}"
        return f", {told} poses left out"

    def results(self, benchmark: str = "evaluate", table: str = "evaluate") -> Results:
        """The figures as rows."""
        return Results(benchmark, self.data_digest, _rows(self, table))


def evaluate(cases: Sequence[Case], experiment: Experiment, progress: Progress | None = None) -> Evaluation:
    """Runs every method over every case.

    A method is given what the sensors say, the wearer's bones and the placements; the truth is looked at afterwards.
    With more than one worker a script must guard its top level by `if __name__ == "__main__"`.

    Args:
        cases: What to reconstruct.
        experiment: How.
        progress: Told how far it is.

    Raises:
        PoseloomError: for no case, an unknown method, a missing library, or what a method refuses.
    """
    tell = progress or _silent
    if not cases or not experiment.methods:
        raise PoseloomError("there is nothing to evaluate", remedy="Give at least one motion and one method")
    library = _library_for(experiment)
    forbidden = tuple(LeftOut() for _ in cases)
    if library is not None and experiment.split is not Split.NONE:
        forbidden = left_out(library, cases, experiment.split, lambda done, total: tell("finding copies", done, total))
    trials = [
        _Trial(case, experiment, name, experiment.conditions.seed + index, forbidden[index])
        for index, case in enumerate(cases)
        for name in experiment.methods
    ]
    tell("evaluating", 0, len(trials))
    results: list[MethodResult] = []
    for result in in_order(_run, trials, experiment.workers):
        results.append(result)
        tell("evaluating", len(results), len(trials))
    each = len(experiment.methods)
    return Evaluation(
        experiment,
        tuple(
            SequenceResult(case.name, case.truth, tuple(results[each * i : each * (i + 1)]))
            for i, case in enumerate(cases)
        ),
        forbidden,
        0 if library is None else len(library.poses),
        _describe_setting(cases, experiment.conditions),
        _digest(cases, library),
    )


def _library_for(experiment: Experiment) -> MotionLibrary | None:
    """The library, where a method needs one; every method's name is checked on the way."""
    wanted = [name for name in experiment.methods if needs_library(name)]
    if not wanted:
        return None
    if experiment.library is None:
        raise PoseloomError(
            f"the method {wanted[0]!r} needs a motion library",
            remedy="Build one with `poseloom library build` and name it with --library, or leave the method out",
        )
    return open_library(experiment.library)


@dataclass(frozen=True, eq=False)
class _Trial:
    """One method on one case: the question that a process of the pool gets."""

    case: Case
    experiment: Experiment
    method: str
    seed: int
    forbidden: LeftOut


def _run(trial: _Trial) -> MethodResult:
    recording = sensed(trial.case, trial.experiment.conditions, trial.seed)
    folder = trial.experiment.library
    library = allowed = None
    if needs_library(trial.method) and folder is not None:
        library = _opened(folder, (folder / HEADER_FILE).stat().st_mtime_ns)
        allowed = allowed_poses(library, trial.forbidden)
    method = make_method(trial.method, recording.layout, library, allowed)
    _warm_up(method, recording)
    made = reconstruct(method, recording)
    return compare(trial.method, trial.case.truth, made.motion, made.samples, made.step_seconds, method.delay)


@lru_cache(maxsize=1)
def _opened(folder: Path, _written: int) -> MotionLibrary:
    """A process opens a library once for all its trials, and again if it was written to."""
    return open_library(folder)


def _warm_up(method: Reconstructor[Any], recording: Recording) -> None:
    state = method.start(recording.skeleton, recording.placements)
    for index in range(min(_WARM_UP, len(recording))):
        state, _ = method.step(state, recording.sample(index))


def _describe_setting(cases: Sequence[Case], conditions: Conditions) -> str:
    parts: list[str] = []
    if any(case.recording is not None for case in cases):
        parts.append("sensors as recorded")
    if any(case.recording is None for case in cases):
        noise = conditions.noise
        parts.append(f"{conditions.layout}, {1e3 * noise.position_m:g} mm and {degrees(noise.orientation_rad):g}°")
    return "; ".join(parts)


def _digest(cases: Sequence[Case], library: MotionLibrary | None) -> str:
    truths = motions_digest(case.truth for case in cases)
    return truths if library is None else hashlib.sha256(f"{truths} {library.digest}".encode()).hexdigest()


def _silent(what: str, done: int, total: int) -> None:
    pass


def _rows(evaluation: Evaluation, table: str) -> tuple[Row, ...]:
    split = evaluation.experiment.split if evaluation.library_poses else Split.NONE
    return tuple(
        Row(
            table=table,
            method=method,
            setting=evaluation.setting,
            split=str(split),
            metric=metric,
            value=mean.value,
            spread=mean.spread,
            sequences=mean.sequences,
            frames=mean.frames,
            seed=evaluation.experiment.conditions.seed,
        )
        for method, metrics in mean_over_sequences(evaluation.sequences).items()
        for metric, mean in metrics.items()
    )
