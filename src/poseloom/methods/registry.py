"""Methods by name: a table of data. `poseloom.methods.choose` makes one ready for a request."""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from poseloom.arrays import Array, Bools
from poseloom.errors import MethodError
from poseloom.library import MotionLibrary
from poseloom.methods.contract import Reconstructor
from poseloom.methods.flex.network_method import SHIPPED_MODEL, load_flex_lstm, load_flex_scales
from poseloom.methods.flex.root import on_its_feet
from poseloom.methods.imus.baselines.fitting import COMPARATORS, loader
from poseloom.methods.imus.model_file import read_phase_hmm
from poseloom.methods.prior.method import SensorPrior
from poseloom.methods.prior.model_file import read_prior, shipped_path
from poseloom.methods.trackers.inverse_kinematics import InverseKinematics
from poseloom.methods.trackers.library_methods import LocalGaussian, LocalPca, LocalPcr, LocalRegression, NearestExample
from poseloom.methods.trackers.local_filter import LocalFilter
from poseloom.methods.trackers.neighbours import NeighbourMethod
from poseloom.plugins import METHODS_GROUP, Registry
from poseloom.sensors import SensorKind, SensorLayout

Make = Callable[[SensorLayout, MotionLibrary | None, Path | None], Reconstructor[Any]]
"""Makes a method of a layout, a library and a model's file. What `needs` says is there; the rest may be None."""


class Needs(enum.StrEnum):
    """What a method is made of besides its layout."""

    NOTHING = "nothing"
    LIBRARY = "a library"
    MODEL = "a model"


@dataclass(frozen=True)
class MethodEntry:
    """A method that can be named. An entry that is incomplete is refused when it is made, at import.

    Attributes:
        summary: What it is, in half a line.
        sensors: The kind of sensors without which it cannot run.
        needs: What it is made of.
        make: Makes it.
        shipped: The model that travels with the package, used where none is named; None where none does.
        kind: Its class, where other settings than the tuned ones can be given.
        mixes: Whether it takes any mixture of sensors, `sensors` or not.
        least: With fewer sensors it is no default, for it then says too little.

    Raises:
        TypeError: for an entry that lacks something, or says one thing here and another there.
    """

    summary: str
    sensors: SensorKind
    needs: Needs
    make: Make
    shipped: Path | None = None
    kind: type[NeighbourMethod] | None = None
    mixes: bool = False
    least: int = 1

    def __post_init__(self) -> None:
        faults = {
            "no summary": not self.summary,
            "no known kind of sensors": self.sensors not in set(SensorKind),
            "no known needs": self.needs not in set(Needs),
            "nothing that makes it": not callable(self.make),
            "a shipped model that it does not need": self.shipped is not None and self.needs is not Needs.MODEL,
        }
        found = [fault for fault, there in faults.items() if there]
        if found:
            raise TypeError(f"the method {self.summary!r} has {', '.join(found)}")

    def fits(self, layout: SensorLayout) -> bool:
        """Whether a layout has the sensors that it needs, and no others that it cannot use."""
        if self.mixes:
            return True
        kinds = {sensor.kind for sensor in layout.sensors}
        usable = {SensorKind.FLEX, SensorKind.IMU} if self.sensors is SensorKind.FLEX else {self.sensors}
        return self.sensors in kinds <= usable


def _from_library(summary: str, kind: type[NeighbourMethod]) -> MethodEntry:
    def make(layout: SensorLayout, library: MotionLibrary | None, model: Path | None) -> Reconstructor[Any]:
        assert library is not None
        return kind(library, layout)

    return MethodEntry(summary, SensorKind.TRACKER, Needs.LIBRARY, make, kind=kind)


def _fitted(
    summary: str, sensors: SensorKind, load: Callable[[Path], Reconstructor[Any]], shipped: Path | None = None
) -> MethodEntry:
    def make(layout: SensorLayout, library: MotionLibrary | None, model: Path | None) -> Reconstructor[Any]:
        assert model is not None
        return on_its_feet(load(model), layout)

    return MethodEntry(summary, sensors, Needs.MODEL, make, shipped)


