"""Methods that turn samples into poses, and the contract that they keep."""

from poseloom.methods.choose import Chosen, choose
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.methods.reconstruction import Reconstruction, reconstruct
from poseloom.methods.registry import DEFAULT_METHOD, METHODS, MethodEntry, make_method, needs_library, needs_model
from poseloom.methods.trackers import (
    InverseKinematics,
    LocalFilter,
    LocalGaussian,
    LocalPca,
    LocalPcr,
    LocalRegression,
    NearestExample,
    NeighbourMethod,
    NeighbourSettings,
    Query,
    TrackerSettings,
)

__all__ = [
    "DEFAULT_METHOD",
    "METHODS",
    "Chosen",
    "Frame",
    "Health",
    "HealthState",
    "InverseKinematics",
    "LocalFilter",
    "LocalGaussian",
    "LocalPca",
    "LocalPcr",
    "LocalRegression",
    "MethodEntry",
    "NearestExample",
    "NeighbourMethod",
    "NeighbourSettings",
    "Query",
    "Reconstruction",
    "Reconstructor",
    "TrackerSettings",
    "choose",
    "make_method",
    "needs_library",
    "needs_model",
    "reconstruct",
]
