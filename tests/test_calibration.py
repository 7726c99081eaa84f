"""Calibration: solver and Jacobians against scipy and finite differences, sizes, sessions and their verdicts."""

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from typer.testing import CliRunner

from poseloom.calibration.body_size import (
    body_size_from_json,
    body_size_model,
    body_size_to_json,
    fit_body_size,
    size_vectors,
)
from poseloom.calibration.calibration import Level, apply_calibration, read_calibration, write_calibration
from poseloom.calibration.fit import fit_calibration, without_lever_bias
from poseloom.calibration.holds import match_in_order, pose_costs, still_readings
from poseloom.calibration.poses import guided_pose, guided_poses, sole_heights
from poseloom.calibration.problem import CalibrationProblem
from poseloom.calibration.screening import expected_positions
from poseloom.calibration.session import ROUNDS_SETTING, calibrate
from poseloom.calibration.size_sources import distinct_bodies, read_asf_size, read_cmu_sizes, thorax_ratio
from poseloom.calibration.soles import sole_model
from poseloom.calibration.unknowns import CalibrationSettings, CalibrationState, HeldPoses
from poseloom.cli._app import build_app
from poseloom.errors import FormatError, PoseloomError, SensorError, SkeletonError
from poseloom.formats.recording import write_recording
from poseloom.report.calibration import write_calibration_report
from poseloom.report.guide import write_guide
from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix
from poseloom.sensors import Recording, default_placements, layout, make_layout
from poseloom.skeleton.body import average_body
from poseloom.skeleton.contacts import sole_positions
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve.least_squares import LeastSquaresSettings, Linearisation, Residuals, minimise
from poseloom.synthesis import NO_NOISE, Fault, FaultKind, TrackerNoise, simulate_trackers, true_placements
from poseloom.synthesis.holding import HoldingStyle, hold_poses, hold_times, simulate_session

SIX = layout("six-trackers")
POSES = np.stack([pose.q for pose in guided_poses()])
EXACT = HoldingStyle(pose_rad=0.0, heading_rad=0.2, sway_rad=0.0)


def person(seed: int) -> Skeleton:
    model = body_size_model()
    return model.body_of(np.random.default_rng(seed).normal(size=model.size))


def session(seed: int, poses: np.ndarray = POSES, faults: Sequence[Fault] = (), rounds: int = 1) -> Recording:
    asked = np.concatenate([poses] * rounds)
    return simulate_session(person(seed), asked, SIX, faults=faults, seed=seed, settings={ROUNDS_SETTING: str(rounds)})


def small_problem(rng: np.random.Generator, holds: int = 3) -> tuple[CalibrationProblem, CalibrationState]:
    """A problem far from its solution, with a silent sensor in one hold."""
    model, body = body_size_model().cut(4), average_body()
    guided = POSES[:holds]
    positions = rng.normal(size=(holds, 6, 3))
    rotations = matrix_from_rotvec(rng.normal(size=(holds, 6, 3)))
    positions[1, 2], rotations[1, 2] = np.nan, np.nan
    usual = default_placements(SIX, body)
    offsets = np.stack([each.p_bone_sensor for each in usual])
    bones = np.array([body.index(each.bone) for each in usual])
    held = HeldPoses(guided, positions, rotations)
    problem = CalibrationProblem(model, sole_model(model), held, bones, offsets, CalibrationSettings())
    state = CalibrationState(
        rng.normal(size=4),
        matrix_from_rotvec(rng.normal(size=(6, 3))),
        offsets + 0.05 * rng.normal(size=(6, 3)),
        guided + 0.1 * rng.normal(size=guided.shape),
    )
    return problem, state


