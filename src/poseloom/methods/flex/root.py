"""Where the hips are: turned as an IMU on them says, carried by the legs that stand; without an IMU only their height.

Four bends say nothing of how the hips are turned, and the flex paper borrows that from the truth. Here one IMU on the
hips tells it (VQF, Laidig and Seel 2023, without a magnetometer: the heading is relative to the first sample and may
drift). The root's path comes from the legs, what stands on the floor stays where it is, and from how the hips bob.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from poseloom.arrays import Array, Floats, Ints, frozen_float
from poseloom.errors import MethodError
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.methods.flex.hips import GRAVITY, HipsTurn, turn_hips
from poseloom.methods.flex.stride import NO_STRIDE, Stride, StrideSettings, follow_stride, stepping, walking_speed
from poseloom.rotations import heading_angle, heading_matrix, nearest_branch, quat_from_matrix, rotvec_from_matrix
from poseloom.sensors import Placement, Sample, SensorKind, SensorLayout
from poseloom.skeleton.contacts import sole_points
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.skeleton import Skeleton

Inner = TypeVar("Inner")


@dataclass(frozen=True)
class RootSettings:
    """How the root is carried.

    Attributes:
        softness_m: Points of the soles share the standing by `exp(-height / softness)`: no step when one takes over ...
        softness_m_s: ... and by how far the root's speed that each tells lies from the last one (Gaussian): near the
            floor a swinging foot is told from a standing one by that.
        speed_s: Time constant of the root's speed, seconds.
        tilt_rad: Spread of the hips' tilt with an IMU.
        heading_rad: Spread of their heading with an IMU, at first ...
        heading_rad_s: ... and by how much it grows a second.
        height_m: Spread of the root's height: feet are taken to stand on a level floor.
        path_share: Spread of the root's place as a share of the way walked.
        upright_s: Seconds for which the hips are taken to have stood upright before the first sample.
        unobserved_rad: Spread of the hips' turn without an IMU.
        unobserved_m: Spread of the root's place without an IMU.
        most_longer: Steps are at most this many times as long as the legs tell: who moves his legs and tells of no way
            stays where he is.
        stride: When bobbing hips are taken for walking.
    """

    softness_m: float = 0.015
    softness_m_s: float = 0.3
    speed_s: float = 0.1
    tilt_rad: float = 0.06
    heading_rad: float = 0.05
    heading_rad_s: float = 0.002
    height_m: float = 0.05
    path_share: float = 0.5
    upright_s: float = 0.4
    unobserved_rad: float = 1.0
    unobserved_m: float = 3.0
    most_longer: float = 2.5
    stride: StrideSettings = field(default=StrideSettings())


class Sole(NamedTuple):
    """Left heel, left toe, right heel and right toe of a body.

    Attributes:
        bones: Index of the bone that carries each.
        locals: Its place in that bone's frame, metres.
    """

    bones: Ints[Array, "4"]
    locals: Floats[Array, "4 3"]


@dataclass(frozen=True, eq=False)
class RootState(Generic[Inner]):
    """What changes as samples come.

    Attributes:
        inner: The state of the method that tells the joints' angles.
        skeleton: The wearer's.
        sole: The four points of its soles.
        R_bone_sensor: How the IMU sits on the hips; None without one.
        turn: What it has told.
        soles: Places of the soles' four points relative to the root in the last frame, metres, world axes; None before.
        root: The root's place in the last frame.
        speed: How fast it goes on the level, smoothed, metres a second.
        time: Device time of the last frame, seconds.
        walked: Metres that it went, on the level.
        rotvec: The hips' rotation vector in the last frame: the next one stays on its branch.
        stride: How the hips bobbed and the thighs swung.
        ahead: How fast the legs said that it goes ahead, smoothed, metres a second.
    """

    inner: Inner
    skeleton: Skeleton
    sole: Sole
    R_bone_sensor: Floats[Array, "3 3"] | None
    turn: HipsTurn
    soles: Floats[Array, "4 3"] | None
    root: Floats[Array, "3"]
    speed: Floats[Array, "3"]
    time: float
    walked: float
    rotvec: Floats[Array, "3"]
    stride: Stride
    ahead: float


class OnItsFeet(Reconstructor[RootState[Inner]]):
    """A method that tells joint angles from flex sensors, put on its feet.

    With an IMU on the hips these turn as it says and the root goes where the standing soles leave it, and further ahead
    where bobbing hips say that the steps are longer than the legs told. Without one the hips stay upright and face
    ahead, only the height follows the lower foot, and the spread says that nothing else is known.

    Args:
        method: Tells the joints' angles; listens to flex sensors only.
        layout: These flex sensors, and perhaps an IMU on the hips.
        settings: How the root is carried.

    Raises:
        MethodError: if the layout has other sensors.
    """

    def __init__(
        self,
        method: Reconstructor[Inner],
        layout: SensorLayout,
        settings: RootSettings = RootSettings(),
    ) -> None:
        names = [layout.names[i] for i in layout.of_kind(SensorKind.FLEX)]
        imus = layout.of_kind(SensorKind.IMU)
        if names != list(method.layout.names) or len(names) + len(imus) != len(layout):
            raise MethodError(
                f"the method listens to the layout {method.layout.name!r}, the recording has {layout.name!r}",
                remedy="Choose flex-four or flex-four+hips-imu",
            )
        if len(imus) > 1 or any(layout.sensors[i].bone != "hips" for i in imus):
            raise MethodError(f"layout {layout.name!r} has other IMUs than one on the hips", remedy="Leave them out")
        self.method, self.layout, self.settings = method, layout, settings
        self.delay, self.any_rate = method.delay, method.any_rate
        self._flex = list(layout.of_kind(SensorKind.FLEX))
        self._imu = imus[0] if imus else None

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> RootState[Inner]:
        """The state before the first sample."""
        return RootState(
            self.method.start(skeleton, [placements[i] for i in self._flex]),
            skeleton,
            _sole(skeleton),
            None if self._imu is None else placements[self._imu].R_bone_sensor,
            HipsTurn(None, 0.0, np.eye(3), 0.0, 0.0),
            None,
            np.zeros(3),
            np.zeros(3),
            0.0,
            0.0,
            np.zeros(3),
            NO_STRIDE,
            0.0,
        )

    def step(self, state: RootState[Inner], sample: Sample) -> tuple[RootState[Inner], Frame | None]:
        """Takes in one sample; changes neither argument."""
        inner, frame = self.method.step(state.inner, _part(sample, self._flex))
        turn, silent = state.turn, False
        if self._imu is not None and state.R_bone_sensor is not None:
            turn = turn_hips(state.turn, sample, self._imu, state.R_bone_sensor, self.settings.upright_s)
            silent = turn is state.turn
        state = replace(state, inner=inner, turn=turn)
        if frame is None:
            return state, None
        if not silent:
            state = self._followed(state, sample, frame.pose, frame.time)
        state, pose = self._placed(state, frame.pose, frame.time)
        health = _with_hips(frame.health, self.layout.names[self._imu]) if self._imu is not None and silent else None
        return state, replace(frame, pose=pose, spread=self._spread(state, frame.spread), health=health or frame.health)

    def _followed(self, state: RootState[Inner], sample: Sample, pose: Pose, time: float) -> RootState[Inner]:
        """With what the hips' bobbing and the thighs' swing tell of the steps."""
        if self._imu is None or state.R_bone_sensor is None:
            return state
        force = state.turn.R_world_hips @ state.R_bone_sensor @ sample.specific_forces[self._imu]
        thighs = pose.q[3:].reshape(-1, 3)[_thighs(state.skeleton), 0]
        since = max(time - state.time, 0.0) if state.soles is not None else 0.0
        stride = follow_stride(state.stride, since, float(force[1]) - GRAVITY, -thighs, self.settings.stride)
        return replace(state, stride=stride)

    def _placed(self, state: RootState[Inner], pose: Pose, time: float) -> tuple[RootState[Inner], Pose]:
        """The pose with its hips turned and its root where the soles leave it."""
        turned = rotvec_from_matrix(state.turn.R_world_hips)
        rotvec = nearest_branch(turned[None], state.rotvec[None])[0]
        q = pose.q.copy()
        q[:3], q[3:6] = 0.0, rotvec
        soles = _places(state.skeleton, state.sole, q)
        root, speed, ahead = state.root.copy(), state.speed, state.ahead
        heights = soles[:, 1] - soles[:, 1].min()
        standing = np.exp(-heights / self.settings.softness_m)
        step = time - state.time
        if self._imu is not None and state.soles is not None and step > 0:
            ways = state.soles - soles
            ways[:, 1] = 0.0
            off = np.linalg.norm(ways / step - speed, axis=1) / self.settings.softness_m_s
            standing *= np.exp(-0.5 * (off - off.min()) ** 2)
            way = standing @ ways / standing.sum()
            speed = speed + (way / step - speed) * -np.expm1(-step / self.settings.speed_s)
            front = level_front(state.turn.R_world_hips)
            taken = -np.expm1(-step / self.settings.stride.average_s)
            ahead += (float(way @ front) / step - ahead) * float(taken)
            root += way + self._lacking(state, ahead) * step * front
        standing /= standing.sum()
        root[1] = -(standing @ soles[:, 1])
        walked = state.walked + float(np.hypot(root[0] - state.root[0], root[2] - state.root[2]))
        q[:3] = root
        after = replace(
            state, soles=soles, root=root, speed=speed, time=time, walked=walked, rotvec=rotvec, ahead=ahead
        )
        return after, Pose(state.skeleton, frozen_float(q))

    def _lacking(self, state: RootState[Inner], ahead: float) -> float:
        """How much faster the hips go ahead than the legs tell, metres a second; negative where they go backwards."""
        settings = self.settings.stride
        speed = stepping(state.stride, settings) * walking_speed(state.stride, _leg_m(state.skeleton), settings)
        lacking = min(max(speed - abs(ahead), 0.0), (self.settings.most_longer - 1) * abs(ahead))
        return math.copysign(lacking, ahead)

    def _spread(self, state: RootState[Inner], spread: Floats[Array, "dofs"]) -> Floats[Array, "dofs"]:
        settings, told = self.settings, spread.copy()
        if self._imu is None:
            told[:6] = [settings.unobserved_m, settings.height_m, settings.unobserved_m, *3 * [settings.unobserved_rad]]
            return frozen_float(told)
        path = 0.02 + settings.path_share * state.walked
        heading = settings.heading_rad + settings.heading_rad_s * state.turn.since
        told[:6] = [path, settings.height_m, path, settings.tilt_rad, heading, settings.tilt_rad]
        return frozen_float(told)


def level_front(R_world_hips: Floats[Array, "3 3"]) -> Floats[Array, "3"]:
    """Where the hips face on the level, a unit vector."""
    return heading_matrix(heading_angle(quat_from_matrix(R_world_hips)))[:, 2]


def _thighs(skeleton: Skeleton) -> list[int]:
    return [skeleton.index(f"{side}UpperLeg") for side in ("left", "right")]


def _leg_m(skeleton: Skeleton) -> float:
    return sum(float(np.linalg.norm(skeleton.offsets[skeleton.index(f"left{bone}")])) for bone in ("LowerLeg", "Foot"))


def _sole(skeleton: Skeleton) -> Sole:
    feet = [(side, sole_points(skeleton, side)) for side in ("left", "right")]
    bones = [skeleton.index(f"{side}{bone}") for side, _ in feet for bone in ("Foot", "Toes")]
    return Sole(np.array(bones, dtype=np.int64), np.stack([point for _, points in feet for point in points]))


def _places(skeleton: Skeleton, sole: Sole, q: Floats[Array, "dofs"]) -> Floats[Array, "4 3"]:
    """Where the points of the soles are in the world."""
    frames = forward_kinematics(skeleton, q)
    return frames.positions[sole.bones] + np.einsum("pij,pj->pi", frames.rotations[sole.bones], sole.locals)


def _part(sample: Sample, sensors: list[int]) -> Sample:
    """What some of the sensors say."""
    return Sample(
        sample.time,
        sample.arrival,
        sample.positions[sensors],
        sample.quats_wxyz[sensors],
        sample.specific_forces[sensors],
        sample.angular_rates[sensors],
        sample.counts[sensors],
        sample.status[sensors],
    )


def _with_hips(health: Health, name: str) -> Health:
    state = HealthState.DEGRADED if health.state is HealthState.OK else health.state
    return Health(state, (*health.sensors, name))


def on_its_feet(method: Reconstructor[Any], layout: SensorLayout) -> Reconstructor[Any]:
    """A method that listens to flex sensors only, put on its feet for a layout that has them; any other as it is.

    Raises:
        MethodError: for a layout that has other flex sensors, or other sensors besides than an IMU on the hips.
    """
    if len(method.layout.of_kind(SensorKind.FLEX)) < len(method.layout):
        return method
    return OnItsFeet(method, layout)
