"""Methods by name, for the command line, the evaluation and the live path."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from poseloom.arrays import Array, Bools
from poseloom.errors import MethodError, unknown_name
from poseloom.library import MotionLibrary
from poseloom.methods.contract import Reconstructor
from poseloom.methods.flex.network_method import SHIPPED_MODEL, load_flex_lstm, load_flex_scales
from poseloom.methods.flex.root import on_its_feet
from poseloom.methods.imus.baselines.fitting import COMPARATORS, loader
from poseloom.methods.imus.model_file import read_phase_hmm
from poseloom.methods.trackers.inverse_kinematics import InverseKinematics
from poseloom.methods.trackers.library_methods import LocalGaussian, LocalPca, LocalPcr, LocalRegression, NearestExample
from poseloom.methods.trackers.local_filter import LocalFilter
from poseloom.methods.trackers.neighbours import NeighbourMethod
from poseloom.sensors import SensorLayout


@dataclass(frozen=True)
class MethodEntry:
    """A method that can be named.

    Attributes:
        summary: What it is, in half a line.
        kind: Its class, for methods that ask a library; None for those that need none.
        load: Reads its fitted model from a file, for methods that are fitted first; None for the others.
        shipped: The model that travels with the package, used where none is named; None where none does.
    """

    summary: str
    kind: type[NeighbourMethod] | None = None
    load: Callable[[Path], Reconstructor[Any]] | None = None
    shipped: Path | None = None


METHODS: Mapping[str, MethodEntry] = MappingProxyType(
    {
        "local-filter": MethodEntry("the nearest moments as a Kalman filter, given the sensors", LocalFilter),
        "local-gaussian": MethodEntry("the nearest moments' mean and covariance, given the sensors", LocalGaussian),
        "local-regression": MethodEntry("the six-sensor paper's local model, mended", LocalRegression),
        "local-pcr": MethodEntry("local principal component regression (Liu et al. 2011)", LocalPcr),
        "local-pca": MethodEntry("local PCA of the neighbours' poses (Chai and Hodgins 2005)", LocalPca),
        "nearest-example": MethodEntry("the nearest moment's pose, bent to the sensors", NearestExample),
        "inverse-kinematics": MethodEntry("the previous pose, bent to the sensors; no library"),
        "phase-hmm": MethodEntry("one to three IMUs: a two-level HMM over signal windows", load=read_phase_hmm),
        "phase-hmm-paper": MethodEntry("the single-IMU paper's model: one sample a state", load=read_phase_hmm),
        **{name: MethodEntry(each.summary, load=loader(name)) for name, each in COMPARATORS.items()},
        "flex-scales": MethodEntry(
            "four flex sensors: filters over many time scales and an LSTM", load=load_flex_scales, shipped=SHIPPED_MODEL
        ),
        "flex-lstm": MethodEntry("four flex sensors: the flex paper's calibrating Bi-LSTM", load=load_flex_lstm),
    }
)
"""Every method, the recommended one first."""

DEFAULT_METHOD = next(iter(METHODS))
"""The recommended method."""


def needs_library(name: str) -> bool:
    """Whether a method asks a motion library. Raises MethodError for an unknown name."""
    return _entry(name).kind is not None


def needs_model(name: str) -> bool:
    """Whether a method runs a fitted model. Raises MethodError for an unknown name."""
    return _entry(name).load is not None


def make_method(
    name: str,
    layout: SensorLayout,
    library: MotionLibrary | None = None,
    allowed: Bools[Array, "poses"] | None = None,
    model: Path | None = None,
) -> Reconstructor[Any]:
    """A method by name, with its tuned settings.

    Args:
        name: One of `METHODS`.
        layout: The sensors.
        library: The motion library, for methods that ask one.
        allowed: Mask over the library's poses: False for those that must not be used.
        model: File of the fitted model, for methods that are fitted first; the shipped one if left out and there is
            one. It says its layout itself.

    Raises:
        MethodError: for an unknown name, or a library or model that is missing.
        FormatError: for a file that holds no such model.
    """
    entry = _entry(name)
    if entry.load is not None:
        model = entry.shipped if model is None else model
        if model is None:
            raise MethodError(
                f"the method {name!r} needs a fitted model",
                remedy=f"Fit one with `poseloom fit {name}` and name it with --model",
            )
        return on_its_feet(entry.load(model), layout)
    kind = entry.kind
    if kind is None:
        return InverseKinematics(layout)
    if library is None:
        raise MethodError(
            f"the method {name!r} needs a motion library",
            remedy="Build one with `poseloom library build` and name it with --library, or use inverse-kinematics",
        )
    return kind(library, layout, allowed=allowed)


def _entry(name: str) -> MethodEntry:
    if name not in METHODS:
        raise unknown_name("method", name, METHODS, MethodError)
    return METHODS[name]
