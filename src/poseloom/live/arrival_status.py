"""The state of all sources in one text: what arrives, from where and at what rate, what is missing and what to do.

`ArrivalMonitor` reports it within two seconds of a start, and again whenever it has changed.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from poseloom.live.arrivals import LASTING, LOOK_EVERY, Meter, Pipeline, ReasonCounts, SourceArrivals
from poseloom.live.contract import ArrivalStatus, Level
from poseloom.live.source import Needs, Source

_CHANGED_RATE, _STEADY_RATE, _LOWEST_RATE = 0.25, 0.1, 4.0
"""Share by which a rate must differ from the reported one to be reported again, share by which a steady one differs
from look to look, and the lowest rate that these are a share of."""
_MOST_REPORTS, _REPORTS_WITHIN = 10, 60.0
"""So many reports within so many seconds at most: whoever invents senders must not fill the terminal."""
_COMMON = 1.0
"""Refusals a second from which a reason belongs to the state."""
_SHOWN = 4
_WITHOUT_DATA = frozenset(("status", "the root"))


def differs(now: ArrivalStatus, before: ArrivalStatus | None, share: float = _CHANGED_RATE) -> bool:
    """Whether two states differ, or their rates by more than a share."""
    if before is None or now.state != before.state or len(now.rates) != len(before.rates):
        return True
    return any(
        abs(rate - old) > share * max(old, _LOWEST_RATE) for rate, old in zip(now.rates, before.rates, strict=True)
    )


class ArrivalMonitor:
    """Watches the arrivals of all sources of a session.

    Args:
        sources: The sources.
        onward: Where their packets go on to.

    Attributes:
        listeners: What each source reports to, in order.
    """

    def __init__(self, sources: Sequence[Source], onward: Pipeline) -> None:
        self.listeners = tuple(SourceArrivals(source.name, source.layout, _needs(source), onward) for source in sources)
        self._sources = tuple(sources)
        self._looked = -1e9
        self._before: ArrivalStatus | None = None
        self._reported: ArrivalStatus | None = None
        self._since: float | None = None
        self._reports: deque[float] = deque(maxlen=_MOST_REPORTS)

    def poll(self, now: float) -> ArrivalStatus | None:
        """The status, where it differs from the one that was reported last; to be called often.

        A state that lasts is reported at the second look, one that changes from look to look after two seconds.
        """
        if now - self._looked < LOOK_EVERY:
            return None
        first = self._looked < 0
        self._looked = now
        for source, listener in zip(self._sources, self.listeners, strict=True):
            # A port that the system chooses is known once it is open.
            listener.name, listener.needs = source.name, _needs(source)
            listener.look(now)
        if first:
            return None
        status = _joined([_status(listener, now) for listener in self.listeners])
        steady = not differs(status, self._before, _STEADY_RATE)
        self._before = status
        if not differs(status, self._reported):
            self._since = None
            return None
        self._since = now if self._since is None else self._since
        many = len(self._reports) == _MOST_REPORTS and now - self._reports[0] < _REPORTS_WITHIN
        if many or not (steady or now - self._since >= LASTING):
            return None
        self._since = None
        self._reports.append(now)
        self._reported = status
        return status

    def overall(self) -> ArrivalStatus:
        """What has arrived in the whole session."""
        return _joined([_status(listener, None) for listener in self.listeners])

    @property
    def refused(self) -> Mapping[str, int]:
        """How many parts of packets were refused in the whole session, by reason, the commonest first."""
        totals: dict[str, int] = {}
        for listener in self.listeners:
            for reason, counts in listener.reasons.items():
                totals[reason] = totals.get(reason, 0) + counts.meter.total
        return dict(sorted(totals.items(), key=lambda item: -item[1]))


def _needs(source: Source) -> Needs:
    needs = getattr(source, "needs", None)
    return needs if isinstance(needs, Needs) else Needs()


def _joined(parts: Sequence[ArrivalStatus]) -> ArrivalStatus:
    level = Level.WARNING if any(part.level is Level.WARNING for part in parts) else Level.NOTE
    return ArrivalStatus(
        level,
        ". ".join(part.text for part in parts),
        ". ".join(part.state for part in parts),
        tuple(rate for part in parts for rate in part.rates),
    )


def _status(source: SourceArrivals, now: float | None) -> ArrivalStatus:
    """The status at one moment, or of the whole session."""
    words = _Words(source, now, with_rates=now is not None)
    text = words.text()
    level = Level.WARNING if words.missing or words.reasons else Level.NOTE
    return ArrivalStatus(level, text, _Words(source, now, with_rates=False).text(), tuple(words.rates))


@dataclass
class _Words:
    """A source's arrivals at one moment, or (`now` None) of the whole session, in words."""

    source: SourceArrivals
    now: float | None
    with_rates: bool
    rates: list[float] = field(default_factory=list[float])

    def __post_init__(self) -> None:
        source = self.source
        self.senders = sorted(name for name, sender in source.senders.items() if self._has(sender.packets))
        self.sensors = [name for name, meter in source.sensors.items() if self._has(meter)]
        self.missing = [name for name in source.layout.names if name not in self.sensors]
        self.reasons = self._reasons()

    def text(self) -> str:
        if not self.senders:
            more = " any more" if self.source.senders else ""
            return f"nothing arrives{more} at {self.source.name}: {self.source.needs.begin}"
        return self._some() if self.sensors else self._none()

    def _none(self) -> str:
        needs = self.source.needs
        kinds = ", ".join(self._kinds()) or "packets"
        text = f"only {kinds} come from {self._from()}{self._packet_rate()}"
        if self.reasons:
            text += f", and nothing of it can be used: {'; '.join(self.reasons)}"
        unknown = self._unknown()
        if unknown:
            return f"{text}; {unknown}"
        remedy = needs.refused if self.reasons and needs.refused else needs.remedy
        return f"{text}; poseloom needs {needs.messages}: {remedy}"

    def _some(self) -> str:
        count = len(self.source.layout)
        many = "all" if not self.missing else f"{len(self.sensors)} of"
        text = f"{many} {count} sensors come from {self._from()}{self._sensor_rate()}"
        if self.missing:
            text += f"; {', '.join(self.missing)} {'is' if len(self.missing) == 1 else 'are'} missing"
        if self.reasons:
            text += f"; not used: {'; '.join(self.reasons)}"
        elif self.missing:
            text += f": {self._unknown() or self.source.needs.absent}"
        return text

    def _has(self, meter: Meter) -> bool:
        return meter.total > 0 if self.now is None else meter.is_active(self.now)

    def _from(self) -> str:
        more = f" and {len(self.senders) - _SHOWN} more" if len(self.senders) > _SHOWN else ""
        return ", ".join(self.senders[:_SHOWN]) + more

    def _kinds(self) -> list[str]:
        """Kinds of messages, without those that carry no data where others do."""
        counts = [self.source.senders[name].kinds for name in self.senders]
        kinds = {kind for each in counts for kind, meter in each.items() if self._has(meter)}
        return sorted(kinds - _WITHOUT_DATA or kinds)

    def _packet_rate(self) -> str:
        if self.now is None or not self.with_rates:
            return ""
        self.rates.append(sum(self.source.senders[name].packets.rate(self.now) for name in self.senders))
        return f" at {self.rates[-1]:.0f} packets/s"

    def _sensor_rate(self) -> str:
        """The middle one of the sensors' rates, and those that are much slower."""
        if self.now is None or not self.with_rates:
            return ""
        rates = {name: self.source.sensors[name].rate(self.now) for name in self.sensors}
        middle = sorted(rates.values())[len(rates) // 2]
        self.rates.append(middle)
        slow = [f"{name} {rate:.0f}" for name, rate in rates.items() if rate < (1.0 - _CHANGED_RATE) * middle]
        return f" at {middle:.0f} Hz" + (f" ({', '.join(slow)})" if slow else "")

    def _reasons(self) -> list[str]:
        """Why parts are refused: at a moment only what is common, overall the commonest first."""
        found = [item for item in self.source.reasons.items() if self._is_common(item[1])]
        found.sort(key=lambda item: -item[1].meter.total if self.now is None else 0)
        return [self._reason(*item) for item in found[:_SHOWN]]

    def _is_common(self, counts: ReasonCounts) -> bool:
        return self.now is None or counts.meter.rate(self.now) >= _COMMON

    def _reason(self, reason: str, counts: ReasonCounts) -> str:
        names = f" ({', '.join(counts.names)})" if counts.names else ""
        return f"{reason}{names}" + (f", {counts.meter.total:,} times" if self.now is None else "")

    def _unknown(self) -> str:
        layout = self.source.layout
        names = [repr(name) for name, meter in self.source.unknown.items() if self._has(meter)][:_SHOWN]
        if not names:
            return ""
        return (
            f"the layout {layout.name} has no sensor {', '.join(names)}: name them as it does "
            f"({', '.join(layout.names)}), or choose another layout"
        )
