"""Plain inverse kinematics: the baseline that knows no motion."""

from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.methods.trackers.loop import TrackerMethod, TrackerState
from poseloom.methods.trackers.standing import standing_pose
from poseloom.methods.trackers.state import BoneView, TrackerSettings, Wearer
from poseloom.sensors import SensorLayout
from poseloom.solve import GaussianPrior, SensorReadings


@dataclass(frozen=True)
class InverseKinematicsSettings:
    """How far a pose may move between samples before the sensors must insist.

    Attributes:
        joint_step: Standard deviation of a joint angle's change, radians.
        root_step: Standard deviation of the root's change, metres and radians.
        first_joint: Standard deviation of the joint angles about the standing pose of the first frame, radians.
        first_root: Standard deviation of the root's place, metres, and rotation, radians, there.
    """

    joint_step: float = 0.5
    root_step: float = 0.1
    first_joint: float = 0.1
    first_root: float = 1.0


class InverseKinematics(TrackerMethod):
    """The pose nearest to the previous one that agrees with the sensors.

    Source: the comparator of the six-sensor paper; the same loop, solver and sensors as every other method here, with
    the previous pose as the only prior.
    """

    any_rate = True

    def __init__(
        self,
        layout: SensorLayout,
        parameters: InverseKinematicsSettings | None = None,
        settings: TrackerSettings | None = None,
    ) -> None:
        super().__init__(layout, settings)
        self.parameters = parameters or InverseKinematicsSettings()

    def first_prior(self, wearer: Wearer, readings: SensorReadings) -> GaussianPrior:
        """See `TrackerMethod.first_prior`."""
        mean = standing_pose(wearer, readings)
        return GaussianPrior(mean, _diagonal(len(mean), self.parameters.first_root, self.parameters.first_joint))

    def next_prior(self, state: TrackerState, previous: Floats[Array, "dofs"], view: BoneView) -> GaussianPrior:
        """See `TrackerMethod.next_prior`."""
        steps = self.parameters
        return GaussianPrior(previous, _diagonal(len(previous), steps.root_step, steps.joint_step))


def _diagonal(size: int, root: float, joint: float) -> Floats[Array, "dofs dofs"]:
    return np.diag(np.concatenate([np.full(6, root), np.full(size - 6, joint)]) ** 2)
