"""What an evaluation is to run, and its sequences made ready: at the rate that the methods need, known to the split."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from poseloom.errors import MethodError
from poseloom.evaluation.cases import Case, Conditions
from poseloom.evaluation.constant_pose import CONSTANT_POSE
from poseloom.evaluation.sensed import case_at_rate, layout_of
from poseloom.evaluation.splits import Split, findable
from poseloom.library import MotionLibrary
from poseloom.methods.choose import Library, Method, choose, method_name
from poseloom.methods.reconstruction import rate_note
from poseloom.methods.registry import entry_of, needs_library, needs_model
from poseloom.sensors import SensorLayout
from poseloom.sensors.rate import same_rate


@dataclass(frozen=True)
class Experiment:
    """What to run.

    Attributes:
        methods: Methods, or names of methods; `constant-pose` is one here.
        library: The motion library or its folder; None where no method needs one.
        models: Files of fitted models, by name of the method.
        split: What of the library a method may not see.
        conditions: The sensors.
        workers: Number of processes.
    """

    methods: tuple[Method, ...]
    library: Library | None = None
    split: Split = Split.BY_SEQUENCE
    conditions: Conditions = field(default_factory=Conditions)
    workers: int = 1
    models: Mapping[str, Path] = field(default_factory=dict[str, Path])

    @property
    def names(self) -> tuple[str, ...]:
        """What the methods are called, each name once."""
        names: list[str] = []
        for method in self.methods:
            name, number = method_name(method), 2
            while name in names:
                name, number = f"{method_name(method)} {number}", number + 1
            names.append(name)
        return tuple(names)


def named_methods(experiment: Experiment) -> list[str]:
    """The methods that are given by name, but for the constant pose."""
    return [method for method in experiment.methods if isinstance(method, str) and method != CONSTANT_POSE]


def at_one_rate(
    cases: Sequence[Case], experiment: Experiment, library: MotionLibrary | None
) -> tuple[Sequence[Case], tuple[str, ...]]:
    """The cases at the rate that the methods need, and what people are told of it. Refuses what does not fit."""
    at_rate: list[Case] = []
    notes: dict[str, None] = {}
    for case in cases:
        own = layout_of(case, experiment.conditions)
        needed = _needed_rates(own, experiment, library)
        if len(needed) > 1:
            told = " and ".join(f"{rate:g} Hz ({name})" for rate, name in sorted(needed.items()))
            raise MethodError(
                f"the methods need different rates: {told}", remedy="Evaluate them in one call for each rate"
            )
        rate = next(iter(needed), case.truth.rate)
        if case.recording is not None and not same_rate(own.rate, rate):
            notes[rate_note(own.rate, rate)] = None
        at_rate.append(case_at_rate(case, rate))
    fitted = [method for method in named_methods(experiment) if needs_model(method)]
    if fitted:
        notes[
            f"the split leaves nothing out of what {', '.join(fitted)} {'was' if len(fitted) == 1 else 'were'} fitted "
            "to: the figures count where the fit did without these sequences"
        ] = None
    return at_rate, tuple(notes)


def _needed_rates(own: SensorLayout, experiment: Experiment, library: MotionLibrary | None) -> dict[float, str]:
    """The rates that methods need for a layout, each with one of these methods."""
    needed: dict[float, str] = {}
    for method in experiment.methods:
        if method == CONSTANT_POSE:
            continue
        name = method if isinstance(method, str) else None
        if name is not None and library is not None and needs_library(name) and entry_of(name).fits(own):
            needed.setdefault(library.rate, name)  # known without an index of its poses
            continue
        model = None if name is None else experiment.models.get(name)
        chosen = choose(own, method, library=library, model=model)
        if not chosen.method.any_rate:
            needed.setdefault(chosen.method.layout.rate, chosen.name)
    return needed


def unknown_people(cases: Sequence[Case], experiment: Experiment, library: MotionLibrary | None) -> tuple[str, ...]:
    """Words about people whose takes are to be left out, and who are not in the library: nothing is left out then."""
    if library is None or experiment.split is not Split.BY_SUBJECT:
        return ()
    people = {clip.subject for clip in library.clips}
    return tuple(
        f"the library has no clip of a person called {who!r}"
        for who in dict.fromkeys(case.subject for case in cases)
        if who and who not in people
    )


def findable_cases(
    cases: Sequence[Case], experiment: Experiment, library: MotionLibrary | None
) -> tuple[Sequence[Case], tuple[str, ...]]:
    """The cases of which it can be told whether the library holds them, and the names of the others."""
    if library is None or experiment.split is Split.NONE:
        return cases, ()
    kept = [case for case in cases if findable(case, library)]
    if not kept:
        return cases, ()  # the split will say what is wrong
    return kept, tuple(
        f"{case.name!r} is too short to tell whether the library holds it" for case in cases if case not in kept
    )
