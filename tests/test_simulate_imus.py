"""Virtual IMUs: exact on known trajectories, calm on rounded ones, noisy as asked, the same for the same seed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from poseloom.errors import SensorError
from poseloom.rotations import geodesic_angle, matrix_from_rotvec, quat_from_matrix
from poseloom.sensors import (
    Recording,
    SensorKind,
    SensorSpec,
    SensorStatus,
    default_placements,
    imu_layout,
    layout,
    make_layout,
    make_placement,
)
from poseloom.sensors.paths import SmoothPath
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.synthesis import NO_IMU_NOISE, Fault, FaultKind, ImuNoise, simulate_imus, true_placements
from poseloom.synthesis.imus import GRAVITY, imu_signals

FOOT_HAND = imu_layout("right-foot", "right-hand")


def swinging(seconds: float = 8.0, rate: float = 120.0, fastest: float = 6.0, seed: int = 0) -> Motion:
    """Each pose-vector entry swings at its own slow frequency."""
    rng = np.random.default_rng(seed)
    body = average_body()
    times = np.arange(round(seconds * rate) + 1) / rate
    swing = np.sin(times[:, None] * rng.uniform(0.5, fastest, body.size) + rng.uniform(0, 6, body.size))
    return make_motion(body, 0.4 * swing, rate, "swing")


@pytest.fixture(scope="module")
def motion() -> Motion:
    return swinging()


@pytest.fixture(scope="module")
def long_still() -> Motion:
    body = average_body()
    return make_motion(body, np.tile(np.linspace(-0.3, 0.3, body.size), (6001, 1)), 60.0, "still")


def spinning(rate: float, radius: float, speed: float, seconds: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Places and orientations of a sensor that goes round a horizontal circle, its z axis along its way."""
    angle = speed * np.arange(round(seconds * rate) + 1) / rate
    zero = np.zeros_like(angle)
    places = radius * np.stack([np.sin(angle), zero, np.cos(angle)], axis=1)
    return places, matrix_from_rotvec(np.stack([zero, angle + math.pi / 2, zero], axis=1))


def test_at_rest_it_feels_gravity_upwards(long_still: Motion):
    recording = simulate_imus(long_still.cut(0, 50), FOOT_HAND, NO_IMU_NOISE)
    still = recording.truth
    assert still is not None
    from poseloom.skeleton.kinematics import motion_frames

    rotations = motion_frames(still).rotations
    for index, sensor in enumerate(FOOT_HAND.sensors):
        up = rotations[:, still.skeleton.index(sensor.bone)].swapaxes(-1, -2) @ np.array([0.0, GRAVITY, 0.0])
        np.testing.assert_allclose(recording.specific_forces[:, index], up, atol=1e-6)
    assert np.abs(recording.angular_rates).max() < 1e-8
    assert np.isnan(recording.positions).all()
    assert np.isnan(recording.quats_wxyz).all()


@pytest.mark.parametrize("rate", [30.0, 60.0, 120.0])
def test_going_round_a_circle_is_centripetal(rate: float):
    radius, speed = 0.8, 5.0
    places, rotations = spinning(rate, radius, speed)
    moments = np.linspace(0.5, 2.5, 77) * rate
    felt = imu_signals(places, rotations, rate, moments)
    # z leads along the way and y points up, so x points to the middle.
    expected = np.array([radius * speed**2, GRAVITY, 0.0])
    np.testing.assert_allclose(felt.specific_forces, np.tile(expected, (77, 1)), atol=2e-3 * (60 / rate) ** 4)
    np.testing.assert_allclose(felt.angular_rates, np.tile([0.0, speed, 0.0], (77, 1)), atol=2e-4 * (60 / rate) ** 4)


def test_a_pendulum_feels_what_physics_says():
    length, swing, rate = 0.9, 1.0, 120.0
    pace = math.sqrt(GRAVITY / length)
    times = np.arange(361) / rate
    # Small oscillation's law as a driven motion: any angle(t) will do, as its derivatives are known.
    angle, speed = swing * np.cos(pace * times), -swing * pace * np.sin(pace * times)
    gain = -swing * pace**2 * np.cos(pace * times)
    zero = np.zeros_like(times)
    places = length * np.stack([np.sin(angle), -np.cos(angle), zero], axis=1)
    felt = imu_signals(
        places, matrix_from_rotvec(np.stack([zero, zero, angle], axis=1)), rate, np.arange(361, dtype=np.float64)
    )
    inside = slice(30, -30)
    expected = np.stack(
        [length * gain + GRAVITY * np.sin(angle), length * speed**2 + GRAVITY * np.cos(angle), zero], axis=1
    )
    np.testing.assert_allclose(felt.specific_forces[inside], expected[inside], atol=1e-4)
    np.testing.assert_allclose(felt.angular_rates[inside, 2], speed[inside], atol=1e-6)


