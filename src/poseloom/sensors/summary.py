"""A recording in words and numbers, for people."""

import numpy as np

from poseloom.sensors.recording import Recording
from poseloom.sensors.sample import SensorStatus

_LONGEST_SETTING = 60


def summarise(recording: Recording) -> list[tuple[str, str]]:
    """Labels and texts: layout, length, what is missing, delays, truth, and how it was made."""
    layout = recording.layout
    sensors = ", ".join(f"{sensor.name} ({sensor.kind})" for sensor in layout.sensors)
    delays = (recording.arrivals - recording.times) * 1e3
    return [
        ("name", recording.name or "-"),
        ("layout", f"{layout.name}, {layout.rate:g} Hz"),
        ("sensors", sensors),
        ("samples", f"{len(recording)} in {recording.duration:.2f} s"),
        ("missing", _share_by_sensor(recording, SensorStatus.MISSING)),
        ("flagged", _flags(recording)),
        ("delay", f"{np.median(delays):.1f} ms, at most {delays.max():.1f} ms"),
        ("truth", "none" if recording.truth is None else f"{len(recording.truth)} poses"),
        *((key, _shortened(value)) for key, value in recording.settings.items()),
    ]


def _share_by_sensor(recording: Recording, status: SensorStatus) -> str:
    shares = (recording.status == status).mean(axis=0)
    told = [f"{name} {share:.1%}" for name, share in zip(recording.layout.names, shares, strict=True) if share > 0]
    return ", ".join(told) or "none"


def _flags(recording: Recording) -> str:
    rare = (SensorStatus.LATE, SensorStatus.SATURATED, SensorStatus.STUCK)
    counts = [(status.name.lower(), int((recording.status == status).sum())) for status in rare]
    return ", ".join(f"{count} {name}" for name, count in counts if count) or "none"


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST_SETTING else text[: _LONGEST_SETTING - 3] + "..."
