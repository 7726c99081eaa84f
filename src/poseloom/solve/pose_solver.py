"""The pose that agrees best with a prior and with the sensors."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import _kernels
from poseloom.solve.terms import GaussianPrior, SensorMount, SensorReadings


@dataclass(frozen=True)
class SolverSettings:
    """How hard to try.

    Attributes:
        iterations: Most Gauss-Newton steps.
        tolerance: Largest change of an entry, in radians or metres, at which to stop.
        robust_scale: The number of sigmas at which the Lorentzian begins to disbelieve a reading; 1 is the six-sensor
            paper's (eq. 10), infinity is least squares.
    """

    iterations: int = 5
    tolerance: float = 1e-4
    robust_scale: float = 4.0


class Solution(NamedTuple):
    """A solved pose.

    Attributes:
        q: Pose vector.
        spread: Posterior standard deviation of each entry.
        residuals: Measured minus predicted in the world frame, per sensor: metres, and radians as a rotation vector.
        weights: How far each reading was believed, 0 to 1; 0 where it is missing.
        cost: The minimised energy.
        iterations: Steps taken.
        converged: Whether the last step was below the tolerance.
    """

    q: Floats[Array, "dofs"]
    spread: Floats[Array, "dofs"]
    residuals: Floats[Array, "sensors 2 3"]
    weights: Floats[Array, "sensors 2"]
    cost: float
    iterations: int
    converged: bool


def solve_pose(
    skeleton: Skeleton,
    sensors: SensorMount,
    measured: SensorReadings,
    prior: GaussianPrior,
    start: Floats[Array, "dofs"] | None = None,
    settings: SolverSettings | None = None,
) -> Solution:
    """Minimises 1/2 (q - m)' C^-1 (q - m) + sum of k^2 log(1 + e^2 / (2 k^2 sigma^2)) by Levenberg-Marquardt.

    Source: eq. 2, 9, 10 and 12 of the six-sensor paper, with 2 sigma^2 in both terms, position and orientation each
    with a sigma of its own, and a full prior covariance where the paper has a diagonal one. Any reading may be missing.

    Args:
        skeleton: The wearer's.
        sensors: Their places on it.
        measured: What they say.
        prior: Mean and covariance of the pose vector.
        start: Where to begin; the prior's mean unless given. It needs a covariance of full rank.
        settings: How hard to try.
    """
    how = settings or SolverSettings()
    q = np.array(prior.mean if start is None else start)
    dual = np.zeros_like(q) if start is None else np.linalg.solve(prior.covariance, start - prior.mean)
    count = len(sensors.bones)
    spread, result = np.empty_like(q), np.empty(3)
    residuals, weights = np.zeros((count, 2, 3)), np.zeros((count, 2))
    _kernels.solve_pose_kernel(
        skeleton.parents, skeleton.offsets,
        sensors.bones, sensors.p_bone_sensor, sensors.R_bone_sensor,
        measured.positions, measured.rotations, measured.sigmas, how.robust_scale,
        prior.mean, prior.covariance, q, dual, how.iterations, how.tolerance,
        spread, residuals, weights, result,
    )  # fmt: skip
    return Solution(q, spread, residuals, weights, float(result[0]), int(result[1]), bool(result[2]))
