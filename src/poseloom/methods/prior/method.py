"""`sensor-prior`: the learnt prior, what sensors say added bone by bone, the root by contacts and learnt velocity."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import radians

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.methods.flex.hips import HipsTurn, turn_hips
from poseloom.methods.gliding import Glide, GlideSettings, glide_to
from poseloom.methods.prior.calibration import PriorCalibration
from poseloom.methods.prior.channels import RATE, SIX_BONES
from poseloom.methods.prior.gaussian import pose_gaussian, pose_vector
from poseloom.methods.prior.model_file import shipped_prior
from poseloom.methods.prior.network import PriorEstimate, PriorNetwork
from poseloom.methods.prior.root import RootCarrier, RootSettings, RootState
from poseloom.methods.prior.running import PriorRunner, PriorState
from poseloom.rotations import matrix_from_quat, quat_from_matrix
from poseloom.sensors import Placement, Sample, SensorKind, SensorLayout
from poseloom.sensors.flex_range import FlexRange, FlexRangeState
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import SensorMount, SensorReadings, Solution, SolverSettings, mount, solve_pose

_FULL_BEND = 2.3
"""Radians of a joint at the end of a flex sensor's range: a knee or elbow bent as far as it goes."""


@dataclass(frozen=True)
class PriorSettings:
    """How the prior and the sensors are joined.

    Attributes:
        tracker_position: Standard deviation of a tracker's position, metres.
        tracker_orientation: That of its orientation, radians.
        imu_orientation: That of a worn IMU's orientation, each axis.
        forearm_orientation: The same on a forearm or hand, whose skin twists.
        root: How the root is carried where no position is measured.
        solver: How the pose is solved for.
        glide: How the figure follows where the estimate leaps.
        lost_after: Seconds of silence of all sensors after which the pose means little.
    """

    tracker_position: float = 0.003
    tracker_orientation: float = radians(0.5)
    imu_orientation: float = radians(8.0)
    forearm_orientation: float = radians(12.0)
    root: RootSettings = field(default=RootSettings())
    solver: SolverSettings = field(default=SolverSettings())
    glide: GlideSettings = field(default=GlideSettings())
    lost_after: float = 2.0


@dataclass(frozen=True, eq=False)
class Worn:
    """What stays the same from the first sample to the last."""

    skeleton: Skeleton
    mount: SensorMount
    runner: PriorRunner
    carrier: RootCarrier


@dataclass(frozen=True, eq=False)
class SensorPriorState:
    """What changes as samples come.

    Attributes:
        worn: What does not.
        prior: Of the network.
        ranges: Of the flex sensors; None without any.
        turns: Of each IMU that gives no orientation: what is known of it from its rates and forces.
        q: The newest estimate; None before the first.
        root: Of the root.
        time: Device time of the last sample.
        silent: Samples for which all sensors are missing.
        spoken: Which sensors have ever measured.
        glide: Of what is shown.
    """

    worn: Worn
    prior: PriorState
    ranges: FlexRangeState | None
    turns: tuple[HipsTurn, ...]
    q: Floats[Array, "dofs"] | None = None
    root: RootState | None = None
    time: float = 0.0
    silent: int = 0
    spoken: Bools[Array, "sensors"] | None = None
    glide: Glide | None = None


