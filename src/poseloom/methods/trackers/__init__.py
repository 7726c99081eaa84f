"""Full-body motion from 6-DoF trackers: one loop, and several ways to predict."""

from poseloom.methods.trackers.inverse_kinematics import InverseKinematics
from poseloom.methods.trackers.library_methods import LocalGaussian, LocalPca, LocalPcr, LocalRegression, NearestExample
from poseloom.methods.trackers.local_filter import LocalFilter
from poseloom.methods.trackers.loop import TrackerState
from poseloom.methods.trackers.neighbours import NeighbourMethod, NeighbourSettings, Query
from poseloom.methods.trackers.state import GateSettings, TrackerSettings

__all__ = [
    "GateSettings",
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
    "TrackerSettings",
    "TrackerState",
]