class TestSolver:
    def test_jacobians_are_the_finite_differences(self):
        rng = np.random.default_rng(3)
        problem, state = small_problem(rng)
        linear = problem.linearise(state)
        shared, own = rng.normal(size=linear.by_shared.shape[-1]), rng.normal(size=state.q.shape)
        step = 1e-6
        ends = [problem.linearise(problem.move(state, s * shared, s * own)).residuals for s in (step, -step)]
        numeric = (ends[0].blocks - ends[1].blocks) / (2 * step)
        analytic = linear.by_shared @ shared + np.einsum("hgad,hd->hga", linear.by_own, own)
        came = problem.present
        assert not came.all()
        assert np.allclose(numeric[came], analytic[came], atol=1e-5 * np.abs(numeric).max())
        rows, turns = (ends[0].shared - ends[1].shared) / (2 * step), slice(4, 4 + 3 * 6)
        told = linear.shared_by_shared @ shared
        told[turns] = 0.0  # any turn of a sensor is as likely as any other; the rows only bound the steps
        assert np.allclose(rows, told, atol=1e-6)

    def test_the_minimum_is_scipys(self):
        problem = CurveProblem()
        found = minimise(problem, problem.start(), LeastSquaresSettings(iterations=200, tolerance=1e-14))
        start = np.concatenate([problem.start()[0], problem.start()[1].reshape(-1)])
        oracle = least_squares(problem.flat, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert found.converged
        assert np.allclose(found.state[0], oracle.x[:2], atol=1e-6)
        covariance = np.linalg.inv(oracle.jac.T @ oracle.jac)[:2, :2]
        assert np.allclose(found.covariance, covariance, rtol=1e-4)

    def test_a_robust_group_counts_as_its_lorentzian(self):
        problem = CurveProblem(scale=1.5)
        found = minimise(problem, problem.start(), LeastSquaresSettings(iterations=300, tolerance=1e-14))
        start = np.concatenate([problem.start()[0], problem.start()[1].reshape(-1)])
        oracle = least_squares(problem.flat_robust, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert found.cost == pytest.approx(oracle.cost, rel=1e-6)

    def test_a_problem_that_is_not_finite_is_refused(self):
        problem = CurveProblem()
        shared, own = problem.start()
        with pytest.raises(PoseloomError, match="cannot start"):
            minimise(problem, (shared * np.nan, own))


class CurveProblem:
    """Blocks with an own rate each share an amplitude and a level: y_b(t) = level + amplitude exp(-rate_b t)."""

    def __init__(self, scale: float = np.inf) -> None:
        rng = np.random.default_rng(1)
        self.times = np.linspace(0, 2, 12).reshape(4, 3)
        rates = np.array([0.5, 1.0, 2.0])
        self.data = 0.3 + 2.0 * np.exp(-rates[:, None, None] * self.times) + 0.05 * rng.normal(size=(3, 4, 3))
        self.data[1, 2] += 3.0
        self.scale = scale

    present = np.ones((3, 4), dtype=np.bool_)

    @property
    def robust_scales(self) -> np.ndarray:
        return np.full(4, self.scale)

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.0, 1.0]), np.ones((3, 1))

    def linearise(self, state: tuple[np.ndarray, np.ndarray]) -> Linearisation:
        (level, amplitude), rates = state
        decay = np.exp(-rates[:, :, None] * self.times)
        blocks = (self.data - level - amplitude * decay) / 0.05
        by_shared = np.stack([-np.ones_like(decay), -decay], axis=-1) / 0.05
        by_own = (amplitude * self.times * decay)[..., None] / 0.05
        return Linearisation(Residuals(blocks, state[0] - 1.0), by_shared, by_own, np.eye(2))

    def move(self, state: tuple[np.ndarray, np.ndarray], shared: np.ndarray, own: np.ndarray):
        return state[0] + shared, state[1] + own

    def flat(self, x: np.ndarray) -> np.ndarray:
        residuals = self.linearise((x[:2], x[2:, None])).residuals
        return np.concatenate([residuals.blocks.reshape(-1), residuals.shared])

    def flat_robust(self, x: np.ndarray) -> np.ndarray:
        residuals = self.linearise((x[:2], x[2:, None])).residuals
        halves = 0.5 * (residuals.blocks**2).sum(axis=-1).reshape(-1)
        return np.concatenate([np.sqrt(2 * self.scale**2 * np.log1p(halves / self.scale**2)), residuals.shared])


