"""Virtual trackers: what six-degree-of-freedom trackers on a moving body would say."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Floats
from poseloom.errors import SensorError
from poseloom.formats.recording_header import placements_from_json, placements_to_json
from poseloom.rotations import matrix_from_rotvec, quat_from_matrix, quat_from_rotvec, quat_multiply
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.sensors.placement import Placement, default_placements, make_placement, place_sensors
from poseloom.sensors.recording import Recording, make_recording
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors, resample
from poseloom.synthesis.faults import Fault, Readings, apply_faults, check_fault
from poseloom.synthesis.noise import Streams, TrackerNoise, check_noise, draw_arrivals, draw_errors

TRUE_PLACEMENTS = "true placements"
"""Key in a recording's settings of where the sensors really sat (JSON, see `true_placements`)."""


def simulate_trackers(
    motion: Motion,
    layout: SensorLayout,
    noise: TrackerNoise = TrackerNoise(),  # noqa: B008 - frozen
    faults: Sequence[Fault] = (),
    seed: int | Generator = 0,
    placements: Sequence[Placement] | None = None,
) -> Recording:
    """Lets a body wear virtual trackers and records them.

    The motion is resampled to the layout's rate and becomes the recording's truth; sample i is frame i, at i / rate
    seconds. Exact kinematics of the placements, then the errors of `noise`, then `faults` in order. Each sensor and
    each kind of error has a random stream of its own.

    Args:
        motion: Moves the body that wears the sensors; its skeleton becomes the recording's.
        layout: Trackers only.
        noise: Errors; `NO_NOISE` for none.
        faults: What goes wrong at stated times, in addition.
        seed: Number or generator for all that is drawn.
        placements: Where the recording says the sensors sit; sane places if left out.

    Returns:
        The recording; its settings tell all parameters that are not zero, and where the sensors really sat if there is
        a placement error.

    Raises:
        SensorError: if the layout has other sensors than trackers, a bone is missing, the motion's joints translate, or
            a parameter makes no sense.
    """
    _check_wearer(motion, layout)
    check_noise(noise)
    for fault in faults:
        check_fault(fault, layout)
    streams = Streams(seed)
    truth = resample(motion, layout.rate)
    stated = default_placements(layout, motion.skeleton) if placements is None else tuple(placements)
    worn = _misplaced(stated, layout, noise, streams)
    times = np.arange(len(truth)) / layout.rate
    seen = truth if noise.lag_s == 0 else _delayed(motion, times - noise.lag_s, layout.rate)
    frames = place_sensors(motion_frames(seen), motion.skeleton, worn)
    readings = Readings(times, frames.positions, quat_from_matrix(frames.rotations))
    _spoil(readings, layout, noise, streams)
    apply_faults(readings, faults, layout, streams)
    return make_recording(
        layout,
        stated,
        motion.skeleton,
        times,
        arrivals=draw_arrivals(noise, times, streams),
        positions=readings.positions,
        quats_wxyz=readings.quats_wxyz,
        truth=truth,
        name=motion.name,
        settings=_settings(motion, noise, faults, streams, None if worn is stated else worn),
    )


def true_placements(recording: Recording) -> tuple[Placement, ...]:
    """Where the sensors of a simulated recording really sat: what calibration should find.

    That is where the recording says, unless it was simulated with a placement error.
    """
    text = recording.settings.get(TRUE_PLACEMENTS)
    if text is None:
        return recording.placements
    return placements_from_json(json.loads(text))


def _check_wearer(motion: Motion, layout: SensorLayout) -> None:
    if motion.displacements is not None:
        raise SensorError(
            "the motion moves its joints apart, so no sensor keeps its place on a bone",
            remedy="Retarget the motion to the body first",
        )
    others = [sensor.name for sensor in layout.sensors if sensor.kind is not SensorKind.TRACKER]
    if others:
        raise SensorError(
            f"layout {layout.name!r} has sensors that are no trackers: {', '.join(others)}",
            remedy="Choose a layout of trackers, such as six-trackers",
        )


def _misplaced(
    stated: tuple[Placement, ...], layout: SensorLayout, noise: TrackerNoise, streams: Streams
) -> tuple[Placement, ...]:
    """Where the sensors really sit."""
    if not (noise.placement_m or noise.placement_rad):
        return stated
    worn: list[Placement] = []
    for sensor, placement in zip(layout.names, stated, strict=True):
        shift, turn = streams.stream(sensor, "placement").normal(size=(2, 3))
        worn.append(
            make_placement(
                placement.bone,
                placement.p_bone_sensor + noise.placement_m * shift,
                placement.R_bone_sensor @ matrix_from_rotvec(noise.placement_rad * turn),
            )
        )
    return tuple(worn)


def _delayed(motion: Motion, moments: Floats[Array, "samples"], rate: float) -> Motion:
    """The motion at arbitrary moments, in seconds from its first frame; before that it stands still."""
    places = np.clip(moments * motion.rate, 0, len(motion) - 1)
    before = np.minimum(np.floor(places).astype(np.int64), max(len(motion) - 2, 0))
    after = np.minimum(before + 1, len(motion) - 1)
    return make_motion(
        motion.skeleton, interpolate_pose_vectors(motion.q[before], motion.q[after], places - before), rate
    )


def _spoil(readings: Readings, layout: SensorLayout, noise: TrackerNoise, streams: Streams) -> None:
    for index, sensor in enumerate(layout.names):
        errors = draw_errors(noise, len(readings.times), layout.rate, sensor, streams)
        readings.positions[:, index] += errors.shifts
        if errors.turns.any():
            quats = quat_multiply(readings.quats_wxyz[:, index], quat_from_rotvec(errors.turns))
            readings.quats_wxyz[:, index] = quats
        readings.positions[errors.gone, index] = np.nan
        readings.quats_wxyz[errors.gone, index] = np.nan


def _settings(
    motion: Motion,
    noise: TrackerNoise,
    faults: Sequence[Fault],
    streams: Streams,
    worn: tuple[Placement, ...] | None,
) -> Mapping[str, str]:
    settings = {"made by": "simulate_trackers", "source": motion.name, "seed": str(streams.seed)}
    told = {each.name: getattr(noise, each.name) for each in fields(noise)}
    settings |= {f"noise {name}": repr(value) for name, value in told.items() if value}
    if faults:
        settings["faults"] = json.dumps([asdict(fault) for fault in faults])
    if worn is not None:
        settings[TRUE_PLACEMENTS] = json.dumps(placements_to_json(worn))
    return settings
