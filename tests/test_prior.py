"""The learnt prior at run time: what it receives, what it gives, its file, and what a calibration pose teaches it."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.errors import FormatError, MethodError, PoseloomError
from poseloom.evaluation.sparse_inertial import sparse_inertial_measures
from poseloom.methods.prior.calibration import PriorCalibration, known_rotations, measured_residuals
from poseloom.methods.prior.channels import (
    ANY,
    OUTPUT_SIZE,
    SIX,
    SIX_BONES,
    CalibrationPose,
    Channel,
    InputSpec,
    body_sizes,
    likeness,
)
from poseloom.methods.prior.intake import PriorIntake
from poseloom.methods.prior.model_file import read_prior, shipped_prior, write_prior
from poseloom.methods.prior.network import PriorNetwork, rotations_from_columns
from poseloom.methods.prior.running import PriorRunner
from poseloom.rotations import matrix_from_rotvec, quat_from_matrix, rotvec_from_matrix
from poseloom.sensors.layout import SensorKind, SensorSpec, make_layout
from poseloom.sensors.placement import default_placements
from poseloom.sensors.sample import Sample
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.kinematics import forward_kinematics

SIX_LAYOUT = make_layout("six", [SensorSpec(bone, SensorKind.IMU, bone) for bone in SIX_BONES], 40.0)


def random_network(spec: InputSpec = SIX, hidden: int = 16, seed: int = 0) -> PriorNetwork:
    """A network of random weights."""
    generator = np.random.default_rng(seed)

    def draw(*shape: int) -> np.ndarray:
        return generator.normal(size=shape).astype(np.float32) / math.sqrt(shape[-1])

    weights = {
        "encode.weight": draw(hidden, spec.size), "encode.bias": draw(hidden),
        "head.weight": draw(OUTPUT_SIZE, hidden), "head.bias": draw(OUTPUT_SIZE),
    }  # fmt: skip
    for layer in range(2):
        weights |= {f"memory.weight_{which}_l{layer}": draw(3 * hidden, hidden) for which in ("ih", "hh")}
        weights |= {f"memory.bias_{which}_l{layer}": draw(3 * hidden) for which in ("ih", "hh")}
    return PriorNetwork(spec, weights)


def resting_sample(rotations: np.ndarray, layout=SIX_LAYOUT, missing: tuple[str, ...] = ()) -> Sample:
    """What IMUs whose axes are their bones' give while the body rests with these world rotations."""
    count = len(layout)
    bones = [BODY_BONES.index(sensor.bone) for sensor in layout.sensors]
    axes = rotations[bones]
    quats = quat_from_matrix(axes)
    forces = 9.80665 * axes[:, 1, :]
    gone = [sensor.bone in missing for sensor in layout.sensors]
    quats[gone] = np.nan
    forces[gone] = np.nan
    return Sample(
        0.0, 0.0, np.full((count, 3), np.nan), quats, forces, np.zeros((count, 3)), np.full(count, np.nan),
        np.zeros(count, dtype=np.int64),
    )  # fmt: skip


def random_rotations(seed: int) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=average_body().size) * 0.4
    return forward_kinematics(average_body(), q).rotations


def turned_about_vertical(sample: Sample, angle: float) -> Sample:
    turn = matrix_from_rotvec(np.array([0.0, angle, 0.0]))
    from poseloom.rotations import matrix_from_quat

    return replace(sample, quats_wxyz=quat_from_matrix(turn @ matrix_from_quat(sample.quats_wxyz)))


