"""From packets to samples: clocks, order, assembly and pace, with everything counted."""

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import replace

from poseloom.live.assembling import Assembler, Assembly
from poseloom.live.clock import ClockSettings, DeviceClock, step_clock
from poseloom.live.contract import Counters, Level
from poseloom.live.pacing import Pace, step_pace
from poseloom.live.readings import Packet
from poseloom.live.sinks.outlet import Tell
from poseloom.sensors import Sample, SensorLayout
from poseloom.sensors.sample import SensorStatus

_MOST_STREAMS = 64
"""Senders whose clocks are remembered: somebody who invents senders must not fill the memory."""
_RATE_OVER = 240
"""Samples over which the rate is told."""
_FILL_AFTER = 0.1
"""Seconds of complete silence after which empty samples keep the figure going."""
_FILL_FULL, _FILL_SLOW = 10.0, 0.5
"""Seconds of silence after which empty samples become rare, and seconds between them then."""


class Hearing:
    """Hears all sources of a session and makes samples. All calls come from the session's event loop.

    Args:
        layout: The session's sensors and rate.
        admit: Called with each sample.
        tell: Where sources' notes go.
        alone: Whether there is one source only, which then knows when it has said all.
        thin: Whether samples beyond the layout's rate are left out.
        clock: When a device's clock is believed to have jumped.
    """

    def __init__(
        self,
        layout: SensorLayout,
        admit: Callable[[Sample], None],
        tell: Tell,
        alone: bool,
        thin: bool = True,
        clock: ClockSettings | None = None,
    ) -> None:
        self._assembler = Assembler(layout)
        self._assembly = Assembly()
        self._admit, self._tell, self._alone, self._thin = admit, tell, alone, thin
        self._clock_settings = clock or ClockSettings()
        self._clocks: OrderedDict[str, DeviceClock] = OrderedDict()
        self._pace = Pace()
        self._arrivals: deque[float] = deque(maxlen=_RATE_OVER)
        self._filled_at: float | None = None
        self._counters = Counters()

    @property
    def counters(self) -> Counters:
        """What came and what became of it; the counts of others are 0 here."""
        rate = 0.0
        if len(self._arrivals) > 1:
            span = self._arrivals[-1] - self._arrivals[0]
            rate = (len(self._arrivals) - 1) / span if span > 0 else 0.0
        return replace(self._counters, rate=rate)

    def packet(self, packet: Packet, arrival: float, stream: str) -> bool:
        """See `Listener`. False for a packet that is late or came twice."""
        self._count(packets=1, malformed=sum(not refusal.missing for refusal in packet.refused))
        time = arrival
        if packet.time is not None:
            clock, told = step_clock(self._clock_of(stream), packet.time, arrival, self._clock_settings)
            self._clocks[stream] = clock
            if told is None:
                self._count(stale=1)
                return False
            time = told
        if not self._alone and packet.whole:
            packet = replace(packet, whole=False)
        self._assembly, samples = self._assembler.hear(self._assembly, packet, time, arrival)
        for sample in samples:
            self._take(sample)
        return True

    def malformed(self, reason: str, sender: str = "") -> None:
        """See `Listener`."""
        self._count(packets=1, malformed=1)

    def lost(self, count: int) -> None:
        """See `Listener`."""
        self._count(lost=count)

    def note(self, text: str, warning: bool = False) -> None:
        """See `Listener`."""
        self._tell(Level.WARNING if warning else Level.NOTE, text)

    def poll(self, now: float) -> None:
        """Passes on what waits too long for other sensors, and empty samples while all is silent."""
        self._assembly, samples = self._assembler.poll(self._assembly, now)
        for sample in samples:
            self._take(sample)
        if not self._arrivals:
            return
        silence = now - self._arrivals[-1]
        if silence < _FILL_AFTER:
            return
        step = self._assembler.period if silence < _FILL_FULL else _FILL_SLOW
        due = self._arrivals[-1] + _FILL_AFTER if self._filled_at is None else self._filled_at + step
        for _ in range(8):
            if now < due:
                return
            self._assembly, sample = self._assembler.fill(self._assembly, now)
            self._filled_at = due
            due += step
            self._count(samples=1, filled=1)
            self._admit(sample)

    def _take(self, sample: Sample) -> None:
        self._filled_at = None
        self._arrivals.append(sample.arrival)
        self._pace, wanted = step_pace(self._pace, sample.time, sample.arrival, self._assembler.layout.rate)
        if self._thin and not wanted:
            self._count(superseded=1)
            return
        self._count(samples=1, usable=int((sample.status == int(SensorStatus.OK)).any()))
        self._admit(sample)

    def _clock_of(self, stream: str) -> DeviceClock:
        if stream not in self._clocks and len(self._clocks) >= _MOST_STREAMS:
            self._clocks.popitem(last=False)
        clock = self._clocks.setdefault(stream, DeviceClock())
        self._clocks.move_to_end(stream)
        return clock

    def _count(
        self,
        packets: int = 0,
        malformed: int = 0,
        stale: int = 0,
        samples: int = 0,
        superseded: int = 0,
        lost: int = 0,
        filled: int = 0,
        usable: int = 0,
    ) -> None:
        now = self._counters
        self._counters = replace(
            now,
            packets=now.packets + packets,
            malformed=now.malformed + malformed,
            stale=now.stale + stale,
            samples=now.samples + samples,
            superseded=now.superseded + superseded,
            lost=now.lost + lost,
            filled=now.filled + filled,
            usable=now.usable + usable,
        )
