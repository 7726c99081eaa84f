"""What trackers say of the bones that carry them."""

from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.rotations import matrix_from_quat
from poseloom.sensors import Sample
from poseloom.skeleton.kinematics import BoneFrames
from poseloom.solve import SensorMount, SensorReadings


class BoneView(NamedTuple):
    """Rotations of the sensors' bones, and the places of given points on them, in one frame of reference.

    Attributes:
        points: Metres.
        rotations: Bone rotations.
    """

    points: Floats[Array, "sensors 3"]
    rotations: Floats[Array, "sensors 3 3"]


def observe(sample: Sample, sigmas: Floats[Array, "sensors 2"]) -> SensorReadings:
    """A sample's tracker channels as readings; what is missing stays NaN."""
    return SensorReadings(sample.positions, matrix_from_quat(sample.quats_wxyz), sigmas)


def turned(readings: SensorReadings, x: float, z: float, heading: float) -> SensorReadings:
    """Readings seen from a ground point and heading."""
    c, s = np.cos(heading), np.sin(heading)
    back = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return SensorReadings(
        (readings.positions - np.array([x, 0.0, z])) @ back.T, back @ readings.rotations, readings.sigmas
    )


def heard(readings: SensorReadings) -> Bools[Array, "sensors 2"]:
    """Which position and which orientation was said."""
    return np.stack([np.isfinite(readings.positions[:, 0]), np.isfinite(readings.rotations[:, 0, 0])], axis=1)


def predicted_view(frames: BoneFrames, mount: SensorMount, points: Floats[Array, "sensors 3"]) -> BoneView:
    """Where a pose puts the points on the sensors' bones."""
    rotations = frames.rotations[mount.bones]
    return BoneView(frames.positions[mount.bones] + np.einsum("sab,sb->sa", rotations, points), rotations)


def measured_view(
    readings: SensorReadings, mount: SensorMount, points: Floats[Array, "sensors 3"], fallback: BoneView
) -> BoneView:
    """Where the sensors put the points on their bones; what a sensor does not say is taken from the fallback."""
    said = heard(readings)
    rotations = np.where(
        said[:, 1, None, None], readings.rotations @ np.swapaxes(mount.R_bone_sensor, -1, -2), fallback.rotations
    )
    arms = np.einsum("sab,sb->sa", rotations, mount.p_bone_sensor - points)
    return BoneView(np.where(said[:, :1], readings.positions - arms, fallback.points), rotations)
