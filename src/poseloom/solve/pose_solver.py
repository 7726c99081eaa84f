"""The pose that agrees best with a prior and with the sensors."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import _kernels
from poseloom.solve.terms import GaussianPrior, SensorMount, SensorReadings

_DAMPINGS = 8
"""Dampings that are tried before a step is given up."""


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
        covariance: Posterior covariance, at the last linearisation.
        residuals: Measured minus predicted in the world frame, per sensor: metres, and radians as a rotation vector.
        weights: How far each reading was believed, 0 to 1; 0 where it is missing.
        cost: The minimised energy.
        iterations: Steps taken.
        converged: Whether the last step was below the tolerance.
    """

    q: Floats[Array, "dofs"]
    covariance: Floats[Array, "dofs dofs"]
    residuals: Floats[Array, "sensors 2 3"]
    weights: Floats[Array, "sensors 2"]
    cost: float
    iterations: int
    converged: bool

    @property
    def spread(self) -> Floats[Array, "dofs"]:
        """Posterior standard deviation of each entry."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


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
    work = _Work(skeleton, sensors, measured, prior, how.robust_scale)
    here = work.at(
        np.array(prior.mean if start is None else start),
        np.zeros(len(prior.mean)) if start is None else np.linalg.solve(prior.covariance, start - prior.mean),
    )
    damping, used, converged = 0.0, 0, False
    while used < how.iterations and not converged:
        used += 1
        step = work.linearised(here, used == 1)
        found = None
        for _ in range(_DAMPINGS):
            found = work.stepped(here, step, damping)
            if found is not None and (used == 1 or found.cost <= here.cost + 1e-12 * abs(here.cost)):
                break
            found = None
            damping = 0.1 if damping == 0.0 else 10.0 * damping
        if found is None:
            # No descent along any damped step: the pose is as low as floating point goes.
            break
        saved, moved = here.cost - found.cost, float(np.abs(found.q - here.q).max())
        here, damping = found, 0.0 if damping <= 0.1 else 0.1 * damping
        converged = moved < how.tolerance or (used > 1 and saved < 1e-10 * (1.0 + abs(here.cost)))
    return Solution(here.q, work.posterior(here), here.residuals, here.weights, here.cost, used, converged)


class _Point(NamedTuple):
    """A pose, and what it makes of the readings."""

    q: Floats[Array, "dofs"]
    dual: Floats[Array, "dofs"]  # C^-1 (q - mean), carried along so that C is never inverted
    cost: float
    positions: Floats[Array, "joints 3"]
    rotations: Floats[Array, "joints 3 3"]
    points: Floats[Array, "sensors 3"]
    residuals: Floats[Array, "sensors 2 3"]
    present: Bools[Array, "sensors 2"]
    weights: Floats[Array, "sensors 2"]


class _Step(NamedTuple):
    """The problem, linear about a pose: one row a number that a sensor says."""

    jacobian: Floats[Array, "rows dofs"]
    spreading: Floats[Array, "rows dofs"]  # J C
    gram: Floats[Array, "rows rows"]  # J C J'
    pull: Floats[Array, "rows"]  # J (q - mean)
    innovation: Floats[Array, "rows"]
    noise: Floats[Array, "rows"]


class _Work(NamedTuple):
    """One problem: what its parts need again and again."""

    skeleton: Skeleton
    sensors: SensorMount
    measured: SensorReadings
    prior: GaussianPrior
    robust_scale: float

    def at(self, q: Floats[Array, "dofs"], dual: Floats[Array, "dofs"]) -> _Point:
        joints, count = len(self.skeleton), len(self.sensors.bones)
        positions, rotations, points = np.empty((joints, 3)), np.empty((joints, 3, 3)), np.empty((count, 3))
        residuals, weights = np.zeros((count, 2, 3)), np.empty((count, 2))
        present = np.empty((count, 2), dtype=np.bool_)
        readings = _kernels.measure(
            self.skeleton.parents, self.skeleton.offsets,
            self.sensors.bones, self.sensors.p_bone_sensor, self.sensors.R_bone_sensor,
            self.measured.positions, self.measured.rotations, self.measured.sigmas, self.robust_scale,
            q, positions, rotations, points, residuals, present, weights,
        )  # fmt: skip
        cost = readings + 0.5 * float((q - self.prior.mean) @ dual)
        return _Point(q, dual, cost, positions, rotations, points, residuals, present, weights)

    def linearised(self, here: _Point, first: bool) -> _Step:
        count, size = len(self.sensors.bones), len(here.q)
        jacobian, rows_work = np.empty((6 * count, size)), np.empty((2, 6 * count))
        rows = _kernels.linearise(
            self.skeleton.parents, self.sensors.bones, here.q, here.positions, here.rotations, here.points,
            here.residuals, here.present, here.weights, self.measured.sigmas,
            np.empty((len(self.skeleton), 3, 3)), np.empty((3, size)), np.empty((3, size)),
            jacobian, rows_work[0], rows_work[1],
        )  # fmt: skip
        jacobian, innovation, noise = jacobian[:rows], rows_work[0, :rows], rows_work[1, :rows]
        spreading = jacobian @ self.prior.covariance
        gram = spreading @ jacobian.T
        # Before the first step a residual shows the prior's error as well as the sensor's. Judged by the sensor's sigma
        # alone, a good reading of a fast movement would look like an outlier, and the solver could settle on disbelief.
        if first and np.isfinite(self.robust_scale):
            own = self.measured.sigmas[here.present] ** 2
            expected = own + gram.diagonal().reshape(-1, 3).mean(axis=1)
            squares = (innovation.reshape(-1, 3) ** 2).sum(axis=1)
            noise = np.repeat(own * (1.0 + 0.5 * squares / (expected * self.robust_scale**2)), 3)
        return _Step(jacobian, spreading, gram, jacobian @ (here.q - self.prior.mean), innovation, noise)

    def stepped(self, here: _Point, step: _Step, damping: float) -> _Point | None:
        rows = len(step.noise)
        factor, multipliers = np.empty((rows, rows)), np.empty(rows)
        if not _kernels.propose(rows, damping, step.gram, step.noise, step.innovation, step.pull, factor, multipliers):
            return None
        scale = 1.0 / (1.0 + damping)
        change = multipliers @ step.spreading - (here.q - self.prior.mean)
        change_dual = multipliers @ step.jacobian - here.dual
        return self.at(here.q + scale * change, here.dual + scale * change_dual)

    def posterior(self, here: _Point) -> Floats[Array, "dofs dofs"]:
        step = self.linearised(here, False)
        reduction = _kernels.whiten(step.spreading, step.gram, step.noise)
        return self.prior.covariance - reduction.T @ reduction
