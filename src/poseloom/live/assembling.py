"""Readings that come one by one, from devices without a common clock, put together to samples."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from poseloom.live.readings import Packet, Reading, sample_of_readings
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
        time: Session time of the newest of them.
        heard: Host's time at which each sensor was heard last.
        last_time: Session time of the newest sample; None before the first.
        first: Host's time of the first reading; None before it.
        closed: Host's time at which the newest sample was closed.
        absent: Sensors that were missing in it.
    """

    pending: Mapping[str, Reading] = field(default_factory=dict[str, Reading])
    began: float = 0.0
    time: float = 0.0
    heard: Mapping[str, float] = field(default_factory=dict[str, float])
    last_time: float | None = None
    first: float | None = None
    closed: float = 0.0
    absent: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Assembler:
    """Puts samples together: one is done when every sensor that has been speaking has spoken.

    A sensor that speaks a second time before the others closes the sample if most of a period has gone by (some sensor
    is slower, or has fallen silent: it is missing then), and otherwise replaces its first reading (it is faster than
    the others). `poll` closes a sample for which the others are late. No reading is ever used twice.

    A sensor that comes back just after a sample was closed without it is waited for from the next on: taken into that
    one at once, it would stay a period older than the others for good.

    Attributes:
        layout: The sensors, and the rate that is expected.
        speaking: Seconds after its last reading for which a sensor is waited for.
        gathering: Seconds from the first reading on in which all sensors are waited for.
    """

    layout: SensorLayout
    speaking: float = 0.15
    gathering: float = 1.0

    @property
    def period(self) -> float:
        """Seconds from sample to sample."""
        return 1.0 / self.layout.rate

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
        own = {name: reading for name, reading in packet.readings.items() if name in self.layout.names}
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
            time=time,
            heard=heard,
            first=arrival if state.first is None else state.first,
        )
        if packet.whole or self._is_complete(state, arrival):
            state, last = self._close(state, arrival)
            done += last
        return state, done

    def poll(self, state: Assembly, arrival: float) -> tuple[Assembly, tuple[Sample, ...]]:
        """Closes the pending sample if one and a half periods have gone by since it began."""
        if not state.pending or arrival - state.began < 1.5 * self.period:
            return state, ()
        return self._close(state, arrival)

    def fill(self, state: Assembly, arrival: float) -> tuple[Assembly, Sample]:
        """A sample without any reading, one period after the last: the figure goes on while all is silent."""
        time = arrival if state.last_time is None else state.last_time + self.period
        return replace(state, last_time=time), sample_of_readings({}, self.layout, time, arrival)

    def _is_complete(self, state: Assembly, arrival: float) -> bool:
        if state.first is None or arrival - state.first < self.gathering:
            return all(name in state.pending for name in self.layout.names)
        return all(name in state.pending for name, last in state.heard.items() if arrival - last < self.speaking)

    def _close(self, state: Assembly, arrival: float) -> tuple[Assembly, tuple[Sample, ...]]:
        time = state.time
        if state.last_time is not None:
            # After a pause that was filled, what comes late catches up at twice the pace rather than being lost.
            time = max(time, state.last_time + 0.5 * self.period)
        sample = sample_of_readings(state.pending, self.layout, time, arrival)
        absent = frozenset(self.layout.names) - frozenset(state.pending)
        return replace(state, pending={}, last_time=time, closed=arrival, absent=absent), (sample,)
