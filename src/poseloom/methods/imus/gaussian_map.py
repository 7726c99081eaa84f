"""The multivariate Gaussian map: motion given signal, from the joint Gaussian of both.

Source: section 5.1 of the single-IMU paper, eq. 2 to 7:

    E[x | y] = mu_x + U_xy U_yy^-1 (y - mu_y),    Cov[x | y] = U_xx - U_xy U_yy^-1 U_yx

Departures: the paper estimates one Gaussian a state, which one example cannot define; here the Gaussian is that of all
registered examples of a phase at one warped time, with U_yy shrunk towards its diagonal and solved by Cholesky. Only
the diagonal of the conditional covariance is kept.
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from scipy.linalg import cho_factor, cho_solve  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import MethodError

_LEAST = 1e-9
"""Share of the mean variance that is added to every diagonal entry: channels that never change stay solvable."""


@dataclass(frozen=True, eq=False)
class GaussianMap:
    """A joint Gaussian of x and y, ready to be asked for x given y. Make one with `fit_gaussian_map`.

    Attributes:
        mean_x: Mean of x.
        mean_y: Mean of y.
        gain: U_xy U_yy^-1.
        variance: Diagonal of Cov[x | y].
    """

    mean_x: Floats[Array, "dx"]
    mean_y: Floats[Array, "dy"]
    gain: Floats[Array, "dx dy"]
    variance: Floats[Array, "dx"]

    def given(self, y: Floats[Array, "dy"]) -> Floats[Array, "dx"]:
        """E[x | y], eq. 6."""
        return self.mean_x + self.gain @ (y - self.mean_y)


def fit_gaussian_map(
    x: Floats[Array, "examples dx"],
    y: Floats[Array, "examples dy"],
    shrinkage: float,
    weights: Floats[Array, "examples"] | None = None,
) -> GaussianMap:
    """Estimates the joint Gaussian.

    Args:
        x: Motion features.
        y: Signal features.
        shrinkage: 0 to 1: by how much U_yy is drawn towards `trace / dy` on its diagonal, as U' = (1 - s) U + s t I.
            With 0 the gain is that of least squares; with 1 y tells next to nothing.
        weights: Of the examples; equal unless given.

    Raises:
        MethodError: for no examples, or a shrinkage outside 0 to 1.
    """
    if len(x) == 0 or len(x) != len(y):
        raise MethodError(f"{len(x)} examples of x and {len(y)} of y give no Gaussian", remedy="Give pairs")
    if not 0.0 <= shrinkage <= 1.0:
        raise MethodError(f"a shrinkage of {shrinkage}", remedy="Give a number from 0 to 1")
    share = np.full(len(x), 1 / len(x)) if weights is None else weights / weights.sum()
    mean_x, mean_y = share @ x, share @ y
    dx, dy = x - mean_x, y - mean_y
    weighted = dy * share[:, None]
    covariance = dy.T @ weighted
    scale = float(np.trace(covariance)) / len(covariance)
    if scale == 0.0:
        return GaussianMap(
            frozen_float(mean_x), frozen_float(mean_y),
            frozen_float(np.zeros((x.shape[1], y.shape[1]))), frozen_float(share @ dx**2),
        )  # fmt: skip
    shrunk = (1 - shrinkage) * covariance + (shrinkage + _LEAST) * scale * np.eye(len(covariance))
    cross = (1 - shrinkage) * (weighted.T @ dx)
    factor = cast(Any, cho_factor(shrunk, lower=True))
    gain = np.asarray(cho_solve(factor, cross), dtype=np.float64).T
    # The residuals' variance; with no shrinkage it is the diagonal of U_xx - U_xy U_yy^-1 U_yx.
    left = dx - dy @ gain.T
    return GaussianMap(frozen_float(mean_x), frozen_float(mean_y), frozen_float(gain), frozen_float(share @ left**2))
