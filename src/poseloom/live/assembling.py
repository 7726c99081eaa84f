"""Readings that come one by one, from devices without a common clock, put together to samples."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from poseloom.live.readings import Packet, Reading, sample_of_readings
from poseloom.live.session_clock import SessionClock, SessionTime
from poseloom.sensors import Sample, SensorLayout

_AGAIN = 0.75
"""Periods after which a sensor that speaks again closes the sample: between a device at the expected rate, which then
speaks for the next sample, and one at twice that rate, which does not."""


@dataclass(frozen=True)
class Assembly:
    """What is remembered between packets.

    Attributes:
        pending: Readings of the sample that is being put together, by sensor.
        began: Host's time of the first of them.
        time: When the newest of them was measured, on the host's clock. It never goes back: a sample of several senders
            is of the time of its newest reading, whoever's packet came last.
        arrival: Host's time at which the last of them came.
        kept: Readings of samples that were left out since the newest was taken.
        kept_since: Host's time of the first of these.
        heard: Host's time at which each sensor was heard last.
        clock: Session time of the newest sample.
        first: Host's time of the first reading; None before it.
        closed: Host's time at which the newest sample was closed, taken or not.
        absent: Sensors that were missing in it.
        gathered: How many samples were put together.
        superseded: Of these, those that were left out because they came faster than the session's rate.
        late: Of these, those that were left out because later ones had been taken.
    """

    pending: Mapping[str, Reading] = field(default_factory=dict[str, Reading])
    began: float = 0.0
    time: float = -math.inf
    arrival: float = 0.0
    kept: Mapping[str, Reading] = field(default_factory=dict[str, Reading])
    kept_since: float = 0.0
    heard: Mapping[str, float] = field(default_factory=dict[str, float])
    clock: SessionTime = field(default_factory=SessionTime)
    first: float | None = None
    closed: float = 0.0
    absent: frozenset[str] = frozenset()
    gathered: int = 0
    superseded: int = 0
    late: int = 0


@dataclass(frozen=True)
class Assembler:
    """Puts samples together: one is done when every sensor that has been speaking has spoken.

    A sensor that speaks a second time before the others closes the sample if most of a period has gone by (some sensor
    is slower, or has fallen silent: it is missing then), and otherwise replaces its first reading (it is faster than
    the others). `poll` closes a sample for which the others are late. No reading is ever used twice.

    A sensor that comes back just after a sample was closed without it is waited for from the next on: taken into that
    one at once, it would stay a period older than the others for good.

    A sample beyond the session's rate is left out. What its sensors said is kept for the next one, where these say
    nothing newer until then: beside a fast device a slow one must not lose its readings.

    Attributes:
        layout: The sensors, and the rate that is expected.
        thin: Whether samples beyond that rate are left out.
        speaking: Seconds after its last reading for which a sensor is waited for.
        gathering: Seconds from the first reading on in which all sensors are waited for.
    """

    layout: SensorLayout
    thin: bool = True
    speaking: float = 0.15
    gathering: float = 1.0

    @cached_property
    def period(self) -> float:
        """Seconds from sample to sample."""
        return 1.0 / self.layout.rate

    @cached_property
    def _names(self) -> frozenset[str]:
        return frozenset(self.layout.names)

    @cached_property
    def _clock(self) -> SessionClock:
        return SessionClock(self.period, self.thin)

    def hear(self, state: Assembly, packet: Packet, time: float, arrival: float) -> tuple[Assembly, tuple[Sample, ...]]:
        """Takes in a packet.

        Args:
            state: What is remembered.
            packet: The readings; sensors that are not the layout's are left out.
            time: Its time on the session's clock, seconds.
            arrival: Host's time at which it came, seconds.

        Returns:
            What to remember, and the samples that are done: at most two.
        """
        own = {name: reading for name, reading in packet.readings.items() if name in self._names}
        done: tuple[Sample, ...] = ()
        again = any(name in state.pending for name in own)
        if state.pending and again and (packet.whole or arrival - state.began >= _AGAIN * self.period):
            state, done = self._close(state, arrival)
        if not own and not packet.whole:
            return state, done
        heard = {**state.heard, **dict.fromkeys(own, arrival)}
        if not state.pending and arrival - state.closed < 0.5 * self.period and state.absent.issuperset(own) and own:
            return replace(state, heard=heard), done
        state = replace(
            state,
            pending={**state.pending, **own},
            began=state.began if state.pending else arrival,
            time=max(time, state.time),
            arrival=arrival,
            heard=heard,
            first=arrival if state.first is None else state.first,
        )
        if packet.whole or self._is_complete(state, arrival):
            state, last = self._close(state, arrival, packet.whole)
            done += last
        return state, done

    def poll(self, state: Assembly, arrival: float) -> tuple[Assembly, tuple[Sample, ...]]:
        """Closes the pending sample if one and a half periods have gone by since it began."""
        if not state.pending or arrival - state.began < 1.5 * self.period:
            return state, ()
        return self._close(state, arrival)

    def fill(self, state: Assembly, time: float, arrival: float) -> tuple[Assembly, Sample]:
        """A sample without any reading at a session time: the figure goes on while all is silent."""
        clock = self._clock.fill(state.clock, time)
        return replace(state, clock=clock, kept={}), sample_of_readings({}, self.layout, time, arrival)

    def _is_complete(self, state: Assembly, arrival: float) -> bool:
        if state.first is None or arrival - state.first < self.gathering:
            return len(state.pending) == len(self._names)
        return all(name in state.pending for name, last in state.heard.items() if arrival - last < self.speaking)

    def _close(self, state: Assembly, now: float, whole: bool = False) -> tuple[Assembly, tuple[Sample, ...]]:
        kept: Mapping[str, Reading] = {} if whole or state.arrival - state.kept_since >= self.period else state.kept
        readings = {**kept, **state.pending}
        clock, time = self._clock.take(state.clock, state.time, state.arrival)
        late = time is None and clock.time is not None and state.time <= clock.time
        superseded = time is None and not late
        closed = replace(
            state,
            pending={},
            kept=readings if superseded else kept if late else {},
            kept_since=state.kept_since if kept else state.arrival,
            clock=clock,
            closed=now,
            absent=self._names.difference(state.pending),
            gathered=state.gathered + 1,
            superseded=state.superseded + superseded,
            late=state.late + late,
        )
        done = () if time is None else (sample_of_readings(readings, self.layout, time, state.arrival),)
        return closed, done
