"""Methods that turn samples into poses, and the contract that they keep."""

from poseloom.methods.contract import (
    Frame,
    Health,
    HealthState,
    Reconstruction,
    Reconstructor,
    reconstruct,
)
from poseloom.methods.registry import METHODS, make_method, needs_library
from poseloom.methods.trackers import (
    InverseKinematics,
    LocalRegression,
    NearestExample,
    NeighbourSettings,
    QuerySettings,
    TrackerSettings,
)

__all__ = [
    "METHODS",
    "Frame",
    "Health",
    "HealthState",
    "InverseKinematics",
    "LocalRegression",
    "NearestExample",
    "NeighbourSettings",
    "QuerySettings",
    "Reconstruction",
    "Reconstructor",
    "TrackerSettings",
    "make_method",
    "needs_library",
    "reconstruct",
]