def _sensor_prior(layout: SensorLayout, library: MotionLibrary | None, model: Path | None) -> Reconstructor[Any]:
    # Two networks are shipped, and the method takes the one that fits; a file that is named is another.
    return SensorPrior(layout, None if model in (None, PRIOR_MODEL) else read_prior(model))


PRIOR_MODEL = shipped_path("any")
_IMU, _FLEX = SensorKind.IMU, SensorKind.FLEX

METHODS = Registry(
    METHODS_GROUP,
    "method",
    MethodEntry,
    {
        "local-filter": _from_library("the nearest moments as a Kalman filter, given the sensors", LocalFilter),
        "local-gaussian": _from_library("the nearest moments' mean and covariance, given the sensors", LocalGaussian),
        "local-regression": _from_library("the six-sensor paper's local model, mended", LocalRegression),
        "local-pcr": _from_library("local principal component regression (Liu et al. 2011)", LocalPcr),
        "local-pca": _from_library("local PCA of the neighbours' poses (Chai and Hodgins 2005)", LocalPca),
        "nearest-example": _from_library("the nearest moment's pose, bent to the sensors", NearestExample),
        "inverse-kinematics": MethodEntry(
            "the previous pose, bent to the sensors; no library",
            SensorKind.TRACKER,
            Needs.NOTHING,
            lambda layout, library, model: InverseKinematics(layout),
        ),
        "phase-hmm": _fitted("one to three IMUs: a two-level HMM over signal windows", _IMU, read_phase_hmm),
        "phase-hmm-paper": _fitted("the single-IMU paper's model: one sample a state", _IMU, read_phase_hmm),
        **{name: _fitted(each.summary, _IMU, loader(name)) for name, each in COMPARATORS.items()},
        "flex-scales": _fitted(
            "four flex sensors: filters over many time scales and an LSTM", _FLEX, load_flex_scales, SHIPPED_MODEL
        ),
        "flex-lstm": _fitted("four flex sensors: the flex paper's calibrating Bi-LSTM", _FLEX, load_flex_lstm),
        "sensor-prior": MethodEntry(
            "any sensors, people never seen: a learnt prior, joined with what sensors say",
            _IMU,
            Needs.MODEL,
            _sensor_prior,
            PRIOR_MODEL,
            mixes=True,
            least=3,
        ),
    },
    MethodError,
)
"""Every method, the recommended one first; other packages add theirs through `poseloom.methods`."""

DEFAULT_METHOD = next(iter(METHODS))
"""The recommended method."""


def needs_library(name: str) -> bool:
    """Whether a method asks a motion library. Raises MethodError for an unknown name."""
    return entry_of(name).needs is Needs.LIBRARY


def needs_model(name: str) -> bool:
    """Whether a method runs a fitted model. Raises MethodError for an unknown name."""
    return entry_of(name).needs is Needs.MODEL


def make_method(
    name: str,
    layout: SensorLayout,
    library: MotionLibrary | None = None,
    allowed: Bools[Array, "poses"] | None = None,
    model: str | Path | None = None,
) -> Reconstructor[Any]:
    """A method by name, with its tuned settings; `poseloom.methods.choose` also opens libraries and finds the rate.

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
    entry = entry_of(name)
    file = entry.shipped if model is None else Path(model)
    if entry.needs is Needs.MODEL and file is None:
        raise MethodError(
            f"the method {name!r} needs a fitted model",
            remedy=f"Fit one with `poseloom fit {name}` and name it with --model",
        )
    if entry.needs is Needs.LIBRARY:
        if library is None:
            raise MethodError(
                f"the method {name!r} needs a motion library",
                remedy="Build one with `poseloom library build` and name it with --library, or use inverse-kinematics",
            )
        library = library if allowed is None else library.restricted(allowed)
    return entry.make(layout, library, file)


def entry_of(name: str) -> MethodEntry:
    """The entry of a name. Raises MethodError for an unknown one, with the nearest name, and for a broken plug-in."""
    return METHODS.row(name)
