"""The root and the hips' turn of flex methods: an IMU on the hips, soles that stand."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from poseloom.errors import MethodError
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.methods.flex.root import OnItsFeet, RootSettings, on_its_feet
from poseloom.methods.flex.stride import NO_STRIDE, StrideSettings, follow_stride, stepping, walking_speed
from poseloom.methods.reconstruction import reconstruct
from poseloom.rotations import (
    geodesic_angle,
    heading_angle,
    heading_matrix,
    quat_from_matrix,
    quat_from_rotvec,
    quat_multiply,
)
from poseloom.samples import sample_motions
from poseloom.samples.looping import loop
from poseloom.sensors import Placement, Recording, Sample, SensorKind, imu_layout, layout
from poseloom.skeleton import Motion, Pose, Skeleton, resample, sole_positions
from poseloom.synthesis import IDEAL_FLEX, NO_IMU_NOISE, merge_recordings, simulate_flex, simulate_imus
from poseloom.synthesis.mixed import layout_of_kind

MIXED = layout("flex-four+hips-imu")
FOUR = layout("flex-four")


class Told(Reconstructor[int]):
    """Tells the true joint angles and knows nothing of the hips: what a perfect network would say."""

    any_rate = True

    def __init__(self, truth: Motion) -> None:
        self.layout, self.delay, self.truth = FOUR, 0, truth

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> int:
        assert len(placements) == 4
        return 0

    def step(self, state: int, sample: Sample) -> tuple[int, Frame | None]:
        assert sample.counts.shape == (4,)
        q = self.truth.q[state].copy()
        q[:6] = 0.0
        return state + 1, Frame(sample.time, Pose(self.truth.skeleton, q), np.full(len(q), 0.1), Health())


@pytest.fixture(scope="module")
def walk() -> Recording:
    motion = loop(sample_motions()["walk"], 1)
    flex = simulate_flex(motion, FOUR, IDEAL_FLEX)
    imu = simulate_imus(motion, layout_of_kind(MIXED, SensorKind.IMU), NO_IMU_NOISE)
    return merge_recordings(MIXED, [flex, imu])


def test_with_an_imu_the_hips_turn_as_they_do_and_the_root_goes_where_it_goes(walk: Recording) -> None:
    truth = walk.truth
    assert truth is not None
    found = reconstruct(OnItsFeet(Told(truth), MIXED), walk)
    turned_away = heading_matrix(-heading_angle(quat_from_rotvec(truth.q[:1, 3:6])))[0]
    hips = quat_multiply(quat_from_matrix(turned_away)[None], quat_from_rotvec(truth.q[:, 3:6]))
    off = np.degrees(geodesic_angle(quat_from_rotvec(found.motion.q[:, 3:6]), hips))
    assert off.mean() < 3.0
    # The sample walks on a robot's stiff legs, which bob as if it were faster.
    way = (truth.q[:, :3] - truth.q[0, :3]) @ turned_away.T
    gone = found.motion.q[:, :3] - found.motion.q[0, :3]
    length = np.linalg.norm(np.diff(way[:, [0, 2]], axis=0), axis=1).sum()
    assert np.linalg.norm((gone - way)[-1, [0, 2]]) < 0.45 * length
    # Legs that tell the truth need no bobbing.
    alone = reconstruct(OnItsFeet(Told(truth), MIXED, RootSettings(most_longer=1.0)), walk).motion.q[:, :3]
    assert np.linalg.norm((alone[-1] - alone[0] - way[-1])[[0, 2]]) < 0.15 * length
    assert np.std(found.motion.q[:, 1] - truth.q[:, 1]) < 0.04
    assert all(health.state is HealthState.OK for health in found.health)
    path = found.spread[:, 0]
    assert (np.diff(path) >= 0).all()
    assert path[-1] > 2 * path[0]


def test_without_an_imu_the_lower_foot_stands_and_nothing_else_is_claimed(walk: Recording) -> None:
    assert walk.truth is not None
    flex = simulate_flex(walk.truth, FOUR, IDEAL_FLEX)
    found = reconstruct(OnItsFeet(Told(walk.truth), FOUR), flex)
    lowest = sole_positions(found.motion)[..., 1].min(axis=1)
    assert np.abs(lowest).max() < 0.03
    assert (found.motion.q[:, [0, 2, 3, 4, 5]] == 0).all()
    assert (found.spread[:, [0, 2]] > 1).all()
    assert (found.spread[:, 3:6] >= 1).all()
    np.testing.assert_array_equal(found.motion.q[:, 6:], walk.truth.q[:, 6:])


def test_it_stands_still_when_the_person_does() -> None:
    motion = sample_motions()["walk"]
    still = replace(motion, q=np.repeat(motion.q[:1], 400, axis=0))
    flex = simulate_flex(still, FOUR, IDEAL_FLEX)
    imu = simulate_imus(still, layout_of_kind(MIXED, SensorKind.IMU), seed=2)
    both = merge_recordings(MIXED, [flex, imu])
    assert both.truth is not None
    found = reconstruct(OnItsFeet(Told(both.truth), MIXED), both)
    assert np.abs(found.motion.q[-1, [0, 2]] - found.motion.q[0, [0, 2]]).max() < 0.1


def test_an_imu_that_falls_silent_is_named_and_the_rest_goes_on(walk: Recording) -> None:
    forces, rates = walk.specific_forces.copy(), walk.angular_rates.copy()
    status = walk.status.copy()
    forces[100:150, 4], rates[100:150, 4], status[100:150, 4] = np.nan, np.nan, 1
    spoilt = replace(walk, specific_forces=forces, angular_rates=rates, status=status)
    assert walk.truth is not None
    found = reconstruct(OnItsFeet(Told(walk.truth), MIXED), spoilt)
    assert [health.sensors for health in found.health[100:150]] == [("hips",)] * 50
    assert found.health[99].state is found.health[150].state is HealthState.OK
    assert np.isfinite(found.motion.q).all()


def test_whole_is_split_and_no_argument_changes(walk: Recording) -> None:
    assert walk.truth is not None
    method = OnItsFeet(Told(walk.truth), MIXED)
    whole = reconstruct(method, walk)
    state = method.start(walk.skeleton, walk.placements)
    for index in range(60):
        before = state
        kept = (dict(before.turn.filter or {}), before.root.copy(), before.rotvec.copy())
        state, frame = method.step(state, walk.sample(index))
        again, same = method.step(before, walk.sample(index))
        assert frame is not None
        assert same is not None
        np.testing.assert_array_equal(frame.pose.q, same.pose.q)
        np.testing.assert_array_equal(frame.pose.q, whole.motion.q[index])
        np.testing.assert_array_equal(again.root, state.root)
        assert kept[0] == dict(before.turn.filter or {})
        np.testing.assert_array_equal(kept[1], before.root)
        np.testing.assert_array_equal(kept[2], before.rotvec)


def test_only_flex_methods_are_put_on_their_feet_and_only_in_their_layouts(walk: Recording) -> None:
    assert walk.truth is not None
    told = Told(walk.truth)
    assert isinstance(on_its_feet(told, MIXED), OnItsFeet)
    with pytest.raises(MethodError, match="flex-four"):
        on_its_feet(told, layout("six-trackers"))
    with pytest.raises(MethodError, match="flex-four"):
        on_its_feet(told, imu_layout("hips"))


@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_any_rate_will_do(rate: float) -> None:
    motion = loop(sample_motions()["walk"], 1)
    mixed = replace(MIXED, rate=rate)
    flex = simulate_flex(motion, layout_of_kind(mixed, SensorKind.FLEX), IDEAL_FLEX)
    imu = simulate_imus(motion, layout_of_kind(mixed, SensorKind.IMU), NO_IMU_NOISE)
    truth = resample(motion, rate)
    found = reconstruct(OnItsFeet(Told(truth), MIXED), merge_recordings(mixed, [flex, imu]))
    way = math.dist(truth.q[0, [0, 2]], truth.q[-1, [0, 2]])
    gone = math.dist(found.motion.q[0, [0, 2]], found.motion.q[-1, [0, 2]])
    assert gone == pytest.approx(way, rel=0.45)


LEG_M = 0.85


def _bobbing(rise_m: float, steps_s: float, in_turn: bool, rate: float = 100.0):
    """Ten seconds of hips that rise and fall by `rise_m` in every step, on thighs that swing."""
    stride, settings = NO_STRIDE, StrideSettings()
    turns = 2 * math.pi * steps_s
    for frame in range(round(10 * rate)):
        time = frame / rate
        swing = 0.4 * math.sin(turns * time / 2)
        vertical = -0.5 * rise_m * turns**2 * math.sin(turns * time)
        thighs = np.array([swing, -swing if in_turn else swing])
        stride = follow_stride(stride, 1 / rate, vertical, thighs, settings)
    return stride


@pytest.mark.parametrize(("rise_m", "steps_s"), [(0.03, 1.6), (0.045, 2.0), (0.05, 2.4)])
def test_bobbing_hips_tell_the_speed_of_an_inverted_pendulum(rise_m: float, steps_s: float) -> None:
    stride = _bobbing(rise_m, steps_s, in_turn=True)
    expected = 2 * math.sqrt(2 * LEG_M * rise_m) * steps_s  # the pendulum's step, times steps a second
    assert walking_speed(stride, LEG_M, StrideSettings()) == pytest.approx(expected, rel=0.05)
    assert stepping(stride, StrideSettings()) > 0.95


def test_who_squats_does_not_step() -> None:
    assert stepping(_bobbing(0.05, 2.0, in_turn=False), StrideSettings()) == 0.0
    assert stepping(NO_STRIDE, StrideSettings()) == walking_speed(NO_STRIDE, LEG_M, StrideSettings()) == 0.0


class Hobbled(Told):
    """Tells thighs that swing half as far about their mean as the true ones: what networks do."""

    def step(self, state: int, sample: Sample) -> tuple[int, Frame | None]:
        after, frame = super().step(state, sample)
        assert frame is not None
        q = frame.pose.q.copy()
        thighs = [3 + 3 * self.truth.skeleton.index(f"{side}UpperLeg") for side in ("left", "right")]
        mean = self.truth.q[:, thighs].mean(axis=0)
        q[thighs] = mean + 0.5 * (q[thighs] - mean)
        return after, replace(frame, pose=Pose(self.truth.skeleton, q))


def test_bobbing_makes_up_for_legs_that_swing_too_little() -> None:
    motion = loop(sample_motions()["walk"], 4)
    flex = simulate_flex(motion, FOUR, IDEAL_FLEX)
    imu = simulate_imus(motion, layout_of_kind(MIXED, SensorKind.IMU), NO_IMU_NOISE)
    both = merge_recordings(MIXED, [flex, imu])
    truth = both.truth
    assert truth is not None
    way = math.dist(truth.q[0, [0, 2]], truth.q[-1, [0, 2]])
    shares = []
    for settings in (RootSettings(most_longer=1.0), RootSettings()):
        q = reconstruct(OnItsFeet(Hobbled(truth), MIXED, settings), both).motion.q
        shares.append(math.dist(q[0, [0, 2]], q[-1, [0, 2]]) / way)
    assert shares[0] < 0.7
    assert abs(shares[1] - 1) < 0.35