def test_signals_agree_with_fine_differences_of_the_body(motion: Motion):
    """The oracle: the same analytic motion at 1920 Hz, differentiated crudely."""
    fine = swinging(rate=1920.0)
    from poseloom.sensors import place_sensors
    from poseloom.skeleton.kinematics import motion_frames

    recording = simulate_imus(motion, FOOT_HAND, NO_IMU_NOISE)
    seen = place_sensors(motion_frames(fine), fine.skeleton, recording.placements)
    step = 1 / 1920.0
    gain = (seen.positions[2:] - 2 * seen.positions[1:-1] + seen.positions[:-2]) / step**2
    turn = seen.rotations[:-2].swapaxes(-1, -2) @ seen.rotations[2:] / (2 * step)
    at = np.arange(60, 420) * 32
    force = np.einsum("nsji,nsj->nsi", seen.rotations[at], gain[at - 1] + np.array([0, GRAVITY, 0]))
    spin = np.stack(
        [
            turn[at - 1, :, 2, 1] - turn[at - 1, :, 1, 2],
            turn[at - 1, :, 0, 2] - turn[at - 1, :, 2, 0],
            turn[at - 1, :, 1, 0] - turn[at - 1, :, 0, 1],
        ],
        axis=-1,
    )
    np.testing.assert_allclose(recording.specific_forces[60:420], force, atol=5e-3)
    np.testing.assert_allclose(recording.angular_rates[60:420], spin / 2, atol=1e-3)


@pytest.mark.parametrize("rate", [30.0, 60.0])
def test_rounding_to_three_decimals_is_not_amplified(rate: float):
    """As in files of degrees and centimetres with three decimals: the signal errs less than the sensor's own noise."""
    exact = swinging(rate=rate, fastest=4.0)
    degrees = np.degrees(exact.q)
    degrees[:, :3] = 100 * exact.q[:, :3]
    rounded = degrees.round(3)
    q = np.radians(rounded)
    q[:, :3] = rounded[:, :3] / 100
    quiet = replace(NO_IMU_NOISE, bandwidth_hz=ImuNoise().bandwidth_hz)
    first, second = (simulate_imus(m, FOOT_HAND, quiet) for m in (exact, make_motion(exact.skeleton, q, rate)))
    errors = second.specific_forces - first.specific_forces
    assert errors.std() < ImuNoise().force_m_s2
    assert (second.angular_rates - first.angular_rates).std() < ImuNoise().rate_rad_s


def test_smooth_path_halves_its_bandwidth_and_passes_what_is_slow():
    rate, bandwidth = 100.0, 12.0
    frames = np.arange(1001.0)
    for frequency, gain in ((2.0, 1.0), (bandwidth, 0.5), (30.0, 0.0)):
        wave = np.sin(2 * math.pi * frequency * frames / rate)
        passed = SmoothPath(wave[:, None], rate, bandwidth).at(frames)[200:-200, 0]
        assert passed.std() / wave[200:-200].std() == pytest.approx(gain, abs=6e-3)
    parabola = np.stack([frames**2, 3 * frames - 1], axis=1) / 100
    path = SmoothPath(parabola, rate, bandwidth)
    np.testing.assert_allclose(path.at(frames), parabola, atol=1e-5)
    np.testing.assert_allclose(path.at(frames, 2)[:, 0], 0.02 * rate**2, rtol=1e-5)


