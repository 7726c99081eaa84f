"""How far a foot went, by its own sensor, and what is made up for in the root's way."""

import numpy as np
import pytest

from poseloom.methods.imus.ground import Footing, make_legs, move, start_ground
from poseloom.methods.imus.odometer import FootTrack, flown, start_track, stood
from poseloom.methods.imus.strides import Stride, foot_sensors, missing_turn, missing_way, no_stride, sensed, shown
from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix
from poseloom.sensors import default_placements, imu_layout
from poseloom.skeleton import average_body, forward_kinematics
from poseloom.skeleton.contacts import sole_points

RATE = 100.0
GRAVITY = np.array([0.0, 9.80665, 0.0])
STANCE, SWING, STEP = 40, 60, 1.3


def strides(count: int, course: float = 0.4) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places (metres), specific forces, angular rates and stances of a sensor on a foot that steps along a course."""
    s = np.arange(SWING) / SWING
    smooth = 10 * s**3 - 15 * s**4 + 6 * s**5
    lift, pitch = 0.12 * np.sin(np.pi * s) ** 4, 0.6 * np.sin(2 * np.pi * s) * np.sin(np.pi * s) ** 2
    ahead, up, turned, stands = [], [], [], []
    for index in range(count):
        ahead += [np.full(STANCE, index * STEP), index * STEP + STEP * smooth]
        up += [np.zeros(STANCE), lift]
        turned += [np.zeros(STANCE), pitch]
        stands += [np.ones(STANCE, dtype=bool), np.zeros(SWING, dtype=bool)]
    # It ends standing: what a stride left missing is made up for after it.
    ahead.append(np.full(3 * STANCE, count * STEP))
    up.append(np.zeros(3 * STANCE))
    turned.append(np.zeros(3 * STANCE))
    stands.append(np.ones(3 * STANCE, dtype=bool))
    ahead, up, turned = np.concatenate(ahead), np.concatenate(up), np.concatenate(turned)
    places = np.stack([ahead * np.sin(course), up, ahead * np.cos(course)], axis=1)
    turns = matrix_from_rotvec(np.array([0.0, course, 0.0])) @ matrix_from_rotvec(
        turned[:, None] * np.array([1.0, 0, 0])
    )
    accelerations = np.gradient(np.gradient(places, 1 / RATE, axis=0), 1 / RATE, axis=0)
    forces = np.einsum("fji,fj->fi", turns, accelerations + GRAVITY)
    rates = np.gradient(turned, 1 / RATE)[:, None] * np.array([1.0, 0.0, 0.0])
    return places, forces, rates, np.concatenate(stands)


def tracked(forces: np.ndarray, rates: np.ndarray, stands: np.ndarray) -> list[FootTrack]:
    track = start_track(np.array([0.1, 1.0, -0.05]), forces[0], rates[0])
    out = [track]
    for force, rate, stand in zip(forces[1:], rates[1:], stands[1:], strict=True):
        track = flown(track, force, rate, 1 / RATE)
        out.append(stood(track, np.zeros(3), 0.02) if stand else track)
        track = out[-1]
    return out


def test_strides_are_as_long_as_they_were() -> None:
    places, forces, rates, stands = strides(6)
    generator = np.random.default_rng(3)
    forces = forces + generator.normal(0, 0.05, forces.shape) + np.array([0.08, -0.05, 0.06])
    rates = rates + generator.normal(0, 0.004, rates.shape) + np.array([0.008, -0.006, 0.01])
    track = tracked(forces, rates, stands)
    last = 5 * (STANCE + SWING) + STANCE - 1
    gone = (track[last].place - track[STANCE - 1].place)[[0, 2]]
    assert np.linalg.norm(gone) == pytest.approx(5 * STEP, rel=0.02)
    # Integration without stances goes astray: it is they that put it right.
    alone = tracked(forces, rates, np.zeros_like(stands))
    astray = (alone[last].place - alone[STANCE - 1].place)[[0, 2]]
    assert abs(np.linalg.norm(astray) - 5 * STEP) > 0.5
    assert np.abs(places[last] - places[0]).max() > 5  # the test's own motion goes somewhere


def test_the_gyroscope_s_bias_is_learnt_from_stances() -> None:
    _, forces, rates, stands = strides(60)
    bias = np.array([0.005, 0.009, -0.004])
    track = tracked(forces, rates + bias, stands)[-1]
    assert track.bias == pytest.approx(bias, abs=0.003)
    # About the vertical only a foot that does not turn while it stands can tell.
    assert abs(track.bias[1] - bias[1]) < 0.3 * bias[1]


def test_what_it_believes_of_its_errors_is_about_right() -> None:
    _, forces, rates, stands = strides(4)
    errors = []
    for seed in range(20):
        generator = np.random.default_rng(seed)
        noisy = forces + generator.normal(0, 0.05, forces.shape) + generator.normal(0, 0.1, 3)
        track = tracked(noisy, rates + generator.normal(0, 0.004, rates.shape) + generator.normal(0, 0.008, 3), stands)
        end = track[3 * (STANCE + SWING) + STANCE - 1]
        errors.append(end.velocity / np.sqrt(np.diag(end.covariance)[3:6]))
    assert np.abs(errors).mean() < 3


def test_the_covariance_follows_the_finite_differences_of_the_flight() -> None:
    generator = np.random.default_rng(5)
    root = generator.normal(size=(12, 12))
    track = FootTrack(
        matrix_from_rotvec(generator.normal(size=3)), *generator.normal(size=(3, 3)), root @ root.T,
        *generator.normal(0, 3, size=(2, 3)), True,
    )  # fmt: skip
    force, rate, seconds = generator.normal(0, 5, 3), generator.normal(0, 2, 3), 1e-3

    def disturbed(error: np.ndarray) -> FootTrack:
        return track._replace(
            turn=matrix_from_rotvec(error[:3]) @ track.turn, velocity=track.velocity + error[3:6],
            place=track.place + error[6:9], bias=track.bias + error[9:],
        )  # fmt: skip

    plain = flown(track, force, rate, seconds)
    columns = []
    for error in 1e-6 * np.eye(12):
        other = flown(disturbed(error), force, rate, seconds)
        turned = rotvec_from_matrix(other.turn @ plain.turn.T)
        parts = (turned, other.velocity - plain.velocity, other.place - plain.place, other.bias - plain.bias)
        columns.append(np.concatenate(parts) / 1e-6)
    slope = np.stack(columns, axis=1)
    noise = plain.covariance - slope @ track.covariance @ slope.T
    # What is left is the process noise, up to terms of second order in the time.
    assert np.abs(noise - np.diag(np.diag(noise))).max() < 1e-4
    assert plain.covariance - plain.covariance.T == pytest.approx(0.0, abs=1e-12)


def test_a_stance_makes_the_sensor_roll_about_its_contact() -> None:
    track = start_track(np.array([0.0, 1.0, 0.0]), GRAVITY, np.array([0.3, -1.0, 0.5]))._replace(
        velocity=np.array([1.0, 0.2, -0.4])
    )
    arm = np.array([0.02, 0.1, 0.15])
    after = stood(track, arm, 1e-6)
    assert after.velocity == pytest.approx(after.turn @ np.cross(track.rate - after.bias, arm), abs=1e-3)
    assert np.linalg.eigvalsh(after.covariance).min() > -1e-12
    assert after.stood


def test_arms_lead_from_the_soles_to_the_sensor() -> None:
    body = average_body()
    placements = default_placements(imu_layout("right-hand", "left-foot"), body)
    (foot,) = foot_sensors(body, placements)
    assert (foot.sensor, foot.side) == (1, 0)
    frames = forward_kinematics(body, np.zeros(body.size))
    at, worn, points = body.index("leftFoot"), placements[1], sole_points(body, "left")
    place = frames.positions[at] + frames.rotations[at] @ worn.p_bone_sensor
    toes = body.index("leftToes")
    soles = [
        frames.positions[at] + frames.rotations[at] @ points.heel,
        frames.positions[toes] + frames.rotations[toes] @ points.toe,
    ]
    world = foot.arms @ (frames.rotations[at] @ worn.R_bone_sensor).T
    assert world == pytest.approx(place - np.stack(soles), abs=1e-9)


def run_figure(share: float, heard: bool = True) -> tuple[float, Stride]:
    """How far a figure's foot goes whose steps are a share of the wearer's, listening to the foot; and the rest."""
    body = average_body()
    (foot,) = foot_sensors(body, default_placements(imu_layout("right-foot"), body))
    turn = default_placements(imu_layout("right-foot"), body)[0].R_bone_sensor
    places, forces, rates, stands = strides(10)
    forces, rates, paid = forces @ turn, rates @ turn, 0.02
    stride, gone = no_stride(), np.zeros(2)
    for index in range(1, len(places)):
        said = np.concatenate([forces[index], rates[index]])
        standing = np.full(4, float(stands[index]))
        stride = sensed(stride, foot, said, np.array([heard]), standing, turn[1][None], 1 / RATE)
        moved = share * (places[index] - places[index - 1])[[0, 2]] + paid * missing_way((stride,))
        stride = shown(stride, foot, moved, 0.4, paid, 1 / RATE)
        gone = gone + moved
    return float(np.linalg.norm(gone)), stride


@pytest.mark.parametrize("share", [0.8, 1.0, 1.2])
def test_a_figure_goes_as_far_as_the_foot_did(share: float) -> None:
    # What is missing is forgotten within seconds, so that a fifth too short comes out a few hundredths short.
    assert run_figure(share)[0] == pytest.approx(10 * STEP, rel=0.05)


def test_a_figure_that_turns_away_is_turned_back() -> None:
    body = average_body()
    placements = default_placements(imu_layout("right-foot"), body)
    (foot,) = foot_sensors(body, placements)
    turn = placements[0].R_bone_sensor
    _, forces, rates, stands = strides(6)
    stride, heading, paid = no_stride(), -1.1, 0.02
    headings = []
    for force, rate, stand in zip(forces @ turn, rates @ turn, stands, strict=True):
        said = np.concatenate([force, rate])
        stride = sensed(stride, foot, said, np.array([True]), np.full(4, float(stand)), turn[1][None], 1 / RATE)
        heading += 0.002 + paid * missing_turn((stride,))
        stride = shown(stride, foot, np.zeros(2), heading, paid, 1 / RATE)
        headings.append(heading)
    # The wearer goes straight on, the figure would have turned by 70 degrees: it stays as at the first stance.
    assert 0.002 * len(headings) > 1.2
    assert np.abs(np.array(headings[100:]) + 1.1).max() < 0.3


def test_a_silent_foot_says_nothing() -> None:
    gone, stride = run_figure(0.8, heard=False)
    assert gone == pytest.approx(8 * STEP)
    assert stride.track is None
    assert missing_way(()) == pytest.approx(0.0)


@pytest.mark.parametrize(("kept", "share"), [(1.0, 0.95), (0.0, 0.02)])
def test_what_standing_feet_withhold_is_paid(kept: float, share: float) -> None:
    body = average_body()
    legs, q, standing = make_legs(body), np.zeros(body.size), np.ones(4)
    ground = start_ground(legs, q, standing)
    begin = ground.root
    for _ in range(300):
        ground, q = move(
            legs, ground, q, np.array([0.0, 0.005]), 1.0, standing, np.zeros(2), Footing(0.5, 0.04, 0.05, kept)
        )
    assert (ground.root - begin)[2] / (300 * 0.005) == pytest.approx(share, abs=0.05)
