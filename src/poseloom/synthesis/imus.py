"""Virtual IMUs: what accelerometers and gyroscopes on a moving body would say."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Bools, Floats
from poseloom.rotations import matrix_from_quat, quat_conjugate, quat_from_matrix, quat_multiply
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.sensors.paths import SmoothPath
from poseloom.sensors.placement import Placement, default_placements, place_sensors
from poseloom.sensors.recording import Recording, make_recording
from poseloom.sensors.sample import SensorStatus
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import frame_instants, resample
from poseloom.synthesis.faults import Fault, FaultKind, Readings, apply_faults, check_fault
from poseloom.synthesis.noise import Delivery, Streams, check_noise, draw_arrivals, draw_gaps, outliers, two_vectors
from poseloom.synthesis.wearing import check_wearer, misplaced, told_settings

GRAVITY = 9.80665
"""Standard gravity, m/s^2, along world -y."""


@dataclass(frozen=True)
class ImuNoise(Delivery):
    """Errors of IMUs. The defaults are those of the MEMS sensors in phones and watches, strapped on with some care.

    A standard deviation holds for each of the sensor's three axes. Losses and delays: see `Delivery`.

    Attributes:
        force_m_s2: White noise of the specific force, standard deviation of each sample.
        rate_rad_s: The same of the angular rate.
        force_bias_m_s2: Standard deviation of an error that a sensor keeps for the whole recording.
        rate_bias_rad_s: The same of the angular rate.
        force_walk: Random walk added to the bias: standard deviation after one second, m/s^2; it grows with the root of
            time.
        rate_walk: The same of the angular rate, rad/s.
        force_scale: Standard deviation of the relative error of each axis' scale.
        rate_scale: The same of the angular rate.
        bandwidth_hz: Frequency at which the sensor's filter, which has no delay, passes one half; at most a third of
            the motion's own rate. Infinite: no filter. Real sensors pass more than 10 Hz, but above it recordings of
            motion hold more jitter than motion (docs/benchmarks/real-imus.md).
        force_range_m_s2: End of the accelerometer's range; what lies beyond reads as the end, with status SATURATED.
        rate_range_rad_s: End of the gyroscope's range.
        clock_error: Standard deviation of the relative error of a sensor's clock: its samples slip against the truth.
        clock_offset_s: Standard deviation of a constant lead or lag of a sensor's samples.
        sampling_jitter_s: Standard deviation of when each sample is really taken.
        placement_m: Standard deviation of the offset between where a sensor really sits and where the recording says.
        placement_rad: The same for how it is turned.
    """

    force_m_s2: float = 0.03
    rate_rad_s: float = 0.002
    force_bias_m_s2: float = 0.1
    rate_bias_rad_s: float = math.radians(0.5)
    force_walk: float = 0.0005
    rate_walk: float = 0.0001
    force_scale: float = 0.005
    rate_scale: float = 0.005
    bandwidth_hz: float = 10.0
    force_range_m_s2: float = 16 * GRAVITY
    rate_range_rad_s: float = math.radians(2000.0)
    clock_error: float = 2e-5
    clock_offset_s: float = 0.0
    sampling_jitter_s: float = 0.0
    placement_m: float = 0.01
    placement_rad: float = math.radians(5.0)


NO_IMU_NOISE = ImuNoise(
    force_m_s2=0.0,
    rate_rad_s=0.0,
    force_bias_m_s2=0.0,
    rate_bias_rad_s=0.0,
    force_walk=0.0,
    rate_walk=0.0,
    force_scale=0.0,
    rate_scale=0.0,
    bandwidth_hz=math.inf,
    force_range_m_s2=math.inf,
    rate_range_rad_s=math.inf,
    clock_error=0.0,
    placement_m=0.0,
    placement_rad=0.0,
)
"""IMUs that tell the truth, jitter of the recorded motion included: their bandwidth is infinite."""


class ImuSignals(NamedTuple):
    """What IMUs feel.

    Attributes:
        specific_forces: m/s^2, sensor frame.
        angular_rates: rad/s, sensor frame.
    """

    specific_forces: Floats[Array, "samples 3"]
    angular_rates: Floats[Array, "samples 3"]


@dataclass(frozen=True, eq=False)
class ImuReadings(Readings):
    """What IMUs say, to be spoilt in place.

    Attributes:
        times: Device times, seconds.
        specific_forces: m/s^2, sensor frame; NaN = missing.
        angular_rates: rad/s, sensor frame; NaN = missing.
    """

    times: Floats[Array, "samples"]
    specific_forces: Floats[Array, "samples sensors 3"]
    angular_rates: Floats[Array, "samples sensors 3"]

    @property
    def channels(self) -> tuple[Floats[Array, "samples sensors *value"], ...]:
        """Specific forces and angular rates."""
        return self.specific_forces, self.angular_rates

    def errors(self, fault: Fault, stream: Generator, count: int) -> Floats[Array, "count error"]:
        """Errors of specific force and angular rate."""
        draw = two_vectors if fault.kind is FaultKind.NOISE else outliers
        return draw(stream, count, fault.size_m_s2, fault.size_rad_s)

    def disturb(self, sensor: int, hit: Bools[Array, "samples"], errors: Floats[Array, "hits error"]) -> None:
        """Adds the errors to the readings that are hit."""
        self.specific_forces[hit, sensor] += errors[:, :3]
        self.angular_rates[hit, sensor] += errors[:, 3:]


def simulate_imus(
    motion: Motion,
    layout: SensorLayout,
    noise: ImuNoise = ImuNoise(),
    faults: Sequence[Fault] = (),
    seed: int | Generator = 0,
    placements: Sequence[Placement] | None = None,
) -> Recording:
    """Lets a body wear virtual IMUs and records them.

    The motion is resampled to the layout's rate and becomes the recording's truth; sample i is frame i, at i / rate
    seconds. The signals do not come from the resampled frames but from quintic splines through the places and
    quaternions of each sensor at the motion's own rate (`SmoothPath`): specific force `R^T (a - g)` and angular rate
    in the sensor's frame, at the places where the sensors really sit. Then the errors of `noise`, `faults` in order,
    and the ends of the ranges. Each sensor and each kind of error has a random stream of its own.

    Args:
        motion: Moves the body that wears the sensors; its skeleton becomes the recording's.
        layout: IMUs only.
        noise: Errors; `NO_IMU_NOISE` for none.
        faults: What goes wrong at stated times, in addition.
        seed: Number or generator for all that is drawn.
        placements: Where the recording says the sensors sit; sane places if left out.

    Returns:
        The recording; its settings tell all parameters that are not zero, and where the sensors really sat if there is
        a placement error (`true_placements`).

    Raises:
        SensorError: if the layout has other sensors than IMUs, a bone is missing, the motion's joints translate, or a
            parameter makes no sense.
    """
    check_wearer(motion, layout, SensorKind.IMU)
    check_noise(noise)
    for fault in faults:
        check_fault(fault, layout)
    streams = Streams(seed)
    truth = resample(motion, layout.rate)
    stated = default_placements(layout, motion.skeleton) if placements is None else tuple(placements)
    worn = misplaced(stated, layout, noise.placement_m, noise.placement_rad, streams)
    times = np.arange(len(truth)) / layout.rate
    readings = _readings(motion, layout, worn, noise, times, streams)
    apply_faults(readings, faults, layout, streams)
    saturated = _saturate(readings, noise)
    missing = np.isnan(readings.specific_forces[..., 0])
    status = np.where(missing, SensorStatus.MISSING, np.where(saturated, SensorStatus.SATURATED, SensorStatus.OK))
    return make_recording(
        layout,
        stated,
        motion.skeleton,
        times,
        arrivals=draw_arrivals(noise, times, streams),
        specific_forces=readings.specific_forces,
        angular_rates=readings.angular_rates,
        status=status.astype(np.int64),
        truth=truth,
        name=motion.name,
        settings=told_settings("simulate_imus", motion, noise, faults, streams, None if worn is stated else worn),
    )


def imu_signals(
    positions: Floats[Array, "frames 3"],
    rotations: Floats[Array, "frames 3 3"],
    rate: float,
    places: Floats[Array, "samples"],
    bandwidth_hz: float = math.inf,
) -> ImuSignals:
    """What an ideal IMU feels on its way.

    Args:
        positions: Where it is, metres, world.
        rotations: `R_world_sensor`.
        rate: Frames a second.
        places: Where to look, counted in frames; between them the way is a quintic spline.
        bandwidth_hz: See `SmoothPath`.
    """
    quats = quat_from_matrix(rotations)
    flips = np.where(np.sum(quats[1:] * quats[:-1], axis=1) < 0, -1.0, 1.0)
    quats[1:] *= np.cumprod(flips)[:, None]
    path = SmoothPath(np.concatenate([positions, quats], axis=1), rate, bandwidth_hz)
    quat = path.at(places)[:, 3:]
    length = np.linalg.norm(quat, axis=1, keepdims=True)
    # The spline of quaternions leaves the unit sphere a little: its radial part is divided out, as it turns nothing.
    spun = quat_multiply(quat_conjugate(quat), path.at(places, 1)[:, 3:]) / length**2
    felt = path.at(places, 2)[:, :3] + np.array([0.0, GRAVITY, 0.0])
    R_world_sensor = matrix_from_quat(quat / length)
    return ImuSignals(np.einsum("nji,nj->ni", R_world_sensor, felt), 2.0 * spun[:, 1:])


def _readings(
    motion: Motion,
    layout: SensorLayout,
    worn: Sequence[Placement],
    noise: ImuNoise,
    times: Floats[Array, "samples"],
    streams: Streams,
) -> ImuReadings:
    frames = place_sensors(motion_frames(motion), motion.skeleton, worn)
    before, fraction = frame_instants(len(motion), motion.rate, layout.rate)
    readings = ImuReadings(times, *np.full((2, len(times), len(layout), 3), np.nan))
    for index, sensor in enumerate(layout.names):
        slip = _slip(noise, times, sensor, streams)
        places = np.clip(before + fraction + slip * motion.rate, 0.0, len(motion) - 1)
        felt = imu_signals(
            frames.positions[:, index], frames.rotations[:, index], motion.rate, places, noise.bandwidth_hz
        )
        gains, errors = _draw_errors(noise, times, layout.rate, sensor, streams)
        readings.specific_forces[:, index] = felt.specific_forces * gains[:3] + errors[:, :3]
        readings.angular_rates[:, index] = felt.angular_rates * gains[3:] + errors[:, 3:]
        gone = draw_gaps(noise, len(times), layout.rate, sensor, streams)
        for values in readings.channels:
            values[gone, index] = np.nan
    return readings


def _slip(noise: ImuNoise, times: Floats[Array, "samples"], sensor: str, streams: Streams) -> Floats[Array, "samples"]:
    """By how much later than its time says each sample was taken, seconds."""
    drift, offset = streams.stream(sensor, "clock").normal(size=2) * [noise.clock_error, noise.clock_offset_s]
    jitter = noise.sampling_jitter_s * streams.stream(sensor, "sampling").normal(size=len(times))
    return np.asarray(drift * times + offset + jitter)


def _draw_errors(
    noise: ImuNoise, times: Floats[Array, "samples"], rate: float, sensor: str, streams: Streams
) -> tuple[Floats[Array, "6"], Floats[Array, "samples 6"]]:
    """Gains of the six axes, and what is added to them: white noise, bias and its walk."""

    def draw(purpose: str, count: int, force: float, turn: float) -> Floats[Array, "count 6"]:
        return two_vectors(streams.stream(sensor, purpose), count, force, turn)

    errors = draw("white", len(times), noise.force_m_s2, noise.rate_rad_s)
    errors += draw("bias", 1, noise.force_bias_m_s2, noise.rate_bias_rad_s)
    steps = draw("walk", len(times), noise.force_walk, noise.rate_walk) / math.sqrt(rate)
    steps[0] = 0.0
    errors += np.cumsum(steps, axis=0)
    return 1.0 + draw("scale", 1, noise.force_scale, noise.rate_scale)[0], errors


def _saturate(readings: ImuReadings, noise: ImuNoise) -> Bools[Array, "samples sensors"]:
    """Clips to the ranges; says which samples reached them."""
    reached = np.zeros(readings.specific_forces.shape[:2], dtype=np.bool_)
    for values, end in zip(readings.channels, (noise.force_range_m_s2, noise.rate_range_rad_s), strict=True):
        reached |= (np.abs(values) >= end).any(axis=-1)
        np.clip(values, -end, end, out=values)
    return reached
