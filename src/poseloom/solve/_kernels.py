"""The inner loop of the pose solver: residuals, their Jacobian, and damped Gauss-Newton steps in covariance form.

The minimum of  1/2 (q - m)' C^-1 (q - m) + sum over measured vectors of rho(|e|^2)  is sought. With few measurements
(up to six numbers a sensor) and many unknowns, the step is written with the prior's covariance C and never its inverse
(the matrix inversion lemma): only one symmetric matrix of the measurements' size is factored, and a locked axis is
simply one of zero variance. Levenberg's damping multiplies the prior's precision by 1 + damping.
"""

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints, compiled
from poseloom.rotations._kernels import log_rotation
from poseloom.skeleton._kernels import forward, frame_jacobian, rotation_axes


@compiled
def sensor_residuals(
    bones: Ints[Array, "sensors"],
    p_bone_sensor: Floats[Array, "sensors 3"],
    R_bone_sensor: Floats[Array, "sensors 3 3"],
    measured_positions: Floats[Array, "sensors 3"],
    measured_rotations: Floats[Array, "sensors 3 3"],
    positions: Floats[Array, "joints 3"],
    rotations: Floats[Array, "joints 3 3"],
    points: Floats[Array, "sensors 3"],
    residuals: Floats[Array, "sensors 2 3"],
    present: Bools[Array, "sensors 2"],
) -> None:
    """Fills measured minus predicted, in the world frame: metres, and rotation vectors of R_measured R_predicted'."""
    turn = np.empty((3, 3))
    for s in range(bones.shape[0]):
        bone = bones[s]
        present[s, 0] = True
        present[s, 1] = True
        for a in range(3):
            points[s, a] = positions[bone, a]
            for b in range(3):
                points[s, a] += rotations[bone, a, b] * p_bone_sensor[s, b]
            residuals[s, 0, a] = measured_positions[s, a] - points[s, a]
            if not np.isfinite(residuals[s, 0, a]):
                present[s, 0] = False
            for b in range(3):
                if not np.isfinite(measured_rotations[s, a, b]):
                    present[s, 1] = False
        if present[s, 1]:
            predicted = rotations[bone] @ R_bone_sensor[s]
            for a in range(3):
                for b in range(3):
                    turn[a, b] = 0.0
                    for c in range(3):
                        turn[a, b] += measured_rotations[s, a, c] * predicted[b, c]
            log_rotation(turn, residuals[s, 1])


@compiled
def robust_cost_and_weights(
    residuals: Floats[Array, "sensors 2 3"],
    present: Bools[Array, "sensors 2"],
    sigmas: Floats[Array, "sensors 2"],
    robust_scale: float,
    weights: Floats[Array, "sensors 2"],
) -> float:
    """Lorentzian cost k^2 log(1 + e^2 / (2 k^2 sigma^2)); fills its IRLS weights 1 / (1 + e^2 / (2 k^2 sigma^2))."""
    cost = 0.0
    bound = robust_scale * robust_scale
    for s in range(residuals.shape[0]):
        for kind in range(2):
            weights[s, kind] = 0.0
            if not present[s, kind]:
                continue
            square = 0.0
            for a in range(3):
                square += residuals[s, kind, a] * residuals[s, kind, a]
            half = 0.5 * square / (sigmas[s, kind] * sigmas[s, kind])
            if np.isfinite(bound):
                cost += bound * np.log1p(half / bound)
                weights[s, kind] = 1.0 / (1.0 + half / bound)
            else:
                cost += half
                weights[s, kind] = 1.0
    return cost


@compiled
def factor_in_place(matrix: Floats[Array, "rows rows"], rows: int) -> bool:
    """Lower Cholesky factor of the leading block, in place; False where the matrix is not positive definite."""
    for i in range(rows):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                matrix[i, i] = np.sqrt(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    return True


@compiled
def solve_factored(factor: Floats[Array, "rows rows"], rows: int, vector: Floats[Array, "rows"]) -> None:
    """Solves L L' x = vector in place."""
    for i in range(rows):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]
    for i in range(rows - 1, -1, -1):
        for k in range(i + 1, rows):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@compiled