@pytest.fixture
def sizes(recordings: Path) -> Path:
    """The table of CMU's skeletons, in the folder of real recordings."""
    table = recordings / "sizes" / "cmu_skeletons.csv"
    if not table.is_file():
        pytest.skip(f"no {table}: put the folder sizes/ of the recordings there")
    return table


class TestBodySize:
    def test_coefficients_and_bodies_are_inverse(self):
        model = body_size_model()
        coefficients = np.random.default_rng(0).normal(size=model.size)
        assert np.allclose(model.coefficients_of(model.body_of(coefficients)), coefficients, atol=1e-9)

    def test_the_mean_is_the_average_body_to_within_millimetres(self):
        model = body_size_model()
        mean = model.body_of(np.zeros(model.size))
        assert np.abs(mean.offsets - average_body().offsets).max() < 5e-3

    def test_a_fit_finds_the_directions_that_made_the_bodies(self):
        model, rng = body_size_model().cut(2), np.random.default_rng(5)
        fitted = fit_body_size([model.body_of(rng.uniform(-1, 1, 2)) for _ in range(50)])
        assert fitted.size == 2
        apart = size_vectors(model.body_of(np.array([1.0, -1.0]))) - fitted.mean
        basis = fitted.components.reshape(2, -1)
        rest = apart.reshape(-1) - basis.T @ np.linalg.lstsq(basis.T, apart.reshape(-1), rcond=None)[0]
        assert np.abs(rest).max() < 1e-9

    def test_one_mismeasured_bone_hardly_moves_the_mean(self):
        model, rng = body_size_model(), np.random.default_rng(6)
        bodies = [model.body_of(rng.normal(size=model.size)) for _ in range(40)]
        offsets = bodies[0].offsets.copy()
        offsets[average_body().index("leftLowerLeg")] *= 3.0
        clean, spoilt = fit_body_size(bodies), fit_body_size([bodies[0].with_offsets(offsets), *bodies[1:]])
        assert np.abs(clean.mean - spoilt.mean).max() < 2e-3

    def test_the_file_keeps_the_model(self):
        model = body_size_model()
        again = body_size_from_json(body_size_to_json(model))
        assert np.abs(again.components - model.components).max() < 1e-5
        assert "NSF EIA-0196217" in again.source

    @pytest.mark.parametrize("text", ["", "{}", '{"mean": 3}', "[]"])
    def test_a_file_that_is_none_is_refused(self, text: str):
        with pytest.raises(SkeletonError, match="no body-size model"):
            body_size_from_json(text)

    def test_too_few_bodies_and_components_are_refused(self):
        with pytest.raises(SkeletonError, match="how people differ"):
            fit_body_size([average_body()])
        with pytest.raises(SkeletonError, match="no 99 components"):
            body_size_model().cut(99)

    def test_a_table_with_a_broken_line_is_refused(self, tmp_path: Path):
        table = tmp_path / "sizes.csv"
        table.write_text("subject,clip,joint,x,y,z\n1,01_01,LeftLeg,1,2\n")
        with pytest.raises(FormatError, match=r"sizes\.csv:2"):
            read_cmu_sizes(table)
        table.write_text("subject,clip,joint,x,y,z\n1,01_01,LeftLeg,1,2,3\n")
        with pytest.raises(FormatError, match="lacks"):
            read_cmu_sizes(table)

    def test_real_skeletons_agree_between_table_and_asf(self, recordings: Path, sizes: Path):
        asf = {path.stem: read_asf_size(path) for path in sorted(recordings.glob("mocap/cmu_asfamc/*/*.asf"))}
        ratio = thorax_ratio(asf.values())
        assert ratio == pytest.approx(1.014, abs=0.002)
        bodies = read_cmu_sizes(sizes, ratio)
        assert (len(bodies), len(distinct_bodies(bodies.values()))) == (43, 41)
        for name, body in asf.items():
            apart = np.linalg.norm(size_vectors(body)[0] - size_vectors(bodies[str(int(name))])[0], axis=1)
            assert apart.max() < 5e-3

    def test_the_shipped_model_is_what_its_command_makes(self, recordings: Path, sizes: Path, tmp_path: Path):
        files = sorted(recordings.glob("mocap/cmu_asfamc/*/*.asf"))
        out = tmp_path / "size.json"
        arguments = [str(sizes), *map(str, files), "-o", str(out)]
        assert CliRunner().invoke(build_app(), ["fit", "body-size", *arguments]).exit_code == 0
        made, shipped = body_size_from_json(out.read_text()), body_size_model()
        assert np.abs(made.mean - shipped.mean).max() < 2e-5
        assert np.allclose(np.abs(made.components), np.abs(shipped.components), atol=5e-5)


