"""From packets to samples: clocks that jump, packets that come twice, devices without a common clock, paces, watch."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.live.clock import ClockSettings, DeviceClock, step_clock
from poseloom.live.contract import Trouble
from poseloom.live.endless import endless_motion
from poseloom.live.hearing import Hearing
from poseloom.live.readings import Packet, Reading
from poseloom.live.virtual import virtual_recording
from poseloom.live.watch import Watch, new_findings
from poseloom.methods.alignment import Alignment, aligned, facing_ahead
from poseloom.rotations import heading_matrix, matrix_from_quat, quat_from_matrix
from poseloom.samples import sample_motions
from poseloom.sensors import Sample, default_placements, layout, place_sensors
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import forward_kinematics, motion_frames
from poseloom.synthesis import parse_fault

SIX = replace(layout("six-trackers"), rate=60.0)
PERIOD = 1 / 60
SETTINGS = ClockSettings()


def reading(index: int) -> Reading:
    return Reading((float(index), 1.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def whole(number: int) -> dict[str, Reading]:
    return {name: reading(number) for name in SIX.names}


def hearing_of(alone: bool = True) -> tuple[Hearing, list[Sample]]:
    samples: list[Sample] = []
    return Hearing(SIX, samples.append, lambda level, text: None, alone), samples


# Clocks


def test_a_steady_clock_keeps_its_spacing():
    clock, times = DeviceClock(), []
    for i in range(600):
        clock, time = step_clock(clock, 1000 + i * PERIOD, 50 + i * PERIOD + (0.002 if i % 7 == 0 else 0.0), SETTINGS)
        times.append(time)
    # The first packet's own delay is known once a faster one has come.
    assert np.allclose(np.diff(times[1:]), PERIOD, atol=2e-4)
    assert clock.jumps == 0


def test_a_clock_that_drifts_is_followed():
    clock, time = DeviceClock(), 0.0
    for i in range(20_000):
        clock, told = step_clock(clock, i * PERIOD * 1.001, i * PERIOD, SETTINGS)
        time = told or time
    assert abs(time - 19_999 * PERIOD) < 0.1
    assert clock.jumps == 0


@pytest.mark.parametrize("jump", [3600.0, -3600.0, 1e9, -1e9])
def test_a_clock_that_jumps_is_set_anew(jump: float):
    clock, times = DeviceClock(), []
    for i in range(240):
        device = 5000 + i * PERIOD + (jump if i >= 120 else 0.0)
        clock, told = step_clock(clock, device, i * PERIOD, SETTINGS)
        times.append(told)
    assert clock.jumps == 1
    late = [time for time in times[120:] if time is not None]
    assert len(late) >= 120 - round(SETTINGS.patience * 60) - 2
    assert abs(late[-1] - 239 * PERIOD) < 1e-6
    kept = [time for time in times if time is not None]
    assert (np.diff(kept) > 0).all()


@settings(deadline=None)
@given(st.lists(st.integers(0, 40), min_size=1, max_size=200))
def test_packets_that_come_twice_or_late_are_stale(numbers: list[int]):
    """Whatever is replayed among sound packets: each sound one is taken once, in order."""
    clock, taken = DeviceClock(), []
    for i, older in enumerate(numbers):
        clock, told = step_clock(clock, i * PERIOD, i * PERIOD, SETTINGS)
        assert told is not None
        taken.append(told)
        again = max(i - older, 0)
        clock, told = step_clock(clock, again * PERIOD, i * PERIOD + 0.001, SETTINGS)
        assert told is None
    assert (np.diff(taken) > 0).all()


# Samples


def test_devices_that_speak_one_by_one_make_one_sample_a_round():
    hearing, samples = hearing_of()
    for i in range(120):
        for place, name in enumerate(SIX.names):
            hearing.packet(Packet({name: reading(i)}), i * PERIOD + place * 0.002, "x")
    assert len(samples) == 120
    for before, sample in pairwise(samples):
        assert np.isfinite(sample.positions).all()
        assert np.ptp(sample.positions[:, 0]) == 0
        assert sample.positions[0, 0] == before.positions[0, 0] + 1


def test_a_sensor_that_falls_silent_is_missing_and_delays_the_others_briefly_at_most():
    hearing, samples = hearing_of()
    for i in range(120):
        now = i * PERIOD
        names = SIX.names if i < 60 else SIX.names[:-1]
        hearing.poll(now)
        hearing.packet(Packet({name: reading(i) for name in names}), now, "x")
        hearing.poll(now + 0.5 * PERIOD)
    silent = [sample for sample in samples if np.isnan(sample.positions[-1, 0])]
    assert len(silent) >= 55
    assert all(np.isfinite(sample.positions[:-1]).all() for sample in silent)
    assert len(samples) >= 118
    # What is missing is never the last value again.
    assert all(np.isnan(sample.positions[-1]).all() for sample in samples[-50:])


def test_a_sensor_that_comes_back_is_not_a_period_behind():
    hearing, samples = hearing_of()
    for i in range(300):
        for place, name in enumerate(SIX.names):
            if name != SIX.names[-1] or not 100 <= i < 200:
                hearing.packet(Packet({name: reading(i)}), i * PERIOD + place * 0.001, "x")
        hearing.poll(i * PERIOD + 0.008)
    back = samples[-90:]
    assert all(np.ptp(sample.positions[:, 0]) == 0 for sample in back)
    assert np.isnan(samples[150].positions[-1, 0])
    assert len(samples) == 300


def test_a_faster_device_gives_its_newest_and_a_slower_one_is_missing_in_between():
    hearing, samples = hearing_of()
    for i in range(240):
        now = i * PERIOD / 2
        said = {name: reading(i) for name in SIX.names[:1]}
        if i % 2 == 0:
            said |= {name: reading(i) for name in SIX.names[1:-1]}
        if i % 4 == 0:
            said |= {SIX.names[-1]: reading(i)}
        for name, each in said.items():
            hearing.packet(Packet({name: each}), now, "x")
        hearing.poll(now + 0.001)
    steady = samples[20:]
    assert abs(len(samples) - 120) < 8
    slow = np.array([np.isfinite(sample.positions[-1, 0]) for sample in steady])
    assert 0.4 < slow.mean() < 0.6
    assert all(np.isfinite(sample.positions[:-1]).all() for sample in steady)


def test_while_all_is_silent_empty_samples_keep_coming_and_session_time_stays_with_the_hosts():
    hearing, samples = hearing_of()
    now = 0.0
    for i in range(60):
        now = i * PERIOD
        hearing.packet(Packet(whole(i), 100 + now, whole=True), now, "x")
    for tick in range(100):
        hearing.poll(now + tick * 0.01)
    filled = hearing.counters.filled
    assert 50 <= filled <= 56
    assert all(np.isnan(sample.positions).all() for sample in samples[60:])
    # The stalled sender's packets all come at once: what empty samples stand for has gone by, and is told to be late.
    for i in range(60, 120):
        hearing.packet(Packet(whole(i), 100 + i * PERIOD, whole=True), now + 1.0 + 1e-4 * (i - 60), "x")
    assert 1 <= hearing.counters.samples - filled - 60 <= 3
    counters = hearing.counters
    assert counters.samples - filled + counters.stale + counters.superseded == 120
    # From then on every one is heard again.
    for i in range(120, 180):
        hearing.packet(Packet(whole(i), 100 + i * PERIOD, whole=True), i * PERIOD + 0.001, "x")
    assert hearing.counters.samples - counters.samples >= 58
    times = np.array([sample.time for sample in samples])
    assert (np.diff(times) > 0).all()
    # The newest of the burst was on its way for a period, too.
    assert np.abs(times - [sample.arrival for sample in samples]).max() < 2 * PERIOD


def test_two_sources_make_samples_together():
    hearing, samples = hearing_of(alone=False)
    for i in range(120):
        now = i * PERIOD
        hearing.packet(Packet({n: reading(i) for n in SIX.names[:3]}, i * PERIOD, whole=True), now, "a")
        hearing.packet(Packet({n: reading(i) for n in SIX.names[3:]}, 9e5 + i * PERIOD, whole=True), now + 0.004, "b")
    assert all(np.isfinite(sample.positions).all() for sample in samples[3:])
    assert 117 <= len(samples) <= 121


def test_strangers_cannot_fill_the_memory():
    hearing, samples = hearing_of()
    for i in range(500):
        hearing.packet(Packet({f"x{i}": reading(0)}, float(i)), 0.001 * i, f"sender {i}")
    assert len(hearing._clocks) <= 64
    assert not hearing._assembly.pending
    assert samples == []


# The world turned


def test_a_reset_heading_puts_the_wearer_at_the_origin_facing_ahead():
    body, rng = average_body(), np.random.default_rng(3)
    places = default_placements(SIX, body)
    q = rng.normal(scale=0.3, size=body.size)
    q[:6] = [3.0, 1.0, -2.0, 0.0, 2.0, 0.0]

    def sample_of(q: np.ndarray) -> Sample:
        worn = place_sensors(forward_kinematics(body, q), body, places)
        nothing = np.full((6, 3), np.nan)
        quats = quat_from_matrix(worn.rotations)
        return Sample(0.0, 0.0, worn.positions, quats, nothing, nothing, np.full(6, np.nan), np.zeros(6, dtype=int))

    ahead = q.copy()
    ahead[[0, 2]] = 0.0
    ahead[3:6] = 0.0
    first = facing_ahead(Alignment(), q)
    assert np.allclose(aligned(sample_of(q), first).positions, sample_of(ahead).positions, atol=1e-9)
    turned = matrix_from_quat(aligned(sample_of(q), first).quats_wxyz)
    assert np.allclose(turned, matrix_from_quat(sample_of(ahead).quats_wxyz), atol=1e-9)
    # From a world that is turned already: a wearer seen at `seen` stands, in the sensors' world, as before.
    seen = ahead.copy()
    seen[[0, 2]], seen[3:6] = [0.7, -0.4], [0.0, -1.1, 0.0]
    second = facing_ahead(first, seen)
    R = heading_matrix(np.array(first.heading))
    moved = seen.copy()
    moved[:3] = R @ seen[:3] + [first.x, 0.0, first.z]
    moved[3:6] = [0.0, first.heading - 1.1, 0.0]
    assert np.allclose(aligned(sample_of(moved), second).positions, sample_of(ahead).positions, atol=1e-9)


# Motions without end


@pytest.mark.parametrize("name", ["walk", "run", "kick"])
def test_an_endless_motion_goes_on_from_its_end(name: str):
    motion = endless_motion(sample_motions()[name])
    frames = motion_frames(motion).positions
    steps = np.linalg.norm(np.diff(np.concatenate([frames, frames[:1]]), axis=0), axis=-1).max(axis=-1)
    assert steps[-1] <= 1.5 * steps[:-1].max()
    assert np.abs(frames[..., [0, 2]]).max() < 8.0
    if name == "walk":
        assert np.ptp(motion.q[:, 0]) > 2.0


# Watch

Change = Callable[[Sample], Sample]


def watched(
    clip: str,
    faults: tuple[str, ...] = (),
    name: str = "six-trackers",
    rate: float = 60.0,
    change: Change | None = None,
) -> list[tuple[float, str, Trouble]]:
    worn = replace(layout(name), rate=60.0)
    recording = virtual_recording(f"sample:{clip}", worn, [parse_fault(text) for text in faults]).cut(0, 480)
    watch = Watch(worn)
    state, found = watch.start(), []
    for index in range(len(recording)):
        sample = recording.sample(index)
        before = state
        state = watch.step(state, sample if change is None else change(sample))
        found += [(sample.time, each.sensor, each.trouble) for each in new_findings(before, state)]
    return found


@pytest.mark.parametrize("clip", ["backflip", "dance_a", "run", "crawl", "spinkick"])
def test_sound_trackers_are_not_blamed(clip: str):
    assert watched(clip) == []


@pytest.mark.parametrize("name", ["hips-imu", "right-foot-imu", "flex-four"])
def test_other_sound_sensors_are_not_blamed(name: str):
    assert watched("run", name=name) == []


@pytest.mark.parametrize(
    ("fault", "trouble", "within"),
    [
        ("silent:leftHand:2:4", Trouble.SILENT, 0.2),
        ("stuck:leftHand:2:5", Trouble.STUCK, 1.0),
        ("noise:leftHand:2:6", Trouble.NOISY, 1.5),
        ("swap:leftHand+rightHand:2:6", Trouble.SWAPPED, 0.5),
    ],
)
def test_a_faulty_tracker_is_named(fault: str, trouble: Trouble, within: float):
    found = watched("walk", (fault,))
    assert {each for _, _, each in found} == {trouble}
    assert "leftHand" in {sensor for _, sensor, _ in found}
    assert {sensor for _, sensor, _ in found} <= {"leftHand", "rightHand"}
    assert 2.0 <= found[0][0] <= 2.0 + within


def scaled(channel: str, factor: float) -> Change:
    return lambda sample: replace(sample, **{channel: getattr(sample, channel) * factor})


def test_other_units_are_named():
    found = watched("walk", change=scaled("positions", 100.0))
    assert {each for _, _, each in found} == {Trouble.MIS_SCALED}
    assert {sensor for _, sensor, _ in found} == set(SIX.names)
    for channel, factor in (("specific_forces", 1 / 9.81), ("angular_rates", np.degrees(1.0))):
        found = watched("run", name="right-foot-imu", change=scaled(channel, factor))
        assert [each for _, _, each in found] == [Trouble.MIS_SCALED]


def test_trackers_on_the_wrong_sides_from_the_start_are_named():
    other = [0, 1, 2, 3, 5, 4]
    found = watched("walk", change=lambda s: replace(s, positions=s.positions[other], quats_wxyz=s.quats_wxyz[other]))
    assert {(sensor, each) for _, sensor, each in found} == {
        ("leftAnkle", Trouble.SWAPPED), ("rightAnkle", Trouble.SWAPPED)
    }  # fmt: skip


def test_silence_shows_without_any_sample():
    watch = Watch(SIX)
    sample = virtual_recording("sample:walk", SIX, endless=False).sample(0)
    state = watch.step(watch.start(), sample)
    assert watch.poll(state, sample.time + 0.1).findings == {}
    late = watch.poll(state, sample.time + 0.19)
    assert {sensor for sensor, _ in late.findings} == set(SIX.names)
    assert all("silent" in each.text for each in late.findings.values())
