"""The pose solver against scipy, and under missing and wild readings."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import point_jacobians
from poseloom.solve import GaussianPrior, SensorMount, SensorReadings, SolverSettings, solve_pose

BONES = ("head", "upperChest", "leftHand", "rightHand", "leftLowerLeg", "rightLowerLeg")
LEAST_SQUARES = SolverSettings(iterations=60, tolerance=1e-12, robust_scale=np.inf)


def _problem(seed: int, full: bool, off: float = 0.15):
    rng = np.random.default_rng(seed)
    body = average_body()
    truth = rng.normal(scale=0.3, size=body.size)
    mean = truth + rng.normal(scale=off, size=body.size)
    sigma = rng.uniform(0.05, 0.3, size=body.size)
    covariance = np.diag(sigma**2)
    if full:
        low = rng.normal(scale=0.1, size=(body.size, 7))
        covariance = covariance + low @ low.T
    sensors = SensorMount(
        np.array([body.index(b) for b in BONES]),
        rng.normal(scale=0.1, size=(6, 3)),
        matrix_from_rotvec(rng.normal(size=(6, 3))),
    )
    at = point_jacobians(body, truth, sensors.bones, sensors.p_bone_sensor)
    positions = at.points + rng.normal(scale=0.003, size=(6, 3))
    rotations = at.rotations @ sensors.R_bone_sensor @ matrix_from_rotvec(rng.normal(scale=0.01, size=(6, 3)))
    sigmas = np.tile([0.003, 0.01], (6, 1))
    return body, truth, sensors, SensorReadings(positions, rotations, sigmas), GaussianPrior(mean, covariance)


def _residual(q, body, sensors, measured, prior, root):
    at = point_jacobians(body, q, sensors.bones, sensors.p_bone_sensor)
    position = (measured.positions - at.points) / measured.sigmas[:, :1]
    turn = rotvec_from_matrix(measured.rotations @ np.swapaxes(at.rotations @ sensors.R_bone_sensor, -1, -2))
    parts = [root @ (q - prior.mean), position.ravel(), (turn / measured.sigmas[:, 1:]).ravel()]
    stacked = np.concatenate(parts)
    return np.where(np.isfinite(stacked), stacked, 0.0)


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_minimum_is_scipys(seed: int, full: bool) -> None:
    body, _, sensors, measured, prior = _problem(seed, full)
    root = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    ours = solve_pose(body, sensors, measured, prior, settings=LEAST_SQUARES)
    theirs = least_squares(
        _residual, prior.mean, args=(body, sensors, measured, prior, root), xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    assert ours.converged
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-6)
    np.testing.assert_allclose(ours.q, theirs.x, atol=1e-4)


def test_five_iterations_are_enough_from_the_prior() -> None:
    body, _, sensors, measured, prior = _problem(11, full=True, off=0.04)
    quick = solve_pose(body, sensors, measured, prior, settings=SolverSettings(robust_scale=np.inf))
    whole = solve_pose(body, sensors, measured, prior, settings=LEAST_SQUARES)
    assert np.abs(quick.q - whole.q).max() < 1e-3


def test_the_start_does_not_change_the_minimum() -> None:
    body, truth, sensors, measured, prior = _problem(5, full=True)
    first = solve_pose(body, sensors, measured, prior, settings=LEAST_SQUARES)
    second = solve_pose(body, sensors, measured, prior, start=truth, settings=LEAST_SQUARES)
    np.testing.assert_allclose(first.q, second.q, atol=1e-5)
    assert first.cost == pytest.approx(second.cost, rel=1e-6)


def test_spread_is_the_linear_gaussian_posterior() -> None:
    body, _, sensors, measured, prior = _problem(3, full=True)
    solution = solve_pose(body, sensors, measured, prior, settings=LEAST_SQUARES)
    at = point_jacobians(body, solution.q, sensors.bones, sensors.p_bone_sensor)
    jacobian = np.concatenate(
        [
            (at.linear / measured.sigmas[:, :1, None]).reshape(18, -1),
            (at.angular / measured.sigmas[:, 1:, None]).reshape(18, -1),
        ]
    )
    posterior = np.linalg.inv(np.linalg.inv(prior.covariance) + jacobian.T @ jacobian)
    np.testing.assert_allclose(solution.spread, np.sqrt(np.diag(posterior)), rtol=1e-3)


def test_without_sensors_the_prior_stands() -> None:
    body, _, sensors, measured, prior = _problem(2, full=True)
    silent = SensorReadings(np.full((6, 3), np.nan), np.full((6, 3, 3), np.nan), measured.sigmas)
    solution = solve_pose(body, sensors, silent, prior)
    np.testing.assert_allclose(solution.q, prior.mean)
    np.testing.assert_allclose(solution.spread, np.sqrt(np.diag(prior.covariance)))
    assert not solution.weights.any()


def test_a_missing_reading_counts_for_nothing() -> None:
    body, _, sensors, measured, prior = _problem(7, full=False)
    positions, rotations = measured.positions.copy(), measured.rotations.copy()
    positions[2], rotations[4] = np.nan, np.nan
    part = SensorReadings(positions, rotations, measured.sigmas)
    root = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    ours = solve_pose(body, sensors, part, prior, settings=LEAST_SQUARES)
    theirs = least_squares(_residual, prior.mean, args=(body, sensors, part, prior, root), xtol=1e-14, ftol=1e-14)
    np.testing.assert_allclose(ours.q, theirs.x, atol=1e-4)


def test_an_outlier_is_disbelieved() -> None:
    body, _, sensors, measured, loose = _problem(9, full=False, off=0.03)
    # A prior that knows: only then is a jump of 36 cm less plausible than a strange pose.
    prior = GaussianPrior(loose.mean, np.eye(body.size) * 0.04**2)
    positions = measured.positions.copy()
    positions[3] += [0.3, 0.2, 0.0]
    wild = SensorReadings(positions, measured.rotations, measured.sigmas)
    clean = solve_pose(body, sensors, measured, prior, settings=SolverSettings(iterations=30))
    robust = solve_pose(body, sensors, wild, prior, settings=SolverSettings(iterations=30))
    naive = solve_pose(body, sensors, wild, prior, settings=LEAST_SQUARES)
    assert robust.weights[3, 0] < 0.05
    assert np.abs(robust.q - clean.q).mean() < 0.2 * np.abs(naive.q - clean.q).mean()


def test_a_locked_axis_stays() -> None:
    body, _, sensors, measured, prior = _problem(4, full=True)
    locked = 3 + 3 * body.index("leftLowerLeg") + 1
    covariance = prior.covariance.copy()
    covariance[locked] = 0.0
    covariance[:, locked] = 0.0
    solution = solve_pose(body, sensors, measured, GaussianPrior(prior.mean, covariance), settings=LEAST_SQUARES)
    assert solution.q[locked] == prior.mean[locked]
    assert solution.spread[locked] == 0.0