class TestPosesAndHolds:
    def test_guided_poses_stand_on_the_floor(self):
        assert len({pose.name for pose in guided_poses()}) == 8
        for pose in guided_poses():
            assert sole_heights(average_body(), pose.q).min() == pytest.approx(0.0, abs=1e-12)
        with pytest.raises(PoseloomError, match="Did you mean 'squat'"):
            guided_pose("squad")

    def test_a_held_motion_is_as_inexact_as_asked_and_stands_on_the_floor(self):
        style = HoldingStyle(sway_rad=0.0, heading_rad=0.0, hold_s=0.1, move_s=0.1)
        motion = hold_poses(average_body(), np.zeros((200, 69)), style, seed=1)
        angles = motion.q[::8, 3 + 3 * average_body().index("leftUpperArm")]
        assert np.degrees(angles.std()) == pytest.approx(7.0, rel=0.15)
        assert np.abs(motion.q[:, 3 + 3 * average_body().index("leftLowerLeg") + 1]).max() == 0
        assert np.abs(sole_positions(motion)[..., 1].min(axis=1)).max() < 1e-9
        with pytest.raises(SensorError, match="pose_rad"):
            hold_poses(average_body(), POSES, HoldingStyle(pose_rad=-1.0))

    def test_still_moments_are_the_holds(self):
        recording = session(1)
        found = still_readings(recording).windows
        for window, (begin, end) in zip(found, hold_times(8, HoldingStyle()), strict=True):
            assert begin - 0.1 < recording.times[window.start]
            assert recording.times[window.stop - 1] < end + 0.1

    def test_costs_do_not_see_place_and_heading(self):
        expected = expected_positions(SIX, guided_poses())
        turn = matrix_from_rotvec(np.array([0.0, 2.0, 0.0]))
        costs = pose_costs(expected @ turn.T + np.array([3.0, 0.5, -1.0]), expected)[0]
        assert np.abs(np.diag(costs)).max() < 1e-12
        assert (costs + np.eye(8)).min() > 1e-3

    def test_matching_keeps_the_order_and_leaves_out_what_does_not_fit(self):
        costs = np.full((4, 3), 0.5)
        costs[0, 0] = costs[2, 1] = costs[3, 2] = 0.0
        found, _ = match_in_order(costs)
        assert found.tolist() == [0, 2, 3]
        found, _ = match_in_order(costs[[0, 3]])
        assert found.tolist() == [0, -1, 1]


