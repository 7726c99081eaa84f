"""The loop of every tracker method: predict, solve, judge. Methods differ in the prediction alone."""

import abc
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import MethodError
from poseloom.library.features import feature_points, reference_sensor
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.methods.trackers import _kernels
from poseloom.methods.trackers.observation import BoneView, heard, observe, plausible_view, turned
from poseloom.methods.trackers.state import TrackerSettings, TrackerState, Wearer
from poseloom.rotations import nearest_branch
from poseloom.sensors import Placement, Sample, SensorKind, SensorLayout
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.retarget import leg_length
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import GaussianPrior, SensorReadings, Solution, mount, solve_pose

_DISBELIEVED = 0.3
"""Robust weight below which a reading counts as disbelieved."""


@dataclass(frozen=True)
class _View:
    """The ground point and heading from which a step is solved: those of the newest pose."""

    x: float
    z: float
    heading: float


class TrackerMethod(Reconstructor[TrackerState], abc.ABC):
    """Full-body motion from trackers: position and orientation of any subset of a layout's sensors.

    Each step is solved in the heading frame of the newest pose, where a regression needs to know neither the place in
    the room nor the way the wearer faces.

    Attributes:
        layout: The trackers.
        settings: What all tracker methods share.
        delay: None.
    """

    def __init__(self, layout: SensorLayout, settings: TrackerSettings | None = None) -> None:
        if any(sensor.kind is not SensorKind.TRACKER for sensor in layout.sensors):
            raise MethodError(
                f"the layout {layout.name!r} is not of trackers alone",
                remedy="Choose a layout of trackers, or a method for its sensors",
            )
        self.layout = layout
        self.delay = 0
        self.settings = settings or TrackerSettings()
        self._sigmas = np.tile(
            [self.settings.sigma_position, self.settings.sigma_orientation], (len(layout.sensors), 1)
        )

    @abc.abstractmethod
    def first_prior(self, wearer: Wearer, readings: SensorReadings) -> GaussianPrior:
        """What is believed before there is a history, in the world."""

    @abc.abstractmethod
    def next_prior(self, state: TrackerState, previous: Floats[Array, "dofs"], view: BoneView) -> GaussianPrior:
        """What is believed of the next pose, in the heading frame of the newest.

        Args:
            state: The state before the sample.
            previous: The newest pose in its own heading frame.
            view: Where the sensors put their bones now, in the world; what one does not say is guessed.
        """

    @property
    def moments(self) -> int:
        """Poses that the state must remember."""
        return 1

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> TrackerState:
        """See `Reconstructor.start`."""
        if skeleton.names != BODY_BONES:
            raise MethodError(
                "tracker methods move the 22-bone body, and this skeleton is another",
                remedy="Retarget the wearer's skeleton to the body first",
            )
        bones = [placement.bone for placement in placements]
        if bones != [sensor.bone for sensor in self.layout.sensors]:
            raise MethodError(
                f"the placements are on {', '.join(bones)}; the layout {self.layout.name!r} has its sensors elsewhere",
                remedy="Give one placement for each sensor of the layout, in its order",
            )
        body = average_body()
        wearer = Wearer(
            skeleton,
            mount(skeleton, placements),
            reference_sensor(bones),
            feature_points(skeleton, bones),
            leg_length(skeleton) / leg_length(body),
        )
        return TrackerState(wearer, np.empty((0, body.size)), np.zeros(body.size))

    def step(self, state: TrackerState, sample: Sample) -> tuple[TrackerState, Frame | None]:
        """See `Reconstructor.step`. No frame comes until a sensor has spoken."""
        readings = observe(sample, self._sigmas)
        said = heard(readings)
        if len(state.history) == 0 or (state.astray >= self.settings.misfit_frames and said.any()):
            if not said.any():
                return state, None
            solution = self._solve(state.wearer, readings, self.first_prior(state.wearer, readings))
            q, spread = self._on_branch(state, solution.q), solution.spread
            history = q[None]
        else:
            solution, q = self._continue(state, readings)
            spread = solution.spread
            history = np.concatenate([q[None], state.history[: self.moments - 1]])
        following = TrackerState(
            state.wearer,
            history,
            spread,
            0 if said.any() else state.silent + 1,
            state.astray + 1 if self._is_astray(solution, said) else 0,
        )
        return following, Frame(
            sample.time, Pose(state.wearer.skeleton, q), spread, self._health(following, solution, said)
        )

    def _continue(self, state: TrackerState, readings: SensorReadings) -> tuple[Solution, Floats[Array, "dofs"]]:
        newest = state.history[0]
        view = _View(float(newest[0]), float(newest[2]), _kernels.root_heading(newest))
        previous = np.empty_like(newest)
        _kernels.into_heading(newest, view.x, view.z, view.heading, previous)
        local = turned(readings, view.x, view.z, view.heading)
        guess = plausible_view(state.wearer, readings, newest, self.settings)
        solution = self._solve(state.wearer, local, self.next_prior(state, previous, guess))
        q = np.empty_like(newest)
        _kernels.into_heading(solution.q, 0.0, 0.0, -view.heading, q)
        q[0] += view.x
        q[2] += view.z
        return solution, self._on_branch(state, q)

    def _solve(self, wearer: Wearer, readings: SensorReadings, prior: GaussianPrior) -> Solution:
        return solve_pose(wearer.skeleton, wearer.mount, readings, prior, settings=self.settings.solver)

    def _on_branch(self, state: TrackerState, q: Floats[Array, "dofs"]) -> Floats[Array, "dofs"]:
        """The pose with its root on the branch of the newest one's; the joints' outputs are there already."""
        if len(state.history) == 0:
            return q
        out = q.copy()
        for at in range(3, len(q), 3):
            out[at : at + 3] = nearest_branch(q[at : at + 3], state.history[0, at : at + 3])
        return out

    def _is_astray(self, solution: Solution, said: Bools[Array, "sensors 2"]) -> bool:
        """Whether the median sensor that speaks is far from where the pose puts it."""
        misses = np.linalg.norm(solution.residuals, axis=-1)
        bounds = (self.settings.misfit_position, self.settings.misfit_orientation)
        return any(
            said[:, kind].any() and float(np.median(misses[said[:, kind], kind])) > bounds[kind] for kind in range(2)
        )

    def _health(self, state: TrackerState, solution: Solution, said: Bools[Array, "sensors 2"]) -> Health:
        if state.silent:
            lost = state.silent > self.settings.lost_after * self.layout.rate
            return Health(HealthState.LOST if lost else HealthState.COASTING, self._names(~said.any(axis=1)))
        troubled = ~said.any(axis=1) | (said & (solution.weights < _DISBELIEVED)).any(axis=1)
        return Health(HealthState.DEGRADED if troubled.any() else HealthState.OK, self._names(troubled))

    def _names(self, chosen: Bools[Array, "sensors"]) -> tuple[str, ...]:
        return tuple(sensor.name for sensor, yes in zip(self.layout.sensors, chosen, strict=True) if yes)
