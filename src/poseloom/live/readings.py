"""What a parser makes of bytes: readings of named sensors, checked before anything else sees them."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from poseloom.sensors import Sample, SensorLayout
from poseloom.sensors.sample import SensorStatus

Vector = tuple[float, ...]


class MalformedPacket(ValueError):
    """Bytes that are not what they should be. The session counts and drops them; it never ends by them."""


@dataclass(frozen=True)
class Limits:
    """Beyond these a value is no measurement. Wide, so that wrong units are heard and named rather than dropped.

    Attributes:
        position: Metres from the origin.
        specific_force: m/s^2.
        angular_rate: rad/s.
        count: Of a converter.
        time: Seconds of a device's clock.
    """

    position: float = 1e4
    specific_force: float = 1e5
    angular_rate: float = 1e5
    count: float = 2.0**24
    time: float = 1e12


LIMITS = Limits()


@dataclass(frozen=True)
class Reading:
    """What one sensor said at once; None for what it does not measure or did not say. Units as in `Sample`."""

    position: Vector | None = None
    quat_wxyz: Vector | None = None
    specific_force: Vector | None = None
    angular_rate: Vector | None = None
    count: float | None = None

    @property
    def is_empty(self) -> bool:
        """Whether it says nothing."""
        return (
            self.position is None
            and self.quat_wxyz is None
            and self.specific_force is None
            and self.angular_rate is None
            and self.count is None
        )


@dataclass(frozen=True)
class Refusal:
    """One part of a packet that is not used; the rest of the packet is.

    Attributes:
        reason: Why, in a few words that are the same for all refusals of one kind.
        who: The sensor or device, as far as it is known.
        missing: Whether the part is well-formed and reports that it has no measurement yet.
    """

    reason: str
    who: str = ""
    missing: bool = False


@dataclass(frozen=True)
class Packet:
    """Readings that came together.

    Attributes:
        readings: By sensor name.
        time: The device's time in seconds; None where it has no clock, and the arrival is the time.
        whole: Whether the device has said all that it will say of this moment, so that nothing is waited for.
        refused: Parts that came with these readings and are not used.
        messages: How many messages of each kind the packet carried, in words ("bones"), where a protocol has kinds.
        paced: Whether `time` goes at another pace than the host's clock, as where a recording is played faster.
    """

    readings: Mapping[str, Reading] = field(default_factory=dict[str, Reading])
    time: float | None = None
    whole: bool = False
    refused: tuple[Refusal, ...] = ()
    messages: Mapping[str, int] = field(default_factory=dict[str, int])
    paced: bool = False


NO_FIX = "no position yet: the quaternion is all zeros"
AT_ORIGIN = "no position yet: exactly at the origin and exactly unrotated"


def checked_vector(values: Iterable[float], size: int, limit: float) -> Vector:
    """A vector of finite numbers within a limit. Raises MalformedPacket."""
    vector = tuple(map(float, values))
    if len(vector) != size or not all(abs(value) <= limit for value in vector):  # a NaN is not within any limit
        raise MalformedPacket(f"not {size} numbers up to {limit:g}")
    return vector


def checked_quat(quat_wxyz: Iterable[float]) -> Vector:
    """A quaternion made unit. Raises MalformedPacket where its length is far from one."""
    quat = checked_vector(quat_wxyz, 4, 2.0)
    length = math.sqrt(sum(value * value for value in quat))
    if not 0.9 <= length <= 1.1:
        raise MalformedPacket("a quaternion whose length is far from 1")
    return tuple(value / length for value in quat)


def without_fix(position: Iterable[float] | None, quat_wxyz: Iterable[float]) -> str:
    """Why a device has no measurement yet, by what trackers send before their first fix; empty where it has one.

    Args:
        position: Metres; None where the device sends none.
        quat_wxyz: As received, before it is made unit.
    """
    w, *vector = quat_wxyz
    if w == 0.0 and not any(vector):
        return NO_FIX
    if position is not None and not any(position) and w == 1.0 and not any(vector):
        return AT_ORIGIN
    return ""


def checked_time(value: float) -> float:
    """A device time. Raises MalformedPacket."""
    time = float(value)
    if not abs(time) <= LIMITS.time:
        raise MalformedPacket("a time that is none")
    return time


def sample_of_readings(readings: Mapping[str, Reading], layout: SensorLayout, time: float, arrival: float) -> Sample:
    """A sample of a layout; sensors without a reading are missing, readings of other sensors are left out."""
    count = len(layout)
    columns = (
        np.full((count, 3), np.nan),
        np.full((count, 4), np.nan),
        np.full((count, 3), np.nan),
        np.full((count, 3), np.nan),
        np.full(count, np.nan),
    )
    status = np.full(count, int(SensorStatus.MISSING), dtype=np.int64)
    for index, name in enumerate(layout.names):
        reading = readings.get(name)
        if reading is None or reading.is_empty:
            continue
        status[index] = SensorStatus.OK
        said = (
            reading.position,
            reading.quat_wxyz,
            reading.specific_force,
            reading.angular_rate,
            reading.count,
        )
        for column, value in zip(columns, said, strict=True):
            if value is not None:
                column[index] = value
    for array in (*columns, status):
        array.flags.writeable = False
    return Sample(time, arrival, *columns, status)


def readings_of_sample(sample: Sample, layout: SensorLayout) -> dict[str, Reading]:
    """The inverse of `sample_of_readings`: every bit is kept."""
    channels = (sample.positions, sample.quats_wxyz, sample.specific_forces, sample.angular_rates)
    readings: dict[str, Reading] = {}
    for index, name in enumerate(layout.names):
        vectors = [tuple(column[index].tolist()) if np.isfinite(column[index]).all() else None for column in channels]
        count = float(sample.counts[index])
        reading = Reading(*vectors, count=None if math.isnan(count) else count)
        if not reading.is_empty:
            readings[name] = reading
    return readings
