"""How the hips are turned, as an IMU on them says (VQF, Laidig and Seel 2023, 6D)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from vqf import VQF  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from poseloom.arrays import Array, Floats
from poseloom.rotations import heading_angle, heading_matrix, matrix_from_quat, quat_from_matrix
from poseloom.sensors import Sample

_R_WORLD_VQF = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""VQF's world has its z axis up, ours its y axis."""

GRAVITY = 9.80665
"""Standard gravity, m/s^2."""
_FIRST_STEP = 0.01
"""Seconds that the first sample of an IMU stands for."""

_LONGEST_STEP = 0.2
"""Seconds: over a longer silence of the IMU the hips' turn is not carried on."""


@dataclass(frozen=True, eq=False)
class HipsTurn:
    """What the IMU has told so far.

    Attributes:
        filter: VQF's state; None before the first sample.
        heading: Angle about the world's up axis by which the first sample's heading is taken away.
        R_world_hips: How the hips are turned.
        time: Device time of the last sample, seconds.
        since: Seconds since the first one.
    """

    filter: Mapping[str, Any] | None
    heading: float
    R_world_hips: Floats[Array, "3 3"]
    time: float
    since: float


def turn_hips(
    turn: HipsTurn, sample: Sample, sensor: int, R_bone_sensor: Floats[Array, "3 3"], upright_s: float = 0.0
) -> HipsTurn:
    """Takes in one sample of the IMU on the hips (VQF, 6D); a missing one leaves the hips as they are.

    Args:
        turn: What was known before.
        sample: What the sensors say.
        sensor: Which of them is the IMU.
        R_bone_sensor: How it sits on the hips.
        upright_s: Seconds for which the hips are taken to have stood upright before the first sample. Who begins in
            the middle of a step is accelerated, and a first accelerometer reading alone would tilt the hips by 20
            degrees and more.
    """
    rate, force = sample.angular_rates[sensor], sample.specific_forces[sensor]
    if not (np.isfinite(rate).all() and np.isfinite(force).all()):
        return turn
    step = sample.time - turn.time if turn.filter is not None else _FIRST_STEP
    orientation: Any = VQF(float(min(step, _LONGEST_STEP)))  # its step is fixed; what it knows is handed on
    if turn.filter is not None:
        orientation.state = dict(turn.filter)
    else:
        upright = np.ascontiguousarray(R_bone_sensor.T @ np.array([0.0, GRAVITY, 0.0]))
        for _ in range(round(upright_s / _FIRST_STEP)):
            orientation.update(np.zeros(3), upright)
    orientation.update(np.ascontiguousarray(rate), np.ascontiguousarray(force))
    R_world_bone = _R_WORLD_VQF @ matrix_from_quat(orientation.getQuat6D()) @ R_bone_sensor.T
    heading = float(heading_angle(quat_from_matrix(R_world_bone))) if turn.filter is None else turn.heading
    return HipsTurn(
        orientation.state,
        heading,
        heading_matrix(np.asarray(-heading)) @ R_world_bone,
        sample.time,
        turn.since + (step if turn.filter is not None else 0.0),
    )
