"""Methods that ask a motion library: the nearest moments, a local model of them, and the solver."""

import enum
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints
from poseloom.errors import MethodError
from poseloom.library import MotionLibrary
from poseloom.library.features import FeatureSettings
from poseloom.library.index import Exclusion, MomentIndex
from poseloom.methods.trackers import _kernels
from poseloom.methods.trackers.local_models import GaussianModel, LocalModel, Neighbourhood
from poseloom.methods.trackers.loop import TrackerMethod, TrackerState
from poseloom.methods.trackers.observation import predicted_view, view_of
from poseloom.methods.trackers.standing import standing_pose
from poseloom.methods.trackers.state import BoneView, TrackerSettings, Wearer
from poseloom.rotations import heading_angle, nearest_branch, quat_from_matrix
from poseloom.sensors import SensorLayout
from poseloom.solve import GaussianPrior, SensorReadings


@dataclass(frozen=True)
class NeighbourSettings:
    """How neighbours are chosen, weighed and made into a prior.

    Attributes:
        neighbours: How many (K in the paper).
        bandwidth: Width of the Gaussian weights in units of the neighbours' root mean square distance; infinity weighs
            all alike, as the paper does.
        angle_floor: Least standard deviation of a predicted angle, radians.
        place_floor: Least standard deviation of the predicted root place, metres.
        persistence: How far a neighbour says "move as I moved" rather than "be where I am", 0 to 1.
        margin: How far beyond the neighbours' range a prediction may go, as a share of that range.
        first_floor: Standard deviation added for the first pose, radians and metres.
    """

    neighbours: int = 128
    bandwidth: float = 1.0
    angle_floor: float = np.deg2rad(1.0)
    place_floor: float = 0.005
    persistence: float = 0.2
    margin: float = 0.1
    first_floor: float = 0.1


class Query(enum.StrEnum):
    """What the search and the regression look at besides the last poses."""

    HISTORY = "history"
    HISTORY_AND_SENSORS = "history+sensors"


