"""`sensor-prior` keeps the contract over every kind of layout, and carries root and spread as it says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from poseloom.methods import HealthState, reconstruct
from poseloom.methods.prior.channels import ANY, OUTPUT_SIZE, SIX, SIX_BONES, InputSpec
from poseloom.methods.prior.gaussian import pose_gaussian, pose_vector
from poseloom.methods.prior.method import SensorPrior
from poseloom.methods.prior.network import PriorNetwork
from poseloom.methods.prior.root import RootCarrier
from poseloom.rotations import geodesic_angle, matrix_from_rotvec, quat_from_matrix
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, SensorKind, SensorLayout, SensorSpec, layout, make_layout
from poseloom.skeleton import average_body, motion_frames
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.synthesis import (
    NO_IMU_NOISE,
    NO_ORIENTATION_ERRORS,
    ImuNoise,
    OrientationErrors,
    TrackerNoise,
    add_orientations,
    merge_recordings,
    simulate_flex,
    simulate_imus,
    simulate_trackers,
)


def calm_network(spec: InputSpec) -> PriorNetwork:
    """A small network whose rotations are near their base, all soles standing."""
    generator = np.random.default_rng(0)
    hidden = 12

    def draw(*shape: int) -> np.ndarray:
        return 0.2 * generator.normal(size=shape).astype(np.float32) / math.sqrt(shape[-1])

    weights = {
        "encode.weight": draw(hidden, spec.size), "encode.bias": draw(hidden),
        "head.weight": draw(OUTPUT_SIZE, hidden), "head.bias": np.zeros(OUTPUT_SIZE, dtype=np.float32),
    }  # fmt: skip
    weights["head.bias"][:132] = np.tile([1, 0, 0, 0, 1, 0], 22)
    weights["head.bias"][154:158] = 3.0
    for layer in range(2):
        weights |= {f"memory.weight_{which}_l{layer}": draw(3 * hidden, hidden) for which in ("ih", "hh")}
        weights |= {f"memory.bias_{which}_l{layer}": draw(3 * hidden) for which in ("ih", "hh")}
    return PriorNetwork(spec, weights)


def imus(*bones: str) -> SensorLayout:
    return make_layout("+".join(bones), [SensorSpec(bone, SensorKind.IMU, bone) for bone in bones], 40.0)


SIX_LAYOUT = imus(*SIX_BONES)


def walk():
    motion = sample_motions()["walk"]
    return motion.cut(0, min(len(motion), 200))


def imu_recording(worn: SensorLayout, noisy: bool = True) -> Recording:
    made = simulate_imus(walk(), worn, ImuNoise() if noisy else NO_IMU_NOISE, seed=3)
    return add_orientations(made, OrientationErrors() if noisy else NO_ORIENTATION_ERRORS, seed=3)


def _recordings() -> dict[str, Recording]:
    made = {
        "six IMUs": imu_recording(SIX_LAYOUT),
        "pelvis and wrists": imu_recording(imus("hips", "leftLowerArm", "rightLowerArm")),
        "wrist": imu_recording(imus("rightLowerArm")),
        "foot and hand without orientations": simulate_imus(walk(), imus("rightFoot", "rightHand"), ImuNoise(), seed=3),
        "six trackers": simulate_trackers(walk(), layout("six-trackers"), TrackerNoise(), seed=3),
        "three trackers": simulate_trackers(walk(), layout("three-trackers"), TrackerNoise(), seed=3),
        "flex": simulate_flex(walk(), replace(layout("flex-four"), rate=40.0), seed=3),
    }
    head = make_layout("head", [SensorSpec("hmd", SensorKind.TRACKER, "head")], 40.0)
    tracked = simulate_trackers(walk(), head, TrackerNoise(), seed=3)
    parts = [tracked, made["flex"], imu_recording(imus("hips"))]
    sensors = [sensor for part in parts for sensor in part.layout.sensors]
    made["head tracker, flex and hips"] = merge_recordings(make_layout("mixed", sensors, 40.0), parts)
    return made


RECORDINGS = _recordings()


def method_for(recording: Recording) -> SensorPrior:
    six = [sensor.bone for sensor in recording.layout.sensors] == list(SIX_BONES)
    return SensorPrior(recording.layout, calm_network(SIX if six else ANY))


@pytest.mark.parametrize("name", RECORDINGS)
def test_every_layout_keeps_the_contract(name: str) -> None:
    recording = RECORDINGS[name]
    method = method_for(recording)
    whole = reconstruct(method, recording)
    assert len(whole.motion) == len(recording)
    assert np.isfinite(whole.motion.q).all()
    assert np.isfinite(whole.spread).all()
    assert (whole.spread >= 0).all()
    np.testing.assert_array_equal(whole.motion.q, reconstruct(method, replace(recording, truth=None)).motion.q)
    state = method.start(recording.skeleton, recording.placements)
    for index in range(30):
        state, _ = method.step(state, recording.sample(index))
    kept = state.prior.memory.copy(), state.q.copy()
    again = [method.step(state, recording.sample(30))[1].pose.q for _ in range(2)]
    np.testing.assert_array_equal(again[0], again[1])
    np.testing.assert_array_equal(again[0], whole.motion.q[30])
    np.testing.assert_array_equal(state.prior.memory, kept[0])
    np.testing.assert_array_equal(state.q, kept[1])


@pytest.mark.parametrize("name", RECORDINGS)
def test_silence_is_survived_and_told(name: str) -> None:
    recording = _silenced(RECORDINGS[name], slice(40, 44))
    result = reconstruct(method_for(recording), recording)
    assert np.isfinite(result.motion.q).all()
    assert {result.health[i].state for i in range(40, 44)} == {HealthState.COASTING}
    assert result.health[39].state is HealthState.OK
    assert result.health[110].state is not HealthState.COASTING
    assert set(result.health[41].sensors) == set(recording.layout.names)


def test_long_silence_is_lost_and_stands_still() -> None:
    recording = _silenced(RECORDINGS["six IMUs"], slice(20, 125))
    result = reconstruct(method_for(recording), recording)
    assert result.health[120].state is HealthState.LOST
    np.testing.assert_allclose(result.motion.q[120], result.motion.q[40], atol=0.05)
    assert result.spread[120].mean() > result.spread[21].mean()


def test_a_sensor_that_joins_late_makes_no_jump() -> None:
    recording = RECORDINGS["six IMUs"]
    quats, forces = recording.quats_wxyz.copy(), recording.specific_forces.copy()
    quats[:60, 2], forces[:60, 2] = np.nan, np.nan
    late = replace(recording, quats_wxyz=quats, specific_forces=forces)
    result = reconstruct(method_for(late), late)
    places = motion_frames(result.motion).positions
    steps = np.linalg.norm(np.diff(places, axis=0), axis=-1).max(axis=1)
    assert steps[59] < 2.5 * max(np.median(steps), 0.02)
    assert "leftLowerArm" in result.health[30].sensors
    assert result.health[130].sensors == ()


def test_an_imu_without_orientation_is_oriented() -> None:
    recording = simulate_imus(walk(), imus("hips"), NO_IMU_NOISE, seed=3)
    method = SensorPrior(recording.layout, calm_network(ANY))
    sure = replace(method.settings, imu_orientation=0.001)
    result = reconstruct(SensorPrior(recording.layout, calm_network(ANY), sure), recording)
    up, true = (motion_frames(m).rotations[20:, 0, 1] for m in (result.motion, recording.truth))
    assert np.degrees(np.arccos(np.clip((up * true).sum(-1), -1, 1))).mean() < 4.0


def test_it_waits_for_the_first_sensor() -> None:
    recording = _silenced(RECORDINGS["six IMUs"], slice(0, 5))
    assert reconstruct(method_for(recording), recording).samples[0] == 5


def test_sensors_bones_are_where_perfect_sensors_say() -> None:
    recording = imu_recording(SIX_LAYOUT, noisy=False)
    method = SensorPrior(SIX_LAYOUT, calm_network(SIX))
    sure = replace(method.settings, imu_orientation=0.001, forearm_orientation=0.001)
    result = reconstruct(SensorPrior(SIX_LAYOUT, calm_network(SIX), sure), recording)
    bones = [average_body().index(bone) for bone in SIX_BONES]
    truth, made = (motion_frames(m).rotations[:, bones] for m in (recording.truth, result.motion))
    assert np.degrees(geodesic_angle(quat_from_matrix(truth[5:]), quat_from_matrix(made[5:]))).max() < 1.0


def test_trackers_carry_the_root() -> None:
    recording = RECORDINGS["six trackers"]
    result = reconstruct(method_for(recording), recording)
    off = np.linalg.norm((result.motion.q - recording.truth.q)[20:, :3], axis=1)
    assert off.mean() < 0.25
    assert result.spread[50, :3].max() < 0.1


def test_a_root_without_positions_stands_on_what_stands() -> None:
    body = average_body()
    carrier = RootCarrier(body)
    q = np.zeros(body.size)
    frames = forward_kinematics(body, q)
    soles = carrier.soles(frames.positions, frames.rotations)
    state = carrier.start(soles)
    assert state.place[1] + soles[:, 1].min() == pytest.approx(0.0)
    # The left foot stands while the body passes over it by a centimetre a step; the right one swings ahead.
    for _ in range(80):
        soles = soles + np.array([[0, 0, -0.01], [0, 0, -0.01], [0, 0, 0.02], [0, 0, 0.02]])
        state = carrier.step(state, soles, np.array([1.0, 1.0, 0.0, 0.0]), np.array([9.0, 9.0, 9.0]), 1 / 40)
    assert state.place[2] == pytest.approx(0.8, abs=0.03)
    assert state.walked == pytest.approx(state.place[2])
    flight = carrier.step(state, soles, np.zeros(4), np.array([1.0, 0.0, 0.0]), 1.0)
    assert flight.place[0] == pytest.approx(1.0, abs=0.01)
    assert (carrier.sigma(state) > carrier.sigma(carrier.start(soles)))[[0, 2]].all()


def test_a_gaussian_of_bones_is_one_of_the_pose_vector() -> None:
    """Against drawn errors of the bones' rotations."""
    body = average_body()
    generator = np.random.default_rng(1)
    q = np.concatenate([np.zeros(3), generator.normal(size=66) * 0.4])
    rotations = forward_kinematics(body, q).rotations
    np.testing.assert_allclose(pose_vector(body, rotations, np.zeros(3), q), q, atol=1e-9)
    sigma = generator.uniform(0.01, 0.03, 22)
    told = pose_gaussian(body, q, rotations, sigma, np.array([0.1, 0.2, 0.3])).covariance
    np.testing.assert_allclose(np.diag(told)[:3], [0.01, 0.04, 0.09])
    errors = matrix_from_rotvec(generator.normal(size=(4000, 22, 3)) * sigma[:, None])
    draws = np.stack([pose_vector(body, rotations @ error, np.zeros(3), q) for error in errors])
    made = np.cov((draws - q)[:, 3:].T)
    scale = np.sqrt(np.outer(np.diag(made), np.diag(made)))
    np.testing.assert_allclose(told[3:, 3:] / scale, made / scale, atol=0.09)


