"""Levenberg-Marquardt for problems in which many blocks of unknowns are tied together by a few shared ones.

Minimises  sum over blocks and groups of rho(|r_bg(s, x_b)|^2) + 1/2 |c(s)|^2  over shared unknowns s and a block's own
x_b. The normal matrix is an arrow: each block's part is eliminated by itself (Schur complement), so the cost grows with
the number of blocks only linearly. What the unknowns are is the problem's affair; they may live on a manifold.
"""

from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, Protocol, TypeVar, cast, runtime_checkable

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.errors import PoseloomError

State = TypeVar("State")


class Residuals(NamedTuple):
    """Whitened residuals: in units of their standard deviations.

    Attributes:
        blocks: Groups of three residuals in each block.
        shared: Those that hang on shared unknowns only.
    """

    blocks: Floats[Array, "blocks groups 3"]
    shared: Floats[Array, "rows"]


class Linearisation(NamedTuple):
    """Residuals and their derivatives by a small step.

    Attributes:
        residuals: At the state itself.
        by_shared: Of the blocks' residuals by the shared unknowns.
        by_own: Of the blocks' residuals by their own unknowns.
        shared_by_shared: Of the shared residuals by the shared unknowns.
    """

    residuals: Residuals
    by_shared: Floats[Array, "blocks groups 3 shared"]
    by_own: Floats[Array, "blocks groups 3 own"]
    shared_by_shared: Floats[Array, "rows shared"]


@runtime_checkable
class Problem(Protocol[State]):
    """What is to be minimised."""

    @property
    def present(self) -> Bools[Array, "blocks groups"]:
        """Which groups count; the others are missing measurements and may hold anything finite."""
        ...

    @property
    def robust_scales(self) -> Floats[Array, "groups"]:
        """Sigmas at which the Lorentzian begins to disbelieve a group; infinity for least squares."""
        ...

    def linearise(self, state: State) -> Linearisation:
        """Residuals and derivatives at a state."""
        ...

    def move(self, state: State, shared: Floats[Array, "shared"], own: Floats[Array, "blocks own"]) -> State:
        """The state after a step, which may be along a manifold."""
        ...


@dataclass(frozen=True)
class LeastSquaresSettings:
    """How hard to try.

    Attributes:
        iterations: Most steps.
        tolerance: Relative decrease of the cost at which to stop.
        damping: Levenberg's at the start, in units of the normal matrix' diagonal.
    """

    iterations: int = 60
    tolerance: float = 1e-6
    damping: float = 1e-3


@dataclass(frozen=True, eq=False)
class Minimum(Generic[State]):
    """Where the search ended.

    Attributes:
        state: The unknowns.
        cost: The minimised energy.
        block_costs: The part of it that each group of each block has; 0 where missing.
        covariance: Posterior covariance of the shared unknowns' steps, the blocks' own integrated out.
        iterations: Steps tried.
        converged: Whether it ended for want of decrease, not of steps.
    """

    state: State
    cost: float
    block_costs: Floats[Array, "blocks groups"]
    covariance: Floats[Array, "shared shared"]
    iterations: int
    converged: bool


def minimise(problem: Problem[State], start: State, settings: LeastSquaresSettings | None = None) -> Minimum[State]:
    """Searches from a start by damped Gauss-Newton steps with iteratively reweighted groups.

    Damping follows Nielsen (1999): it shrinks with the ratio of decrease won to decrease foretold.

    Raises:
        PoseloomError: where the start's residuals are not finite.
    """
    how = settings or LeastSquaresSettings()
    state, damping, growth = start, how.damping, 2.0
    linear = problem.linearise(state)
    costs = _costs(problem, linear.residuals)
    if not np.isfinite(costs.total):
        raise PoseloomError("the least-squares problem cannot start", cause="its residuals there are not finite")
    normal = _normal(problem, linear)
    used, converged = 0, False
    while used < how.iterations and not converged:
        used += 1
        step = _solve(normal, damping)
        if step is None:
            damping, growth = damping * growth, 2 * growth
            continue
        trial = problem.move(state, step.shared, step.own)
        linear = problem.linearise(trial)
        trial_costs = _costs(problem, linear.residuals)
        won = costs.total - trial_costs.total
        if np.isfinite(trial_costs.total) and won >= 0:
            converged = won <= how.tolerance * (1e-12 + costs.total)
            gain = won / max(step.foretold, 1e-300)
            damping *= max(1 / 3, 1 - (2 * min(gain, 1.0) - 1) ** 3)
            damping, growth = max(damping, 1e-12), 2.0
            state, costs = trial, trial_costs
            normal = _normal(problem, linear)
        else:
            converged = step.foretold <= how.tolerance * (1e-12 + costs.total)
            damping, growth = damping * growth, 2 * growth
    _, schur = _eliminate(normal, 0.0)
    return Minimum(state, costs.total, costs.groups, np.asarray(np.linalg.inv(schur)), used, converged)


