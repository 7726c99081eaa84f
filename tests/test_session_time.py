"""Session time: whatever comes, when, how often and in which bursts, it stays with the time at which it came."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from poseloom.live.hearing import Hearing
from poseloom.live.readings import Packet, Reading
from poseloom.sensors import Sample, layout

SIX = layout("six-trackers")
TICK = 0.01
"""Seconds between polls, as in a session."""


@dataclass(frozen=True)
class Sent:
    """A packet on its way: when it was measured, when it came, by whom, of which sensors."""

    measured: float
    arrival: float
    sender: int
    sensors: tuple[str, ...]
    number: int


@dataclass(frozen=True)
class Sender:
    """What one sender does with simulated time, without any sleeping."""

    rate: float
    jitter: float = 0.0
    delay: float = 0.0
    burst: float = 0.0
    clock: bool = True
    drift: float = 0.0
    pauses: tuple[tuple[float, float], ...] = ()
    sensors: tuple[str, ...] = SIX.names

    def packets(self, seconds: float, sender: int, rng: np.random.Generator) -> Iterator[Sent]:
        newest = 0.0
        for number in range(int(seconds * self.rate)):
            measured = (number + self.jitter * rng.uniform(-0.5, 0.5) + 1.0) / self.rate
            if any(begin <= measured < end for begin, end in self.pauses):
                continue
            arrival = measured + self.delay * rng.exponential()
            if self.burst:
                arrival = math.ceil(arrival / self.burst) * self.burst
            newest = max(newest, arrival)  # packets of one sender do not overtake each other
            yield Sent(measured, newest, sender, self.sensors, number)


def heard_of(senders: Sequence[Sender], seconds: float, rate: float, seed: int = 0) -> tuple[list[Sample], Hearing]:
    """What a session at a rate makes of senders."""
    rng = np.random.default_rng(seed)
    worn, samples = replace(SIX, rate=rate), list[Sample]()
    hearing = Hearing(worn, samples.append, lambda level, text: None, len(senders) == 1)
    sent = [each for number, sender in enumerate(senders) for each in sender.packets(seconds, number, rng)]
    now = 0.0
    for each in sorted(sent, key=lambda packet: packet.arrival):
        while now + TICK <= each.arrival:
            now += TICK
            hearing.poll(now)
        sender = senders[each.sender]
        # Where and when it was measured travels in the position, so that what came of it can be told.
        reading = Reading((each.measured, float(each.number), float(each.sender)), (1.0, 0.0, 0.0, 0.0))
        time = 1e4 * (each.sender + 1) + each.measured * (1.0 + sender.drift) if sender.clock else None
        packet = Packet(dict.fromkeys(each.sensors, reading), time, whole=sender.clock)
        hearing.packet(packet, each.arrival, f"sender {each.sender}")
    while now < seconds:
        now += TICK
        hearing.poll(now)
    return samples, hearing


def check(samples: Sequence[Sample], rate: float) -> None:
    """What holds for whatever comes."""
    times = np.array([sample.time for sample in samples])
    arrivals = np.array([sample.arrival for sample in samples])
    assert (np.diff(times) > 0).all()
    # Never ahead of the host's clock, and never before what it tells was measured.
    assert (times - arrivals).max() < 1 / rate
    said = [sample for sample in samples if np.isfinite(sample.positions).any()]
    measured = np.array([np.nanmax(sample.positions[:, 0]) for sample in said])
    assert (np.array([sample.time for sample in said]) - measured).min() > -1 / rate
    empty = np.array([not np.isfinite(sample.positions).any() for sample in samples])
    assert (np.abs(times - arrivals)[empty] < 1 / rate).all()
    # Samples come at the session's rate, thinned, over any stretch of time.
    places = np.arange(len(times))
    spans = (times[None, :] - times[:, None]) * rate
    assert np.triu(places[None, :] - places[:, None] - spans).max() < 2.5
    # Nothing is used twice.
    for sensor in range(len(SIX)):
        used = [tuple(sample.positions[sensor, 1:]) for sample in said if np.isfinite(sample.positions[sensor, 0])]
        assert len(used) == len(set(used))


pauses = st.lists(st.tuples(st.floats(0.1, 2.5), st.floats(0.05, 1.0)), max_size=2).map(
    lambda each: tuple((begin, begin + length) for begin, length in each)
)
senders = st.builds(
    Sender,
    rate=st.one_of(st.floats(5.0, 1000.0), st.sampled_from([5.0, 20.0, 40.0, 60.0, 72.0, 90.0, 240.0, 1000.0])),
    jitter=st.floats(0.0, 1.5),
    delay=st.sampled_from([0.0, 0.001, 0.02, 0.1]),
    burst=st.sampled_from([0.0, 0.0, 0.05, 0.3]),
    clock=st.booleans(),
    drift=st.sampled_from([0.0, 1e-4, -1e-4, 3e-3, -3e-3]),
    pauses=pauses,
)


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(sender=senders, rate=st.sampled_from([20.0, 40.0, 60.0, 100.0]), seed=st.integers(0, 99))
def test_session_time_stays_with_arrival_for_any_sender(sender: Sender, rate: float, seed: int):
    samples, hearing = heard_of([sender], min(3.0, 250 / sender.rate), rate, seed)
    check(samples, rate)
    counters = hearing.counters
    assert counters.packets == counters.samples - counters.filled + counters.superseded + counters.stale


@settings(deadline=None, max_examples=15, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(one=senders, other=senders, rate=st.sampled_from([40.0, 60.0]), apart=st.booleans(), seed=st.integers(0, 99))
def test_session_time_stays_with_arrival_for_two_senders(
    one: Sender, other: Sender, rate: float, apart: bool, seed: int
):
    """Two senders of half the sensors each, or of the same ones."""
    if apart:
        one, other = replace(one, sensors=SIX.names[:3]), replace(other, sensors=SIX.names[3:])
    samples, _ = heard_of([one, other], min(3.0, 250 / max(one.rate, other.rate)), rate, seed)
    if samples:
        check(samples, rate)


@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("rate", [20.0, 41.0, 60.0, 90.0, 240.0, 1000.0])
def test_a_session_lasts_as_long_as_it_was_heard_at_its_own_rate(rate: float, clock: bool):
    """A 90 Hz headset on a library of 40 Hz used to give 16.9 s in 15 s, and 240 Hz gave 45 s."""
    seconds = min(15.0, 600 / rate)
    samples, hearing = heard_of([Sender(rate, jitter=0.2, delay=0.001, clock=clock)], seconds, 40.0)
    check(samples, 40.0)
    lasted = samples[-1].time - samples[0].time
    assert abs(lasted - seconds) < 2 / min(rate, 40.0)
    assert abs(len(samples) - seconds * min(rate, 40.0)) <= 2 + 0.01 * seconds * 40.0
    assert hearing.counters.filled == 0


def test_a_flood_leaves_session_time_where_it_was():
    """Three thousand packets in half a second, from somebody who invents senders, beside a sound device."""
    sound, samples = Sender(60.0), list[Sample]()
    hearing = Hearing(replace(SIX, rate=60.0), samples.append, lambda level, text: None, True)
    for each in sound.packets(2.0, 0, np.random.default_rng(0)):
        reading = Reading((each.measured, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        hearing.packet(Packet(dict.fromkeys(SIX.names, reading), each.measured, whole=True), each.arrival, "sound")
        if 1.0 <= each.measured < 1.5:
            for number in range(100):
                packet = Packet(dict.fromkeys(SIX.names, reading), float(number), whole=True)
                hearing.packet(packet, each.arrival + 1e-4 * number, f"invented {number}")
        hearing.poll(each.arrival)
    assert abs(samples[-1].time - 2.0) < 1 / 60
    assert max(abs(sample.time - sample.arrival) for sample in samples) < 1 / 60
    assert 117 <= len(samples) <= 122


def test_a_slow_device_is_not_taken_for_a_silent_one():
    """Between samples of a device of 5 Hz none is empty; when it does fall silent, the figure goes on."""
    samples, hearing = heard_of([Sender(5.0, jitter=0.2, pauses=((3.0, 4.0),))], 5.0, 60.0)
    filled = [sample.time for sample in samples if not np.isfinite(sample.positions).any()]
    assert 30 <= hearing.counters.filled == len(filled) <= 60
    assert min(filled) > 3.0
    assert max(filled) < 4.3


def test_a_fast_device_does_not_cost_a_slow_one_its_readings():
    """500 Hz beside 30 Hz, at 40 Hz: every reading of the slow one is in a sample."""
    fast = Sender(500.0, clock=False, sensors=SIX.names[:3])
    slow = Sender(30.0, clock=False, sensors=SIX.names[3:])
    samples, _ = heard_of([fast, slow], 1.5, 40.0)
    check(samples, 40.0)
    used = {sample.positions[4, 1] for sample in samples if np.isfinite(sample.positions[4, 0])}
    assert len(used) >= 0.9 * 1.5 * 30.0


def test_a_recording_that_is_played_faster_keeps_its_own_time():
    samples = list[Sample]()
    hearing = Hearing(replace(SIX, rate=60.0), samples.append, lambda level, text: None, True)
    for number in range(300):
        reading = Reading((float(number), 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        packet = Packet(dict.fromkeys(SIX.names, reading), number / 60, whole=True, paced=True)
        hearing.packet(packet, 7.0 + number / 240, "a recording at four times its speed")
        hearing.poll(7.0 + number / 240)
    assert len(samples) == 300
    assert np.allclose(np.diff([sample.time for sample in samples]), 1 / 60)
