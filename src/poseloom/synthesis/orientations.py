"""Orientations that IMUs give of themselves, with the errors of worn ones, for recordings of virtual IMUs."""

import json
import math
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import SensorError
from poseloom.rotations import matrix_from_rotvec, quat_from_matrix
from poseloom.sensors.placement import place_sensors
from poseloom.sensors.recording import Recording
from poseloom.skeleton.kinematics import motion_frames
from poseloom.synthesis.noise import Streams
from poseloom.synthesis.wearing import true_placements

_FOREARM = ("LowerArm", "Hand")


@dataclass(frozen=True)
class OrientationErrors:
    """Standard deviations, radians. The defaults, with 3 degrees of placement error, are 8 degrees in the mean.

    Attributes:
        heading: Constant turn about the vertical.
        heading_drift: The same, varying over ten seconds.
        tissue: Varying turn on the bone, each axis.
        twist: Constant turn of sensors on forearms and hands about the forearm.
        twist_varying: The same, varying.
        seconds: Time in which what varies forgets itself.
    """

    heading: float = math.radians(3.0)
    heading_drift: float = math.radians(1.0)
    tissue: float = math.radians(2.5)
    twist: float = math.radians(7.0)
    twist_varying: float = math.radians(6.0)
    seconds: float = 0.5


NO_ORIENTATION_ERRORS = OrientationErrors(0.0, 0.0, 0.0, 0.0, 0.0)
"""Orientations without errors but those of the placement."""


def add_orientations(
    recording: Recording,
    errors: OrientationErrors = OrientationErrors(),
    seed: int | Generator = 0,
) -> Recording:
    """Gives each sensor of a simulated recording its orientation, where it measured anything.

    Args:
        recording: With its truth; such as `simulate_imus` makes.
        errors: How orientations err.
        seed: Number or generator for all that is drawn.

    Raises:
        SensorError: for a recording without truth.
    """
    if recording.truth is None:
        raise SensorError("the recording has no truth to orient sensors by", remedy="Simulate it from a motion")
    streams = Streams(seed)
    frames = motion_frames(recording.truth)
    bones = place_sensors(frames, recording.skeleton, true_placements(recording))
    quats = np.empty((len(recording), len(recording.layout), 4))
    for index, sensor in enumerate(recording.layout.sensors):
        R_bone_sensor = true_placements(recording)[index].R_bone_sensor
        count, rate = len(recording), recording.layout.rate
        steady = streams.stream(sensor.name, "orientation").normal(size=2)
        slow = _wander(streams.stream(sensor.name, "heading drift"), count, 1, rate * 10.0)
        heading = errors.heading * steady[0] + errors.heading_drift * slow[:, 0]
        turn = errors.tissue * _wander(streams.stream(sensor.name, "tissue"), count, 3, rate * errors.seconds)
        if sensor.bone.endswith(_FOREARM):
            moved = _wander(streams.stream(sensor.name, "twist"), count, 1, rate * errors.seconds)
            turn[:, 0] += errors.twist * steady[1] + errors.twist_varying * moved[:, 0]
        about = np.zeros((count, 3))
        about[:, 1] = heading
        on_bone = R_bone_sensor.T @ matrix_from_rotvec(turn) @ R_bone_sensor
        quats[:, index] = quat_from_matrix(matrix_from_rotvec(about) @ bones.rotations[:, index] @ on_bone)
    there = np.isfinite(recording.specific_forces[..., 0]) | np.isfinite(recording.positions[..., 0])
    quats[~there] = np.nan
    settings = {**recording.settings, "orientation errors": json.dumps({**asdict(errors), "seed": streams.seed})}
    return replace(recording, quats_wxyz=frozen_float(quats), settings=MappingProxyType(settings))


def _wander(stream: Generator, count: int, axes: int, memory: float) -> Floats[Array, "samples axes"]:
    """A smooth stationary process of standard deviation 1 that forgets itself in about `memory` samples.

    Two first-order filters one after the other: skin slides, it does not tremble.
    """
    keep = math.exp(-2 / memory)
    states = stream.normal(size=(count + round(5 * memory), axes))
    for _ in range(2):
        states = np.asarray(lfilter([1.0], [1.0, -keep], states, axis=0))
    return states[-count:] * math.sqrt((1 - keep**2) ** 3 / (1 + keep**2))
