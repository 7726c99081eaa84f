"""What is wrong with the sensors, told from what they say: silent, stuck, noisy, swapped or mis-scaled, in words."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.live.contract import Finding, Trouble
from poseloom.live.watch_rules import (
    Moments,
    WatchSettings,
    exchanged_pair,
    flex_troubles,
    imu_troubles,
    noisy_trackers,
    scale_trouble,
    sides_troubles,
    stuck_sensors,
)
from poseloom.sensors import Sample, SensorLayout


@dataclass(frozen=True, eq=False)
class WatchState:
    """What is remembered between samples.

    Attributes:
        began: Session time of the first sample; None before it.
        heard: Session time at which each sensor was heard last; NaN where never.
        recent: The last second, every sample.
        sparse: The last seconds, a sample every tenth of a second.
        unchanged: Seconds for which each sensor has said exactly the same.
        swaps: Pairs that were seen to exchange their places, as (sensor, sensor).
        findings: Present troubles by sensor and kind.
        seen: Session time at which each of these showed last, but for silence.
        judged: Session time of the last look at the slow signs.
    """

    began: float | None
    heard: Floats[Array, "sensors"]
    recent: Moments
    sparse: Moments
    unchanged: Floats[Array, "sensors"]
    swaps: tuple[tuple[int, int], ...] = ()
    findings: Mapping[tuple[str, Trouble], Finding] = field(default_factory=dict[tuple[str, Trouble], Finding])
    seen: Mapping[tuple[str, Trouble], float] = field(default_factory=dict[tuple[str, Trouble], float])
    judged: float = 0.0


class Watch:
    """Watches over the sensors of a layout.

    Args:
        layout: The sensors.
        settings: What counts as trouble.
    """

    def __init__(self, layout: SensorLayout, settings: WatchSettings | None = None) -> None:
        self.layout = layout
        self.settings = settings or WatchSettings()

    def start(self) -> WatchState:
        """The state before the first sample."""
        count = len(self.layout)
        nothing = Moments.empty(count)
        return WatchState(None, np.full(count, np.nan), nothing, nothing, np.zeros(count))

    def step(self, state: WatchState, sample: Sample) -> WatchState:
        """Takes in a sample, as it came, and looks for what shows at once."""
        said = Moments.of(sample)
        heard = np.where(said.came[-1], sample.time, state.heard)
        sparse = state.sparse
        if not len(sparse) or sample.time - sparse.times[-1] >= self.settings.sparse_step:
            sparse = sparse.with_newest(said, sample.time - self.settings.memory)
        swaps = state.swaps
        pair = exchanged_pair(state.recent, said, self.layout, self.settings)
        if pair is not None:
            # Exchanged twice is as it was.
            swaps = tuple(p for p in swaps if p != pair) if pair in swaps else (*swaps, pair)
        following = replace(
            state,
            began=sample.time if state.began is None else state.began,
            heard=heard,
            recent=state.recent.with_newest(said, sample.time - 1.0),
            sparse=sparse,
            unchanged=self._unchanged(state, said),
            swaps=swaps,
        )
        return self.poll(following, sample.time)

    def poll(self, state: WatchState, time: float) -> WatchState:
        """Judges anew at a session time, whether a sample came or not: silence shows by nothing coming."""
        if state.began is None:
            return state
        slow = time - state.judged >= self.settings.judge_every
        found = dict(self._silent(state, time))
        seen = dict(state.seen)
        if slow:
            others = dict(self._others(state))
            # In another unit any movement looks like noise.
            scaled = {name for name, trouble in others if trouble is Trouble.MIS_SCALED}
            others = {k: text for k, text in others.items() if k[1] is not Trouble.NOISY or k[0] not in scaled}
            seen |= dict.fromkeys(others, time)
            found |= others
        for key, each in state.findings.items():
            if key[1] is not Trouble.SILENT and time - seen.get(key, -1e9) < self.settings.hold:
                found.setdefault(key, each.text)
        findings = {
            key: state.findings[key] if key in state.findings else Finding(key[0], key[1], text, time)
            for key, text in found.items()
        }
        seen = {key: at for key, at in seen.items() if key in findings}
        return replace(state, findings=findings, seen=seen, judged=time if slow else state.judged)

    def _unchanged(self, state: WatchState, said: Moments) -> Floats[Array, "sensors"]:
        if not len(state.recent):
            return state.unchanged
        same = stuck_sensors(state.recent, said)
        step = float(said.times[-1] - state.recent.times[-1])
        # A sensor that is silent is not stuck, and one that comes back says something new.
        return np.where(same, state.unchanged + step, 0.0)

    def _silent(self, state: WatchState, time: float) -> Iterator[tuple[tuple[str, Trouble], str]]:
        begun = state.began or 0.0
        for name, heard in zip(self.layout.names, state.heard.tolist(), strict=True):
            if heard != heard:
                if time - begun > self.settings.silent_at_start:
                    yield (name, Trouble.SILENT), f"{name} has said nothing yet: check its battery and pairing"
            elif time - heard > self.settings.silent_after:
                yield (name, Trouble.SILENT), f"{name} is silent: check its battery, and whether it can be seen"

    def _others(self, state: WatchState) -> Iterator[tuple[tuple[str, Trouble], str]]:
        layout, settings, names = self.layout, self.settings, self.layout.names
        for index, seconds in enumerate(state.unchanged.tolist()):
            longest = settings.flex_stuck_after if index in self._flexes() else settings.stuck_after
            if seconds > longest:
                text = f"{names[index]} is stuck: it has repeated the same value for more than {longest:g} s"
                yield (names[index], Trouble.STUCK), text
        yield from noisy_trackers(state.recent, layout, settings)
        for one, other in state.swaps:
            yield from _swapped(names[one], names[other], "they exchanged their places at once")
        yield from sides_troubles(state.sparse, layout, settings)
        yield from scale_trouble(state.sparse, layout, settings)
        yield from imu_troubles(state.sparse, layout, settings)
        yield from flex_troubles(state.recent, layout, settings)

    def _flexes(self) -> frozenset[int]:
        return frozenset(i for i, sensor in enumerate(self.layout.sensors) if sensor.kind.value == "flex")


def _swapped(one: str, other: str, why: str) -> Iterator[tuple[tuple[str, Trouble], str]]:
    for name, twin in ((one, other), (other, one)):
        yield (name, Trouble.SWAPPED), f"{name} and {twin} are swapped: {why}"


def new_findings(before: WatchState, after: WatchState) -> tuple[Finding, ...]:
    """Troubles that were not there before."""
    return tuple(each for key, each in after.findings.items() if key not in before.findings)


def ended_findings(before: WatchState, after: WatchState) -> tuple[Finding, ...]:
    """Troubles that are over."""
    return tuple(each for key, each in before.findings.items() if key not in after.findings)
