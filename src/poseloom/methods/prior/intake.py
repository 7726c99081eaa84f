"""From samples of any layout to what the prior network receives, one sample at a time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import MethodError
from poseloom.methods.contract import check_wearer
from poseloom.methods.prior.calibration import PriorCalibration
from poseloom.methods.prior.channels import (
    CHANNEL_SIZES,
    RATE,
    REFERENCE_ORDER,
    CalibrationPose,
    Channel,
    InputSpec,
    body_sizes,
    fill_inputs,
    likeness,
)
from poseloom.rotations import matrix_from_quat
from poseloom.sensors.layout import SensorKind, SensorLayout, SensorSpec, make_layout
from poseloom.sensors.placement import Placement, default_placements
from poseloom.sensors.sample import Sample
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.skeleton import Skeleton

GRAVITY = np.array([0.0, 9.80665, 0.0])
"""What an accelerometer at rest reads, world axes, m/s^2."""

PATIENCE = 2.0
"""Seconds without the reference's orientation after which another bone becomes the reference."""

_RATE_TOLERANCE = 0.02


@dataclass(frozen=True, eq=False)
class IntakeState:
    """What must be remembered from sample to sample.

    Attributes:
        reference: The reference bone; empty while there is none.
        axes: Its rotation `R_world_bone` as last measured; the identity where no bone's orientation is.
        missing: Samples since then.
        rotations: `R_world_bone` of each sensor as last measured; NaN before.
        accelerations: World, of the last two samples, newest first; NaN where missing.
        rates: World, of the last sample; NaN where missing.
    """

    reference: str
    axes: Floats[Array, "3 3"]
    missing: int
    rotations: Floats[Array, "sensors 3 3"]
    accelerations: Floats[Array, "two sensors 3"]
    rates: Floats[Array, "sensors 3"]


@dataclass(frozen=True, eq=False)
class Intake:
    """One sample as the network receives it.

    Attributes:
        inputs: See `channels.fill_inputs`.
        axes: `R_world_reference`.
        base: What the network's rotations follow, in the reference's axes.
        switched: Whether the reference is another than at the last sample: the network must start again.
        measured: Which channels of which body bones were measured.
    """

    inputs: Floats[Array, "inputs"]
    axes: Floats[Array, "3 3"]
    base: Floats[Array, "joints 3 3"]
    switched: bool
    measured: Bools[Array, "bones channels"]