class TestFit:
    def test_exactly_held_poses_give_placements_and_lengths(self):
        body = person(4)
        recording = simulate_session(body, POSES, SIX, TrackerNoise(1e-4, 1e-4), style=EXACT, seed=4)
        found = calibrate(recording, CalibrationSettings(pose_rad=np.radians(0.5), offset_m=0.5))
        for placement, true in zip(found.placements, true_placements(recording), strict=True):
            turn = rotvec_from_matrix(placement.R_bone_sensor.T @ true.R_bone_sensor)
            assert np.degrees(np.linalg.norm(turn)) < 0.5
        arm = average_body().index("leftLowerArm")
        assert found.lengths[arm] == pytest.approx(np.linalg.norm(body.offsets[arm]), rel=0.02)

    def test_badly_held_poses_give_better_sizes_than_the_average_body(self):
        apart: list[float] = []
        usual: list[float] = []
        bones = [average_body().index(f"left{b}") for b in ("LowerLeg", "Foot", "UpperArm", "LowerArm", "Hand")]
        for seed in range(2):
            recording = session(seed, rounds=3)
            found = calibrate(recording)
            assert recording.truth is not None
            true = np.linalg.norm(recording.truth.skeleton.offsets[bones], axis=1)
            apart.append(float(np.abs(found.lengths[bones] / true - 1).mean()))
            usual.append(float(np.abs(np.linalg.norm(average_body().offsets[bones], axis=1) / true - 1).mean()))
            places = zip(found.placements, true_placements(recording), strict=True)
            assert np.mean([np.linalg.norm(a.p_bone_sensor - b.p_bone_sensor) for a, b in places]) < 0.02
            assert [verdict.level for verdict in found.verdicts] == [Level.GOOD]
        assert np.mean(apart) < 0.025
        assert np.mean(apart) < 0.7 * np.mean(usual)

    def test_integrating_the_poses_out_shortens_levers(self):
        """At the joint minimum the neck comes out too long, for a long lever explains the same readings by less."""
        recording = simulate_session(average_body(), np.concatenate([POSES] * 2), SIX, seed=1)
        still = still_readings(recording)
        held = HeldPoses(np.concatenate([POSES] * 2), still.positions, still.rotations)
        fit = fit_calibration(body_size_model(), SIX, held)
        neck = average_body().index("head")
        joint, marginal = (
            np.linalg.norm(fit.problem.model.body_of(each.minimum.state.coefficients).offsets[neck])
            for each in (fit, without_lever_bias(fit))
        )
        assert marginal < 0.99 * joint


def exchanged(recording: Recording, order: list[int]) -> Recording:
    return replace(recording, positions=recording.positions[:, order], quats_wxyz=recording.quats_wxyz[:, order])


def worn_elsewhere(sensor: str, bone: str, seed: int) -> Recording:
    """A session with one sensor on another bone than its layout says."""
    sensors = [replace(each, bone=bone) if each.name == sensor else each for each in SIX.sensors]
    motion = hold_poses(person(seed), POSES, seed=seed)
    recording = simulate_trackers(motion, make_layout("mistaken", sensors, SIX.rate), TrackerNoise(), seed=seed)
    return replace(recording, layout=SIX, placements=default_placements(SIX, average_body()))