class SensorPrior(Reconstructor[SensorPriorState]):
    """Full-body motion from any subset of trackers, IMUs and flex sensors, of people never seen.

    An IMU that gives no orientation is oriented here by its rates and forces (VQF, 6D), and its bone is taken to face
    ahead at its first sample; that drifts, and a calibration is better.

    Args:
        layout: The sensors; the method runs at 40 samples a second whatever the layout's rate.
        network: The network; the shipped one that fits if left out.
        settings: How prior and sensors are joined.
        calibration: What a calibration pose showed.

    Raises:
        MethodError: if the network can receive none of the sensors.
    """

    def __init__(
        self,
        layout: SensorLayout,
        network: PriorNetwork | None = None,
        settings: PriorSettings | None = None,
        calibration: PriorCalibration | None = None,
    ) -> None:
        self.layout = replace(layout, rate=RATE)
        self.delay = 0
        self.network = network or shipped_prior("six" if _is_six(layout) else "any")
        self.settings = settings or PriorSettings()
        self.calibration = calibration
        self._flex = FlexRange()
        self._flexes = list(layout.of_kind(SensorKind.FLEX))
        self._sigmas = np.array([self._sigma(sensor.kind, sensor.bone) for sensor in layout.sensors])

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> SensorPriorState:
        """See `Reconstructor.start`."""
        runner = PriorRunner(self.network, self.layout, skeleton, placements, self.calibration)
        worn = Worn(skeleton, mount(skeleton, placements), runner, RootCarrier(skeleton, self.settings.root))
        ranges = self._flex.start(len(self._flexes)) if self._flexes else None
        turns = tuple(HipsTurn(None, 0.0, np.eye(3), 0.0, 0.0) for _ in self.layout.sensors)
        return SensorPriorState(worn, runner.start(), ranges, turns, spoken=np.zeros(len(self.layout), dtype=np.bool_))

    def step(self, state: SensorPriorState, sample: Sample) -> tuple[SensorPriorState, Frame | None]:
        """See `Reconstructor.step`. No frame comes until a sensor has measured."""
        measured = _measured(sample)
        if state.q is None and not measured.any():
            return state, None
        turns, sample = self._oriented(state, sample)
        ranges, bends = self._bends(state, sample)
        prior, estimate = state.worn.runner.step(state.prior, sample, bends)
        if state.silent and not measured.any() and state.q is not None:
            estimate = _held(state, estimate)
        q, root, solution = self._join(state, sample, estimate)
        assert state.spoken is not None
        changed = bool((measured & ~state.spoken).any()) and state.q is not None
        back = bool(state.silent) and bool(measured.any())
        switched = prior.intake.reference != state.prior.intake.reference and state.q is not None
        skeleton = state.worn.skeleton
        troubled = changed or back or switched or not measured.all()
        glide, shown = glide_to(state.glide, skeleton, q, sample.time, troubled, self.settings.glide)
        following = SensorPriorState(
            state.worn,
            prior,
            ranges,
            turns,
            q,
            root,
            sample.time,
            0 if measured.any() else state.silent + 1,
            state.spoken | measured,
            glide,
        )
        spread = solution.spread if glide.offset is None else np.hypot(solution.spread, shown - q)
        return following, Frame(sample.time, Pose(skeleton, shown), spread, self._health(following, measured))

    def _sigma(self, kind: SensorKind, bone: str) -> tuple[float, float]:
        how = self.settings
        if kind is SensorKind.TRACKER:
            return how.tracker_position, how.tracker_orientation
        twisted = bone.endswith(("LowerArm", "Hand"))
        return 1.0, how.forearm_orientation if twisted else how.imu_orientation

    def _oriented(self, state: SensorPriorState, sample: Sample) -> tuple[tuple[HipsTurn, ...], Sample]:
        """The sample with orientations of IMUs that give none themselves."""
        turns, quats = list(state.turns), sample.quats_wxyz
        for index in self.layout.of_kind(SensorKind.IMU):
            if np.isfinite(sample.quats_wxyz[index, 0]) or not np.isfinite(sample.angular_rates[index, 0]):
                continue
            R_bone_sensor = state.worn.mount.R_bone_sensor[index]
            turns[index] = turn_hips(turns[index], sample, index, R_bone_sensor)
            if turns[index].filter is not None:
                quats = quats.copy()
                quats[index] = quat_from_matrix(turns[index].R_world_hips @ R_bone_sensor)
        return tuple(turns), replace(sample, quats_wxyz=quats)

    def _bends(
        self, state: SensorPriorState, sample: Sample
    ) -> tuple[FlexRangeState | None, Floats[Array, "sensors"] | None]:
        if state.ranges is None:
            return None, None
        ranges, readings = self._flex.step(state.ranges, sample.time, sample.counts[self._flexes])
        bends = np.full(len(self.layout), np.nan)
        bends[self._flexes] = _FULL_BEND * readings.values
        return ranges, bends

    def _join(
        self, state: SensorPriorState, sample: Sample, estimate: PriorEstimate
    ) -> tuple[Floats[Array, "dofs"], RootState, Solution]:
        """The pose that agrees best with the prior and the sensors, and the root."""
        worn = state.worn
        at_origin = pose_vector(worn.skeleton, estimate.rotations, np.zeros(3), state.q)
        frames = forward_kinematics(worn.skeleton, at_origin)
        soles = worn.carrier.soles(frames.positions, frames.rotations)
        if state.root is None:
            root = worn.carrier.start(soles)
        else:
            seconds = min(max(sample.time - state.time, 1e-3), 1.0)
            root = worn.carrier.step(state.root, soles, estimate.contacts, estimate.velocity, seconds)
        positioned = np.isfinite(sample.positions[:, 0])
        if state.root is None and positioned.any():
            first = int(np.flatnonzero(positioned)[0])
            bone = worn.mount.bones[first]
            point = frames.positions[bone] + frames.rotations[bone] @ worn.mount.p_bone_sensor[first]
            root = replace(root, place=sample.positions[first] - point)
        at_origin[:3] = root.place
        sigma = np.full(3, 0.1) if positioned.any() else worn.carrier.sigma(root)
        prior = pose_gaussian(worn.skeleton, at_origin, estimate.rotations, estimate.sigma, sigma)
        readings = SensorReadings(sample.positions, matrix_from_quat(sample.quats_wxyz), self._sigmas)
        solution = solve_pose(worn.skeleton, worn.mount, readings, prior, settings=self.settings.solver)
        if positioned.any():
            root = replace(root, place=solution.q[:3].copy())
        return solution.q, root, solution

    def _health(self, state: SensorPriorState, measured: Bools[Array, "sensors"]) -> Health:
        silent = tuple(name for name, there in zip(self.layout.names, measured, strict=True) if not there)
        if state.silent:
            lost = state.silent > self.settings.lost_after * self.layout.rate
            return Health(HealthState.LOST if lost else HealthState.COASTING, silent)
        if state.glide is not None and state.glide.offset is not None:
            return Health(HealthState.REJOINING, silent)
        return Health(HealthState.DEGRADED if silent else HealthState.OK, silent)


def _measured(sample: Sample) -> Bools[Array, "sensors"]:
    """Which sensors gave anything."""
    return (
        np.isfinite(sample.positions[:, 0])
        | np.isfinite(sample.quats_wxyz[:, 0])
        | np.isfinite(sample.specific_forces[:, 0])
        | np.isfinite(sample.counts)
    )


def _held(state: SensorPriorState, estimate: PriorEstimate) -> PriorEstimate:
    """While nothing is measured the last pose stands still, and grows doubtful."""
    assert state.q is not None
    rotations = forward_kinematics(state.worn.skeleton, state.q).rotations
    doubt = np.hypot(estimate.sigma, 0.02 * state.silent)
    return PriorEstimate(rotations, doubt, np.ones(4), np.zeros(3))


def _is_six(layout: SensorLayout) -> bool:
    """Whether the network for six IMUs serves this layout best."""
    imus = all(sensor.kind is SensorKind.IMU for sensor in layout.sensors)
    return imus and tuple(sorted(s.bone for s in layout.sensors)) == tuple(sorted(SIX_BONES))
