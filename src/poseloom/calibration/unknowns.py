"""What calibration is given and what it looks for: held poses, beliefs before they are heard, and the unknowns."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.calibration.body_size import DEFAULT_COMPONENTS


@dataclass(frozen=True)
class CalibrationSettings:
    """What is believed before the sensors are heard, and how hard to try.

    Attributes:
        pose_rad: Standard deviation of a held joint angle about the guided one.
        position_m: Of a sensor's position, averaged over a hold. If it is taken for larger than it is, short bones come
            out too short, for the poses' own error is then thought to explain less.
        orientation_rad: Of its orientation.
        offset_m: Of a sensor's place on its bone about the default place.
        components: Principal components of body size.
        floor_m: Of the height of the lowest sole, which stands on the world's y = 0; infinity where that is no floor.
        other_foot_m: Of the difference in height of the feet where both stand in the guided pose.
        pose_robust: Sigmas at which a joint's deviation from the guided pose begins to be disbelieved.
        sensor_robust: The same for a sensor's residual.
        iterations: Most steps of the solver.
    """

    pose_rad: float = float(np.radians(7.0))
    position_m: float = 0.001
    orientation_rad: float = float(np.radians(0.2))
    offset_m: float = 0.03
    components: int = DEFAULT_COMPONENTS
    floor_m: float = 0.01
    other_foot_m: float = 0.04
    pose_robust: float = 6.0
    sensor_robust: float = 4.0
    iterations: int = 60


@dataclass(frozen=True, eq=False)
class HeldPoses:
    """What the sensors said while a person held poses. Missing readings are NaN.

    Attributes:
        guided: Pose vectors that were asked for, one a hold; the root's place and heading mean nothing.
        positions: Metres, world.
        rotations: `R_world_sensor`.
    """

    guided: Floats[Array, "holds dofs"]
    positions: Floats[Array, "holds sensors 3"]
    rotations: Floats[Array, "holds sensors 3 3"]

    def __len__(self) -> int:
        return len(self.guided)

    def keep(self, holds: Bools[Array, "holds"] | Ints[Array, "kept"]) -> "HeldPoses":
        """Some of the holds."""
        return HeldPoses(self.guided[holds], self.positions[holds], self.rotations[holds])


class CalibrationState(NamedTuple):
    """The unknowns.

    Attributes:
        coefficients: Of the body-size model.
        R_bone_sensor: Sensors' axes in their bones' frames.
        p_bone_sensor: Sensors' places in their bones' frames, metres.
        q: Poses held, as pose vectors.
    """

    coefficients: Floats[Array, "components"]
    R_bone_sensor: Floats[Array, "sensors 3 3"]
    p_bone_sensor: Floats[Array, "sensors 3"]
    q: Floats[Array, "holds dofs"]
