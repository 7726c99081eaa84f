"""The nearest moments as a Kalman filter: where they are, how they move on, and what was known before."""

from dataclasses import dataclass
from math import radians
from typing import Any, ClassVar

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import MethodError
from poseloom.library import MotionLibrary
from poseloom.library.features import FeatureSettings
from poseloom.methods.trackers import _kernels
from poseloom.methods.trackers.local_models import GaussianModel, LocalModel, scatter
from poseloom.methods.trackers.loop import TrackerState
from poseloom.methods.trackers.neighbours import NeighbourMethod, NeighbourSettings
from poseloom.methods.trackers.observation import BoneView, root_turned
from poseloom.sensors import SensorLayout
from poseloom.solve import GaussianPrior

_ONLY_RELATIVE = (0, 2, 4)
"""Entries of which a moment says how they change, not where they are: the root's ground point and its heading."""
_UNKNOWN = 1e4
"""Their variance in what the neighbours say of where the pose is."""


@dataclass(frozen=True)
class FilterModel(GaussianModel):
    """The neighbours' mean and covariance (see `GaussianModel`), and how what was known before is carried on.

    Attributes:
        memory: Samples over which what the neighbours say is one and the same opinion: their error lasts as long, so it
            is heard with this many times its variance.
        drift_scale: The neighbours' scatter in how they move on, times this, is the uncertainty of each step.
        drift_shrinkage: Share of that scatter's correlations that is given up.
        drift_floor: Least standard deviation of a step's change of an angle, radians.
        drift_place_floor: The same of the root's place, metres.
    """

    memory: float = 4.0
    drift_scale: float = 3.0
    drift_shrinkage: float = 0.6
    drift_floor: float = radians(0.2)
    drift_place_floor: float = 0.003

    def carry(
        self,
        known: Floats[Array, "dofs dofs"],
        moved: Floats[Array, "neighbours dofs"],
        weights: Floats[Array, "neighbours"],
    ) -> GaussianPrior:
        """The last pose, moved on as the neighbours move on from it.

        Args:
            known: Covariance of the last pose.
            moved: The last pose, moved by each neighbour's own change.
            weights: How much each neighbour counts.
        """
        mean, covariance = scatter(moved, weights, self.drift_shrinkage)
        covariance *= self.drift_scale
        floor = np.full(len(mean), self.drift_floor**2)
        floor[:3] = self.drift_place_floor**2
        covariance[np.diag_indices_from(covariance)] += floor
        return GaussianPrior(mean, known + covariance)

    def joined(self, carried: GaussianPrior, opinion: GaussianPrior) -> GaussianPrior:
        """The product of what was carried on and of where the neighbours are."""
        heard = self.memory * opinion.covariance
        for entry in _ONLY_RELATIVE:
            heard[entry] = heard[:, entry] = 0.0
            heard[entry, entry] = _UNKNOWN
        known = carried.covariance
        solved = np.linalg.solve(known + heard, np.column_stack([known, opinion.mean - carried.mean]))
        covariance = known - known @ solved[:, :-1]
        return GaussianPrior(carried.mean + known @ solved[:, -1], 0.5 * (covariance + covariance.T))


class LocalFilter(NeighbourMethod):
    """A Kalman filter whose dynamics and whose prior are the nearest moments of the library.

    Three things are known of the next pose: the last one, with all its uncertainty, moved on as the neighbours move
    on; where the neighbours are; and what the sensors say. The first two are joined here, the solver adds the third,
    and what it leaves uncertain is carried to the next step. So what once showed lasts, such as a forearm's twist that
    is plain while the elbow is bent and hidden while it is straight, and the sensors' noise is averaged over time.

    The neighbours' error lasts from sample to sample. To count their opinion anew at each would make it certain in no
    time; it is heard with `FilterModel.memory` times its variance.

    Source: ours; search, loop and solver are those of the six-sensor paper, as `NeighbourMethod` has them. Arguments as
    there; the model is a `FilterModel`, and `NeighbourSettings.persistence` and `margin` are not used.
    """

    default_model: ClassVar[LocalModel] = FilterModel(shrinkage=0.2)
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings(
        neighbours=128, bandwidth=0.4, angle_floor=radians(0.25), place_floor=0.002
    )
    default_features: ClassVar[FeatureSettings] = FeatureSettings()

    def __init__(self, library: MotionLibrary, layout: SensorLayout, **rest: Any) -> None:
        super().__init__(library, layout, **rest)
        if not isinstance(self.model, FilterModel):
            raise MethodError(
                f"the local filter cannot run a {type(self.model).__name__}", remedy="Give it a FilterModel"
            )
        self._filter = self.model

    def next_prior(self, state: TrackerState, previous: Floats[Array, "dofs"], view: BoneView) -> GaussianPrior:
        """See `TrackerMethod.next_prior`."""
        near = self._near(state, previous, view, 0.0)
        mean, covariance = self._filter.predict(near)
        known = root_turned(state.covariance, _kernels.root_heading(state.history[0]))
        carried = self._filter.carry(known, near.moved, near.weights)
        return self._filter.joined(carried, GaussianPrior(mean, covariance + np.diag(self._floor(len(mean)))))
