"""Methods that turn samples into poses, and the contract that they keep."""

from poseloom.methods.contract import (
    Frame,
    Health,
    HealthState,
    Reconstruction,
    Reconstructor,
    reconstruct,
)
from poseloom.methods.registry import DEFAULT_METHOD, METHODS, make_method, needs_library, needs_model
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
    "Frame",
    "Health",
    "HealthState",
    "InverseKinematics",
    "LocalFilter",
    "LocalGaussian",
    "LocalPca",
    "LocalPcr",
    "LocalRegression",
    "NearestExample",
    "NeighbourMethod",
    "NeighbourSettings",
    "Query",
    "Reconstruction",
    "Reconstructor",
    "TrackerSettings",
    "make_method",
    "needs_library",
    "needs_model",
    "reconstruct",
]
