"""Virtual trackers: what six-degree-of-freedom trackers on a moving body would say."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Bools, Floats
from poseloom.rotations import quat_from_matrix, quat_from_rotvec, quat_multiply
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.sensors.placement import Placement, default_placements, place_sensors
from poseloom.sensors.recording import Recording, make_recording
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors, resample
from poseloom.synthesis.faults import Fault, FaultKind, Readings, apply_faults, check_fault
from poseloom.synthesis.noise import (
    Streams,
    TrackerNoise,
    check_noise,
    draw_arrivals,
    draw_errors,
    outliers,
    two_vectors,
)
from poseloom.synthesis.wearing import check_wearer, misplaced, told_settings


@dataclass(frozen=True, eq=False)
class TrackerReadings(Readings):
    """What trackers say, to be spoilt in place.

    Attributes:
        times: Device times, seconds.
        positions: Metres, world; NaN = missing.
        quats_wxyz: `R_world_sensor`; NaN = missing.
    """

    times: Floats[Array, "samples"]
    positions: Floats[Array, "samples sensors 3"]
    quats_wxyz: Floats[Array, "samples sensors 4"]

    @property
    def channels(self) -> tuple[Floats[Array, "samples sensors *value"], ...]:
        """Positions and orientations."""
        return self.positions, self.quats_wxyz

    def errors(self, fault: Fault, stream: Generator, count: int) -> Floats[Array, "count error"]:
        """Displacements in the world and rotation vectors about the sensor's axes."""
        draw = two_vectors if fault.kind is FaultKind.NOISE else outliers
        return draw(stream, count, fault.size_m, fault.size_rad)

    def disturb(self, sensor: int, hit: Bools[Array, "samples"], errors: Floats[Array, "hits error"]) -> None:
        """Shifts and turns the readings that are hit."""
        self.positions[hit, sensor] += errors[:, :3]
        self.quats_wxyz[hit, sensor] = quat_multiply(self.quats_wxyz[hit, sensor], quat_from_rotvec(errors[:, 3:]))


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
    check_wearer(motion, layout, SensorKind.TRACKER)
    check_noise(noise)
    for fault in faults:
        check_fault(fault, layout)
    streams = Streams(seed)
    truth = resample(motion, layout.rate)
    stated = default_placements(layout, motion.skeleton) if placements is None else tuple(placements)
    worn = misplaced(stated, layout, noise.placement_m, noise.placement_rad, streams)
    times = np.arange(len(truth)) / layout.rate
    seen = truth if noise.lag_s == 0 else _delayed(motion, times - noise.lag_s, layout.rate)
    frames = place_sensors(motion_frames(seen), motion.skeleton, worn)
    readings = TrackerReadings(times, frames.positions, quat_from_matrix(frames.rotations))
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
        settings=told_settings("simulate_trackers", motion, noise, faults, streams, None if worn is stated else worn),
    )


def _delayed(motion: Motion, moments: Floats[Array, "samples"], rate: float) -> Motion:
    """The motion at arbitrary moments, in seconds from its first frame; before that it stands still."""
    places = np.clip(moments * motion.rate, 0, len(motion) - 1)
    before = np.minimum(np.floor(places).astype(np.int64), max(len(motion) - 2, 0))
    after = np.minimum(before + 1, len(motion) - 1)
    return make_motion(
        motion.skeleton, interpolate_pose_vectors(motion.q[before], motion.q[after], places - before), rate
    )


def _spoil(readings: TrackerReadings, layout: SensorLayout, noise: TrackerNoise, streams: Streams) -> None:
    for index, sensor in enumerate(layout.names):
        errors = draw_errors(noise, len(readings.times), layout.rate, sensor, streams)
        readings.positions[:, index] += errors.shifts
        if errors.turns.any():
            quats = quat_multiply(readings.quats_wxyz[:, index], quat_from_rotvec(errors.turns))
            readings.quats_wxyz[:, index] = quats
        readings.positions[errors.gone, index] = np.nan
        readings.quats_wxyz[errors.gone, index] = np.nan
