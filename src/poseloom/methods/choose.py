"""The one place that turns a request of names and objects into a ready method.

`poseloom reconstruct`, `live`, `view`, `evaluate` and reprocessing all ask here which method runs, on which library or
model, with which sensors and at which rate.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from poseloom.arrays import Array, Bools
from poseloom.errors import MethodError
from poseloom.formats.artefact import artefact_kind
from poseloom.library import MotionLibrary, open_library
from poseloom.methods.contract import Reconstructor
from poseloom.methods.registry import DEFAULT_METHOD, METHODS, Needs, entry_of, make_method
from poseloom.sensors import SensorKind, SensorLayout

WITHOUT_LIBRARY = "inverse-kinematics"
"""The method for trackers where there is no library."""

Method = Reconstructor[Any] | str
"""A method, or the name of one."""
Library = MotionLibrary | str | Path
"""A motion library, or its folder."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """A method that is ready to run.

    Attributes:
        name: What it is called.
        method: The method; its `layout` has the sensors, and the rate at which it runs.
        library: The library that it asks, opened; None for others.
        model: The file of the model that it runs; None for others.
    """

    name: str
    method: Reconstructor[Any]
    library: MotionLibrary | None = None
    model: Path | None = None


def choose(
    layout: SensorLayout,
    method: Method | None = None,
    *,
    library: Library | None = None,
    model: str | Path | None = None,
    allowed: Bools[Array, "poses"] | None = None,
) -> Chosen:
    """The method for a layout, ready to run.

    Args:
        layout: The sensors and their rate. A method that asks a library runs at the library's rate, one that runs a
            model at the model's; any other at the layout's.
        method: A method, which is taken as it is; or a name; None: see `default_method`.
        library: A library or its folder, opened only if the method asks one.
        model: File of a fitted model; None: the one that travels with the package, for methods that have one.
        allowed: Mask over the library's poses, False for those that must not be used.

    Raises:
        MethodError: for an unknown name, a method for other sensors, or a library or model that is missing.
        LibraryError, FormatError: for a library or model that cannot be read.
    """
    if method is None:
        method = default_method(layout, library, model)
    if not isinstance(method, str):
        _check_sensors(method_name(method), method, layout)
        return Chosen(method_name(method), method)
    entry = entry_of(method)
    if not entry.fits(layout):
        kinds = " and ".join(sorted({sensor.kind.value for sensor in layout.sensors}))
        raise MethodError(
            f"the method {method!r} is for {entry.sensors.value} sensors, "
            f"and the layout {layout.name!r} is not of these alone",
            cause=f"its sensors are of the kind {kinds}",
            remedy=f"Choose one of {', '.join(fitting_methods(layout)) or 'the layouts that a method is for'}",
        )
    opened = None
    if entry.needs is Needs.LIBRARY and library is not None:
        opened = library if isinstance(library, MotionLibrary) else open_library(library)
        layout = replace(layout, rate=opened.rate)
    file = Path(model) if model is not None else entry.shipped
    made = make_method(method, layout, opened, allowed, file)
    _check_sensors(method, made, layout)
    return Chosen(method, made, opened, file if entry.needs is Needs.MODEL else None)


def default_method(layout: SensorLayout, library: Library | None = None, model: str | Path | None = None) -> str:
    """The name of the method where none is named.

    The one that a model's file is for, if there is such a file. Else for trackers the recommended one if there is a
    library, and inverse kinematics without; for other sensors the first one that needs nothing but what is shipped.

    Raises:
        MethodError: where nothing fits without being told.
        FormatError: for a file that holds no model.
    """
    if model is not None:
        return model_method(Path(model))
    if all(sensor.kind is SensorKind.TRACKER for sensor in layout.sensors):
        return WITHOUT_LIBRARY if library is None else DEFAULT_METHOD
    for name in fitting_methods(layout):
        if METHODS[name].shipped is not None and len(layout.sensors) >= METHODS[name].least:
            return name
    raise MethodError(
        f"no method was given for the layout {layout.name!r}, and none runs without a fitted model",
        remedy=f"Give --model, from `poseloom fit`, for one of {', '.join(fitting_methods(layout)) or 'the methods'}",
    )


def fitting_methods(layout: SensorLayout) -> tuple[str, ...]:
    """Names of the methods for these sensors, the recommended one first."""
    return tuple(name for name, entry in METHODS.items() if entry.fits(layout))


def ready_methods(layout: SensorLayout, library: Library | None = None) -> tuple[str, ...]:
    """Names of the methods for these sensors that need nothing more than this library, or what is shipped."""
    return tuple(
        name
        for name in fitting_methods(layout)
        if METHODS[name].needs is Needs.NOTHING
        or METHODS[name].shipped is not None
        or (METHODS[name].needs is Needs.LIBRARY and library is not None)
    )


def maker(
    layout: SensorLayout, library: Library | None = None, model: str | Path | None = None
) -> Callable[[str], Reconstructor[Any]]:
    """A function that makes methods by name for one session, each once, all at one rate.

    With a library for trackers all methods run at the library's rate, those that do not ask it, too.
    """
    if library is not None and not isinstance(library, MotionLibrary):
        library = open_library(library)
    if library is not None and all(sensor.kind is SensorKind.TRACKER for sensor in layout.sensors):
        layout = replace(layout, rate=library.rate)
    made: dict[str, Reconstructor[Any]] = {}

    def make(name: str) -> Reconstructor[Any]:
        if name not in made:
            made[name] = choose(layout, name, library=library, model=_model_for(name, model)).method
        return made[name]

    return make


def method_name(method: Method) -> str:
    """What a method is called: its name, or its class's."""
    return method if isinstance(method, str) else type(method).__name__


def _model_for(name: str, model: str | Path | None) -> str | Path | None:
    """The model's file if it is this method's; a session may go on with a method that travels with its own."""
    if model is None or METHODS[name].shipped is None or model_method(Path(model)) == name:
        return model
    return None


def model_method(file: Path) -> str:
    """The name of the method that a fitted model's file is for. Raises FormatError, MethodError for other files."""
    kind, header = artefact_kind(file)
    name = str(header.get("method", kind))
    if name not in METHODS or METHODS[name].needs is not Needs.MODEL:
        raise MethodError(
            f"this file holds a {kind}, which no method runs", remedy="Name a model from `poseloom fit`", file=file
        )
    return name


def _check_sensors(name: str, method: Reconstructor[Any], layout: SensorLayout) -> None:
    if method.layout.names != layout.names:
        raise MethodError(
            f"the method {name!r} listens to {', '.join(method.layout.names)}",
            cause=f"the layout {layout.name!r} has {', '.join(layout.names)}",
            remedy="Choose a layout or a model that fits",
        )