def test_smooth_path_minimises_its_cost():
    """Against the dense solution of the same least-squares problem."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(12, 2))
    wave = 2 * math.pi * 0.2
    weight = ((66 + 52 * math.cos(wave) + 2 * math.cos(2 * wave)) / 120) ** 2 / (2 * math.sin(wave / 2)) ** 6
    basis = sum(b * np.eye(12, 16, k) for k, b in enumerate(np.array([1, 26, 66, 26, 1]) / 120))
    rough = np.diff(np.eye(16), 3, axis=0)
    best = basis @ np.linalg.solve(basis.T @ basis + weight * rough.T @ rough, basis.T @ values)
    np.testing.assert_allclose(SmoothPath(values, 50.0, 10.0).at(np.arange(12.0)), best, atol=1e-9)


@pytest.mark.parametrize("frames", [1, 2, 3, 5])
def test_short_motions_have_signals(motion: Motion, frames: int):
    recording = simulate_imus(motion.cut(0, frames), FOOT_HAND)
    assert np.isfinite(recording.specific_forces).all()


def test_truth_is_resampled_and_signals_follow_it(motion: Motion):
    at_120, at_50 = (simulate_imus(motion, imu_layout("right-foot", rate=rate), NO_IMU_NOISE) for rate in (120.0, 50.0))
    assert at_50.truth is not None
    assert len(at_50.truth) == len(at_50) == 401
    np.testing.assert_allclose(at_50.times, np.arange(401) / 50)
    np.testing.assert_allclose(at_50.angular_rates[::5], at_120.angular_rates[::12], atol=1e-9)


def noise_only(**given: float) -> ImuNoise:
    return replace(NO_IMU_NOISE, **given)


def errors(recording: Recording, exact: Recording) -> tuple[np.ndarray, np.ndarray]:
    return (
        recording.specific_forces - exact.specific_forces,
        recording.angular_rates - exact.angular_rates,
    )


def test_each_error_has_its_size(long_still: Motion):
    many = make_layout("many", [SensorSpec(f"s{i}", SensorKind.IMU, "hips") for i in range(60)], 60.0)
    part = long_still.cut(0, 601)
    exact = simulate_imus(part, many, NO_IMU_NOISE)
    force, rate = errors(simulate_imus(part, many, noise_only(force_m_s2=0.2, rate_rad_s=0.01)), exact)
    assert force.std() == pytest.approx(0.2, rel=0.02)
    assert rate.std() == pytest.approx(0.01, rel=0.02)
    force, rate = errors(simulate_imus(part, many, noise_only(force_bias_m_s2=0.2, rate_bias_rad_s=0.01)), exact)
    assert np.abs(np.diff(force, axis=0)).max() < 1e-9
    assert force[0].std() == pytest.approx(0.2, rel=0.15)
    assert rate[0].std() == pytest.approx(0.01, rel=0.15)
    force, rate = errors(simulate_imus(part, many, noise_only(force_walk=0.2, rate_walk=0.01)), exact)
    for second in (1, 4, 10):
        assert force[60 * second].std() == pytest.approx(0.2 * math.sqrt(second), rel=0.2)
        assert rate[60 * second].std() == pytest.approx(0.01 * math.sqrt(second), rel=0.2)
    force, _ = errors(simulate_imus(part, many, noise_only(force_scale=0.02)), exact)
    relative = force[0] / exact.specific_forces[0]
    assert relative.std() == pytest.approx(0.02, rel=0.15)


def test_range_clips_and_says_so(motion: Motion):
    exact = simulate_imus(motion, FOOT_HAND, NO_IMU_NOISE)
    clipped = simulate_imus(motion, FOOT_HAND, noise_only(force_range_m_s2=12.0, rate_range_rad_s=1.0))
    np.testing.assert_array_equal(clipped.specific_forces, np.clip(exact.specific_forces, -12.0, 12.0))
    np.testing.assert_array_equal(clipped.angular_rates, np.clip(exact.angular_rates, -1.0, 1.0))
    beyond = (np.abs(exact.specific_forces) >= 12).any(-1) | (np.abs(exact.angular_rates) >= 1).any(-1)
    assert 0 < beyond.mean() < 1
    np.testing.assert_array_equal(clipped.status == SensorStatus.SATURATED, beyond)


def test_mounting_error_is_hidden_but_told(motion: Motion):
    recording = simulate_imus(motion, FOOT_HAND, noise_only(placement_m=0.02, placement_rad=0.1), seed=4)
    worn = true_placements(recording)
    for stated, usual, true in zip(
        recording.placements, default_placements(FOOT_HAND, motion.skeleton), worn, strict=True
    ):
        np.testing.assert_array_equal(stated.R_bone_sensor, usual.R_bone_sensor)
        assert 0.005 < np.linalg.norm(true.p_bone_sensor - stated.p_bone_sensor) < 0.1
        quats = [quat_from_matrix(each.R_bone_sensor) for each in (stated, true)]
        assert 0.02 < geodesic_angle(*quats) < 0.5
    exact = simulate_imus(motion, FOOT_HAND, NO_IMU_NOISE, placements=worn)
    np.testing.assert_allclose(recording.specific_forces, exact.specific_forces, atol=1e-9)


def test_a_wrong_clock_slips(motion: Motion):
    exact = simulate_imus(motion, imu_layout("hips", rate=120.0), NO_IMU_NOISE)
    slow = simulate_imus(motion, imu_layout("hips", rate=120.0), noise_only(clock_error=0.01), seed=3)
    sampled = np.arange(961) / 120.0
    inside = slice(60, 780)

    def slipped(slip: float) -> np.ndarray:
        known = exact.angular_rates[:, 0]
        return np.stack([np.interp(sampled[inside] * (1 + slip), sampled, known[:, axis]) for axis in range(3)], axis=1)

    slips = np.linspace(-0.04, 0.04, 801)
    misses = [np.abs(slipped(slip) - slow.angular_rates[inside, 0]).max() for slip in slips]
    assert abs(slips[np.argmin(misses)]) > 1e-3
    assert min(misses) < 0.02
    ahead = simulate_imus(motion, imu_layout("hips", rate=120.0), noise_only(clock_offset_s=0.1), seed=1)
    assert np.abs(ahead.angular_rates - exact.angular_rates).max() > 0.05


def test_lost_samples_are_missing(long_still: Motion):
    recording = simulate_imus(long_still, FOOT_HAND, noise_only(drop_out_probability=0.1))
    gone = recording.status == SensorStatus.MISSING
    assert gone.mean() == pytest.approx(0.1, abs=0.01)
    np.testing.assert_array_equal(np.isnan(recording.specific_forces).all(axis=-1), gone)
    np.testing.assert_array_equal(np.isnan(recording.angular_rates).all(axis=-1), gone)


def test_faults_hit_only_their_sensor_and_time(motion: Motion):
    exact = simulate_imus(motion, FOOT_HAND, NO_IMU_NOISE)
    hit = (exact.times >= 2) & (exact.times < 3)
    for kind in set(FaultKind) - {FaultKind.SATURATED, FaultKind.REPLACED}:  # those are of flex sensors
        other = "rightHand" if kind is FaultKind.SWAP else ""
        fault = Fault("rightFoot", 2.0, 3.0, kind, other=other)
        spoilt = simulate_imus(motion, FOOT_HAND, NO_IMU_NOISE, [fault])
        np.testing.assert_array_equal(spoilt.specific_forces[~hit], exact.specific_forces[~hit])
        said, meant = spoilt.specific_forces[hit], exact.specific_forces[hit]
        if kind is FaultKind.SILENT:
            assert np.isnan(said[:, 0]).all()
        elif kind is FaultKind.STUCK:
            before = exact.specific_forces[np.flatnonzero(hit)[0] - 1, 0]
            np.testing.assert_array_equal(said[:, 0], np.tile(before, (60, 1)))
        elif kind is FaultKind.SWAP:
            np.testing.assert_array_equal(said, meant[:, ::-1])
            continue
        elif kind is FaultKind.OUTLIERS:
            np.testing.assert_allclose(np.linalg.norm(said[:, 0] - meant[:, 0], axis=-1), 30.0)
        elif kind is FaultKind.NOISE:
            assert (said[:, 0] - meant[:, 0]).std() == pytest.approx(30.0, rel=0.2)
        else:
            grown = np.linalg.norm(said[:, 0] - meant[:, 0], axis=-1)
            np.testing.assert_allclose(grown, 30.0 * (exact.times[hit] - 2.0), atol=1e-9)
        np.testing.assert_array_equal(said[:, 1], meant[:, 1])


def test_a_seed_repeats_and_sensors_have_their_own_streams(motion: Motion):
    first, again = simulate_imus(motion, FOOT_HAND, seed=5), simulate_imus(motion, FOOT_HAND, seed=5)
    np.testing.assert_array_equal(first.specific_forces, again.specific_forces)
    alone = simulate_imus(motion, imu_layout("right-hand"), seed=5)
    np.testing.assert_array_equal(alone.specific_forces[:, 0], first.specific_forces[:, 1])
    assert np.abs(simulate_imus(motion, FOOT_HAND, seed=6).specific_forces - first.specific_forces).max() > 0.01
    assert first.settings["made by"] == "simulate_imus"
    assert first.settings["noise bandwidth_hz"] == "10.0"


def test_nonsense_is_refused(motion: Motion):
    with pytest.raises(SensorError, match="no IMUs: head"):
        simulate_imus(motion, layout("three-trackers"))
    with pytest.raises(SensorError, match="force_m_s2 is -1"):
        simulate_imus(motion, FOOT_HAND, ImuNoise(force_m_s2=-1.0))
    with pytest.raises(SensorError, match="bandwidth_hz is 0"):
        simulate_imus(motion, FOOT_HAND, ImuNoise(bandwidth_hz=0.0))
    with pytest.raises(SensorError, match="rate_walk is inf"):
        simulate_imus(motion, FOOT_HAND, ImuNoise(rate_walk=math.inf))
    with pytest.raises(SensorError, match="unknown sensor"):
        simulate_imus(motion, FOOT_HAND, faults=[Fault("hips", 0.0, 1.0)])
    with pytest.raises(SensorError, match="do not fit"):
        simulate_imus(motion, FOOT_HAND, placements=[make_placement("head"), make_placement("hips")])
