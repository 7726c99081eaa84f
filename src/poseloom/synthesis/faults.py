"""Faults on demand: what goes wrong with one tracker from one moment to another."""

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import SensorError
from poseloom.rotations import quat_from_rotvec, quat_multiply
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.synthesis.noise import Streams, outliers


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
        size_m: Of outliers: how far off; of noise: standard deviation an axis; of drift: its length at the end.
        size_rad: The same for the orientation.
        share: Share of samples that are hit, for outliers.
        other: Name of the sensor to swap with.
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
    size_counts: float = 300.0


@dataclass(frozen=True, eq=False)
class Readings:
    """What trackers say, to be spoilt in place.

    Attributes:
        times: Device times, seconds.
        positions: Metres, world; NaN = missing.
        quats_wxyz: `R_world_sensor`; NaN = missing.
    """

    times: Floats[Array, "samples"]
    positions: Floats[Array, "samples sensors 3"]
    quats_wxyz: Floats[Array, "samples sensors 4"]


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
    for name in ("size_m", "size_rad", "size_counts", "share"):
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
            readings.positions[hit, sensor] = np.nan
            readings.quats_wxyz[hit, sensor] = np.nan
        elif fault.kind is FaultKind.STUCK:
            _freeze(readings, sensor, hit)
        elif fault.kind is FaultKind.SWAP:
            other = layout.index(fault.other)
            for values in (readings.positions, readings.quats_wxyz):
                values[hit, sensor], values[hit, other] = values[hit, other].copy(), values[hit, sensor].copy()
        else:
            _disturb(readings, sensor, hit, _errors(fault, readings.times[hit], streams))


def _freeze(readings: Readings, sensor: int, hit: Bools[Array, "samples"]) -> None:
    """Repeats the last sound reading before the fault; a fault from the first sample on repeats that one."""
    places = np.flatnonzero(hit)
    if places.size == 0:
        return
    came = np.flatnonzero(np.isfinite(readings.positions[: max(int(places[0]), 1), sensor, 0]))
    held = int(came[-1]) if came.size else int(places[0])
    readings.positions[hit, sensor] = readings.positions[held, sensor].copy()
    readings.quats_wxyz[hit, sensor] = readings.quats_wxyz[held, sensor].copy()


def _errors(fault: Fault, times: Floats[Array, "hits"], streams: Streams) -> Floats[Array, "hits 6"]:
    stream = streams.stream(fault.sensor, "fault", fault.kind, f"{fault.start!r}")
    if fault.kind is FaultKind.NOISE:
        return np.asarray(stream.normal(size=(len(times), 6)) * np.repeat([fault.size_m, fault.size_rad], 3))
    if fault.kind is FaultKind.DRIFT:
        grown = (times - fault.start) / (fault.stop - fault.start)
        return np.asarray(grown[:, None] * outliers(stream, 1, fault.size_m, fault.size_rad))
    errors = outliers(stream, len(times), fault.size_m, fault.size_rad)
    return np.where((stream.random(len(times)) < fault.share)[:, None], errors, 0.0)


def _disturb(readings: Readings, sensor: int, hit: Bools[Array, "samples"], errors: Floats[Array, "hits 6"]) -> None:
    readings.positions[hit, sensor] += errors[:, :3]
    turns = quat_from_rotvec(errors[:, 3:])
    readings.quats_wxyz[hit, sensor] = quat_multiply(readings.quats_wxyz[hit, sensor], turns)