class TestVerdicts:
    @pytest.fixture(autouse=True)
    def without_the_last_step(self, monkeypatch: pytest.MonkeyPatch):
        """Verdicts are found before the poses are integrated out, which would take most of the time."""
        monkeypatch.setattr("poseloom.calibration.session.without_lever_bias", lambda fit: fit)

    @pytest.mark.parametrize("seed", range(100, 120))
    def test_a_clean_session_is_good(self, seed: int):
        assert [verdict.topic for verdict in calibrate(session(seed)).verdicts] == ["good"]

    @pytest.mark.parametrize("pair", [(0, 1), (0, 4), (1, 3), (2, 3), (2, 4), (3, 4), (4, 5)])
    def test_exchanged_trackers_are_named(self, pair: tuple[int, int]):
        order = list(range(6))
        order[pair[0]], order[pair[1]] = order[pair[1]], order[pair[0]]
        names = [SIX.names[place] for place in pair]
        with pytest.raises(SensorError, match=f"trackers '{names[0]}' and '{names[1]}' are exchanged"):
            calibrate(exchanged(session(21), order))

    @pytest.mark.parametrize(
        ("sensor", "bone"),
        [
            ("leftHand", "leftLowerArm"),
            ("rightAnkle", "rightFoot"),
            ("upperChest", "hips"),
            ("head", "upperChest"),
        ],
    )
    def test_a_tracker_on_another_bone_is_named(self, sensor: str, bone: str):
        with pytest.raises(SensorError, match=f"'{sensor}' moves as if it sat on {bone}"):
            calibrate(worn_elsewhere(sensor, bone, 11))

    @pytest.mark.parametrize(("factor", "unit"), [(1000, "millimetres"), (100, "centimetres"), (39.37, "inches")])
    def test_another_unit_is_named(self, factor: float, unit: str):
        recording = session(22)
        with pytest.raises(SensorError, match=f"seem to be in {unit}"):
            calibrate(replace(recording, positions=recording.positions * factor))

    @pytest.mark.parametrize(
        ("turn", "words"),
        [
            ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], r"along \+Z"),
            ([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], r"along \+X"),
            ([[1, 0, 0], [0, -1, 0], [0, 0, -1]], "along -Y"),
            ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], "left-handed"),
        ],
    )
    def test_other_axes_are_named(self, turn: list[list[int]], words: str):
        recording = session(23)
        with pytest.raises(SensorError, match=words):
            calibrate(replace(recording, positions=recording.positions @ np.array(turn, dtype=float).T))

    @pytest.mark.parametrize(("asked", "held"), [(4, 0), (2, 5), (6, 0)])
    def test_another_pose_than_asked_is_named_and_left_out(self, asked: int, held: int):
        poses = POSES.copy()
        poses[asked] = POSES[held]
        found = calibrate(session(24, poses))
        assert [verdict.topic for verdict in found.verdicts] == ["missed"]
        assert guided_poses()[asked].title in found.verdicts[0].fact
        assert guided_poses()[held].title in found.verdicts[0].cause
        assert guided_poses()[asked].name not in found.poses

    def test_a_pose_that_was_left_out_is_named(self):
        found = calibrate(session(25, np.delete(POSES, 3, axis=0)), rounds=1)
        assert guided_poses()[3].title in found.verdicts[0].fact
        assert "left out" in found.verdicts[0].cause

    def test_poses_out_of_order_are_named(self):
        found = calibrate(session(26, POSES[[0, 1, 3, 2, 4, 5, 6, 7]]))
        told = " ".join(str(verdict) for verdict in found.verdicts)
        assert {verdict.topic for verdict in found.verdicts} == {"missed"}
        assert "Left heel up" in told or "Right heel up" in told

    @pytest.mark.parametrize(("kind", "word"), [(FaultKind.SILENT, "silent"), (FaultKind.STUCK, "stuck")])
    def test_a_dead_tracker_is_named_and_done_without(self, kind: FaultKind, word: str):
        found = calibrate(session(27, faults=[Fault("rightHand", 0.0, 1e3, kind)]))
        assert [verdict.topic for verdict in found.verdicts] == [word]
        assert "'rightHand'" in found.verdicts[0].fact
        assert np.isnan(found.residuals[:, 3]).all()

    def test_too_little_stillness_is_told(self):
        restless = simulate_session(person(1), POSES, SIX, style=HoldingStyle(hold_s=0.3), seed=1)
        with pytest.raises(SensorError, match="still moments"):
            calibrate(restless)

    def test_dead_trackers_all_over_are_told(self):
        # Without noise every reading of a hold is the same: no living tracker does that.
        frozen = simulate_session(person(1), POSES, SIX, NO_NOISE, style=EXACT, seed=1)
        with pytest.raises(SensorError, match="too few trackers say anything"):
            calibrate(frozen)

    def test_other_sensors_are_refused(self):
        recording = session(2)
        flex = replace(recording, layout=layout("flex-four"))
        with pytest.raises(SensorError, match="no trackers"):
            calibrate(flex)


