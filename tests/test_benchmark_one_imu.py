"""The one-IMU benchmark: its sequences never mix, its measures mean what they say, its page shows its rows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.benchmark.one_imu import measures
from poseloom.benchmark.one_imu.accuracy import pooled_mean, rows_of
from poseloom.benchmark.one_imu.page import one_imu_figures
from poseloom.benchmark.one_imu.plan import FOOT, METHODS, OURS, Plan
from poseloom.benchmark.one_imu.run import run_one_imu
from poseloom.benchmark.one_imu.sequences import BEHAVIOURS, FOLDS, Pool, Take, behaviour_of, read_pool
from poseloom.benchmark.one_imu.splices import splice
from poseloom.benchmark.one_imu.sweep import SPACES, TRIALS, settings_to_try
from poseloom.benchmark.one_imu.trials import Answer
from poseloom.benchmark.six_trackers.sequences import motions_folder
from poseloom.errors import PoseloomError
from poseloom.evaluation.rows import Results, Row
from poseloom.methods import METHODS as NAMED
from poseloom.methods.imus.baselines.fitting import COMPARATORS
from poseloom.methods.imus.settings import PhaseHmmSettings
from poseloom.report.one_imu import placements_svg
from poseloom.rotations import heading_matrix, matrix_from_rotvec, rotvec_from_matrix
from poseloom.samples import sample_motions
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import resample


def walk() -> Motion:
    return resample(sample_motions()["walk"], 60.0)


def moved(motion: Motion, turn: float, way: tuple[float, float]) -> Motion:
    q, rotation = np.array(motion.q), heading_matrix(np.array(turn))
    q[:, :3] = q[:, :3] @ rotation.T + [way[0], 0, way[1]]
    q[:, 3:6] = rotvec_from_matrix(rotation @ matrix_from_rotvec(q[:, 3:6]))
    return make_motion(motion.skeleton, q, motion.rate)


def take(name: str, behaviour: str = "walking", person: str = "a", of: str = "") -> Take:
    return Take(name, behaviour, of or name, person, walk())


@pytest.fixture(scope="module")
def pool() -> Pool:
    tables = tuple(take(f"t{i}", person="ab"[i % 2]) for i in range(6))
    rest = tuple(take(f"r{i}") for i in range(3))
    validation = tuple(take(f"v{i}", person="c") for i in range(4))
    return Pool((*tables, *rest, *validation), tables, (take("x"),), validation)


def test_place_and_heading_do_not_count_in_a_pose() -> None:
    truth = walk()
    assert measures.pose_errors_cm(truth, moved(truth, 1.3, (4, -2))).max() < 1e-6
    bent = np.array(truth.q)
    bent[:, 3 + 3 * truth.skeleton.index("leftLowerArm")] += 0.5
    error = measures.pose_errors_cm(truth, replace(truth, q=bent))
    frames, others = motion_frames(truth).positions, motion_frames(replace(truth, q=bent)).positions
    expected = 100 * np.linalg.norm(frames - others, axis=-1).sum(axis=1) / (len(truth.skeleton) - 2)
    np.testing.assert_allclose(error, expected, rtol=1e-9)


def test_ways_begin_at_one_place_with_one_heading() -> None:
    truth = walk()
    assert measures.path_errors_m(truth, moved(truth, -2.0, (1, 1))).max() < 1e-9
    slow = np.array(truth.q)
    slow[:, [0, 2]] *= 0.9
    end = np.linalg.norm(truth.q[-1, [0, 2]] - truth.q[0, [0, 2]])
    np.testing.assert_allclose(measures.path_errors_m(truth, replace(truth, q=slow))[-1], 0.1 * end, rtol=1e-6)
    assert measures.way_m(truth) == pytest.approx(end, rel=0.15)


def test_a_way_is_turned_so_that_it_fits_best() -> None:
    truth = walk()
    turned = np.array(truth.q)
    turned[:, [0, 2]] = turned[:, [0, 2]] @ heading_matrix(np.array(0.2))[np.ix_([0, 2], [0, 2])]
    turned[:, [0, 2]] *= 0.9
    estimate = replace(truth, q=turned)
    assert measures.path_errors_m(truth, estimate)[-1] > 0.15 * measures.way_m(truth)
    found = measures.turned_path_errors_m(truth, estimate)
    ways = [np.asarray(measures.facing_start(each).q[:, [0, 2]]) for each in (truth, estimate)]
    # Brute force over the turn; the best fits the whole way, not its end.
    fits = []
    for angle in np.linspace(-0.5, 0.5, 2001):
        c, s = np.cos(angle), np.sin(angle)
        fits.append(np.linalg.norm(ways[0] - ways[1] @ np.array([[c, s], [-s, c]]), axis=1))
    best = min(fits, key=lambda errors: float((errors**2).sum()))
    np.testing.assert_allclose(found, best, atol=1e-3)


def test_a_jump_is_found_where_it_is() -> None:
    truth = walk()
    q = np.array(truth.q)
    q[20:, 3 + 3 * truth.skeleton.index("leftUpperLeg")] += 0.3
    jumped = replace(truth, q=q)
    assert measures.largest_jump_cm(truth, jumped, 10, 30) > 5
    assert measures.largest_jump_cm(truth, jumped, 0, 20) < 1e-9
    assert measures.largest_velocity_jump_m_s(jumped, 10, 30) > measures.largest_velocity_jump_m_s(truth, 10, 30) + 1


def test_the_truth_s_own_figures() -> None:
    truth = walk()
    standing = measures.standing_soles(truth)
    assert standing.any()
    assert 0 < measures.foot_skate_cm_s(truth, standing) < 40
    assert np.isnan(measures.foot_skate_cm_s(truth, np.zeros_like(standing)))
    assert measures.jitter_km_s3(truth) > 0


def test_spliced_motions_go_on_smoothly() -> None:
    first, second = walk(), resample(sample_motions()["run"], 60.0)
    made = splice(first, second, 0.4, 0.3)
    speed = np.linalg.norm(np.diff(made.motion.q[:, :3], axis=0), axis=1)
    plain = max(np.linalg.norm(np.diff(m.q[:, :3], axis=0), axis=1).max() for m in (first, second))
    assert speed.max() < 1.5 * plain
    assert 0 < made.change < len(made.motion)
    start = made.change - round(first.rate / 3) // 2
    np.testing.assert_allclose(
        np.diff(made.motion.q[:start, 6:], axis=0)[0], np.diff(first.q[:, 6:], axis=0)[0 : len(first)][
            np.abs(first.q[:-1, 6:] - made.motion.q[0, 6:]).sum(axis=1).argmin()
        ], atol=1e-9,
    )  # fmt: skip


def test_what_is_asked_never_trains(pool: Pool) -> None:
    assert len(pool.folds) == FOLDS
    assert sorted(t.source for fold in pool.folds for t in fold) == sorted([f"t{i}" for i in range(6)] + ["x"])
    for fold in pool.folds:
        assert not {t.take for t in fold} & {t.take for t in pool.without(fold)}
    people = {t.person for t in pool.without(pool.tables[:1], by_subject=True)}
    assert people == {"b", "c"}
    assert pool.is_covered(pool.tables[0])
    assert not pool.is_covered(pool.validation[0])


def test_files_have_one_behaviour() -> None:
    assert behaviour_of("cmu_expmap/train/running/running_3.txt") == "running"
    assert behaviour_of("hdm05/HDM_bd_hopBothLegs1hops_001_120") == "hopping"
    assert behaviour_of("bandai/walk") is None


def test_the_sequences_of_the_recordings(recordings: Path) -> None:
    read = read_pool(motions_folder(recordings))
    tabled, chosen = {t.take for t in (*read.tables, *read.transitions)}, {t.take for t in read.validation}
    assert not tabled & chosen
    assert len({t.take for t in read.takes}) == len(read.takes)
    assert {t.behaviour for t in read.tables} == set(BEHAVIOURS) == {t.behaviour for t in read.validation}
    walks = {t.source: t for t in (*read.takes, *read.tables)}
    # walking_1 is CMU's 02_01, which must not train beside it under its other name.
    assert walks["cmu_expmap/train/walking/walking_1"].take not in {
        t.take for t in read.without(read.fold_of(walks["cmu_expmap/train/walking/walking_1"]))
    }
    assert "cmu_asfamc/02/02_01" not in walks


def answers() -> list[Answer]:
    return [
        Answer("a", "walking", np.array([1.0, 3.0]), 2.0, 10.0, 5.0, 0.1, 0.04, 1.9, 2.0, np.ones(2)),
        Answer("b", "walking", np.array([5.0] * 6), 4.0, float("nan"), float("nan"), 0.1, 0.1, 0.5, 0.5, np.ones(6)),
    ]


def test_means_are_over_frames_and_undefined_figures_are_left_out() -> None:
    assert pooled_mean(answers()) == pytest.approx(34 / 8)
    rows = {row.metric: row for row in rows_of(Plan(Path()), "3", OURS, "x", "by-sequence", answers())}
    assert rows["joint_position_cm"].value == pytest.approx(34 / 8)
    assert rows["joint_position_cm_of_sequences"].value == pytest.approx(3.5)
    assert rows["foot_skate_over_truth"].value == pytest.approx(2.0)
    assert rows["path_error_percent"].value == pytest.approx(5.0)
    assert rows["turned_path_error_percent"].value == pytest.approx(2.0)
    assert rows["way_length_error_percent"].value == pytest.approx(5.0)
    assert rows["joint_position_cm_first_two_seconds"].value == pytest.approx(34 / 8)
    assert "joint_position_cm_after_half_a_second" not in rows  # neither sequence is that long
    assert pooled_mean(answers(), 1, 3) == pytest.approx(13 / 3)
    assert rows["jitter_over_truth"].value == pytest.approx(3.0)


def test_the_page_and_the_picture_show_the_rows() -> None:
    rows = [
        Row("3", OURS, f"{FOOT}, joint, all, covered", "by-sequence", "joint_position_cm", 3.21, 0.5, 4, 100, 0),
        Row("10", OURS, "hips-imu, joint, walking, covered", "by-sequence", "joint_position_cm", 4.44, 0.5, 4, 100, 0),
        Row("10", OURS, "hips-imu, joint, all, covered", "by-sequence", "joint_position_cm", 5.55, 0.5, 4, 100, 0),
        Row("2", OURS, "W, 500 frames", "none", "step_ms_p99", 0.77, None, 4, 100, 0),
        Row("drop-outs", OURS, f"{FOOT}, all silent", "by-sequence", "worst_jump_cm", 9.87, None, 4, 0, 0),
        *(
            Row("tried", OURS, f"blend {blend}", "by-sequence", metric, 5.0 + blend, None, 4, 100, 0)
            for blend in (0.6, 0.3)
            for metric in (
                "mean_over_behaviours_cm",
                "one_sensor_cm",
                "two_sensors_cm",
                "joint_position_cm",
                "jitter_over_truth",
            )
        ),
    ]
    page = one_imu_figures(Results("one-imu", "d" * 64, tuple(rows)), "abc")
    for figure in ("3.21 ± 0.50", "*4.53*", "4.44 ± 0.50", "0.77", "9.87", "| 1 | blend 0.3 | 5.30", "commit `abc`"):
        assert figure in page
    svg = placements_svg(rows)
    assert svg.startswith("<svg")
    assert ">4.4<" in svg


def test_every_method_is_searched_alike() -> None:
    assert set(SPACES) == set(METHODS) - {"phase-hmm-paper"}
    for method, space in SPACES.items():
        tried = settings_to_try(method)
        assert len(tried) == TRIALS
        assert tried[0] == {name: values[0] for name, values in space.items()}
        assert all(tried.count(each) == 1 for each in tried)
        assert all(each[name] in values for each in tried for name, values in space.items())
        assert tried == settings_to_try(method)
        present = PhaseHmmSettings() if method == OURS else COMPARATORS[method].settings
        assert {name: getattr(present, name) for name in space} in tried


def test_methods_are_known_and_unknown_parts_refused() -> None:
    assert set(METHODS) <= set(NAMED)
    with pytest.raises(PoseloomError, match="drop"):
        run_one_imu(Plan(Path(), parts=("drop",)))
