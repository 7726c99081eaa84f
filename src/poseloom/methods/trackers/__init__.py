"""Full-body motion from 6-DoF trackers: one loop, and several ways to predict."""

from poseloom.methods.trackers.inverse_kinematics import InverseKinematics
from poseloom.methods.trackers.neighbours import LocalRegression, NearestExample, NeighbourSettings, QuerySettings
from poseloom.methods.trackers.state import TrackerSettings, TrackerState

__all__ = [
    "InverseKinematics",
    "LocalRegression",
    "NearestExample",
    "NeighbourSettings",
    "QuerySettings",
    "TrackerSettings",
    "TrackerState",
]