def test_inputs_do_not_depend_on_the_heading_and_rest_reads_no_acceleration() -> None:
    body = average_body()
    intake = PriorIntake(SIX, SIX_LAYOUT, body, default_placements(SIX_LAYOUT, body))
    sample = resting_sample(random_rotations(1))
    _, taken = intake.take(intake.start(), sample)
    _, turned = intake.take(intake.start(), turned_about_vertical(sample, 2.0))
    np.testing.assert_allclose(taken.inputs, turned.inputs, atol=1e-9)
    assert len(taken.inputs) == SIX.size
    per_bone = taken.inputs[: 16 * 6].reshape(6, 16)
    np.testing.assert_allclose(per_bone[:, 7:10], 0.0, atol=1e-9)
    np.testing.assert_array_equal(per_bone[:, 10], 1.0)
    np.testing.assert_array_equal(per_bone[:, 15], [1, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(taken.inputs[96:99], taken.axes.T @ [0, 1, 0], atol=1e-12)


def test_each_bone_follows_the_likest_measured_one_as_last_measured() -> None:
    body = average_body()
    intake = PriorIntake(SIX, SIX_LAYOUT, body, default_placements(SIX_LAYOUT, body))
    first, second = random_rotations(1), random_rotations(2)
    state, _ = intake.take(intake.start(), resting_sample(first))
    _, taken = intake.take(state, resting_sample(second, missing=("leftLowerArm",)))
    back = second[0].T
    expected = {"leftHand": first, "leftLowerArm": first, "rightHand": second, "chest": second, "leftFoot": second}
    sources = {"leftHand": "leftLowerArm", "leftLowerArm": "leftLowerArm", "rightHand": "rightLowerArm",
               "chest": "hips", "leftFoot": "leftLowerLeg"}  # fmt: skip
    for bone, world in expected.items():
        made = taken.base[BODY_BONES.index(bone)]
        np.testing.assert_allclose(made, back @ world[BODY_BONES.index(sources[bone])], atol=1e-12)
    assert not taken.measured[BODY_BONES.index("leftLowerArm"), Channel.ROTATION]


def test_a_lost_reference_holds_and_is_replaced_after_two_seconds() -> None:
    body = average_body()
    intake = PriorIntake(SIX, SIX_LAYOUT, body, default_placements(SIX_LAYOUT, body))
    state, first = intake.take(intake.start(), resting_sample(random_rotations(1)))
    without = resting_sample(random_rotations(2), missing=("hips",))
    switches = []
    for _ in range(100):
        state, taken = intake.take(state, without)
        switches.append(taken.switched)
        if not any(switches):
            np.testing.assert_array_equal(taken.axes, first.axes)
    assert switches.index(True) == 80
    assert sum(switches) == 1
    assert state.reference == "head"


def test_positions_count_from_the_anchor_and_its_height() -> None:
    bones = ("head", "leftHand", "rightHand")
    layout = make_layout("three", [SensorSpec(bone, SensorKind.TRACKER, bone) for bone in bones], 40.0)
    body = average_body()
    placements = default_placements(layout, body)
    intake = PriorIntake(ANY, layout, body, placements)
    sample = resting_sample(np.tile(np.eye(3), (22, 1, 1)), layout)
    places = np.array([[1.0, 1.7, 2.0], [1.7, 1.4, 2.0], [0.3, 1.4, 2.0]])
    _, taken = intake.take(intake.start(), replace(sample, positions=places))
    size = (len(taken.inputs) - 3 - 8 - 3) // 22
    rows = taken.inputs[: 22 * size].reshape(22, size)[[BODY_BONES.index(bone) for bone in bones]]
    np.testing.assert_allclose(rows[:, 15:18], [[0, 1.7, 0], [0.7, -0.3, 0], [-0.7, -0.3, 0]], atol=1e-12)


@pytest.mark.parametrize("missing", [SIX_BONES, ("hips",), ()])
def test_samples_without_anything_still_give_finite_rotations(missing: tuple[str, ...]) -> None:
    body = average_body()
    runner = PriorRunner(random_network(), SIX_LAYOUT, body, default_placements(SIX_LAYOUT, body))
    state = runner.start()
    for seed in range(3):
        state, estimate = runner.step(state, resting_sample(random_rotations(seed), missing=missing))
    turns = estimate.rotations
    np.testing.assert_allclose(turns @ turns.swapaxes(-1, -2), np.tile(np.eye(3), (22, 1, 1)), atol=1e-6)
    assert np.isfinite(estimate.sigma).all()
    assert (estimate.sigma > 0).all()
    assert ((estimate.contacts >= 0) & (estimate.contacts <= 1)).all()


def test_a_step_changes_neither_argument() -> None:
    body = average_body()
    runner = PriorRunner(random_network(), SIX_LAYOUT, body, default_placements(SIX_LAYOUT, body))
    state, _ = runner.step(runner.start(), resting_sample(random_rotations(1)))
    before = state.memory.copy(), state.intake.rotations.copy()
    runner.step(state, resting_sample(random_rotations(2)))
    np.testing.assert_array_equal(state.memory, before[0])
    np.testing.assert_array_equal(state.intake.rotations, before[1])


def test_the_figure_turns_with_the_wearer() -> None:
    body = average_body()
    runner = PriorRunner(random_network(), SIX_LAYOUT, body, default_placements(SIX_LAYOUT, body))
    sample = resting_sample(random_rotations(1))
    _, straight = runner.step(runner.start(), sample)
    _, turned = runner.step(runner.start(), turned_about_vertical(sample, 1.0))
    turn = matrix_from_rotvec(np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(turned.rotations, turn @ straight.rotations, atol=1e-5)
    np.testing.assert_allclose(turned.velocity, turn @ straight.velocity, atol=1e-5)


@pytest.mark.parametrize("pose", [CalibrationPose.T, CalibrationPose.N])
def test_a_calibration_pose_shows_how_sensors_are_turned(pose: CalibrationPose) -> None:
    turns = {bone: np.array([0.05, 0.1 * (1 - 2 * (i % 2)), 0.08]) for i, bone in enumerate(SIX_BONES)}
    facing = matrix_from_rotvec(np.array([0.0, 0.7, 0.0]))
    bones = [BODY_BONES.index(bone) for bone in SIX_BONES]
    held = facing @ known_rotations(pose)[bones] @ matrix_from_rotvec(np.stack(list(turns.values())))
    residuals, heading = measured_residuals(SIX_BONES, np.tile(held, (5, 1, 1, 1)), pose)
    assert heading == pytest.approx(0.7, abs=0.06)
    assert np.isnan(residuals[BODY_BONES.index("chest")]).all()
    # What is left beyond the sensors' turns is one common heading.
    back = matrix_from_rotvec(np.array([0.0, 0.7 - heading, 0.0]))
    expected = rotvec_from_matrix(known_rotations(pose)[bones].swapaxes(-1, -2) @ back @ facing.T @ held)
    np.testing.assert_allclose(residuals[bones], expected, atol=1e-9)


def test_half_of_the_networks_own_error_at_the_pose_is_taken_out() -> None:
    body = average_body()
    placements = default_placements(SIX_LAYOUT, body)
    plain = PriorRunner(random_network(), SIX_LAYOUT, body, placements)
    samples = [resting_sample(known_rotations(CalibrationPose.N))] * 20
    whole = plain.calibrated(samples, CalibrationPose.N, share=1.0)
    half = plain.calibrated(samples, CalibrationPose.N, share=0.5)
    still = whole.still_estimate(samples[0]).rotations
    np.testing.assert_allclose(still, known_rotations(CalibrationPose.N), atol=1e-5)
    shown = PriorRunner(
        plain.network, SIX_LAYOUT, body, placements, PriorCalibration(CalibrationPose.N, half.calibration.residuals)
    )
    own = np.linalg.norm(
        rotvec_from_matrix(shown.still_estimate(samples[0]).rotations.swapaxes(-1, -2) @ still), axis=-1
    )
    left = np.linalg.norm(
        rotvec_from_matrix(half.still_estimate(samples[0]).rotations.swapaxes(-1, -2) @ still), axis=-1
    )
    assert own.max() > 0.1
    usual = plain.calibrated(samples, CalibrationPose.N)
    np.testing.assert_allclose(usual.calibration.corrections, np.tile(np.eye(3), (22, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(left, own / 2, atol=1e-4)


def test_a_pose_without_orientations_and_a_wrong_rate_are_refused() -> None:
    body = average_body()
    placements = default_placements(SIX_LAYOUT, body)
    runner = PriorRunner(random_network(), SIX_LAYOUT, body, placements)
    empty = resting_sample(random_rotations(1), missing=SIX_BONES)
    with pytest.raises(MethodError, match="no orientation was measured"):
        runner.calibrated([empty], CalibrationPose.T)
    with pytest.raises(MethodError, match="no calibration pose is named"):
        runner.calibrated([resting_sample(random_rotations(1))], CalibrationPose.NONE)
    with pytest.raises(MethodError, match="60 samples a second"):
        PriorIntake(SIX, make_layout("six", SIX_LAYOUT.sensors, 60.0), body, placements)
    flex = make_layout("feet", [SensorSpec("toe", SensorKind.IMU, "leftToes")], 40.0)
    with pytest.raises(MethodError, match="receives none of the sensors"):
        PriorIntake(SIX, flex, body, default_placements(flex, body))
    with pytest.raises(MethodError, match="at most once"):
        InputSpec(("hips", "hips"), (Channel.ROTATION,))


def test_a_file_gives_the_network_back_in_half_precision(tmp_path: Path) -> None:
    network = random_network()
    named = PriorNetwork(SIX, network.weights, np.linspace(0.5, 2, 22), {"minutes": 3.5, "people": {"cmu01": 2.0}})
    path = tmp_path / "prior.npz"
    write_prior(named, path, seed=4)
    back = read_prior(path)
    assert back.spec == SIX
    assert json.loads(json.dumps(dict(back.card))) == {"minutes": 3.5, "people": {"cmu01": 2.0}}
    np.testing.assert_array_equal(back.sigma_factors, np.linspace(0.5, 2, 22))
    inputs = np.random.default_rng(0).normal(size=SIX.size)
    base = np.tile(np.eye(3), (22, 1, 1))
    _, given = back.step(back.start(), inputs, base)
    _, kept = named.step(named.start(), inputs, base)
    np.testing.assert_allclose(given.rotations, kept.rotations, atol=5e-3)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(FormatError):
        read_prior(path)


@pytest.mark.parametrize("fault", ["missing", "shape", "infinite", "sigma", "unknown"])
def test_weights_that_do_not_fit_are_refused(fault: str) -> None:
    weights = dict(random_network().weights)
    sigma = np.ones(22)
    if fault == "missing":
        del weights["memory.bias_hh_l1"]
    elif fault == "shape":
        weights["head.weight"] = weights["head.weight"][:-1]
    elif fault == "infinite":
        weights["encode.bias"] = np.full(16, np.inf, dtype=np.float32)
    elif fault == "sigma":
        sigma[3] = 0.0
    else:
        weights["extra"] = np.zeros(3, dtype=np.float32)
    with pytest.raises(FormatError, match="no prior network"):
        PriorNetwork(SIX, weights, sigma)


def test_an_unknown_shipped_network_is_named() -> None:
    with pytest.raises(PoseloomError, match="Valid names: six, any"):
        shipped_prior("seven")


def test_gram_schmidt_gives_rotations_back() -> None:
    rotations = random_rotations(3)
    columns = rotations[:, :, :2].swapaxes(1, 2)
    np.testing.assert_allclose(rotations_from_columns(2.5 * columns), rotations, atol=1e-7)


def test_likeness_prefers_what_turns_least_between() -> None:
    unlike = likeness()
    order = {bone: np.argsort(unlike[i]) for i, bone in enumerate(BODY_BONES)}
    assert [BODY_BONES[i] for i in order["leftFoot"][:3]] == ["leftFoot", "leftLowerLeg", "leftToes"]
    assert BODY_BONES[order["chest"][0]] == "chest"
    np.testing.assert_allclose(np.round(unlike, 1), np.round(unlike, 1).T)


def test_body_sizes_are_shares_of_the_average() -> None:
    body = average_body()
    np.testing.assert_allclose(body_sizes(body), 0.0, atol=1e-12)
    np.testing.assert_allclose(body_sizes(body.with_offsets(1.1 * body.offsets)), 1.0, atol=1e-9)


def test_the_fields_measures_see_what_they_define() -> None:
    body = average_body()
    truth = random_rotations(5)[None]
    turn = matrix_from_rotvec(np.array([0.0, math.radians(30.0), 0.0]))
    whole = sparse_inertial_measures(truth, turn @ truth)
    assert max(whole.sip_deg[0], whole.angle_deg[0], whole.position_cm[0]) < 1e-4
    upper = BODY_BONES.index("leftUpperArm")
    bent = truth.copy()
    bent[:, upper] = truth[:, upper] @ matrix_from_rotvec(np.array([0.0, 0.0, math.radians(12.0)]))
    measures = sparse_inertial_measures(truth, bent)
    assert measures.sip_deg[0] == pytest.approx(3.0)
    assert measures.angle_deg[0] == pytest.approx(12 / 24)
    chord = 2 * math.sin(math.radians(6.0)) * float(np.linalg.norm(body.offsets[BODY_BONES.index("leftLowerArm")]))
    # Elbow, wrist and hand move by the same chord.
    assert measures.position_cm[0] == pytest.approx(100 * 3 * chord / 24)
    hand = truth.copy()
    hand[:, BODY_BONES.index("leftHand")] = np.eye(3)
    assert sparse_inertial_measures(truth, hand).angle_deg[0] == pytest.approx(0.0, abs=1e-4)