class PriorIntake:
    """Assembles inputs for one wearer.

    IMUs must give orientations: without one, an acceleration has no known direction and is left out. Bends come from
    flex sensors by way of `FlexRange` or a calibration, in radians.

    Args:
        spec: Which numbers the network receives; sensors on other bones and other channels are not used.
        layout: The sensors, at 40 Hz: resample other rates first.
        skeleton: The wearer's, the 22-bone body.
        placements: Where the sensors sit.
        calibration: What a calibration pose showed; none if left out.

    Raises:
        MethodError: for another skeleton or rate, or if the network can receive none of the sensors.
    """

    def __init__(
        self,
        spec: InputSpec,
        layout: SensorLayout,
        skeleton: Skeleton,
        placements: Sequence[Placement],
        calibration: PriorCalibration | None = None,
    ) -> None:
        check_wearer("the learnt prior moves", layout, skeleton, placements)
        if abs(layout.rate / RATE - 1) > _RATE_TOLERANCE:
            raise MethodError(
                f"the layout {layout.name!r} gives {layout.rate:g} samples a second",
                cause=f"the prior network was trained at {RATE:g} Hz",
                remedy=f"Resample the recording to {RATE:g} Hz",
            )
        if not any(sensor.bone in spec.bones for sensor in layout.sensors):
            raise MethodError(
                f"the network receives none of the sensors of {layout.name!r}",
                remedy=f"Wear sensors on {', '.join(spec.bones)}, or take the network for any sensors",
            )
        self.spec, self.layout = spec, layout
        self._bones = np.array([BODY_BONES.index(s.bone) for s in layout.sensors], dtype=np.int64)
        self._turns = np.stack([placement.R_bone_sensor.T for placement in placements])
        self._shifts = _usual_spots(layout, skeleton) - np.stack([p.p_bone_sensor for p in placements])
        self._unlike = likeness()[:, self._bones]
        self._sizes = body_sizes(skeleton)
        self._calibration = calibration or PriorCalibration()
        self._usable = np.array([sensor.bone in spec.bones for sensor in layout.sensors])

    def start(self) -> IntakeState:
        """The state before the first sample."""
        count = len(self.layout)
        return IntakeState(
            "",
            np.eye(3),
            0,
            np.full((count, 3, 3), np.nan),
            np.full((2, count, 3), np.nan),
            np.full((count, 3), np.nan),
        )

    def bone_rotations(self, sample: Sample) -> Floats[Array, "sensors 3 3"]:
        """`R_world_bone` as each sensor gives it; NaN where it gives none."""
        return matrix_from_quat(sample.quats_wxyz) @ self._turns

    def take(
        self, state: IntakeState, sample: Sample, bends: Floats[Array, "sensors"] | None = None
    ) -> tuple[IntakeState, Intake]:
        """Takes in one sample; changes neither argument.

        Args:
            state: What was remembered.
            sample: What came; NaN where nothing did.
            bends: Of each flex sensor's joint, radians; NaN where unknown.
        """
        rotations = self.bone_rotations(sample)
        oriented = np.isfinite(rotations[:, 0, 0])
        sensor_axes = matrix_from_quat(sample.quats_wxyz)
        felt = _turn(sensor_axes, sample.specific_forces) - GRAVITY
        turning = _turn(sensor_axes, sample.angular_rates)
        reference, axes, missing, switched = self._reference(state, rotations, oriented)

        channels: dict[Channel, Floats[Array, "sensors _"]] = {
            Channel.ROTATION: (axes.T @ rotations)[:, :, :2].swapaxes(1, 2).reshape(-1, 6),
            Channel.ACCELERATION: _weighted(felt, state.accelerations) @ axes,
            Channel.ANGULAR_RATE: _halfway(turning, state.rates) @ axes,
            Channel.POSITION: self._positions(sample, rotations) @ axes,
            Channel.BEND: (np.full(len(self.layout), np.nan) if bends is None else bends)[:, None],
        }
        values, measured = self._by_bone(channels)
        values[Channel.RESIDUAL] = np.nan_to_num(self._calibration.residuals)
        given = np.isfinite(self._calibration.residuals[:, 0]) & (self._calibration.pose is not CalibrationPose.NONE)
        measured[:, Channel.RESIDUAL] = given & measured[:, Channel.ROTATION]
        inputs = fill_inputs(
            self.spec, values, measured, axes[1].copy(), reference, self._sizes, self._calibration.pose
        )
        held = np.where(oriented[:, None, None], rotations, state.rotations)
        following = IntakeState(reference, axes, missing, held, np.stack([felt, state.accelerations[0]]), turning)
        return following, Intake(inputs, axes, self._base(held, axes), switched, measured)

    def _reference(
        self, state: IntakeState, rotations: Floats[Array, "sensors 3 3"], oriented: Bools[Array, "sensors"]
    ) -> tuple[str, Floats[Array, "3 3"], int, bool]:
        """The reference, its axes, for how long it is missing, and whether it is a new one."""
        usable = cast("list[int]", np.flatnonzero(oriented & self._usable)[::-1].tolist())
        there = {self.layout.sensors[i].bone: i for i in usable}
        if state.reference in there:
            return state.reference, rotations[there[state.reference]], 0, False
        if there and (not state.reference or state.missing >= PATIENCE * RATE):
            newest = next(bone for bone in REFERENCE_ORDER if bone in there)
            return newest, rotations[there[newest]], 0, bool(state.reference)
        return state.reference, state.axes, state.missing + 1, False

    def _base(self, held: Floats[Array, "sensors 3 3"], axes: Floats[Array, "3 3"]) -> Floats[Array, "joints 3 3"]:
        """For each body bone the rotation, as last measured, of the sensor on the likest bone."""
        known = np.isfinite(held[:, 0, 0]) & self._usable
        if not known.any():
            return np.tile(np.eye(3), (len(BODY_BONES), 1, 1))
        return axes.T @ held[np.where(known, self._unlike, np.inf).argmin(axis=1)]

    def _positions(self, sample: Sample, rotations: Floats[Array, "sensors 3 3"]) -> Floats[Array, "sensors 3"]:
        """At the usual spots of the bones, from the anchor; the anchor's own from the floor below it."""
        turned = np.where(np.isfinite(rotations), rotations, np.eye(3))
        places = sample.positions + _turn(turned, self._shifts)
        there = np.isfinite(places[:, 0]) & self._usable
        if not there.any():
            return places
        anchor = min(np.flatnonzero(there), key=lambda i: REFERENCE_ORDER.index(self.layout.sensors[i].bone))
        relative = places - places[anchor]
        relative[anchor] = [0.0, places[anchor, 1], 0.0]
        return relative

    def _by_bone(
        self, channels: dict[Channel, Floats[Array, "sensors _"]]
    ) -> tuple[dict[Channel, Floats[Array, "bones _"]], Bools[Array, "bones channels"]]:
        """Sensors' numbers by body bone; of two sensors of one kind on a bone the first counts."""
        measured = np.zeros((len(BODY_BONES), len(Channel)), dtype=np.bool_)
        values = {channel: np.zeros((len(BODY_BONES), CHANNEL_SIZES[channel])) for channel in Channel}
        for channel, numbers in channels.items():
            there = np.flatnonzero(np.isfinite(numbers).all(axis=1) & self._usable)[::-1]
            values[channel][self._bones[there]] = numbers[there]
            measured[self._bones[there], channel] = True
        return values, measured


def _usual_spots(layout: SensorLayout, skeleton: Skeleton) -> Floats[Array, "sensors 3"]:
    """Where virtual sensors sat in training: the usual spots of IMUs."""
    as_imus = make_layout(layout.name, [SensorSpec(s.name, SensorKind.IMU, s.bone) for s in layout.sensors], RATE)
    return np.stack([placement.p_bone_sensor for placement in default_placements(as_imus, skeleton)])


def _weighted(newest: Floats[Array, "sensors 3"], before: Floats[Array, "two sensors 3"]) -> Floats[Array, "sensors 3"]:
    """(f_i + 2 f_(i-1) + f_(i-2)) / 4; a missing older one is taken for the next newer."""
    last = np.where(np.isfinite(before[0]), before[0], newest)
    oldest = np.where(np.isfinite(before[1]), before[1], last)
    return 0.25 * (newest + 2 * last + oldest)


def _halfway(newest: Floats[Array, "sensors 3"], before: Floats[Array, "sensors 3"]) -> Floats[Array, "sensors 3"]:
    """The mean rate of the last step."""
    return 0.5 * (newest + np.where(np.isfinite(before), before, newest))


def _turn(rotations: Floats[Array, "sensors 3 3"], vectors: Floats[Array, "sensors 3"]) -> Floats[Array, "sensors 3"]:
    return (rotations @ vectors[:, :, None])[:, :, 0]
