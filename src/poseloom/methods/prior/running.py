"""The prior network at work: samples in, a Gaussian over all bones in the world out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.methods.prior.calibration import (
    CORRECTED_SHARE,
    HOLD_SECONDS,
    PriorCalibration,
    known_rotations,
    measured_residuals,
    part_of,
)
from poseloom.methods.prior.channels import RATE, CalibrationPose
from poseloom.methods.prior.intake import GRAVITY, IntakeState, PriorIntake
from poseloom.methods.prior.network import Memory, PriorEstimate, PriorNetwork
from poseloom.rotations import matrix_from_quat, matrix_from_rotvec, quat_from_matrix
from poseloom.sensors.layout import SensorLayout
from poseloom.sensors.placement import Placement
from poseloom.sensors.sample import Sample
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class PriorState:
    """What must be remembered from sample to sample.

    Attributes:
        intake: Of the sensors.
        memory: Of the network.
    """

    intake: IntakeState
    memory: Memory


class PriorRunner:
    """Runs a network for one wearer; `start` and `step` as a method has them.

    Args:
        network: The network.
        layout: The sensors, at 40 Hz.
        skeleton: The wearer's.
        placements: Where the sensors sit.
        calibration: What a calibration pose showed (`calibrated` makes it).

    Raises:
        MethodError: as `PriorIntake`.
    """

    def __init__(
        self,
        network: PriorNetwork,
        layout: SensorLayout,
        skeleton: Skeleton,
        placements: Sequence[Placement],
        calibration: PriorCalibration | None = None,
    ) -> None:
        self.network = network
        self.calibration = calibration or PriorCalibration()
        self._worn = (layout, skeleton, tuple(placements))
        self._intake = PriorIntake(network.spec, layout, skeleton, placements, self.calibration)

    def start(self) -> PriorState:
        """The state before the first sample."""
        return PriorState(self._intake.start(), self.network.start())

    def step(
        self, state: PriorState, sample: Sample, bends: Floats[Array, "sensors"] | None = None
    ) -> tuple[PriorState, PriorEstimate]:
        """Takes in one sample; changes neither argument.

        Args:
            state: What was remembered.
            sample: What came.
            bends: Of each flex sensor's joint, radians; NaN where unknown.

        Returns:
            The next state, and the estimate in world axes; without any orientation the world's axes are those of the
            hips' heading.
        """
        intake, taken = self._intake.take(state.intake, sample, bends)
        memory = self.network.start() if taken.switched else state.memory
        memory, estimate = self.network.step(memory, taken.inputs, taken.base)
        world = PriorEstimate(
            taken.axes @ estimate.rotations @ self.calibration.corrections,
            estimate.sigma,
            estimate.contacts,
            taken.axes @ estimate.velocity,
        )
        return PriorState(intake, memory), world

    def calibrated(
        self, samples: Sequence[Sample], pose: CalibrationPose, share: float = CORRECTED_SHARE
    ) -> "PriorRunner":
        """The same for a wearer who has held a pose.

        Two things are learnt: what the sensors showed, which the network receives from then on, and by how much the
        network's own estimate of that very pose is off, of which a share is corrected.

        Args:
            samples: Those of the hold.
            pose: The pose that was asked for.
            share: Of the difference that is corrected.

        Raises:
            MethodError: if no orientation was measured.
        """
        layout, skeleton, placements = self._worn
        held = np.stack([self._intake.bone_rotations(sample) for sample in samples])
        residuals, facing = measured_residuals([sensor.bone for sensor in layout.sensors], held, pose)
        shown = PriorRunner(self.network, layout, skeleton, placements, PriorCalibration(pose, residuals))
        known = matrix_from_rotvec(np.array([0.0, facing, 0.0])) @ known_rotations(pose)
        off = shown.still_estimate(shown.pose_sample(samples[-1], facing)).rotations.swapaxes(-1, -2) @ known
        return PriorRunner(
            self.network, layout, skeleton, placements, replace(shown.calibration, corrections=part_of(off, share))
        )

    def pose_sample(self, sample: Sample, facing: float) -> Sample:
        """A sample of the calibration pose at rest as this wearer's sensors showed it."""
        layout, _, placements = self._worn
        turn = matrix_from_rotvec(np.array([0.0, facing, 0.0]))
        known = known_rotations(self.calibration.pose)
        quats = np.full((len(layout), 4), np.nan)
        for index, (sensor, placement) in enumerate(zip(layout.sensors, placements, strict=True)):
            residual = self.calibration.residuals[BODY_BONES.index(sensor.bone)]
            if np.isfinite(residual).all():
                R_world_bone = turn @ known[BODY_BONES.index(sensor.bone)] @ matrix_from_rotvec(residual)
                quats[index] = quat_from_matrix(R_world_bone @ placement.R_bone_sensor)
        nothing = np.full((len(layout), 3), np.nan)
        at_rest = _gravity_in(quats)
        felt = np.where(np.isfinite(sample.specific_forces), at_rest, np.nan)
        turning = np.where(np.isfinite(sample.angular_rates), 0.0, np.nan)
        return replace(
            sample, positions=nothing, quats_wxyz=quats, specific_forces=felt, angular_rates=turning,
            counts=np.full(len(layout), np.nan),
        )  # fmt: skip

    def still_estimate(self, sample: Sample) -> PriorEstimate:
        """What the network estimates of a sample that it receives for a second and a half."""
        state, estimate = self.step(self.start(), sample)
        for _ in range(round(HOLD_SECONDS * RATE) - 1):
            state, estimate = self.step(state, sample)
        return estimate


def _gravity_in(quats: Floats[Array, "sensors 4"]) -> Floats[Array, "sensors 3"]:
    """What accelerometers at rest read, sensor axes."""
    return GRAVITY[1] * matrix_from_quat(quats)[:, 1, :]
