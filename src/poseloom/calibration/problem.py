"""What calibration minimises: sensors' readings in held poses, given sizes, placements, and the poses themselves.

The six-sensor paper's eq. 3 as a maximum a posteriori problem: its weight alpha and its two norms become standard
deviations, and the poses, which it takes as known, are unknown with a prior around the guided ones.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.calibration.body_size import BodySizeModel
from poseloom.calibration.soles import SoleModel, standing_feet
from poseloom.calibration.unknowns import CalibrationSettings, CalibrationState, HeldPoses
from poseloom.rotations import (
    left_jacobian,
    matrix_from_rotvec,
    right_jacobian,
    right_jacobian_inverse,
    rotvec_from_matrix,
)
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.kinematics import forward_kinematics, point_jacobians
from poseloom.solve.least_squares import Linearisation, Residuals

_UP = np.array([0.0, 1.0, 0.0])
_BLUR_M = 0.003
"""Metres within which heights are taken for equally low."""
_HINGE_RAD = np.radians(1.5)
"""Standard deviation of a turn about an axis about which a joint does not turn."""


def pose_sigmas(pose_rad: float) -> Floats[Array, "joints 3"]:
    """Standard deviations of joint angles about a guided pose, in each joint's own axes; the root's are of its tilt.

    Knees bend about X only, elbows bend (Y) and roll (X); toes stay.
    """
    sigmas = np.full((len(BODY_BONES), 3), pose_rad)
    for side in ("left", "right"):
        sigmas[BODY_BONES.index(f"{side}LowerLeg"), 1:] = _HINGE_RAD
        sigmas[BODY_BONES.index(f"{side}LowerArm"), 2] = _HINGE_RAD
        sigmas[BODY_BONES.index(f"{side}Toes")] = _HINGE_RAD
    return sigmas


class _MovingPoints(NamedTuple):
    """Sensors, then sole points, in all holds: as `PointJacobians`, and their places by the size coefficients."""

    points: Floats[Array, "holds points 3"]
    rotations: Floats[Array, "holds points 3 3"]
    linear: Floats[Array, "holds points 3 dofs"]
    angular: Floats[Array, "holds points 3 dofs"]
    by_size: Floats[Array, "holds points 3 components"]


@dataclass(frozen=True, eq=False)
class CalibrationProblem:
    """The residuals for `poseloom.solve.least_squares`. A hold is a block; its groups are positions, orientations,
    joints, and two for the floor.

    Shared unknowns are, in order: size coefficients, sensors' rotations (right-multiplied), sensors' offsets.

    Attributes:
        model: How bodies differ.
        soles: Points of the model's bodies that meet the floor.
        held: Readings and guided poses.
        bones: Index of the bone that wears each sensor.
        usual_offsets: Default places of the sensors on the average body, metres in their bones' frames.
        settings: Standard deviations.
    """

    model: BodySizeModel
    soles: SoleModel
    held: HeldPoses
    bones: Ints[Array, "sensors"]
    usual_offsets: Floats[Array, "sensors 3"]
    settings: CalibrationSettings

    @property
    def present(self) -> Bools[Array, "holds groups"]:
        """Which readings came; joints always count."""
        return self._present

    @cached_property
    def _present(self) -> Bools[Array, "holds groups"]:
        joints = np.ones((len(self.held), len(BODY_BONES)), dtype=np.bool_)
        came = (np.isfinite(self.held.positions).all(axis=2), np.isfinite(self.held.rotations).all(axis=(2, 3)))
        floor = np.stack([self.standing.any(axis=1), self.standing.all(axis=1)], axis=1)
        return np.concatenate([*came, joints, floor & bool(np.isfinite(self.settings.floor_m))], axis=1)

    @cached_property
    def standing(self) -> Bools[Array, "holds 2"]:
        """Which feet stand in the guided poses."""
        return standing_feet(self.held.guided)

    @property
    def robust_scales(self) -> Floats[Array, "groups"]:
        """Of each group."""
        how = self.settings
        return np.repeat([how.sensor_robust, how.pose_robust], [2 * len(self.bones), len(BODY_BONES) + 2])

    def move(
        self, state: CalibrationState, shared: Floats[Array, "shared"], own: Floats[Array, "holds dofs"]
    ) -> CalibrationState:
        """The state after a step."""
        size, sensors = self.model.size, len(self.bones)
        turns = shared[size : size + 3 * sensors].reshape(sensors, 3)
        return CalibrationState(
            state.coefficients + shared[:size],
            state.R_bone_sensor @ matrix_from_rotvec(turns),
            state.p_bone_sensor + shared[size + 3 * sensors :].reshape(sensors, 3),
            state.q + own,
        )

    def linearise(self, state: CalibrationState) -> Linearisation:
        """Residuals and their derivatives."""
        sensors, holds = len(self.bones), len(self.held)
        groups, shared = 2 * sensors + len(BODY_BONES) + 2, self.model.size + 6 * sensors
        residuals = np.zeros((holds, groups, 3))
        by_shared, by_own = np.zeros((holds, groups, 3, shared)), np.zeros((holds, groups, 3, state.q.shape[1]))
        moving = self._moving_points(state)
        parts = (residuals, by_shared, by_own)
        self._positions(state, moving, *(array[:, :sensors] for array in parts))
        self._orientations(state, moving, *(array[:, sensors : 2 * sensors] for array in parts))
        self._joints(state.q, residuals[:, 2 * sensors : -2], by_own[:, 2 * sensors : -2])
        self._floor(moving, *(array[:, -2:] for array in parts))
        return Linearisation(Residuals(residuals, self._shared(state)), by_shared, by_own, self._shared_jacobian())

    def _moving_points(self, state: CalibrationState) -> "_MovingPoints":
        """Sensors and soles in all holds."""
        body = self.model.body_of(state.coefficients)
        soles = self.soles.local + np.tensordot(state.coefficients, self.soles.by_size, 1)
        bones, local = np.concatenate([self.bones, self.soles.bones]), np.concatenate([state.p_bone_sensor, soles])
        each = [point_jacobians(body, q, bones, local) for q in state.q]
        R_world_bone = np.stack([forward_kinematics(body, q).rotations for q in state.q])
        by_size = np.zeros((len(state.q), len(BODY_BONES), 3, self.model.size))
        for joint in range(1, len(BODY_BONES)):
            parent = body.parents[joint]
            grown = np.einsum("pij,hj->pih", R_world_bone[:, parent], self.model.components[:, 0, joint])
            by_size[:, joint] = by_size[:, parent] + grown
        by_size = by_size[:, bones]
        by_size[:, len(self.bones) :] += np.einsum(
            "psij,hsj->psih", R_world_bone[:, self.soles.bones], self.soles.by_size
        )
        return _MovingPoints(
            np.stack([one.points for one in each]),
            np.stack([one.rotations for one in each]),
            np.stack([one.linear for one in each]),
            np.stack([one.angular for one in each]),
            by_size,
        )

    def _positions(
        self,
        state: CalibrationState,
        moving: "_MovingPoints",
        residuals: Floats[Array, "holds sensors 3"],
        by_shared: Floats[Array, "holds sensors 3 shared"],
        by_own: Floats[Array, "holds sensors 3 dofs"],
    ) -> None:
        size, sensors, sigma = self.model.size, len(self.bones), self.settings.position_m
        residuals[:] = (np.nan_to_num(self.held.positions) - moving.points[:, :sensors]) / sigma
        by_own[:] = -moving.linear[:, :sensors] / sigma
        by_shared[..., :size] = -moving.by_size[:, :sensors] / sigma
        for sensor in range(sensors):
            offset = size + 3 * (sensors + sensor)
            by_shared[:, sensor, :, offset : offset + 3] = -moving.rotations[:, sensor] / sigma

    def _orientations(
        self,
        state: CalibrationState,
        moving: "_MovingPoints",
        residuals: Floats[Array, "holds sensors 3"],
        by_shared: Floats[Array, "holds sensors 3 shared"],
        by_own: Floats[Array, "holds sensors 3 dofs"],
    ) -> None:
        size, sensors = self.model.size, len(self.bones)
        predicted = moving.rotations[:, :sensors] @ state.R_bone_sensor
        came = np.isfinite(self.held.rotations).all(axis=(2, 3), keepdims=True)
        measured = np.where(came, self.held.rotations, predicted)
        turns = rotvec_from_matrix(measured @ predicted.swapaxes(2, 3))
        residuals[:] = turns / self.settings.orientation_rad
        # r = log(R_measured R_predicted') changes by -J_r(r)^-1 times the world angular change of the prediction.
        falls = -right_jacobian_inverse(turns) / self.settings.orientation_rad
        by_own[:] = falls @ moving.angular[:, :sensors]
        for sensor in range(sensors):
            turn = size + 3 * sensor
            by_shared[:, sensor, :, turn : turn + 3] = falls[:, sensor] @ predicted[:, sensor]

    def _floor(
        self,
        moving: "_MovingPoints",
        residuals: Floats[Array, "holds two 3"],
        by_shared: Floats[Array, "holds two 3 shared"],
        by_own: Floats[Array, "holds two 3 dofs"],
    ) -> None:
        """The lowest sole against the floor, and the two feet's lowest points against each other."""
        size, sensors = self.model.size, len(self.bones)
        heights = moving.points[:, sensors:, 1].reshape(-1, 2, 2)
        # Smooth minima: the true one would jump from heel to toe, and with it the derivatives.
        shares = np.exp((heights.min(axis=(1, 2), keepdims=True) - heights) / _BLUR_M)
        shares[~self.standing] = 0.0
        lowest = shares / shares.sum(axis=(1, 2), keepdims=True)
        within = np.exp((heights.min(axis=2, keepdims=True) - heights) / _BLUR_M)
        between = within / within.sum(axis=2, keepdims=True) * np.array([1.0, -1.0])[:, None]
        values = (
            heights.min(axis=(1, 2)) - _BLUR_M * np.log(shares.sum(axis=(1, 2))),
            np.diff(_BLUR_M * np.log(within.sum(axis=2)) - heights.min(axis=2), axis=1)[:, 0],
        )
        sigmas = (self.settings.floor_m, self.settings.other_foot_m)
        for row, (value, weights, sigma) in enumerate(zip(values, (lowest, between), sigmas, strict=True)):
            weighted = weights.reshape(-1, 4, 1) / sigma
            residuals[:, row, 0] = -value / sigma
            by_own[:, row, 0] = -(weighted * moving.linear[:, sensors:, 1]).sum(axis=1)
            by_shared[:, row, 0, :size] = -(weighted * moving.by_size[:, sensors:, 1]).sum(axis=1)

    def _joints(
        self,
        q: Floats[Array, "holds dofs"],
        residuals: Floats[Array, "holds joints 3"],
        by_own: Floats[Array, "holds joints 3 dofs"],
    ) -> None:
        """How far each joint is from the guided pose, in its own axes; of the root, the tilt, which gravity shows."""
        sigmas = pose_sigmas(self.settings.pose_rad)
        rotvecs = q[:, 3:].reshape(len(q), -1, 3)
        R_guided = matrix_from_rotvec(self.held.guided[:, 3:].reshape(rotvecs.shape))
        R = matrix_from_rotvec(rotvecs)
        apart = rotvec_from_matrix(R_guided.swapaxes(2, 3) @ R)
        residuals[:] = apart / sigmas
        steps = right_jacobian_inverse(apart) @ right_jacobian(rotvecs) / sigmas[:, :, None]
        for joint in range(1, len(BODY_BONES)):
            by_own[:, joint, :, 3 + 3 * joint : 6 + 3 * joint] = steps[:, joint]
        # In its own axes the vertical is R' up, which changes by R' (up x d) for a world turn d of R.
        tilt = self.settings.pose_rad
        residuals[:, 0] = (R[:, 0, 1] - R_guided[:, 0, 1]) / tilt
        across = np.cross(_UP, left_jacobian(rotvecs[:, 0]), axisb=1, axisc=1)
        by_own[:, 0, :, 3:6] = R[:, 0].swapaxes(1, 2) @ across / tilt

    def _shared(self, state: CalibrationState) -> Floats[Array, "rows"]:
        offsets = (state.p_bone_sensor - self.usual_offsets) / self.settings.offset_m
        return np.concatenate([state.coefficients, np.zeros(3 * len(self.bones)), offsets.reshape(-1)])

    def _shared_jacobian(self) -> Floats[Array, "rows shared"]:
        # A sensor may be turned in any way; that it cannot be turned by more than pi keeps a silent one's turn finite.
        scales = np.repeat(
            [1.0, 1 / np.pi, 1 / self.settings.offset_m], np.array([self.model.size, *2 * [3 * len(self.bones)]])
        )
        return np.diag(scales)
