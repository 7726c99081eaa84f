"""A first guess without any library: a person who stands where the sensors are and faces the way they say."""

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.methods.trackers._kernels import into_heading
from poseloom.methods.trackers.observation import heard
from poseloom.methods.trackers.state import Wearer
from poseloom.rotations import heading_angle, quat_from_matrix
from poseloom.skeleton.body import BODY_BONES
from poseloom.solve import SensorReadings

_ARM_DOWN = np.deg2rad(75.0)


def standing_pose(wearer: Wearer, readings: SensorReadings) -> Floats[Array, "dofs"]:
    """Upright, arms hanging, above the mean of the sensors' places, along their heading; nothing of it is measured."""
    skeleton = wearer.skeleton
    local = np.zeros(skeleton.size)
    feet = [skeleton.index(bone) for bone in ("leftFoot", "leftToes")]
    rest = skeleton.rest_positions()
    local[1] = -float(rest[feet, 1].min())
    for side, sign in (("left", -1.0), ("right", 1.0)):
        local[3 + 3 * skeleton.index(f"{side}UpperArm") + 2] = sign * _ARM_DOWN
    places = readings.positions[heard(readings)[:, 0]]
    x, z = (float(places[:, 0].mean()), float(places[:, 2].mean())) if len(places) else (0.0, 0.0)
    q = np.empty_like(local)
    into_heading(local, 0.0, 0.0, -sensors_heading(wearer, readings), q)
    q[0] += x
    q[2] += z
    return q


def sensors_heading(wearer: Wearer, readings: SensorReadings) -> float:
    """Which way the wearer faces: by the steadiest sensor with an orientation, else by what is left and what right."""
    said = heard(readings)
    for sensor in (wearer.reference, *range(len(said))):
        if said[sensor, 1]:
            turn = readings.rotations[sensor] @ wearer.mount.R_bone_sensor[sensor].T
            return float(heading_angle(quat_from_matrix(turn)))
    sides = [_side(BODY_BONES[int(bone)]) if said[s, 0] else 0 for s, bone in enumerate(wearer.mount.bones)]
    if 1 in sides and -1 in sides:
        left = readings.positions[[s for s, side in enumerate(sides) if side == 1]].mean(axis=0)
        right = readings.positions[[s for s, side in enumerate(sides) if side == -1]].mean(axis=0)
        across = left - right
        return float(np.arctan2(-across[2], across[0]))
    return 0.0


def _side(bone: str) -> int:
    return 1 if bone.startswith("left") else -1 if bone.startswith("right") else 0
