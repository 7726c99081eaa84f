"""What a pose is asked to agree with: measurements of sensors, and a Gaussian prior."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats, Ints, frozen, frozen_float
from poseloom.rotations import matrix_from_quat
from poseloom.sensors import Placement
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class SensorMount:
    """Sensors' places on a skeleton's bones, as arrays.

    Attributes:
        bones: Index of the bone that carries each sensor.
        p_bone_sensor: Sensor origins in their bones' frames, metres.
        R_bone_sensor: Sensor axes in their bones' frames.
    """

    bones: Ints[Array, "sensors"]
    p_bone_sensor: Floats[Array, "sensors 3"]
    R_bone_sensor: Floats[Array, "sensors 3 3"]


@dataclass(frozen=True, eq=False)
class SensorReadings:
    """World positions and orientations that sensors report at one moment; NaN where one is silent.

    Attributes:
        positions: Metres.
        rotations: `R_world_sensor`.
        sigmas: Standard deviations of position (metres) and orientation (radians) for each sensor.
    """

    positions: Floats[Array, "sensors 3"]
    rotations: Floats[Array, "sensors 3 3"]
    sigmas: Floats[Array, "sensors 2"]


@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """What is believed of the pose vector before the sensors are heard.

    Attributes:
        mean: Pose vector.
        covariance: Its covariance. A row and column of zeros locks an entry at its mean.
    """

    mean: Floats[Array, "dofs"]
    covariance: Floats[Array, "dofs dofs"]


def mount(skeleton: Skeleton, placements: Sequence[Placement]) -> SensorMount:
    """Placements as arrays. Raises SkeletonError for a bone that the skeleton lacks."""
    return SensorMount(
        frozen(np.array([skeleton.index(p.bone) for p in placements], dtype=np.int64)),
        frozen_float(np.stack([p.p_bone_sensor for p in placements])),
        frozen_float(np.stack([p.R_bone_sensor for p in placements])),
    )


def readings(
    positions: Floats[Array, "sensors 3"], quats_wxyz: Floats[Array, "sensors 4"], sigmas: Floats[Array, "sensors 2"]
) -> SensorReadings:
    """Readings from positions and quaternions, NaN where missing."""
    return SensorReadings(positions, matrix_from_quat(quats_wxyz), sigmas)
