"""What arrives at each source, counted: from which senders, at what rate, for which sensors, what is refused and why.

Every source reports to a `SourceArrivals`, which passes everything on to the session. `poseloom.live.arrival_status`
puts the counts into words.
"""

from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from poseloom.live.readings import Packet, Refusal
from poseloom.live.source import Needs
from poseloom.sensors import SensorLayout

LOOK_EVERY = 0.5
"""Seconds from one look at the rates to the next."""
LASTING = 2.0
"""Seconds after which something that arrives no more counts as absent; rates are of this time."""
STALE = "late or received twice: the time is not after the newest one's"
LOST = "dropped unread: more arrived at once than this machine could read"

_LOOKS = round(LASTING / LOOK_EVERY) + 1
_MOST_SENDERS, _MOST_KINDS, _MOST_NAMES, _LONGEST_NAME = 32, 24, 4, 64
"""Strangers must not fill the memory by inventing senders, reasons or names."""
_UNREADABLE = "unreadable packets"
_OTHER = "other reasons"


@runtime_checkable
class Pipeline(Protocol):
    """Where a source's packets go on to."""

    def packet(self, packet: Packet, arrival: float, stream: str) -> bool:
        """Takes a packet; False for one that is late or was received before."""
        ...

    def malformed(self, reason: str, sender: str = "") -> None:
        """Counts a packet that is malformed as a whole."""
        ...

    def lost(self, count: int) -> None:
        """Counts packets that were dropped unread."""
        ...

    def note(self, text: str, warning: bool = False) -> None:
        """Passes on what a person should know."""
        ...


@dataclass
class Meter:
    """How often something arrives.

    Attributes:
        total: How often so far.
        last: Host's monotonic time of the last one, seconds.
    """

    total: int = 0
    last: float = -1e9
    _looks: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=_LOOKS))

    def add(self, at: float, count: int = 1) -> None:
        """Counts some that arrived at one time."""
        if at - self.last > LASTING:
            self._looks.clear()
            self._looks.append((at, self.total + count))  # the first of a stretch begins the interval that is counted
        self.total += count
        self.last = max(at, self.last)

    def look(self, now: float) -> None:
        """Moves the interval of the rate along; twice a second."""
        if self.is_active(now):
            self._looks.append((now, self.total))

    def is_active(self, now: float) -> bool:
        """Whether one arrived lately."""
        return now - self.last <= LASTING

    def rate(self, now: float) -> float:
        """How many a second, from two seconds ago, or since they began to arrive, until the last one."""
        if not self.is_active(now) or not self._looks:
            return 0.0
        begin, before = self._looks[0]
        return (self.total - before) / max(self.last - begin, 1e-3)


@dataclass
class SenderCounts:
    """What one sender sends: packets, and messages of each kind."""

    packets: Meter = field(default_factory=Meter)
    kinds: dict[str, Meter] = field(default_factory=dict[str, Meter])


@dataclass
class ReasonCounts:
    """How often parts are refused for one reason, and the first few sensors or devices that are concerned."""

    meter: Meter = field(default_factory=Meter)
    names: dict[str, None] = field(default_factory=dict[str, None])


class SourceArrivals:
    """Counts what one source receives and passes it on: the `Listener` of that source.

    Args:
        name: The source, in words.
        layout: Its sensors.
        needs: What it must receive.
        onward: Where packets go on to.

    Attributes:
        senders: By address, the last few dozen.
        sensors: Readings of each sensor of the layout.
        unknown: Readings of sensors that the layout does not have, the first few.
        reasons: Why parts are refused, the first two dozen reasons; the others are counted together.
    """

    def __init__(self, name: str, layout: SensorLayout, needs: Needs, onward: Pipeline) -> None:
        self.name, self.layout, self.needs = name, layout, needs
        self.senders: OrderedDict[str, SenderCounts] = OrderedDict()
        self.sensors = {sensor: Meter() for sensor in layout.names}
        self.unknown: dict[str, Meter] = {}
        self.reasons: dict[str, ReasonCounts] = {}
        self._onward = onward
        self._now = -1e9

    def packet(self, packet: Packet, arrival: float, stream: str) -> None:
        """See `Listener`."""
        self._received(stream, packet.messages, arrival)
        for refusal in packet.refused:
            self._refused(refusal, arrival)
        if not self._onward.packet(packet, arrival, stream):
            self._refused(Refusal(STALE), arrival)
            return
        for name in packet.readings:
            meter = self.sensors.get(name) or _entry(self.unknown, name[:_LONGEST_NAME])
            if meter is not None:
                meter.add(arrival)

    def malformed(self, reason: str, sender: str = "") -> None:
        """See `Listener`."""
        if sender:
            self._received(sender, {_UNREADABLE: 1}, self._now)
        self._refused(Refusal(reason), self._now)
        self._onward.malformed(reason, sender)

    def lost(self, count: int) -> None:
        """See `Listener`."""
        self._refused(Refusal(LOST), self._now, count)
        self._onward.lost(count)

    def note(self, text: str, warning: bool = False) -> None:
        """See `Listener`."""
        self._onward.note(text, warning)

    def look(self, now: float) -> None:
        """Brings the rates up to date; twice a second."""
        self._now = max(self._now, now)
        for meter in self._meters():
            meter.look(now)

    def _meters(self) -> Iterable[Meter]:
        yield from self.sensors.values()
        yield from self.unknown.values()
        yield from (reason.meter for reason in self.reasons.values())
        for sender in self.senders.values():
            yield sender.packets
            yield from sender.kinds.values()

    def _received(self, stream: str, messages: Mapping[str, int], arrival: float) -> None:
        self._now = max(self._now, arrival)
        if stream not in self.senders and len(self.senders) >= _MOST_SENDERS:
            self.senders.popitem(last=False)
        sender = self.senders.setdefault(stream, SenderCounts())
        self.senders.move_to_end(stream)
        sender.packets.add(arrival)
        for kind, count in messages.items():
            meter = _entry(sender.kinds, kind)
            if meter is not None:
                meter.add(arrival, count)

    def _refused(self, refusal: Refusal, at: float, count: int = 1) -> None:
        known = refusal.reason in self.reasons or len(self.reasons) < _MOST_KINDS
        reason = self.reasons.setdefault(refusal.reason if known else _OTHER, ReasonCounts())
        reason.meter.add(at, count)
        if refusal.who and len(reason.names) < _MOST_NAMES:
            # Names come from strangers and go to a terminal.
            reason.names[refusal.who if refusal.who.isprintable() else ascii(refusal.who)] = None


def _entry(table: dict[str, Meter], key: str) -> Meter | None:
    """An entry of a table, new ones only until it is full."""
    if key not in table and len(table) >= _MOST_KINDS:
        return None
    return table.setdefault(key, Meter())
