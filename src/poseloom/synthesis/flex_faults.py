"""Faults on demand of flex sensors."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Bools, Floats
from poseloom.sensors.layout import SensorLayout
from poseloom.synthesis.faults import Fault, FaultKind
from poseloom.synthesis.flex_readings import flex_counts
from poseloom.synthesis.flex_sensors import FlexSensors, draw_channels
from poseloom.synthesis.noise import Streams


def apply_flex_faults(
    counts: Floats[Array, "samples sensors"],
    bends: Floats[Array, "samples sensors"],
    times: Floats[Array, "samples"],
    faults: Iterable[Fault],
    layout: SensorLayout,
    sensors: FlexSensors,
    streams: Streams,
) -> None:
    """Spoils counts in place, fault after fault. Each fault draws from its own stream; lost lines stay lost."""
    top = sensors.board.top
    for fault in faults:
        sensor = layout.index(fault.sensor)
        stream = streams.stream(fault.sensor, "fault", fault.kind, f"{fault.start!r}")
        hit = (times >= fault.start) & (times < fault.stop)
        column = counts[:, sensor]
        came = np.isfinite(column)
        if fault.kind is FaultKind.SILENT:
            column[hit] = np.nan
        elif fault.kind is FaultKind.STUCK:
            _freeze(column, hit)
        elif fault.kind is FaultKind.SATURATED:
            column[hit & came] = top
        elif fault.kind is FaultKind.SWAP:
            other = counts[:, layout.index(fault.other)]
            column[hit], other[hit] = other[hit].copy(), column[hit].copy()
        elif fault.kind is FaultKind.REPLACED:
            after = came & (times >= fault.start)
            fresh = draw_channels(replace(sensors, lost_lines=0.0), 1, stream)
            begin = int(np.searchsorted(times, fault.start))
            if begin < len(times):
                read = np.full(len(times), np.nan)
                read[begin:] = flex_counts(bends[begin:, [sensor]], layout.rate, fresh, 0.0, stream)[:, 0]
                column[after] = read[after]
        else:
            column[hit] = np.clip(np.floor(column[hit] + _errors(fault, times[hit], stream)), 0.0, top)


def _freeze(column: Floats[Array, "samples"], hit: Bools[Array, "samples"]) -> None:
    """Repeats the last reading before the fault; a fault from the first sample on repeats the first that came."""
    places = np.flatnonzero(hit)
    came = np.flatnonzero(np.isfinite(column))
    if places.size == 0 or came.size == 0:
        return
    before = came[came < places[0]]
    column[hit & np.isfinite(column)] = column[before[-1] if before.size else came[0]]


def _errors(fault: Fault, times: Floats[Array, "hits"], stream: Generator) -> Floats[Array, "hits"]:
    if fault.kind is FaultKind.NOISE:
        return fault.size_counts * stream.normal(size=len(times))
    direction = stream.choice([-1.0, 1.0], size=len(times))
    if fault.kind is FaultKind.DRIFT:
        sign = direction[0] if len(times) else 1.0
        return sign * fault.size_counts * (times - fault.start) / (fault.stop - fault.start)
    return np.where(stream.random(len(times)) < fault.share, fault.size_counts * direction, 0.0)
