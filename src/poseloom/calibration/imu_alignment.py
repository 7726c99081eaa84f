"""How inertial sensors are turned on their bones, from a person who stands still and then walks.

Standing still tells which way is up: the mean specific force. It is taken to be up in the bone too, so the bone's rest
is the person's own way of standing. Walking tells the heading (`imu_headings`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.calibration.imu_episodes import Episode, find_standing, find_walking
from poseloom.calibration.imu_headings import HEADINGS, LevelWalk
from poseloom.errors import SensorError
from poseloom.rotations import quat_conjugate, quat_from_matrix, quat_multiply
from poseloom.sensors.placement import default_placements
from poseloom.sensors.recording import Recording

_WALKED_SECONDS = 2.0
"""Least that must have been heard of a walk."""


@dataclass(frozen=True, eq=False)
class ImuAlignment:
    """How one sensor is turned on its bone.

    Attributes:
        sensor: The sensor's name.
        R_bone_sensor: Turns the sensor's axes into the bone's.
        gyroscope_bias: What the gyroscope said in standing still, rad/s, sensor frame.
        forward_trust: How clear forwards was, 0 to 1: below 0.3 it may be backwards.
        axis_trust: How clear the axis was, 0 to 1: of legs the share of the level turning that is about it, of hips and
            head the same as `forward_trust`.
    """

    sensor: str
    R_bone_sensor: Floats[Array, "3 3"]
    gyroscope_bias: Floats[Array, "3"]
    forward_trust: float
    axis_trust: float


def align_imus(
    recording: Recording, standing: Episode | None = None, walking: Episode | None = None
) -> tuple[ImuAlignment, ...]:
    """Finds how each sensor is turned on its bone.

    Args:
        recording: Specific forces and angular rates of someone who stands upright and still for a second, and walks.
        standing: Seconds from and to which; found if left out (`find_standing`).
        walking: The same of the walk, some steps straight on.

    Returns:
        One a sensor.

    Raises:
        SensorError: for sensors on arms, whose way of hanging is not known, or where nobody stands or walks.
    """
    arms = [sensor.name for sensor in recording.layout.sensors if _kind(sensor.bone) not in HEADINGS]
    if arms:
        raise SensorError(
            f"standing and walking do not tell how a sensor on an arm is turned: {', '.join(arms)}",
            remedy="Wear it along the bone's axes and import it without alignment (--align none)",
        )
    for channel in ("specific_forces", "angular_rates"):
        silent = ~np.isfinite(getattr(recording, channel)).any(axis=(0, 2))
        if silent.any():
            raise SensorError(
                f"sensor {recording.layout.names[int(np.argmax(silent))]!r} tells no {channel.replace('_', ' ')}",
                cause="its file has orientations only" if channel == "specific_forces" else "",
                remedy="Import it without alignment (--align none); methods that need them cannot use it",
            )
    walk = find_walking(recording) if walking is None else walking
    stand = find_standing(recording, walk) if standing is None else standing
    still, moving = (_inside(recording.times, episode) for episode in (stand, walk))
    found: list[ImuAlignment] = []
    for index, sensor in enumerate(recording.layout.sensors):
        forces, turns = recording.specific_forces[:, index], recording.angular_rates[:, index]
        spoke = np.isfinite(forces).all(axis=1) & np.isfinite(turns).all(axis=1)
        if not (still & spoke).any() or np.count_nonzero(moving & spoke) < _WALKED_SECONDS * recording.layout.rate:
            raise SensorError(
                f"sensor {sensor.name!r} is missing while its wearer stands or walks",
                remedy=f"Choose moments at which it spoke, with {_WALKED_SECONDS:g} seconds of walking",
            )
        up, bias = forces[still & spoke].mean(axis=0), turns[still & spoke].mean(axis=0)
        walked = _without_gaps(recording.times, forces, turns - bias, moving)
        R_level_sensor = _levelling(up)
        heading = HEADINGS[_kind(sensor.bone)](
            LevelWalk(recording.layout.rate, walked[0] @ R_level_sensor.T, walked[1] @ R_level_sensor.T)
        )
        cos, sin = math.cos(heading.angle), math.sin(heading.angle)
        R_bone_level = np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
        found.append(
            ImuAlignment(sensor.name, R_bone_level @ R_level_sensor, bias, heading.forward_trust, heading.axis_trust)
        )
    return tuple(found)


def turn_to_bones(recording: Recording, alignments: Sequence[ImuAlignment]) -> Recording:
    """The recording as sensors would have made it whose axes are the bones', as the default placements say.

    Gyroscopes lose the bias that they had in standing. So a method that was fitted to sensors at default placements
    listens to real ones.

    Args:
        recording: As imported.
        alignments: One a sensor, in order.

    Raises:
        SensorError: for alignments of other sensors.
    """
    if tuple(alignment.sensor for alignment in alignments) != recording.layout.names:
        raise SensorError(
            f"the alignment is of {', '.join(a.sensor for a in alignments)}, "
            f"the recording of {', '.join(recording.layout.names)}",
            remedy="Align the recording itself",
        )
    turns = np.stack([alignment.R_bone_sensor for alignment in alignments])
    biases = np.stack([alignment.gyroscope_bias for alignment in alignments])
    told = ", ".join(f"{a.sensor} (forward {a.forward_trust:.2f}, axis {a.axis_trust:.2f})" for a in alignments)
    return replace(
        recording,
        specific_forces=np.einsum("sij,nsj->nsi", turns, recording.specific_forces),
        angular_rates=np.einsum("sij,nsj->nsi", turns, recording.angular_rates - biases),
        quats_wxyz=quat_multiply(recording.quats_wxyz, quat_conjugate(quat_from_matrix(turns))),
        placements=default_placements(recording.layout, recording.skeleton),
        settings=MappingProxyType({**recording.settings, "aligned": told}),
    )


def _kind(bone: str) -> str:
    return bone.removeprefix("left").removeprefix("right")


def _inside(times: Floats[Array, "samples"], episode: Episode) -> Bools[Array, "samples"]:
    return np.asarray((times >= episode[0]) & (times <= episode[1]))


def _without_gaps(
    times: Floats[Array, "samples"],
    forces: Floats[Array, "samples 3"],
    turns: Floats[Array, "samples 3"],
    moving: Bools[Array, "samples"],
) -> tuple[Floats[Array, "walked 3"], Floats[Array, "walked 3"]]:
    """Signals of the walk; short gaps are bridged by straight lines, which only this alignment sees."""
    known = np.isfinite(forces).all(axis=1) & np.isfinite(turns).all(axis=1)
    bridged = [
        np.stack([np.interp(times[moving], times[known], values[known, axis]) for axis in range(3)], axis=1)
        for values in (forces, turns)
    ]
    return bridged[0], bridged[1]


def _levelling(up: Floats[Array, "3"]) -> Floats[Array, "3 3"]:
    """Turns the sensor's axes so that y is up; x is whichever sensor axis lies flattest."""
    y = up / np.linalg.norm(up)
    flattest = np.eye(3)[int(np.argmin(np.abs(y)))]
    x = flattest - (flattest @ y) * y
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)])
