"""Faults on demand: what goes wrong with one sensor from one moment to another."""

import abc
import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import SensorError, unknown_name
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.synthesis.noise import Streams


class FaultKind(enum.StrEnum):
    """What goes wrong.

    SILENT: nothing comes. STUCK: the last reading before the fault is repeated as if it were new. OUTLIERS: a share of
    readings lies off. NOISE: more white noise. DRIFT: an error in one direction that grows evenly to its size at the
    end, and then is gone. SWAP: the readings of two sensors are exchanged. Of flex sensors only: SATURATED: the reading
    stands at the upper end. REPLACED: from its start on, for good, another, new sensor is worn.
    """

    SILENT = "silent"
    STUCK = "stuck"
    OUTLIERS = "outliers"
    NOISE = "noise"
    DRIFT = "drift"
    SWAP = "swap"
    SATURATED = "saturated"
    REPLACED = "replaced"


@dataclass(frozen=True)
class Fault:
    """One fault of one sensor. The recording's status stays OK but for a silent one: a sensor does not know its faults.

    Attributes:
        sensor: Name of the sensor.
        start: Device time at which it begins, seconds.
        stop: Device time at which it is over, seconds; a sample at this time is sound.
        kind: What goes wrong.
        size_m: Of a tracker's outliers: how far off; of noise: standard deviation an axis; of drift: its length at the
            end.
        size_rad: The same for a tracker's orientation.
        share: Share of samples that are hit, for outliers.
        other: Name of the sensor to swap with, which must be of the same kind.
        size_m_s2: As `size_m`, for the specific force of an IMU.
        size_rad_s: The same for its angular rate.
        size_counts: As `size_m`, for the counts of a flex sensor.
    """

    sensor: str
    start: float
    stop: float
    kind: FaultKind = FaultKind.SILENT
    size_m: float = 0.3
    size_rad: float = 0.5
    share: float = 1.0
    other: str = ""
    size_m_s2: float = 30.0
    size_rad_s: float = 6.0
    size_counts: float = 300.0


class Readings(abc.ABC):
    """What the sensors of one kind say, to be spoilt in place.

    Attributes:
        times: Device times, seconds.
    """

    times: Floats[Array, "samples"]

    @property
    @abc.abstractmethod
    def channels(self) -> tuple[Floats[Array, "samples sensors *value"], ...]:
        """What is said: each channel's values, NaN = missing; all channels of a sensor are missing together."""

    @abc.abstractmethod
    def errors(self, fault: Fault, stream: Generator, count: int) -> Floats[Array, "count error"]:
        """Draws `count` errors of the fault's size: of white noise for noise, else in random directions."""

    @abc.abstractmethod
    def disturb(self, sensor: int, hit: Bools[Array, "samples"], errors: Floats[Array, "hits error"]) -> None:
        """Adds one error to each sample of a sensor that is hit."""


def check_fault(fault: Fault, layout: SensorLayout) -> None:
    """Raises SensorError for an unknown sensor, an interval that is none, or sizes that make no sense."""
    worn = layout.sensors[layout.index(fault.sensor)].kind
    if fault.kind in (FaultKind.SATURATED, FaultKind.REPLACED) and worn is not SensorKind.FLEX:
        raise SensorError(
            f"a fault {fault.kind.value!r} of {fault.sensor!r}, which is no flex sensor",
            remedy="Choose another fault, such as silent or stuck",
        )
    if fault.kind is FaultKind.SWAP:
        layout.index(fault.other)
    if math.isnan(fault.start) or math.isnan(fault.stop) or fault.stop <= fault.start:
        raise SensorError(
            f"a fault of {fault.sensor!r} lasts from {fault.start} s to {fault.stop} s",
            remedy="Let it stop after its start",
        )
    for name in ("size_m", "size_rad", "size_m_s2", "size_rad_s", "size_counts", "share"):
        size = getattr(fault, name)
        if not (math.isfinite(size) and size >= 0) or (name == "share" and size > 1):
            raise SensorError(
                f"a fault of {fault.sensor!r} has the {name} {size}",
                remedy="Give finite sizes that are not negative, and a share of at most one",
            )


def apply_faults(readings: Readings, faults: Iterable[Fault], layout: SensorLayout, streams: Streams) -> None:
    """Spoils readings in place, fault after fault. Each fault draws from its own stream."""
    for fault in faults:
        sensor = layout.index(fault.sensor)
        hit = (readings.times >= fault.start) & (readings.times < fault.stop)
        if fault.kind is FaultKind.SILENT:
            for values in readings.channels:
                values[hit, sensor] = np.nan
        elif fault.kind is FaultKind.STUCK:
            _freeze(readings, sensor, hit)
        elif fault.kind is FaultKind.SWAP:
            other = layout.index(fault.other)
            for values in readings.channels:
                values[hit, sensor], values[hit, other] = values[hit, other].copy(), values[hit, sensor].copy()
        else:
            readings.disturb(sensor, hit, _errors(fault, readings, hit, streams))


def _freeze(readings: Readings, sensor: int, hit: Bools[Array, "samples"]) -> None:
    """Repeats the last sound reading before the fault; a fault from the first sample on repeats that one."""
    places = np.flatnonzero(hit)
    if places.size == 0:
        return
    said = readings.channels[0][: max(int(places[0]), 1), sensor]
    came = np.flatnonzero(np.isfinite(said.reshape(len(said), -1)[:, 0]))
    held = int(came[-1]) if came.size else int(places[0])
    for values in readings.channels:
        values[hit, sensor] = values[held, sensor].copy()


def _errors(
    fault: Fault, readings: Readings, hit: Bools[Array, "samples"], streams: Streams
) -> Floats[Array, "hits error"]:
    stream = streams.stream(fault.sensor, "fault", fault.kind, f"{fault.start!r}")
    times = readings.times[hit]
    if fault.kind is FaultKind.NOISE:
        return readings.errors(fault, stream, len(times))
    if fault.kind is FaultKind.DRIFT:
        grown = (times - fault.start) / (fault.stop - fault.start)
        return np.asarray(grown[:, None] * readings.errors(fault, stream, 1))
    errors = readings.errors(fault, stream, len(times))
    return np.where((stream.random(len(times)) < fault.share)[:, None], errors, 0.0)


def parse_fault(text: str) -> Fault:
    """A fault from KIND:SENSOR:START:STOP, or with A+B as SENSOR for a swap. Raises SensorError."""
    try:
        kind, sensor, start, stop = text.split(":")
        begin, end = float(start), float(stop)
    except ValueError:
        raise SensorError(
            f"the fault {text!r} is not understood",
            remedy="Write KIND:SENSOR:START:STOP with times in seconds, such as silent:leftHand:2:3",
        ) from None
    if kind not in set(FaultKind):
        raise unknown_name("kind of fault", kind, list(FaultKind), SensorError)
    first, _, other = sensor.partition("+")
    return Fault(first, begin, end, FaultKind(kind), other=other)