def solve_pose_kernel(
    parents: Ints[Array, "joints"],
    offsets: Floats[Array, "joints 3"],
    bones: Ints[Array, "sensors"],
    p_bone_sensor: Floats[Array, "sensors 3"],
    R_bone_sensor: Floats[Array, "sensors 3 3"],
    measured_positions: Floats[Array, "sensors 3"],
    measured_rotations: Floats[Array, "sensors 3 3"],
    sigmas: Floats[Array, "sensors 2"],
    robust_scale: float,
    mean: Floats[Array, "dofs"],
    covariance: Floats[Array, "dofs dofs"],
    q: Floats[Array, "dofs"],
    dual: Floats[Array, "dofs"],
    iterations: int,
    tolerance: float,
    spread: Floats[Array, "dofs"],
    residuals: Floats[Array, "sensors 2 3"],
    weights: Floats[Array, "sensors 2"],
    result: Floats[Array, "3"],
) -> None:
    """Minimises; `q` and `dual` (C^-1 (q - mean)) are the start on entry and the answer on return.

    Fills the posterior standard deviations, the residuals and weights at the answer, and `result` with cost, iterations
    used, and 1 where it converged.
    """
    count, size = parents.shape[0], q.shape[0]
    sensors = bones.shape[0]
    most = 6 * sensors
    positions, rotations, axes = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3, 3))
    points = np.empty((sensors, 3))
    present = np.empty((sensors, 2), dtype=np.bool_)
    linear, angular = np.zeros((sensors, 3, size)), np.zeros((sensors, 3, size))
    trial, trial_dual = np.empty(size), np.empty(size)
    trial_residuals, trial_weights = np.empty_like(residuals), np.empty_like(weights)
    forward(parents, offsets, q, positions, rotations)
    sensor_residuals(
        bones, p_bone_sensor, R_bone_sensor, measured_positions, measured_rotations, positions, rotations, points,
        residuals, present,
    )  # fmt: skip
    cost = robust_cost_and_weights(residuals, present, sigmas, robust_scale, weights)
    cost += 0.5 * np.dot(q - mean, dual)
    damping = 0.0
    trial_cost = cost
    jacobian = np.zeros((most, size))
    innovation = np.zeros(most)
    noise = np.zeros(most)
    used = 0
    converged = False
    rows = 0
    for _ in range(iterations):
        used += 1
        rotation_axes(parents, q, rotations, axes)
        rows = 0
        for s in range(sensors):
            frame_jacobian(parents, positions, axes, bones[s], points[s], linear[s], angular[s])
            for kind in range(2):
                if present[s, kind]:
                    for a in range(3):
                        jacobian[rows] = linear[s, a] if kind == 0 else angular[s, a]
                        innovation[rows] = residuals[s, kind, a]
                        noise[rows] = sigmas[s, kind] ** 2 / max(weights[s, kind], 1e-12)
                        rows += 1
        active = jacobian[:rows]
        spreading = np.dot(active, covariance)
        gram = np.dot(spreading, active.T)
        pull = np.dot(active, q - mean)
        # Before the first step a residual shows the prior's error as well as the sensor's. Judged by the sensor's sigma
        # alone, a good reading of a fast movement would look like an outlier, and the solver could settle on disbelief.
        first = used == 1 and np.isfinite(robust_scale)
        if first:
            _soften(noise, gram, innovation, sigmas, present, robust_scale)
        accepted = False
        for _ in range(8):
            scale = 1.0 / (1.0 + damping)
            factor = gram * scale
            multipliers = innovation[:rows] + scale * pull
            for i in range(rows):
                factor[i, i] += noise[i]
            if factor_in_place(factor, rows):
                solve_factored(factor, rows, multipliers)
                change = np.dot(multipliers, spreading) - (q - mean)
                change_dual = np.dot(multipliers, active) - dual
                for i in range(size):
                    trial[i] = q[i] + scale * change[i]
                    trial_dual[i] = dual[i] + scale * change_dual[i]
                forward(parents, offsets, trial, positions, rotations)
                sensor_residuals(
                    bones, p_bone_sensor, R_bone_sensor, measured_positions, measured_rotations, positions, rotations,
                    points, trial_residuals, present,
                )  # fmt: skip
                trial_cost = robust_cost_and_weights(trial_residuals, present, sigmas, robust_scale, trial_weights)
                trial_cost += 0.5 * np.dot(trial - mean, trial_dual)
                if first or trial_cost <= cost + 1e-12 * abs(cost):
                    accepted = True
                    break
            damping = 0.1 if damping == 0.0 else 10.0 * damping
        if not accepted:
            # No descent along any damped step: the start is as low as floating point goes.
            forward(parents, offsets, q, positions, rotations)
            converged = True
            break
        largest = np.max(np.abs(trial - q))
        saved = cost - trial_cost
        q[:] = trial
        dual[:] = trial_dual
        residuals[:] = trial_residuals
        weights[:] = trial_weights
        cost = trial_cost
        damping = 0.0 if damping <= 0.1 else 0.1 * damping
        if largest < tolerance or (not first and saved < 1e-10 * (1.0 + abs(cost))):
            converged = True
            break
    _posterior_spread(jacobian, rows, covariance, noise, spread)
    result[0] = cost
    result[1] = used
    result[2] = 1.0 if converged else 0.0


@compiled
def _soften(
    noise: Floats[Array, "rows"],
    gram: Floats[Array, "rows rows"],
    innovation: Floats[Array, "rows"],
    sigmas: Floats[Array, "sensors 2"],
    present: Bools[Array, "sensors 2"],
    robust_scale: float,
) -> None:
    """Sets each reading's noise from its innovation, judged by the sensor's and the prior's variance together."""
    row = 0
    for s in range(present.shape[0]):
        for kind in range(2):
            if present[s, kind]:
                own = sigmas[s, kind] ** 2
                expected = own + (gram[row, row] + gram[row + 1, row + 1] + gram[row + 2, row + 2]) / 3.0
                square = innovation[row] ** 2 + innovation[row + 1] ** 2 + innovation[row + 2] ** 2
                inflation = 1.0 + 0.5 * square / (expected * robust_scale * robust_scale)
                for a in range(3):
                    noise[row + a] = own * inflation
                row += 3


@compiled
def _posterior_spread(
    jacobian: Floats[Array, "rows dofs"],
    rows: int,
    covariance: Floats[Array, "dofs dofs"],
    noise: Floats[Array, "rows"],
    spread: Floats[Array, "dofs"],
) -> None:
    """Standard deviations of C - C J' (J C J' + W^-1)^-1 J C, at the last linearisation."""
    size = covariance.shape[0]
    active = jacobian[:rows]
    spreading = np.dot(active, covariance)
    factor = np.dot(spreading, active.T)
    for i in range(rows):
        factor[i, i] += noise[i]
    ok = factor_in_place(factor, rows)
    for d in range(size):
        spread[d] = covariance[d, d]
    if ok:
        for i in range(rows):
            for k in range(i):
                for d in range(size):
                    spreading[i, d] -= factor[i, k] * spreading[k, d]
            for d in range(size):
                spreading[i, d] /= factor[i, i]
                spread[d] -= spreading[i, d] * spreading[i, d]
    for d in range(size):
        spread[d] = np.sqrt(max(spread[d], 0.0))
