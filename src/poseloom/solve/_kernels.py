"""The inner parts of the pose solver: residuals, their Jacobian, and damped Gauss-Newton steps in covariance form.

The minimum of  1/2 (q - m)' C^-1 (q - m) + sum over measured vectors of rho(|e|^2)  is sought. With few measurements
(up to six numbers a sensor) and many unknowns, the step is written with the prior's covariance C and never its inverse
(the matrix inversion lemma): only one symmetric matrix of the measurements' size is factored, and a locked axis is
simply one of zero variance. Levenberg's damping multiplies the prior's precision by 1 + damping.
"""

import math

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
    turn, predicted = np.empty((3, 3)), np.empty((3, 3))
    for s in range(bones.shape[0]):
        bone = bones[s]
        present[s, 0] = True
        present[s, 1] = True
        for a in range(3):
            points[s, a] = positions[bone, a]
            for b in range(3):
                points[s, a] += rotations[bone, a, b] * p_bone_sensor[s, b]
            residuals[s, 0, a] = measured_positions[s, a] - points[s, a]
            if not math.isfinite(residuals[s, 0, a]):
                present[s, 0] = False
            for b in range(3):
                if not math.isfinite(measured_rotations[s, a, b]):
                    present[s, 1] = False
        if present[s, 1]:
            for a in range(3):
                for b in range(3):
                    predicted[a, b] = 0.0
                    for c in range(3):
                        predicted[a, b] += rotations[bone, a, c] * R_bone_sensor[s, c, b]
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
            if math.isfinite(bound):
                cost += bound * math.log1p(half / bound)
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
                matrix[i, i] = math.sqrt(total)
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
def measure(
    parents: Ints[Array, "joints"],
    offsets: Floats[Array, "joints 3"],
    bones: Ints[Array, "sensors"],
    p_bone_sensor: Floats[Array, "sensors 3"],
    R_bone_sensor: Floats[Array, "sensors 3 3"],
    measured_positions: Floats[Array, "sensors 3"],
    measured_rotations: Floats[Array, "sensors 3 3"],
    sigmas: Floats[Array, "sensors 2"],
    robust_scale: float,
    q: Floats[Array, "dofs"],
    positions: Floats[Array, "joints 3"],
    rotations: Floats[Array, "joints 3 3"],
    points: Floats[Array, "sensors 3"],
    residuals: Floats[Array, "sensors 2 3"],
    present: Bools[Array, "sensors 2"],
    weights: Floats[Array, "sensors 2"],
) -> float:
    """Fills a pose's joint frames, residuals and weights; returns the readings' share of its energy."""
    forward(parents, offsets, q, positions, rotations)
    sensor_residuals(
        bones, p_bone_sensor, R_bone_sensor, measured_positions, measured_rotations, positions, rotations, points,
        residuals, present,
    )  # fmt: skip
    return robust_cost_and_weights(residuals, present, sigmas, robust_scale, weights)


@compiled
def linearise(
    parents: Ints[Array, "joints"],
    bones: Ints[Array, "sensors"],
    q: Floats[Array, "dofs"],
    positions: Floats[Array, "joints 3"],
    rotations: Floats[Array, "joints 3 3"],
    points: Floats[Array, "sensors 3"],
    residuals: Floats[Array, "sensors 2 3"],
    present: Bools[Array, "sensors 2"],
    weights: Floats[Array, "sensors 2"],
    sigmas: Floats[Array, "sensors 2"],
    axes: Floats[Array, "joints 3 3"],
    linear: Floats[Array, "3 dofs"],
    angular: Floats[Array, "3 dofs"],
    jacobian: Floats[Array, "most dofs"],
    innovation: Floats[Array, "most"],
    noise: Floats[Array, "most"],
) -> int:
    """Fills one row a present number: its slope, residual and variance over weight. Returns the number of rows."""
    size = q.shape[0]
    rotation_axes(parents, q, rotations, axes)
    rows = 0
    for s in range(bones.shape[0]):
        for a in range(3):
            for d in range(size):
                linear[a, d] = 0.0
                angular[a, d] = 0.0
        frame_jacobian(parents, positions, axes, bones[s], points[s], linear, angular)
        for kind in range(2):
            if present[s, kind]:
                for a in range(3):
                    for d in range(size):
                        jacobian[rows, d] = linear[a, d] if kind == 0 else angular[a, d]
                    innovation[rows] = residuals[s, kind, a]
                    noise[rows] = sigmas[s, kind] ** 2 / max(weights[s, kind], 1e-12)
                    rows += 1
    return rows


@compiled
def propose(
    rows: int,
    damping: float,
    gram: Floats[Array, "rows rows"],
    noise: Floats[Array, "rows"],
    innovation: Floats[Array, "rows"],
    pull: Floats[Array, "rows"],
    factor: Floats[Array, "rows rows"],
    multipliers: Floats[Array, "rows"],
) -> bool:
    """Fills the multipliers of the rows in a damped Gauss-Newton step; False where no step can be computed."""
    scale = 1.0 / (1.0 + damping)
    for i in range(rows):
        for k in range(i + 1):
            factor[i, k] = gram[i, k] * scale
        factor[i, i] += noise[i]
        multipliers[i] = innovation[i] + scale * pull[i]
    if not factor_in_place(factor, rows):
        return False
    solve_factored(factor, rows, multipliers)
    return True


@compiled
def whiten(
    spreading: Floats[Array, "rows dofs"], gram: Floats[Array, "rows rows"], noise: Floats[Array, "rows"]
) -> Floats[Array, "rows dofs"]:
    """L^-1 J C with L L' = J C J' + W^-1, whose square is what the readings take off C; overwrites its inputs.

    Nil where the readings' matrix is not positive definite: then nothing is said to be known better than before.
    """
    rows, size = spreading.shape
    for i in range(rows):
        gram[i, i] += noise[i]
    if not factor_in_place(gram, rows):
        spreading[:] = 0.0
        return spreading
    for i in range(rows):
        for k in range(i):
            for d in range(size):
                spreading[i, d] -= gram[i, k] * spreading[k, d]
        for d in range(size):
            spreading[i, d] /= gram[i, i]
    return spreading
