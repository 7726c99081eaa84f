"""Methods by name, for the command line, the evaluation and the live path."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from poseloom.arrays import Array, Bools
from poseloom.errors import MethodError, unknown_name
from poseloom.library import MotionLibrary
from poseloom.methods.contract import Reconstructor
from poseloom.methods.trackers.inverse_kinematics import InverseKinematics
from poseloom.methods.trackers.local_models import (
    JointSubspace,
    LocalModel,
    LocalPca,
    LocalPcr,
    LocalRidge,
    NearestPose,
)
from poseloom.methods.trackers.neighbours import LocalRegression
from poseloom.sensors import SensorLayout


@dataclass(frozen=True)
class MethodEntry:
    """A method that can be named.

    Attributes:
        summary: What it is, in half a line.
        model: The local model of the neighbours, for methods that ask a library; None for those that need none.
    """

    summary: str
    model: Callable[[], LocalModel] | None


METHODS: Mapping[str, MethodEntry] = MappingProxyType(
    {
        "local-regression": MethodEntry("ridge regression of the nearest moments, full covariance", LocalRidge),
        "joint-subspace": MethodEntry("the six-sensor paper's local model, mended", JointSubspace),
        "local-pcr": MethodEntry("local principal component regression (Liu et al. 2011)", LocalPcr),
        "local-pca": MethodEntry("local PCA of the neighbours' poses (Chai and Hodgins 2005)", LocalPca),
        "nearest-example": MethodEntry("the nearest moment's pose, bent to the sensors", NearestPose),
        "inverse-kinematics": MethodEntry("the previous pose, bent to the sensors; no library", None),
    }
)
"""Every method, the recommended one first."""


def needs_library(name: str) -> bool:
    """Whether a method asks a motion library. Raises MethodError for an unknown name."""
    return _entry(name).model is not None


def make_method(
    name: str, layout: SensorLayout, library: MotionLibrary | None = None, allowed: Bools[Array, "poses"] | None = None
) -> Reconstructor[Any]:
    """A method by name, with its tuned settings.

    Args:
        name: One of `METHODS`.
        layout: The sensors.
        library: The motion library, for methods that ask one.
        allowed: Mask over the library's poses: False for those that must not be used.

    Raises:
        MethodError: for an unknown name, or a library that is missing.
    """
    model = _entry(name).model
    if model is None:
        return InverseKinematics(layout)
    if library is None:
        raise MethodError(
            f"the method {name!r} needs a motion library",
            remedy="Build one with `poseloom library build` and name it with --library, or use inverse-kinematics",
        )
    return LocalRegression(library, layout, model(), allowed=allowed)


def _entry(name: str) -> MethodEntry:
    if name not in METHODS:
        raise unknown_name("method", name, METHODS, MethodError)
    return METHODS[name]