def marginal_mode(
    problem: Problem[State], minimum: Minimum[State], along: Ints[Array, "directions"], rounds: int = 2
) -> Minimum[State]:
    """Moves from the joint minimum to where the shared unknowns alone are most probable.

    Each block's own unknowns are integrated out by Laplace's approximation, which adds half the logarithm of the
    determinant of their normal matrix to the energy. Without it, shared unknowns are biased towards where the blocks'
    own have most effect: a long lever explains the same readings with smaller angles, so lengths come out too long, and
    no number of blocks mends it.

    Args:
        problem: What was minimised.
        minimum: Its answer.
        along: Shared unknowns of which the determinant is differentiated, by finite differences; of the others its
            change is neglected.
        rounds: Newton steps.
    """
    state, covariance = minimum.state, minimum.covariance
    linear = problem.linearise(state)
    for _ in range(rounds):
        normal = _normal(problem, linear)
        solved, schur = _eliminate(normal, 0.0)
        gradient = normal.shared_gradient - np.einsum("bos,bo->s", normal.cross, solved[..., -1])
        level, sigmas = _log_determinant(normal.own), np.sqrt(np.diag(covariance))
        for direction in along:
            shared = np.zeros(len(sigmas))
            shared[direction] = _PROBE * sigmas[direction]
            probed = problem.move(state, shared, -solved[..., :-1] @ shared)
            raised = _log_determinant(_normal(problem, problem.linearise(probed)).own) - level
            gradient[direction] += 0.5 * raised / shared[direction]
        step = -_solution(schur, gradient)
        state = problem.move(state, step, -solved[..., -1] - solved[..., :-1] @ step)
        linear = problem.linearise(state)
    costs = _costs(problem, linear.residuals)
    return replace(minimum, state=state, cost=costs.total, block_costs=costs.groups)


_PROBE = 0.1
"""Length of finite differences, in posterior standard deviations."""


def _log_determinant(own: Floats[Array, "blocks own own"]) -> float:
    return float(np.linalg.slogdet(own)[1].sum())


class _Costs(NamedTuple):
    total: float
    groups: Floats[Array, "blocks groups"]


class _Normal(NamedTuple):
    """The weighted normal equations, by blocks."""

    own: Floats[Array, "blocks own own"]
    cross: Floats[Array, "blocks own shared"]
    shared: Floats[Array, "shared shared"]
    own_gradient: Floats[Array, "blocks own"]
    shared_gradient: Floats[Array, "shared"]


class _Step(NamedTuple):
    shared: Floats[Array, "shared"]
    own: Floats[Array, "blocks own"]
    foretold: float


def _halves(problem: Problem[State], blocks: Floats[Array, "blocks groups 3"]) -> Floats[Array, "blocks groups"]:
    return np.where(problem.present, 0.5 * (blocks**2).sum(axis=-1), 0.0)


def _costs(problem: Problem[State], residuals: Residuals) -> _Costs:
    """Lorentzian k^2 log(1 + e^2 / (2 k^2)) of each group, as in the pose solver."""
    halves, bounds = _halves(problem, residuals.blocks), problem.robust_scales**2
    with np.errstate(invalid="ignore"):
        groups = np.where(np.isfinite(bounds), bounds * np.log1p(halves / bounds), halves)
    return _Costs(float(groups.sum() + 0.5 * residuals.shared @ residuals.shared), groups)


def _normal(problem: Problem[State], linear: Linearisation) -> _Normal:
    halves = _halves(problem, linear.residuals.blocks)
    weights = np.where(problem.present, 1 / (1 + halves / problem.robust_scales**2), 0.0)
    roots = np.sqrt(weights)[..., None]
    blocks = len(roots)
    residuals = (roots * np.where(problem.present[..., None], linear.residuals.blocks, 0.0)).reshape(blocks, -1, 1)
    by_shared = (roots[..., None] * linear.by_shared).reshape(blocks, residuals.shape[1], -1)
    by_own = (roots[..., None] * linear.by_own).reshape(blocks, residuals.shape[1], -1)
    turned = by_own.swapaxes(1, 2)
    rows, only = linear.residuals.shared, linear.shared_by_shared
    flat = by_shared.reshape(-1, by_shared.shape[2])
    return _Normal(
        turned @ by_own,
        turned @ by_shared,
        flat.T @ flat + only.T @ only,
        (turned @ residuals)[..., 0],
        flat.T @ residuals.reshape(-1) + only.T @ rows,
    )


def _eliminate(
    normal: _Normal, damping: float
) -> tuple[Floats[Array, "blocks own columns"], Floats[Array, "shared shared"]]:
    """Each block's own part solved for cross terms and gradient, and the Schur complement that is left."""
    own = normal.own * (1 + damping * np.eye(normal.own.shape[1]))
    solved = _solution(own, np.concatenate([normal.cross, normal.own_gradient[..., None]], axis=2))
    schur = normal.shared - np.einsum("bos,bot->st", normal.cross, solved[..., :-1])
    schur += damping * np.diag(np.diag(normal.shared))
    return solved, schur


def _solution(matrix: Floats[Array, "..."], right: Floats[Array, "..."]) -> Floats[Array, "..."]:
    """numpy's solve, with its type told."""
    return cast(Floats[Array, "..."], np.linalg.solve(matrix, right))


def _solve(normal: _Normal, damping: float) -> _Step | None:
    """One damped step; None where the matrix is singular to working precision."""
    try:
        solved, schur = _eliminate(normal, damping)
        gradient = normal.shared_gradient - np.einsum("bos,bo->s", normal.cross, solved[..., -1])
        shared = -_solution(schur, gradient)
    except np.linalg.LinAlgError:
        return None
    own = -solved[..., -1] - solved[..., :-1] @ shared
    diagonals = np.diagonal(normal.own, axis1=1, axis2=2)
    down = -(normal.shared_gradient @ shared + (normal.own_gradient * own).sum())
    damped = damping * (np.diag(normal.shared) @ shared**2 + (diagonals * own**2).sum())
    return _Step(shared, own, float(0.5 * (down + damped)))
