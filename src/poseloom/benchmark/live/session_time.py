"""Session time beside the time of arrival, for devices of any rate, in floods and over pauses: simulated, no sleeping.

What a session makes of arrivals is decided by `Hearing` alone, from the times that it is given; so arrivals of hours
are tried in seconds, and the figures are the same on any machine.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from poseloom.evaluation.rows import Row
from poseloom.live.hearing import Hearing
from poseloom.live.readings import Packet, Reading
from poseloom.sensors import Sample, layout

Show = Callable[[str, int, int], None]
_row = partial(Row, "session time", split="none")
_RATE = 40.0
_TICK = 0.01
"""Seconds between looks at silence, as in a session."""
_DELAY = 0.002
"""Mean network delay, seconds."""


@dataclass(frozen=True)
class _Arrivals:
    """A device's packets: its rate, and seconds between which it is silent or somebody floods the port."""

    rate: float
    pause: tuple[float, float] = (0.0, 0.0)
    flood: tuple[float, float] = (0.0, 0.0)

    def packets(self, seconds: float, rng: np.random.Generator) -> Iterator[tuple[float, float, str]]:
        """Time of measurement, arrival and sender of each, in order of arrival."""
        newest = 0.0
        for number in range(int(seconds * self.rate)):
            measured = (number + rng.uniform(-0.2, 0.2)) / self.rate
            if not self.pause[0] <= measured < self.pause[1]:
                newest = max(newest, measured + rng.exponential(_DELAY))
                yield measured, newest, "device"
            if self.flood[0] <= measured < self.flood[1]:
                for other in range(20):
                    yield measured, newest, f"invented {number} {other}"


def measure_session_time(seconds: float, seed: int, show: Show) -> list[Row]:
    """How far session time and arrival come apart in sessions at 40 Hz, and how long these last."""
    cases = {f"{rate:g} Hz": _Arrivals(rate) for rate in (5.0, 20.0, 40.0, 60.0, 90.0, 240.0, 1000.0)}
    cases["90 Hz, flood for a third"] = _Arrivals(90.0, flood=(seconds / 3, 2 * seconds / 3))
    cases["90 Hz, pause of a third"] = _Arrivals(90.0, pause=(seconds / 3, 2 * seconds / 3))
    rows: list[Row] = []
    for number, (name, arrivals) in enumerate(cases.items()):
        show("session time", number, len(cases))
        rows += _measured(name, arrivals, seconds, seed)
    show("session time", len(cases), len(cases))
    return rows


def _measured(name: str, arrivals: _Arrivals, seconds: float, seed: int) -> list[Row]:
    worn = replace(layout("six-trackers"), rate=_RATE)
    samples: list[Sample] = []
    hearing = Hearing(worn, samples.append, lambda level, text: None, alone=True)
    reading = Reading((0.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    readings = dict.fromkeys(worn.names, reading)
    now, last, slowest = 0.0, 0.0, 0.0
    for measured, arrival, sender in arrivals.packets(seconds, np.random.default_rng(seed)):
        while now + _TICK <= arrival:
            now += _TICK
            hearing.poll(now)
        hearing.packet(Packet(readings, 5e3 + measured, whole=True), arrival, sender)
        last, slowest = arrival, max(slowest, arrival - measured)
    times = np.array([sample.time for sample in samples])
    apart = times - np.array([sample.arrival for sample in samples])
    values = {
        "session_s": float(times[-1] - times[0]),
        "heard_s": last - float(samples[0].arrival),
        "samples_a_second": (len(samples) - 1) / float(times[-1] - times[0]),
        "ahead_of_arrival_ms_most": 1e3 * float(apart.max()),
        "behind_arrival_ms_most": -1e3 * float(apart.min()),
        "network_delay_ms_most": 1e3 * slowest,
        "drift_at_the_end_ms": 1e3 * abs(float(apart[-1])),
    }
    return [_row(name, "", metric=key, value=value, frames=len(samples)) for key, value in values.items()]
