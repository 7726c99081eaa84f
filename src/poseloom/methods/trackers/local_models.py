"""Local models: what the neighbours of a moment say of the next pose.

Each takes a neighbourhood and gives a Gaussian of the pose. All share inputs, outputs, floors and bounds, so to compare
two is to compare their mathematics alone.
"""

import abc
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """The moments of a library nearest to the present one.

    Attributes:
        query: Projected features of the present moment.
        inputs: The same of each neighbour.
        outputs: Pose of each neighbour, from the ground point and heading of the pose before it; metres and radians.
        moved: The newest pose, moved as each neighbour moved; in the same frame.
        weights: How much each neighbour counts; they sum to one.
        previous: The newest reconstructed pose, in its own heading frame.
    """

    query: Floats[Array, "columns"]
    inputs: Floats[Array, "neighbours columns"]
    outputs: Floats[Array, "neighbours dofs"]
    moved: Floats[Array, "neighbours dofs"]
    weights: Floats[Array, "neighbours"]
    previous: Floats[Array, "dofs"]


class LocalModel(abc.ABC):
    """Predicts a pose from a neighbourhood."""

    @abc.abstractmethod
    def predict(self, near: Neighbourhood) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
        """Mean and covariance of the pose; the covariance without the floor that the loop adds."""


def scatter(
    outputs: Floats[Array, "neighbours dofs"], weights: Floats[Array, "neighbours"], shrinkage: float
) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
    """Weighted mean and covariance, with a share of each correlation given up."""
    mean = weights @ outputs
    centred = np.sqrt(weights)[:, None] * (outputs - mean)
    covariance = centred.T @ centred
    variance = np.diag(covariance).copy()
    covariance *= 1.0 - shrinkage
    np.fill_diagonal(covariance, variance)
    return mean, covariance


@dataclass(frozen=True)
class GaussianModel(LocalModel):
    """The neighbours' mean and covariance: regression is left to the solver, which conditions it on the sensors.

    The sensors' map from pose to signal is known exactly, so nothing of it need be learnt from examples: conditioning a
    joint Gaussian of poses on the sensors through that map is the regression from sensors to pose, and unlike a fitted
    one it cannot amplify errors of the history that it would read as inputs. Covariances between joints that the
    neighbours are too few to show are shrunk.

    Attributes:
        shrinkage: Share of each correlation that is given up.
    """

    shrinkage: float = 0.3

    def predict(self, near: Neighbourhood) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
        """See `LocalModel.predict`."""
        return scatter(near.outputs, near.weights, self.shrinkage)


@dataclass(frozen=True)
class NearestModel(LocalModel):
    """The nearest neighbour's pose, with the neighbours' scatter about it for a spread."""

    def predict(self, near: Neighbourhood) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
        """See `LocalModel.predict`."""
        best = near.outputs[int(np.argmin(((near.inputs - near.query) ** 2).sum(axis=1)))]
        return best, np.diag(near.weights @ (near.outputs - best) ** 2)


@dataclass(frozen=True)
class PcaModel(LocalModel):
    """A Gaussian in the principal subspace of the neighbours' poses; the inputs only choose and weigh the neighbours.

    Source: Chai and Hodgins, Performance animation from low-dimensional control signals, 2005, section 5. Their extra
    smoothness term is the history in the choice of neighbours here.

    Attributes:
        energy: Share of the neighbours' variance that the kept components explain.
    """

    energy: float = 0.97

    def predict(self, near: Neighbourhood) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
        """See `LocalModel.predict`."""
        mean = near.weights @ near.outputs
        centred = np.sqrt(near.weights)[:, None] * (near.outputs - mean)
        values, vectors = np.linalg.eigh(centred @ centred.T)
        kept = _kept(values, self.energy)
        factor = vectors[:, kept].T @ centred
        return mean, factor.T @ factor


