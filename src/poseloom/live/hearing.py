"""From packets to samples: clocks, order, assembly and pace, with everything counted."""

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import replace
from itertools import islice, pairwise

from poseloom.live.assembling import Assembler, Assembly
from poseloom.live.clock import ClockSettings, DeviceClock, step_clock
from poseloom.live.contract import Counters, Level
from poseloom.live.readings import Packet
from poseloom.live.sinks.outlet import Tell
from poseloom.sensors import Sample, SensorLayout
from poseloom.sensors.sample import SensorStatus

_MOST_STREAMS = 64
"""Senders whose clocks are remembered: somebody who invents senders must not fill the memory."""
_RATE_OVER = 240
"""Samples over which the rate is told."""
_FILL_AFTER, _FILL_AFTER_MOST = 0.1, 0.5
"""Seconds of complete silence after which empty samples keep the figure going: the least, and the most, for devices
that are so slow that they are silent for longer between their samples."""
_USUAL_GAPS = 2.0
"""Usual times between samples that make a silence."""
_RECENT = 8
"""Samples by which it is told how far apart they usually come."""


class Hearing:
    """Hears all sources of a session and makes samples. All calls come from the session's event loop.

    Args:
        layout: The session's sensors and rate.
        admit: Called with each sample.
        tell: Where sources' notes go.
        alone: Whether there is one source only, which then knows when it has said all.
        thin: Whether samples beyond the layout's rate are left out.
        clock: When a device's clock is believed to have jumped.

    Session time is the host's monotonic time at which a sample was measured: as its device's clock says, put on the
    host's, or else when it came. It is never ahead of the host's clock by more than a quarter of a period, and behind
    it by the network's delay. Only a recording that is played at another speed brings its own time along.
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
        self._assembler = Assembler(layout, thin)
        self._assembly = Assembly()
        self._admit, self._tell, self._alone = admit, tell, alone
        self._clock_settings = clock or ClockSettings()
        self._clocks: OrderedDict[str, DeviceClock] = OrderedDict()
        self._paced_from: float | None = None
        self._arrivals: deque[float] = deque(maxlen=_RATE_OVER)
        self._filled_at: float | None = None
        names: tuple[str, ...] = ("packets", "malformed", "stale", "samples", "lost", "filled", "usable")
        self._counts: dict[str, int] = dict.fromkeys(names, 0)

    @property
    def counters(self) -> Counters:
        """What came and what became of it; the counts of others are 0 here."""
        rate = 0.0
        if len(self._arrivals) > 1:
            span = self._arrivals[-1] - self._arrivals[0]
            rate = (len(self._arrivals) - 1) / span if span > 0 else 0.0
        assembly = self._assembly
        counts = {**self._counts, "superseded": assembly.superseded, "stale": self._counts["stale"] + assembly.late}
        return Counters(**counts, rate=rate)

    def session_time(self, newest: Sample, now: float) -> float:
        """The session's time at a moment of the host's clock, with its newest sample: it goes on whatever comes.

        Where a recording brings its own time along, that is the newest sample's until the next one.
        """
        return newest.time + (now - newest.arrival if self._paced_from is None else 0.0)

    def packet(self, packet: Packet, arrival: float, stream: str) -> bool:
        """See `Listener`. False for a packet that is late or came twice."""
        self._count(packets=1, malformed=sum(not refusal.missing for refusal in packet.refused))
        time = arrival
        if packet.time is not None and packet.paced:
            if self._paced_from is None:
                self._paced_from = arrival - packet.time
            time = self._paced_from + packet.time
        elif packet.time is not None:
            clock, told = step_clock(self._clock_of(stream), packet.time, arrival, self._clock_settings)
            self._clocks[stream] = clock
            if told is None:
                self._count(stale=1)
                return False
            time = told
        if not self._alone and packet.whole:
            packet = replace(packet, whole=False)
        self._pass_on(*self._assembler.hear(self._assembly, packet, time, arrival), arrival)
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
        self._pass_on(*self._assembler.poll(self._assembly, now), now)
        if not self._arrivals or self._assembly.pending or self._paced_from is not None:
            return
        period = self._assembler.period
        begin = self._arrivals[-1] + self._silent_after()
        due = begin if self._filled_at is None else self._filled_at + period
        while now >= due:
            # What a busy machine has missed is not made up for: session time stays with the host's clock.
            self._filled_at = due = max(due, now - period)
            self._assembly, sample = self._assembler.fill(self._assembly, due, now)
            self._count(samples=1, filled=1)
            self._admit(sample)
            due += period

    def _pass_on(self, assembly: Assembly, samples: tuple[Sample, ...], now: float) -> None:
        """Takes over what is remembered after a packet, and passes on the samples that are done."""
        for _ in range(assembly.gathered - self._assembly.gathered):
            self._arrivals.append(now)
            self._filled_at = None
        self._assembly = assembly
        for sample in samples:
            self._count(samples=1, usable=int((sample.status == int(SensorStatus.OK)).any()))
            self._admit(sample)

    def _silent_after(self) -> float:
        """Seconds without any sample from which all are silent, by how far apart they usually come."""
        last = list(islice(reversed(self._arrivals), _RECENT))
        gaps = sorted(later - earlier for earlier, later in pairwise(reversed(last)))
        usual = gaps[len(gaps) // 2] if gaps else _FILL_AFTER_MOST
        return min(max(_USUAL_GAPS * usual, _FILL_AFTER), _FILL_AFTER_MOST)

    def _clock_of(self, stream: str) -> DeviceClock:
        if stream not in self._clocks and len(self._clocks) >= _MOST_STREAMS:
            self._clocks.popitem(last=False)
        clock = self._clocks.setdefault(stream, DeviceClock())
        self._clocks.move_to_end(stream)
        return clock

    def _count(self, **more: int) -> None:
        for name, number in more.items():
            self._counts[name] += number
