"""Runs methods over sequences, in a pool of processes, and measures what comes out."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import degrees
from pathlib import Path
from typing import Any

from poseloom.errors import PoseloomError
from poseloom.evaluation.cases import Case, Channels, Conditions
from poseloom.evaluation.constant_pose import CONSTANT_POSE, ConstantPose
from poseloom.evaluation.observed import observed_by
from poseloom.evaluation.plan import Experiment, at_one_rate, findable_cases, named_methods, unknown_people
from poseloom.evaluation.results import MethodResult, SequenceResult, compare, mean_over_sequences
from poseloom.evaluation.rows import Results, Row, SequenceFigures, motions_digest
from poseloom.evaluation.sensed import sensed
from poseloom.evaluation.splits import LeftOut, Split, allowed_poses, left_out
from poseloom.library import MotionLibrary, open_library
from poseloom.library.pool import in_order
from poseloom.library.store import HEADER_FILE
from poseloom.methods.choose import Method, choose
from poseloom.methods.contract import Reconstructor
from poseloom.methods.reconstruction import reconstruct
from poseloom.methods.registry import needs_library
from poseloom.sensors import Recording, SensorKind

Progress = Callable[[str, int, int], object]
"""Called with the name of what is being done, and how many of how many are."""

_WARM_UP = 5
"""Samples that a method hears before the clock starts, so that compiling its kernels is not timed."""


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
        skipped: Sequences that are not among these, and why, in words.
        notes: What people should know of how it was measured.
    """

    experiment: Experiment
    sequences: tuple[SequenceResult, ...]
    left_out: tuple[LeftOut, ...]
    library_poses: int
    setting: str
    data_digest: str
    skipped: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

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
        removed = dict.fromkeys(
            result.observed.in_words() for sequence in self.sequences for result in sequence.results
        )
        if any(removed):
            facts["not observed"] = "; ".join(words for words in removed if words)
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
        return Results(benchmark, self.data_digest, _rows(self, table), sequences=_figures(self))


def evaluate_cases(cases: Sequence[Case], experiment: Experiment, progress: Progress | None = None) -> Evaluation:
    """Runs every method over every case.

    All methods get the same samples, at the rate that the methods need. A method is given what the sensors say, the
    wearer's bones and the placements; the truth is looked at afterwards.
    With more than one worker a script must guard its top level by `if __name__ == "__main__"`.

    Args:
        cases: What to reconstruct.
        experiment: How.
        progress: Told how far it is.

    Raises:
        PoseloomError: for no case, an unknown method, a missing library, methods of different rates, or what a method
            refuses.
    """
    tell = progress or _silent
    if not cases or not experiment.methods:
        raise PoseloomError("there is nothing to evaluate", remedy="Give at least one motion and one method")
    library = _library_for(experiment)
    cases, notes = at_one_rate(cases, experiment, library)
    cases, skipped = findable_cases(cases, experiment, library)
    notes += unknown_people(cases, experiment, library)
    forbidden = tuple(LeftOut() for _ in cases)
    if library is not None and experiment.split is not Split.NONE:
        forbidden = left_out(library, cases, experiment.split, lambda done, total: tell("finding copies", done, total))
    # Processes open the library themselves: its poses are not sent to them.
    path = library.path if library is not None and experiment.workers > 1 else library
    told = replace(experiment, library=path)
    trials = [
        _Trial(case, told, method, name, experiment.conditions.seed + index, forbidden[index])
        for index, case in enumerate(cases)
        for method, name in zip(experiment.methods, experiment.names, strict=True)
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
        skipped,
        notes,
    )


def _library_for(experiment: Experiment) -> MotionLibrary | None:
    """The library, where a method needs one; every method's name is checked on the way."""
    wanted = [name for name in named_methods(experiment) if needs_library(name)]
    if not wanted:
        return None
    if experiment.library is None:
        raise PoseloomError(
            f"the method {wanted[0]!r} needs a motion library",
            remedy="Build one with `poseloom library build` and name it with --library, or leave the method out",
        )
    library = experiment.library
    return library if isinstance(library, MotionLibrary) else open_library(library)


@dataclass(frozen=True, eq=False)
class _Trial:
    """One method on one case: the question that a process of the pool gets."""

    case: Case
    experiment: Experiment
    method: Method
    name: str
    seed: int
    forbidden: LeftOut


def _run(trial: _Trial) -> MethodResult:
    recording = sensed(trial.case, trial.experiment.conditions, trial.seed)
    method = _method(trial, recording)
    _warm_up(method, recording)
    made = reconstruct(method, recording)
    return compare(
        trial.name, trial.case.truth, made.motion, made.samples, made.step_seconds, method.delay, observed_by(recording)
    )


def _method(trial: _Trial, recording: Recording) -> Reconstructor[Any]:
    if trial.method == CONSTANT_POSE:
        return ConstantPose(recording.layout)
    library = trial.experiment.library
    allowed = None
    if isinstance(trial.method, str) and needs_library(trial.method) and library is not None:
        if not isinstance(library, MotionLibrary):
            folder = Path(library)
            library = _opened(folder, (folder / HEADER_FILE).stat().st_mtime_ns)
        allowed = allowed_poses(library, trial.forbidden)
    model = trial.experiment.models.get(trial.method) if isinstance(trial.method, str) else None
    return choose(recording.layout, trial.method, library=library, model=model, allowed=allowed).method


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
        noise, worn = conditions.noise, conditions.worn
        errors = f", {1e3 * noise.position_m:g} mm and {degrees(noise.orientation_rad):g}°"
        parts.append(worn.name + (errors if worn.of_kind(SensorKind.TRACKER) else ""))
    if conditions.channels is not Channels.BOTH:
        parts.append(f"{conditions.channels.value} only")
    if conditions.drop:
        parts.append(f"without {', '.join(conditions.drop)}")
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


def _figures(evaluation: Evaluation) -> tuple[SequenceFigures, ...]:
    """The figures of each sequence by itself."""
    seed = evaluation.experiment.conditions.seed
    return tuple(
        SequenceFigures(
            sequence.name,
            len(sequence.truth),
            seed + index,
            {
                result.name: {name: value for name, value in result.metrics.items() if math.isfinite(value)}
                for result in sequence.results
            },
        )
        for index, sequence in enumerate(evaluation.sequences)
    )
