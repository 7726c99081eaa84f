"""The comparators by name: fitted to pairs, written and read."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from poseloom.errors import MethodError, unknown_name
from poseloom.formats._files import reading
from poseloom.formats.artefact_arrays import plain_settings
from poseloom.methods.imus.baselines.driving import SignalComparator, WindowSettings, read_examples
from poseloom.methods.imus.baselines.energy import EnergySettings, SparseAccelerometers
from poseloom.methods.imus.baselines.examples import Examples, examples_of
from poseloom.methods.imus.baselines.motion_graph import GraphSettings, MotionGraph
from poseloom.methods.imus.baselines.motion_primitives import MotionPrimitives, PrimitiveSettings
from poseloom.methods.imus.baselines.nearest_window import NearestWindow, NearestWindowSettings
from poseloom.methods.imus.baselines.phase_regression import PhaseRegression, RegressionSettings
from poseloom.methods.imus.pairs import SignalPair
from poseloom.sensors import SensorLayout


class Comparator(NamedTuple):
    """A comparator's class and its tuned settings."""

    kind: type[SignalComparator[Any]]
    settings: WindowSettings
    summary: str


COMPARATORS: Mapping[str, Comparator] = MappingProxyType(
    {
        "nearest-window": Comparator(NearestWindow, NearestWindowSettings(), "the nearest signal windows' mean pose"),
        "phase-regression": Comparator(
            PhaseRegression, RegressionSettings(), "Eom et al. 2014: phases, and a regression in each"
        ),
        "sparse-accelerometers": Comparator(
            SparseAccelerometers, EnergySettings(), "Riaz et al. 2015: neighbours, and the least energy among them"
        ),
        "motion-primitives": Comparator(
            MotionPrimitives, PrimitiveSettings(), "Min and Chai 2012: primitives and their coefficients"
        ),
        "motion-graph": Comparator(MotionGraph, GraphSettings(), "Kovar et al. 2002: clips and blended transitions"),
    }
)
"""All comparators, with the settings that the validation sequences chose: `poseloom benchmark one-imu --part sweep`."""


def fit_comparator(
    name: str, pairs: Sequence[SignalPair], layout: SensorLayout, changes: Mapping[str, Any] | None = None
) -> SignalComparator[Any]:
    """Fits a comparator to pairs of motion and signal, ready to run.

    Args:
        name: One of `COMPARATORS`.
        pairs: Of the layout, at its rate.
        layout: One to three IMUs.
        changes: Settings that differ from the tuned ones.

    Raises:
        MethodError: for an unknown name or setting, no pairs, or pairs that do not fit the layout.
    """
    return comparator_of(name, examples_of(pairs, layout), changes)


def comparator_of(name: str, examples: Examples, changes: Mapping[str, Any] | None = None) -> SignalComparator[Any]:
    """The same of examples that are made already."""
    comparator = _named(name)
    return comparator.kind(examples, _changed(comparator.settings, changes or {}))


def load_comparator(name: str, path: str | Path) -> SignalComparator[Any]:
    """Reads a comparator that `save_comparator` has written.

    Raises:
        MethodError: for an unknown name.
        FormatError: where the file holds no such comparator.
    """
    comparator = _named(name)
    examples, settings = read_examples(path, name)
    with reading(path, f"a {name}"):
        return comparator.kind(examples, plain_settings(comparator.settings, settings, _RANGES))


_COUNTS = ("neighbours", "components", "branches", "beam", "averaged", "latent", "phases", "examples", "mixture")
_RANGES = {
    "samples": (1.0, 1e3),
    "canonical": (2.0, 1e3),
    "coefficients": (1.0, 1e3),
    **dict.fromkeys(_COUNTS, (1.0, 1e4)),
    **dict.fromkeys(("floor", "dulling", "ridge", "width"), (1e-9, 1e6)),
}
"""Settings in a file that are not from 0 to a million."""


def loader(name: str) -> Any:
    """`load_comparator` of one name, for the registry of methods."""
    return partial(load_comparator, name)


def _named(name: str) -> Comparator:
    if name not in COMPARATORS:
        raise unknown_name("comparator", name, COMPARATORS, MethodError)
    return COMPARATORS[name]


def _changed(settings: WindowSettings, changes: Mapping[str, Any]) -> WindowSettings:
    unknown = sorted(set(changes) - set(vars(settings)))
    if unknown:
        raise unknown_name("setting", unknown[0], list(vars(settings)), MethodError)
    return replace(settings, **changes)