@dataclass(frozen=True)
class PcrModel(LocalModel):
    """Principal component regression: components of the inputs, then least squares from their scores to the pose.

    Source: Liu et al., Realtime human motion control with a small number of inertial sensors, 2011, section 5.

    Attributes:
        energy: Share of the inputs' variance that the kept components explain.
        ridge: Damping, relative to the largest kept variance.
        full_covariance: Keep the residuals' correlations, not their variances alone.
    """

    energy: float = 0.97
    ridge: float = 0.01
    full_covariance: bool = False

    def predict(self, near: Neighbourhood) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
        """See `LocalModel.predict`."""
        root = np.sqrt(near.weights)[:, None]
        middle, mean = near.weights @ near.inputs, near.weights @ near.outputs
        inputs, outputs = root * (near.inputs - middle), root * (near.outputs - mean)
        values, vectors = np.linalg.eigh(inputs.T @ inputs)
        kept = _kept(values, self.energy)
        basis, variance = vectors[:, kept], values[kept]
        scores = inputs @ basis
        damped = variance + self.ridge * variance[-1]
        coefficients = (scores / damped).T @ outputs
        leverage = ((scores / damped) * scores).sum(axis=1)
        return _with_residuals(
            mean + ((near.query - middle) @ basis) @ coefficients,
            outputs - scores @ coefficients,
            leverage + near.weights,
            self.full_covariance,
        )


@dataclass(frozen=True)
class SubspaceModel(LocalModel):
    """The six-sensor paper's model: one principal subspace of inputs and pose together, split into both.

    With U = [Ux; Uy] the kept directions (as columns) of the centred [X Y], the prediction is Uy (Ux' Ux)^-1 Ux' x,
    which equals the paper's eq. 6 and 7 with their transposes and bracket mended. The paper has no intercept (here both
    sides are centred) and the inverse explodes for directions that lie wholly in the pose's part (here it is damped).

    Attributes:
        energy: Share of the variance that the kept directions explain.
        ridge: Damping, relative to the largest eigenvalue of Ux' Ux.
        per_dof: One subspace for each degree of freedom, as in eq. 8, in place of one for the whole pose: dearer.
        full_covariance: Keep the residuals' correlations, not their variances alone as in the paper.
    """

    energy: float = 0.97
    ridge: float = 0.03
    per_dof: bool = False
    full_covariance: bool = False

    def predict(self, near: Neighbourhood) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
        """See `LocalModel.predict`."""
        root = np.sqrt(near.weights)[:, None]
        middle, mean = near.weights @ near.inputs, near.weights @ near.outputs
        inputs, outputs = root * (near.inputs - middle), root * (near.outputs - mean)
        query = near.query - middle
        if not self.per_dof:
            change, fitted, leverage = self._regress(inputs, outputs, query)
        else:
            parts = [self._regress(inputs, outputs[:, d : d + 1], query) for d in range(outputs.shape[1])]
            change = np.concatenate([part[0] for part in parts])
            fitted = np.concatenate([part[1] for part in parts], axis=1)
            leverage = np.max([part[2] for part in parts], axis=0)
        return _with_residuals(mean + change, outputs - fitted, leverage + near.weights, self.full_covariance)

    def _regress(
        self,
        inputs: Floats[Array, "neighbours columns"],
        outputs: Floats[Array, "neighbours out"],
        query: Floats[Array, "columns"],
    ) -> tuple[Floats[Array, "out"], Floats[Array, "neighbours out"], Floats[Array, "neighbours"]]:
        gram = inputs @ inputs.T + outputs @ outputs.T
        values, vectors = np.linalg.eigh(gram)
        kept = _kept(values, self.energy)
        left = vectors[:, kept] / np.sqrt(values[kept])
        u_x, u_y = inputs.T @ left, outputs.T @ left
        inner = u_x.T @ u_x
        inner[np.diag_indices_from(inner)] += self.ridge * float(np.linalg.eigvalsh(inner)[-1])
        back = np.linalg.solve(inner, u_x.T)
        change = u_y @ (back @ query)
        scores = inputs @ back.T
        return change, scores @ u_y.T, (vectors[:, kept] ** 2).sum(axis=1)


def _kept(values: Floats[Array, "values"], energy: float) -> slice:
    """The slice of ascending eigenvalues that explains a share of their sum (never one that is nil)."""
    positive = np.maximum(values, 0.0)
    from_top = np.cumsum(positive[::-1])
    count = int(np.count_nonzero(from_top < energy * from_top[-1])) + 1
    count = max(1, min(count, int(np.count_nonzero(positive > 1e-10 * positive[-1]))))
    return slice(len(values) - count, len(values))


def _with_residuals(
    mean: Floats[Array, "dofs"],
    residuals: Floats[Array, "neighbours dofs"],
    leverage: Floats[Array, "neighbours"],
    full: bool,
) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
    left_out = residuals / np.maximum(1.0 - leverage, 0.1)[:, None]
    if not full:
        return mean, np.diag((left_out**2).sum(axis=0))
    return mean, left_out.T @ left_out
