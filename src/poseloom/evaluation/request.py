"""`poseloom.evaluate`: from what a person asks for, in names or objects, to an evaluation."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar, cast

from poseloom.errors import PoseloomError, unknown_name
from poseloom.evaluation.cases import (
    Case,
    Channels,
    Conditions,
    TooShort,
    case_of_motion,
    case_of_recording,
    read_cases,
)
from poseloom.evaluation.constant_pose import CONSTANT_POSE
from poseloom.evaluation.experiment import Evaluation, Progress, evaluate_cases
from poseloom.evaluation.plan import Experiment
from poseloom.evaluation.sensed import layout_of
from poseloom.evaluation.splits import Split
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, one_line
from poseloom.library import MotionLibrary, open_library
from poseloom.methods.choose import WITHOUT_LIBRARY, Library, Method, choose, default_method, model_method
from poseloom.methods.registry import METHODS, needs_library
from poseloom.sensors import Recording, SensorKind, SensorLayout
from poseloom.skeleton.motion import Motion
from poseloom.synthesis import TrackerNoise

Sequence_ = Motion | Recording | Case | str | Path
"""A sequence to evaluate: a motion, a recording with ground truth, or a file or folder of either."""

_NEAREST = "nearest-example"


def evaluate(
    sequences: Sequence_ | Iterable[Sequence_],
    methods: Method | Iterable[Method] | None = None,
    *,
    library: Library | None = None,
    models: Iterable[str | Path] | Mapping[str, str | Path] = (),
    layout: SensorLayout | str = "six-trackers",
    split: Split | str = Split.BY_SEQUENCE,
    noise: TrackerNoise | None = None,
    channels: Channels | str = Channels.BOTH,
    drop: Iterable[str] = (),
    start: float = 0.0,
    stop: float | None = None,
    subject: str = "",
    seed: int = 0,
    workers: int = 1,
    skeleton: Path | None = None,
    progress: Progress | None = None,
    choices: MotionChoices = NOTHING_SAID,
) -> Evaluation:
    """Measures how far methods are from the ground truth, on any layout of sensors.

    Args:
        sequences: Motions, which wear virtual sensors; recordings that hold their ground truth; files or folders of
            both; `sample:NAME`, or `samples` for all built-in motions.
        methods: Methods or their names. None: those of the models, or the default method for the sensors, and beside
            it the baselines that can run: nearest example, inverse kinematics, and one constant pose.
        library: A motion library or its folder.
        models: Files of fitted models, each for the method that it says, or by name of the method.
        layout: Sensors that motions wear; at the rate that the methods need.
        split: What of the library is held out: `by-sequence`, `by-subject` or `none`.
        noise: Errors of the trackers that motions wear.
        channels: What of trackers is used: `position`, `orientation` or `both`.
        drop: Names of sensors that are missing throughout.
        start: Second of each sequence to begin at.
        stop: Second to end at.
        subject: Who moves, for recordings that do not say so.
        seed: Seed of the first sequence; the next has the next number.
        workers: Number of processes; with more than one a script needs `if __name__ == "__main__"`.
        skeleton: ASF file, for AMC files without their own.
        progress: Called with what is done, and how many of how many.
        choices: What the user says of motion files that do not say it themselves: unit, up axis, rate, rest pose.

    Raises:
        PoseloomError: for what cannot be read or does not fit. Sequences that are too short are skipped and named.
    """
    used = _named(Channels, "channels", channels)
    conditions = Conditions(layout, noise or TrackerNoise(), seed, used, tuple(drop), start, stop, subject, choices)
    by_name = _models(models)
    opened = open_library(library) if isinstance(library, str | Path) else library
    asked = _listed(methods)
    conditions = replace(conditions, layout=_at_the_methods_rate(conditions.worn, asked, opened, by_name))
    skipped: list[str] = []
    cases = _cases(sequences, conditions, skeleton, skipped, progress or _silent)
    if not cases:
        raise PoseloomError(
            "no sequence is left to evaluate",
            cause="; ".join(skipped),
            remedy="Give longer sequences, or recordings with ground truth",
        )
    asked = asked or _defaults(layout_of(cases[0], conditions), opened, by_name)
    asked_library = opened if any(isinstance(m, str) and _asks_library(m) for m in asked) else None
    experiment = Experiment(
        tuple(dict.fromkeys(asked)), asked_library, _named(Split, "split", split), conditions, workers, by_name
    )
    evaluation = evaluate_cases(cases, experiment, progress)
    understood = tuple(
        f"{case.name} read as {one_line(case.motion.conventions)}"
        for case in cases
        if case.motion is not None and case.motion.conventions is not None
    )
    return replace(evaluation, skipped=(*skipped, *evaluation.skipped), notes=(*evaluation.notes, *understood))


def _silent(what: str, done: int, total: int) -> None:
    pass


Kind = TypeVar("Kind", Channels, Split)


def _named(kind: type[Kind], what: str, name: str) -> Kind:
    if name not in set(kind):
        raise unknown_name(what, name, list(kind))
    return kind(name)


def _listed(methods: Method | Iterable[Method] | None) -> list[Method]:
    if methods is None:
        return []
    return [methods] if isinstance(methods, str) or not isinstance(methods, Iterable) else list(methods)


def _models(models: Iterable[str | Path] | Mapping[str, str | Path]) -> dict[str, Path]:
    """Files by name of their method; `METHOD=FILE` names one that the file leaves open."""
    if isinstance(models, Mapping):
        return {name: Path(file) for name, file in cast("Mapping[str, str | Path]", models).items()}
    found: dict[str, Path] = {}
    for text in models:
        name, equals, file = str(text).partition("=")
        if not (equals and name in METHODS):
            name, file = model_method(Path(text)), str(text)
        if name in found:
            raise PoseloomError(f"two models are given for {name!r}", remedy="Evaluate them in two calls")
        found[name] = Path(file)
    return found


def _asks_library(name: str) -> bool:
    return name != CONSTANT_POSE and needs_library(name)


def _at_the_methods_rate(
    worn: SensorLayout, methods: Sequence[Method], library: MotionLibrary | None, models: Mapping[str, Path]
) -> SensorLayout:
    """The sensors that motions wear, at the rate of the library or the model that is asked."""
    trackers = all(sensor.kind is SensorKind.TRACKER for sensor in worn.sensors)
    asks = not methods or any(isinstance(method, str) and _asks_library(method) for method in methods)
    if library is not None and trackers and asks:
        return replace(worn, rate=library.rate)
    for name in [name for name in methods if isinstance(name, str)] or list(models):
        if name in models and METHODS[name].fits(worn):
            method = choose(worn, name, model=models[name]).method
            return worn if method.any_rate else replace(worn, rate=method.layout.rate)
    return worn


def _defaults(worn: SensorLayout, library: MotionLibrary | None, models: Mapping[str, Path]) -> list[Method]:
    """The methods where none are named, and the baselines that can run."""
    trackers = all(sensor.kind is SensorKind.TRACKER for sensor in worn.sensors)
    own: list[Method] = [name for name in models if METHODS[name].fits(worn)] or [default_method(worn, library)]
    if trackers:
        own += [_NEAREST] * (library is not None) + [WITHOUT_LIBRARY]
    return [*dict.fromkeys([*own, CONSTANT_POSE])]


def _cases(
    sequences: Sequence_ | Iterable[Sequence_],
    conditions: Conditions,
    skeleton: Path | None,
    skipped: list[str],
    tell: Progress,
) -> list[Case]:
    given = [sequences] if isinstance(sequences, Motion | Recording | Case | str | Path) else list(sequences)
    found: list[Case] = []
    for done, item in enumerate(given, 1):
        try:
            if isinstance(item, Case):
                found.append(item)
            elif isinstance(item, Motion):
                found.append(case_of_motion(item, conditions))
            elif isinstance(item, Recording):
                found.append(case_of_recording(item, conditions))
            else:
                found += read_cases([str(item)], conditions, skeleton, skipped=skipped)
        except TooShort as error:
            skipped.append(str(error))
        tell("reading motions", done, len(given))
    return found
