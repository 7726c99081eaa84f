"""The flex-sensor simulator: bends, curve, loop, ageing, converter, faults."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.cli._app import run
from poseloom.errors import SensorError
from poseloom.formats.recording import read_recording
from poseloom.samples import sample_motions
from poseloom.sensors import SensorKind, layout
from poseloom.skeleton import average_body, make_motion, motion_frames
from poseloom.synthesis import (
    Fault,
    FaultKind,
    FlexSensors,
    Spread,
    bend_angles,
    draw_channels,
    flex_counts,
    merge_recordings,
    simulate_flex,
    simulate_imus,
    simulate_trackers,
    true_placements,
)
from poseloom.synthesis.mixed import layout_of_kind

FOUR = layout("flex-four")
NOTHING = Spread(0.0)
QUIET = FlexSensors(
    hysteresis=NOTHING, lag_share=NOTHING, slip=NOTHING, noise=NOTHING, opens=NOTHING, spikes=NOTHING, lost_lines=0.0
)


def one(sensors: FlexSensors, bends: np.ndarray, minutes: float = 0.0, rate: float = 50.0, seed: int = 0) -> np.ndarray:
    channels = draw_channels(sensors, 1, np.random.default_rng(seed))
    return flex_counts(np.ascontiguousarray(bends)[:, None], rate, channels, minutes, seed)[:, 0]


def test_bends_are_the_angles_between_the_bones_in_the_world() -> None:
    motion = sample_motions()["cartwheel"]
    places = motion_frames(motion).positions
    angles = bend_angles(motion, FOUR)
    for column, (upper, middle, end) in enumerate(
        [
            ("leftUpperLeg", "leftLowerLeg", "leftFoot"),
            ("rightUpperLeg", "rightLowerLeg", "rightFoot"),
            ("leftUpperArm", "leftLowerArm", "leftHand"),
            ("rightUpperArm", "rightLowerArm", "rightHand"),
        ]
    ):
        a, b, c = (places[:, motion.skeleton.index(name)] for name in (upper, middle, end))
        along, on = b - a, c - b
        cosine = (along * on).sum(1) / np.linalg.norm(along, axis=1) / np.linalg.norm(on, axis=1)
        np.testing.assert_allclose(np.cos(angles[:, column]), cosine, atol=1e-12)


def test_turning_a_bone_about_itself_bends_nothing() -> None:
    body = average_body()
    q = np.zeros((1, body.size))
    elbow = 3 + 3 * body.index("leftLowerArm")
    q[0, elbow] = 1.2  # about X, along the arm
    assert bend_angles(make_motion(body, q, 50.0), FOUR)[0] == pytest.approx(0, abs=1e-12)
    q[0, elbow : elbow + 3] = [0.0, 1.0, 0.0]
    assert bend_angles(make_motion(body, q, 50.0), FOUR)[0, 2] == pytest.approx(1.0)


def test_counts_grow_with_the_bend_whatever_is_drawn() -> None:
    bends = np.linspace(0, math.radians(160), 400)
    for seed in range(30):
        counts = one(replace(QUIET, hysteresis=FlexSensors().hysteresis, lag_share=Spread(0.1, 0.4)), bends, seed=seed)
        assert (np.diff(counts) >= 0).all()
        assert counts[-1] - counts[0] > 200


def test_counts_are_whole_and_within_twelve_bits() -> None:
    generator = np.random.default_rng(3)
    bends = np.abs(np.cumsum(generator.normal(size=(20000, 8)) * 0.1, axis=0)) % 2.7
    wild = replace(FlexSensors(), noise=Spread(200.0), range=Spread(6.0), spikes=Spread(30.0), opens=Spread(30.0))
    counts = flex_counts(bends, 200.0, draw_channels(wild, 8, generator), 500.0, generator)
    came = counts[np.isfinite(counts)]
    assert (came == np.floor(came)).all()
    assert came.min() == 0
    assert came.max() == 4095


def test_the_bridge_is_the_papers() -> None:
    """Equation 1 by hand, on a straight curve."""
    sensors = replace(QUIET, curvature=NOTHING, range=Spread(0.8), divider=Spread(0.85), creep=NOTHING, shrink=NOTHING)
    bends = np.array([0.0, math.radians(75), math.radians(150)])
    resistance = 1 + 0.8 * np.array([0.0, 0.5, 1.0])
    volts = (resistance / (0.85 + resistance) - 0.5) * 4.0
    np.testing.assert_allclose(one(sensors, bends), np.floor(4096 * volts), atol=1)


def test_the_hysteresis_loop_is_closed_as_high_as_stated_and_turns_the_right_way() -> None:
    sensors = replace(
        QUIET, hysteresis=Spread(0.1), curvature=NOTHING, creep=NOTHING, shrink=NOTHING, range=Spread(0.05)
    )
    phase = np.arange(4 * 400) / 400 * 2 * np.pi
    bends = math.radians(75) * (1 - np.cos(phase))
    counts = one(sensors, bends)
    np.testing.assert_array_equal(counts[400:800], counts[800:1200])
    going, coming = counts[800 + 100], counts[800 + 300]  # the same bend, half of the full one
    full = one(replace(sensors, hysteresis=NOTHING), bends)
    assert (coming - going) / (full.max() - full.min()) == pytest.approx(0.1, abs=0.01)
    slow, fast = one(sensors, bends, rate=20.0), one(sensors, bends, rate=200.0)
    np.testing.assert_array_equal(slow, fast)  # it does not ask how fast


def test_a_small_movement_makes_a_small_loop() -> None:
    sensors = replace(QUIET, hysteresis=Spread(0.1), curvature=NOTHING, creep=NOTHING, shrink=NOTHING)
    phase = np.arange(4 * 400) / 400 * 2 * np.pi

    def height(reach: float) -> float:
        counts = one(sensors, math.radians(75) - reach * np.cos(phase))
        return float(counts[1100] - counts[900])

    assert 0 <= height(math.radians(5)) < 0.4 * height(math.radians(60))


def test_use_lifts_the_baseline_and_shrinks_the_range() -> None:
    bends = np.array([0.0, math.radians(150)])
    fresh = np.stack([one(QUIET, bends, 0.0, seed=seed) for seed in range(20)])
    old = np.stack([one(QUIET, bends, 60.0, seed=seed) for seed in range(20)])
    older = np.stack([one(QUIET, bends, 120.0, seed=seed) for seed in range(20)])
    assert (fresh[:, 0] < old[:, 0]).all()
    assert (old[:, 0] < older[:, 0]).all()
    assert (np.ptp(fresh, axis=1) > np.ptp(old, axis=1)).all()
    assert (np.ptp(old, axis=1) > np.ptp(older, axis=1)).all()


def test_use_goes_on_within_a_recording() -> None:
    still = np.zeros(50 * 60 * 10)
    counts = one(QUIET, still)
    assert counts[-1] == one(QUIET, still[:1], minutes=10.0)[0] > counts[0]


def test_the_simulator_repeats_with_its_seed_and_a_fault_leaves_other_channels_alone() -> None:
    motion = sample_motions()["walk"]
    plain, again = (simulate_flex(motion, FOUR, seed=5) for _ in range(2))
    np.testing.assert_array_equal(plain.counts, again.counts)
    assert (plain.counts != simulate_flex(motion, FOUR, seed=6).counts).any()
    spoilt = simulate_flex(motion, FOUR, faults=[Fault("leftElbow", 0.2, 0.8, FaultKind.STUCK)], seed=5)
    np.testing.assert_array_equal(plain.counts[:, [0, 1, 3]], spoilt.counts[:, [0, 1, 3]])
    held = spoilt.counts[(plain.times >= 0.2) & (plain.times < 0.8), 2]
    assert len(np.unique(held[np.isfinite(held)])) == 1


@pytest.mark.parametrize("rate", [20.0, 50.0, 200.0])
def test_any_rate_of_the_boards_will_do(rate: float) -> None:
    recording = simulate_flex(sample_motions()["walk"], replace(FOUR, rate=rate), seed=1)
    assert len(recording) == pytest.approx(recording.truth.duration * rate + 1)  # type: ignore[union-attr]


def test_faults_do_what_they_say() -> None:
    motion = sample_motions()["walk"]

    def spoilt(kind: FaultKind) -> np.ndarray:
        return simulate_flex(motion, FOUR, QUIET, faults=[Fault("leftKnee", 0.3, 0.7, kind)], seed=2).counts[:, 0]

    plain = simulate_flex(motion, FOUR, QUIET, seed=2)
    hit = (plain.times >= 0.3) & (plain.times < 0.7)
    assert np.isnan(spoilt(FaultKind.SILENT)[hit]).all()
    assert (spoilt(FaultKind.SATURATED)[hit] == 4095).all()
    replaced = spoilt(FaultKind.REPLACED)
    np.testing.assert_array_equal(replaced[plain.times < 0.3], plain.counts[plain.times < 0.3, 0])
    assert (replaced[plain.times >= 0.3] != plain.counts[plain.times >= 0.3, 0]).mean() > 0.9
    for kind in (FaultKind.NOISE, FaultKind.OUTLIERS, FaultKind.DRIFT):
        values = spoilt(kind)
        assert (values[hit] != plain.counts[hit, 0]).mean() > 0.8
        np.testing.assert_array_equal(values[~hit], plain.counts[~hit, 0])


def test_drop_outs_are_as_frequent_as_stated() -> None:
    sensors = replace(QUIET, opens=Spread(6.0), open_seconds=Spread(0.5), lost_lines=0.05)
    counts = flex_counts(np.zeros((60000, 4)), 50.0, draw_channels(sensors, 4, np.random.default_rng(1)), 0.0, 1)
    assert np.isnan(counts).all(axis=1).mean() == pytest.approx(0.05, abs=0.005)
    assert (counts == 4095).mean() == pytest.approx(6.0 * 0.5 / 60 * 0.95, rel=0.2)


def test_what_makes_no_sense_is_refused() -> None:
    motion = sample_motions()["walk"]
    with pytest.raises(SensorError, match="no flex sensors"):
        simulate_flex(motion, layout("six-trackers"))
    with pytest.raises(SensorError, match="range"):
        simulate_flex(motion, FOUR, replace(QUIET, range=NOTHING))
    with pytest.raises(SensorError, match="minutes"):
        simulate_flex(motion, FOUR, minutes_of_use=-1.0)
    with pytest.raises(SensorError, match="no flex sensor"):
        simulate_trackers(motion, layout("six-trackers"), faults=[Fault("head", 0.0, 1.0, FaultKind.REPLACED)])


def test_a_mixed_layout_is_its_parts_side_by_side() -> None:
    motion = sample_motions()["walk"]
    mixed = layout("flex-four+hips-imu")
    flex = simulate_flex(motion, layout_of_kind(mixed, SensorKind.FLEX), seed=1)
    imu = simulate_imus(motion, layout_of_kind(mixed, SensorKind.IMU), seed=1)
    both = merge_recordings(mixed, [imu, flex])
    np.testing.assert_array_equal(both.counts[:, :4], flex.counts)
    np.testing.assert_array_equal(both.specific_forces[:, 4], imu.specific_forces[:, 0])
    assert np.isnan(both.counts[:, 4]).all()
    assert np.isnan(both.angular_rates[:, :4]).all()
    assert [placement.bone for placement in true_placements(both)] == [sensor.bone for sensor in mixed.sensors]
    with pytest.raises(SensorError, match="hips"):
        merge_recordings(mixed, [flex])
    with pytest.raises(SensorError, match="leftKnee"):
        merge_recordings(mixed, [flex, flex, imu])
    with pytest.raises(SensorError, match="other times"):
        merge_recordings(mixed, [flex.cut(0, 5), imu])


@pytest.mark.parametrize("worn", ["flex-four", "flex-four+hips-imu"])
def test_the_command_simulates_flex_sensors_alone_and_beside_an_imu(worn: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap"
    words = ["simulate", "sample:walk", "-o", str(path), "--layout", worn, "--minutes-of-use", "30", "--rate", "100"]
    assert run([*words, "--fault", "saturated:leftKnee:1:2"]) == 0
    recording = read_recording(path)
    assert recording.layout.names == layout(worn).names
    assert recording.layout.rate == 100
    assert (recording.counts[110:190, 0] == 4095).all()
    assert any("30.0" in value for key, value in recording.settings.items() if key.endswith("minutes of use"))
