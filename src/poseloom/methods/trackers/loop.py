"""The loop of every tracker method: predict, solve, judge. Methods differ in the prediction alone."""

import abc
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import MethodError
from poseloom.library.features import feature_points, reference_sensor
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor, check_wearer
from poseloom.methods.gliding import Glide, glide_to
from poseloom.methods.trackers import _kernels
from poseloom.methods.trackers.gate import Gated, Trust, gate, take_all
from poseloom.methods.trackers.observation import (
    BoneView,
    heard,
    observe,
    predicted_view,
    root_turned,
    turned,
    view_of,
)
from poseloom.methods.trackers.state import TrackerSettings, Wearer
from poseloom.sensors import Placement, Sample, SensorKind, SensorLayout
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.retarget import leg_length
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import GaussianPrior, SensorReadings, Solution, mount, solve_pose

_DISBELIEVED = 0.3
"""Robust weight below which a reading counts as disbelieved."""

_AT_FIRST = 10.0
"""How much wider a wrong prediction of the first pose is made: any posture may be the first."""


@dataclass(frozen=True, eq=False)
class TrackerState:
    """What changes from sample to sample.

    Attributes:
        wearer: What does not.
        trust: How far each tracker is believed; None before the first has spoken.
        history: The last solved poses in the world, newest first; fewer than asked for at the start.
        covariance: Of the newest pose's entries, the root's place and turn in the world's axes.
        silent: Samples in a row in which no sensor spoke.
        astray: Samples in a row in which the sensors did not fit.
        glide: How what is shown follows `history`; None before the first pose.
    """

    wearer: Wearer
    trust: Trust | None
    history: Floats[Array, "moments dofs"]
    covariance: Floats[Array, "dofs dofs"]
    silent: int = 0
    astray: int = 0
    glide: Glide | None = None


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
        check_wearer("tracker methods move", self.layout, skeleton, placements)
        bones = [placement.bone for placement in placements]
        body = average_body()
        wearer = Wearer(
            skeleton,
            mount(skeleton, placements),
            reference_sensor(bones),
            feature_points(skeleton, bones),
            leg_length(skeleton) / leg_length(body),
        )
        return TrackerState(wearer, None, np.empty((0, body.size)), np.zeros((body.size, body.size)))

    def step(self, state: TrackerState, sample: Sample) -> tuple[TrackerState, Frame | None]:
        """See `Reconstructor.step`. No frame comes until a sensor has spoken."""
        spoken = observe(sample, self._sigmas)
        speaks = bool(heard(spoken).any())
        if state.trust is None and not speaks:
            return state, None
        anew = speaks and self._lost_track(state)
        if state.trust is None or anew:
            gated = take_all(spoken)
            solution = self._solve(state.wearer, spoken, self.first_prior(state.wearer, spoken), gated.taken, True)
            q = self._on_branch(state, solution.q)
            history, covariance = q[None], solution.covariance
        else:
            gated = gate(state.trust, spoken, state.wearer, state.history[0], self.settings.gate)
            solution, q, covariance = self._continue(state, gated)
            history = np.concatenate([q[None], state.history[: self.moments - 1]])
        skeleton = state.wearer.skeleton
        glide, shown = glide_to(state.glide, skeleton, q, sample.time, anew, self.settings.glide)
        following = TrackerState(
            state.wearer,
            gated.trust,
            history,
            covariance,
            0 if speaks else state.silent + 1,
            state.astray + 1 if self._is_astray(solution, gated.taken) else 0,
            glide,
        )
        health = self._health(following, solution, gated.taken)
        spread = solution.spread if glide.offset is None else np.hypot(solution.spread, shown - q)
        return following, Frame(sample.time, Pose(skeleton, shown), spread, health)

    def _lost_track(self, state: TrackerState) -> bool:
        """Whether the newest pose means nothing to the next: for long the sensors were silent, or did not fit it."""
        settings = self.settings
        return state.astray >= settings.misfit_frames or state.silent > settings.anew_after * self.layout.rate

    def _continue(
        self, state: TrackerState, gated: Gated
    ) -> tuple[Solution, Floats[Array, "dofs"], Floats[Array, "dofs dofs"]]:
        newest, readings = state.history[0], gated.readings
        view = _View(float(newest[0]), float(newest[2]), _kernels.root_heading(newest))
        previous = np.empty_like(newest)
        _kernels.into_heading(newest, view.x, view.z, view.heading, previous)
        local = turned(readings, view.x, view.z, view.heading)
        guess = view_of(state.wearer, readings, predicted_view(state.wearer, newest))
        solution = self._solve(state.wearer, local, self.next_prior(state, previous, guess), gated.taken)
        q = np.empty_like(newest)
        _kernels.into_heading(solution.q, 0.0, 0.0, -view.heading, q)
        q[0] += view.x
        q[2] += view.z
        return solution, self._on_branch(state, q), root_turned(solution.covariance, -view.heading)

    def _solve(
        self,
        wearer: Wearer,
        readings: SensorReadings,
        prior: GaussianPrior,
        taken: Bools[Array, "sensors 2"],
        first: bool = False,
    ) -> Solution:
        """The pose that fits prior and sensors.

        The robust solution takes a sensor that contradicts the prediction for wrong. But the gate took it, for it moves
        as a sound one does: so the prediction is wrong, and from there the pose is bent to fit all sensors. Where a few
        cannot be fitted, they contradict the others, and the robust solution says which.
        """
        skeleton, worn, how = wearer.skeleton, wearer.mount, self.settings.misfit
        robust = solve_pose(skeleton, worn, readings, prior, settings=self.settings.solver)
        if not (taken & (robust.weights < how.contradiction)).any():
            return robust
        near = GaussianPrior(robust.q, prior.covariance + np.diag(self._widening(len(prior.mean), first)))
        squares = replace(self.settings.solver, robust_scale=np.inf, iterations=how.iterations)
        bent = solve_pose(skeleton, worn, readings, near, settings=squares)
        bounds = np.array([how.impossible_position, how.impossible_orientation])
        missed = taken & ((bent.residuals**2).sum(axis=-1) > bounds**2)
        most = (2 * missed.sum(axis=0) > taken.sum(axis=0)).any()
        return robust if missed.any() and not most else bent

    def _widening(self, size: int, first: bool) -> Floats[Array, "dofs"]:
        variance = np.full(size, self.settings.misfit.widening_joint**2)
        variance[:6] = self.settings.misfit.widening_root**2
        return (_AT_FIRST**2 if first else 1.0) * variance

    def _on_branch(self, state: TrackerState, q: Floats[Array, "dofs"]) -> Floats[Array, "dofs"]:
        """The pose with its rotation vectors on the branches of the newest one's."""
        out = q.copy()
        if len(state.history):
            _kernels.nearest_branches_in_place(out, state.history[0])
        return out

    def _is_astray(self, solution: Solution, said: Bools[Array, "sensors 2"]) -> bool:
        """Whether most of the sensors that speak are far from where the pose puts them."""
        bounds = np.array([self.settings.misfit_position, self.settings.misfit_orientation])
        far = said & ((solution.residuals**2).sum(axis=-1) > bounds**2)
        return bool((2 * far.sum(axis=0) > said.sum(axis=0)).any())

    def _health(self, state: TrackerState, solution: Solution, said: Bools[Array, "sensors 2"]) -> Health:
        disbelieved = said & (solution.weights < _DISBELIEVED)
        troubled = tuple(
            sensor.name
            for sensor, heard_of, doubtful in zip(self.layout.sensors, said, disbelieved, strict=True)
            if doubtful.any() or not heard_of.any()
        )
        if state.silent:
            lost = state.silent > self.settings.lost_after * self.layout.rate
            return Health(HealthState.LOST if lost else HealthState.COASTING, troubled)
        if state.glide is not None and state.glide.offset is not None:
            return Health(HealthState.REJOINING, troubled)
        return Health(HealthState.DEGRADED if troubled else HealthState.OK, troubled)
