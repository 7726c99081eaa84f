"""Finding the pose that agrees with a prior and with the sensors."""

from poseloom.solve.pose_solver import Solution, SolverSettings, solve_pose
from poseloom.solve.terms import GaussianPrior, SensorMount, SensorReadings, mount, readings

__all__ = [
    "GaussianPrior",
    "SensorMount",
    "SensorReadings",
    "Solution",
    "SolverSettings",
    "mount",
    "readings",
    "solve_pose",
]
