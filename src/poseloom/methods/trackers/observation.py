"""What trackers say of the bones that carry them."""

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.methods.trackers.state import BoneView, Wearer
from poseloom.rotations import matrix_from_quat
from poseloom.sensors import Sample
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.solve import SensorReadings


def observe(sample: Sample, sigmas: Floats[Array, "sensors 2"]) -> SensorReadings:
    """A sample's tracker channels as readings; what is missing stays NaN."""
    return SensorReadings(sample.positions, matrix_from_quat(sample.quats_wxyz), sigmas)


def turned(readings: SensorReadings, x: float, z: float, heading: float) -> SensorReadings:
    """Readings seen from a ground point and heading."""
    back = _seen_along(heading)
    return SensorReadings(
        (readings.positions - np.array([x, 0.0, z])) @ back.T, back @ readings.rotations, readings.sigmas
    )


def root_turned(covariance: Floats[Array, "dofs dofs"], heading: float) -> Floats[Array, "dofs dofs"]:
    """A pose's covariance with the root's place and rotation vector seen along a heading.

    Exact for the place; for the rotation vector to first order about an upright root: enough for a short memory.
    """
    turn, out = _seen_along(heading), covariance.copy()
    for block in (slice(0, 3), slice(3, 6)):
        out[block] = turn @ out[block]
    for block in (slice(0, 3), slice(3, 6)):
        out[:, block] = out[:, block] @ turn.T
    return out


def _seen_along(heading: float) -> Floats[Array, "3 3"]:
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def heard(readings: SensorReadings) -> Bools[Array, "sensors 2"]:
    """Which position and which orientation was said."""
    return np.stack([np.isfinite(readings.positions[:, 0]), np.isfinite(readings.rotations[:, 0, 0])], axis=1)


def predicted_view(wearer: Wearer, q: Floats[Array, "dofs"]) -> BoneView:
    """Where a pose puts the features' points on the sensors' bones."""
    frames = forward_kinematics(wearer.skeleton, q)
    rotations = frames.rotations[wearer.mount.bones]
    return BoneView(frames.positions[wearer.mount.bones] + _turn(rotations, wearer.points), rotations)


def view_of(wearer: Wearer, readings: SensorReadings, fallback: BoneView) -> BoneView:
    """Where the sensors put the features' points; what one does not say is taken from the fallback."""
    said = heard(readings)
    mount = wearer.mount
    measured = readings.rotations @ np.swapaxes(mount.R_bone_sensor, -1, -2)
    rotations = np.where(said[:, 1, None, None], measured, fallback.rotations)
    arms = _turn(rotations, mount.p_bone_sensor - wearer.points)
    return BoneView(np.where(said[:, :1], readings.positions - arms, fallback.points), rotations)


def _turn(rotations: Floats[Array, "sensors 3 3"], vectors: Floats[Array, "sensors 3"]) -> Floats[Array, "sensors 3"]:
    return (rotations @ vectors[:, :, None])[:, :, 0]