def test_the_method_runs_at_the_networks_rate() -> None:
    assert SensorPrior(replace(SIX_LAYOUT, rate=100.0), calm_network(SIX)).layout.rate == 40.0


def test_orientations_of_virtual_imus_err_by_eight_degrees() -> None:
    perfect = imu_recording(SIX_LAYOUT, noisy=False)
    true = motion_frames(perfect.truth).rotations[:, [average_body().index(bone) for bone in SIX_BONES]]
    np.testing.assert_allclose(geodesic_angle(perfect.quats_wxyz, quat_from_matrix(true)), 0.0, atol=1e-6)
    off = []
    for seed in range(12):
        noisy = simulate_imus(walk(), SIX_LAYOUT, ImuNoise(placement_rad=math.radians(3)), seed=seed)
        noisy = add_orientations(noisy, seed=seed)
        off.append(np.degrees(geodesic_angle(noisy.quats_wxyz, quat_from_matrix(true))).mean())
    assert np.mean(off) == pytest.approx(8.0, abs=1.2)


def _silenced(recording: Recording, gone: slice) -> Recording:
    names = ("positions", "quats_wxyz", "specific_forces", "angular_rates", "counts")
    columns = {name: getattr(recording, name).copy() for name in names}
    for column in columns.values():
        column[gone] = np.nan
    return replace(recording, **columns)