class NeighbourMethod(TrackerMethod):
    """Full-body motion from trackers by a local model of the nearest moments of a motion library.

    Source: the six-sensor paper, sections 5 and 6; its slips mended as `docs/derivations.md` says. Departures: the
    search and the model may see the present sensor signal; the prior may keep the covariance of the joints; the first
    pose is found from the sensors, never given.

    Args:
        library: Where the neighbours come from; its rate must be the layout's.
        layout: The trackers.
        model: The local model; the class's own unless given, as with the next two.
        neighbours: How neighbours are chosen and weighed.
        query: What the search looks at.
        settings: What all tracker methods share.
        allowed: Mask over the library's poses: False for those that must not be used (a left-out take). None: those
            that the library itself allows.
        features: How moments are described, the class's own unless given; bones and query are filled in.
    """

    default_model: ClassVar[LocalModel] = GaussianModel()
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings()
    default_query: ClassVar[Query] = Query.HISTORY_AND_SENSORS
    default_features: ClassVar[FeatureSettings] = FeatureSettings(history=3)

    def __init__(
        self,
        library: MotionLibrary,
        layout: SensorLayout,
        *,
        model: LocalModel | None = None,
        neighbours: NeighbourSettings | None = None,
        query: Query | None = None,
        settings: TrackerSettings | None = None,
        allowed: Bools[Array, "poses"] | None = None,
        features: FeatureSettings | None = None,
    ) -> None:
        if abs(library.rate - layout.rate) > 1e-6:
            raise MethodError(
                f"the library has {library.rate:g} poses a second, the layout {layout.name!r} {layout.rate:g}",
                cause="a local model predicts over exactly one sample",
                remedy="Build a library at the sensors' rate (library build --rate), or record at the library's",
            )
        super().__init__(layout, settings)
        self.model = model or self.default_model
        self.neighbours = neighbours or self.default_neighbours
        self.query = query or self.default_query
        self.features = replace(
            features or self.default_features,
            sensor_bones=tuple(sensor.bone for sensor in layout.sensors),
            by_sensors=self.query is Query.HISTORY_AND_SENSORS,
        )
        self._index: MomentIndex = library.moments(self.features)
        self._poses: Floats32[Array, "poses dofs"] = np.asarray(library.poses)
        usable = library.allowed if allowed is None else allowed
        self._exclusion: Exclusion | None = None if usable is None else self._index.exclusion(usable)

    @property
    def moments(self) -> int:
        """See `TrackerMethod.moments`."""
        return self.features.history

    def next_prior(self, state: TrackerState, previous: Floats[Array, "dofs"], view: BoneView) -> GaussianPrior:
        """See `TrackerMethod.next_prior`."""
        return self._prior(self._near(state, previous, view, self.neighbours.persistence))

    def _near(
        self, state: TrackerState, previous: Floats[Array, "dofs"], view: BoneView, persistence: float
    ) -> Neighbourhood:
        """The moments nearest to the present one."""
        query = self._query(state, view)
        found, _ = self._index.search(query, self.neighbours.neighbours, self._exclusion)
        self._check(found)
        outputs, moved = np.empty((2, len(found), len(previous)))
        rows = self._index.rows[found]
        _kernels.gather_outputs(self._poses, rows, previous, state.wearer.scale, persistence, outputs, moved)
        inputs = self._index.columns[found, : len(query)].astype(np.float64)
        return Neighbourhood(query, inputs, outputs, moved, self._weights(inputs, query), previous)

    def _query(self, state: TrackerState, view: BoneView) -> Floats[Array, "columns"]:
        """Projected features of the present moment; at the start the oldest pose stands for those before it."""
        history = state.history[: self.moments]
        history = np.concatenate([history, np.repeat(history[-1:], self.moments - len(history), axis=0)])
        history[:, :3] /= state.wearer.scale
        columns = self._index.history(self._index.features.history(history))
        if self.query is Query.HISTORY:
            return columns
        return np.concatenate([columns, self._sensor_columns(state.wearer, view)])

    def _check(self, found: Ints[Array, "neighbours"]) -> None:
        if len(found) < 2:
            raise MethodError(
                "the library has no motion left to learn from",
                cause="everything in it is left out, or it is nearly empty",
                remedy="Add motions to the library, or leave out less",
            )

    def _weights(
        self, inputs: Floats[Array, "neighbours columns"], query: Floats[Array, "columns"]
    ) -> Floats[Array, "neighbours"]:
        squares = ((inputs - query) ** 2).sum(axis=1)
        width = self.neighbours.bandwidth**2 * float(squares.mean()) + 1e-12
        weights = np.exp(-0.5 * (squares - squares.min()) / width)
        return weights / weights.sum()

    def _prior(self, near: Neighbourhood) -> GaussianPrior:
        mean, covariance = self.model.predict(near)
        low, high = near.outputs.min(axis=0), near.outputs.max(axis=0)
        slack = self.neighbours.margin * (high - low)
        return GaussianPrior(np.clip(mean, low - slack, high + slack), covariance + np.diag(self._floor(len(mean))))

    def _floor(self, size: int) -> Floats[Array, "dofs"]:
        """Least variance of what a model says of each entry."""
        floor = np.full(size, self.neighbours.angle_floor**2)
        floor[:3] = self.neighbours.place_floor**2
        return floor

    def _sensor_columns(self, wearer: Wearer, view: BoneView) -> Floats[Array, "columns"]:
        """Projected sensor features of a view."""
        return self._index.sensors(self._index.features.sensors(view.points / wearer.scale, view.rotations))

    def first_prior(self, wearer: Wearer, readings: SensorReadings) -> GaussianPrior:
        """See `TrackerMethod.first_prior`: the neighbours by the sensors alone, put where the sensors are."""
        standing = standing_pose(wearer, readings)
        target = view_of(wearer, readings, predicted_view(wearer, standing))
        columns = self._sensor_columns(wearer, target)
        found, distances = self._index.search_sensors(columns, self.neighbours.neighbours, self._exclusion)
        self._check(found)
        poses = np.stack([self._placed(wearer, int(row), target, standing) for row in self._index.rows[found]])
        weights = np.exp(-0.5 * (distances - distances.min()) / (float(distances.mean()) + 1e-12))
        weights /= weights.sum()
        mean = weights @ poses
        centred = np.sqrt(weights)[:, None] * (poses - mean)
        return GaussianPrior(mean, centred.T @ centred + np.eye(len(mean)) * self.neighbours.first_floor**2)

    def _placed(
        self, wearer: Wearer, row: int, target: BoneView, reference: Floats[Array, "dofs"]
    ) -> Floats[Array, "dofs"]:
        """A library pose on the wearer, its reference bone above the target's ground point and along its heading."""
        q = self._poses[row].astype(np.float64)
        q[:3] *= wearer.scale
        own, sensor = predicted_view(wearer, q), wearer.reference
        heading = float(heading_angle(quat_from_matrix(own.rotations[sensor])))
        wanted = float(heading_angle(quat_from_matrix(target.rotations[sensor])))
        out = np.empty_like(q)
        x, z = float(own.points[sensor, 0]), float(own.points[sensor, 2])
        _kernels.into_heading(q, x, z, heading - wanted, out)
        out[0] += target.points[sensor, 0]
        out[2] += target.points[sensor, 2]
        out[3:] = nearest_branch(out[3:].reshape(-1, 3), reference[3:].reshape(-1, 3)).ravel()
        return out