class TestFilesAndCommands:
    def test_a_calibration_survives_its_file_and_is_applied(self, tmp_path: Path):
        recording = session(31)
        found = calibrate(recording)
        write_calibration(found, tmp_path / "me.cal")
        again = read_calibration(tmp_path / "me.cal")
        assert again.verdicts == found.verdicts
        assert np.array_equal(again.residuals, found.residuals, equal_nan=True)
        used = apply_calibration(recording, again)
        assert np.array_equal(used.skeleton.offsets, found.skeleton.offsets)
        assert used.placements[2].p_bone_sensor == pytest.approx(found.placements[2].p_bone_sensor)
        (tmp_path / "bad.cal").write_bytes(b"nothing")
        with pytest.raises(FormatError):
            read_calibration(tmp_path / "bad.cal")

    def test_a_calibration_without_the_recordings_sensor_is_refused(self):
        recording = session(32)
        found = calibrate(recording)
        with pytest.raises(SensorError, match="no sensor 'head'"):
            apply_calibration(recording, replace(found, sensors=("hat", *found.sensors[1:])))
        moved = (replace(found.placements[0], bone="neck"), *found.placements[1:])
        with pytest.raises(SensorError, match="on head in the recording, on neck"):
            apply_calibration(recording, replace(found, placements=moved))

    def test_the_commands_lead_from_a_simulated_session_to_a_report(self, tmp_path: Path):
        app, runner = build_app(), CliRunner()
        recording, out, page = tmp_path / "s.mcap", tmp_path / "s.cal", tmp_path / "s.html"
        made = runner.invoke(app, ["simulate-calibration", "-o", str(recording), "--rounds", "1", "--seed", "5"])
        assert made.exit_code == 0, made.output
        done = runner.invoke(app, ["calibrate", str(recording), "-o", str(out), "--report", str(page)])
        assert done.exit_code == 0, done.output
        assert "good:" in done.output
        assert "upper arm" in page.read_text()
        assert len(read_calibration(out).poses) == 8

    def test_an_unusable_session_leaves_no_file(self, tmp_path: Path):
        recording = tmp_path / "s.mcap"
        write_recording(exchanged(session(33), [0, 1, 3, 2, 4, 5]), recording)
        result = CliRunner().invoke(build_app(), ["calibrate", str(recording), "-o", str(tmp_path / "s.cal")])
        assert isinstance(result.exception, SensorError)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["s.mcap"]

    def test_the_report_escapes_and_shows_warnings(self, tmp_path: Path):
        found = calibrate(session(34, faults=[Fault("head", 0.0, 1e3)]))
        write_calibration_report(tmp_path / "r.html", found, "<me>")
        text = (tmp_path / "r.html").read_text()
        assert "&lt;me&gt;" in text
        assert "is silent" in text

    def test_the_guide_needs_no_network_and_runs_in_a_browser(self, tmp_path: Path):
        page = tmp_path / "guide.html"
        write_guide(page, rounds=2)
        text = page.read_text()
        assert "http" not in text.replace("http://www.w3.org", "").replace("http-equiv", "")
        for pose in guided_poses():
            assert pose.title in text
        with pytest.raises(PoseloomError, match="cannot be guided"):
            write_guide(page, rounds=99)
        chromium = shutil.which("chromium")
        if chromium is None:
            return
        flags = ["--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"]
        flags += ["--disable-component-update", "--disable-sync", f"--user-data-dir={tmp_path / 'profile'}"]
        dump = [chromium, *flags, "--virtual-time-budget=2000", "--dump-dom", page.as_uri()]
        shown = subprocess.run(dump, capture_output=True, text=True, timeout=60, check=False)
        if shown.returncode == 0:
            assert "press Start" in shown.stdout
            assert shown.stdout.count("<li") == 8
