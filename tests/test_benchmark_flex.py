"""The flex benchmark's parts: scores, intervals, comparators, tables, and the commands."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

pytest.importorskip("torch", reason="torch is not installed (extra `train`)")
pytest.importorskip("onnx", reason="onnx is not installed (extra `train`)")

from poseloom.benchmark.flex.comparators import lagged, mean_pose, nearest_windows, ridge
from poseloom.benchmark.flex.conditions import SPOILT, ageing_rows, fault_rows, replacement_rows
from poseloom.benchmark.flex.material import BY_SUBJECT, WITHIN, Material, part_of, person_of
from poseloom.benchmark.flex.page import flex_figures
from poseloom.benchmark.flex.picture import accuracy_and_jitter_svg
from poseloom.benchmark.flex.run import Plan, run_flex
from poseloom.benchmark.flex.scoring import PieceScore, jitter_of, pooled, score_pieces
from poseloom.benchmark.flex.tables import by_joint, by_motion, half_interval, motion_of, paired, summarised
from poseloom.benchmark.flex.trials import Effort, Trial, centred_median, fit_trial
from poseloom.cli._app import run
from poseloom.evaluation.rows import Results, Row, read_results, write_results
from poseloom.library import MotionLibrary, build_library, open_library
from poseloom.methods.flex.angles import ANGLES, FLEX_JOINTS, moving_angles
from poseloom.training.examples import Heard
from poseloom.training.fitting import FitSettings, draw_sets
from poseloom.training.sessions import chosen_clips, make_sessions, mean_angles
from poseloom.training.splits import Part, by_person, within_takes


def _score(errors: float, frames: int, jitter: float = 1.0, tags: tuple[str, ...] = ()) -> PieceScore:
    return PieceScore("who", "take", tags, frames, np.full(ANGLES, errors), jitter)


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Material:
    folder = tmp_path_factory.mktemp("library") / "samples"
    build_library(["samples"], folder, rate=50.0, workers=1)
    library: MotionLibrary = open_library(folder)
    clips = chosen_clips(library, lambda clip: clip.name.removeprefix("samples/") in ("walk", "run", "punch"))
    sessions = make_sessions(library, clips, mean_angles(library, clips), lambda clip: clip.name)
    names = [session.person for session in sessions]
    parts = {names[0]: Part.VALIDATE, names[-1]: Part.TEST}
    split = by_person(sessions, lambda person: parts.get(person, Part.TRAIN))
    sets = draw_sets(sessions, replace(FitSettings(), draws=2), 0)
    return Material(library, sessions, within_takes(sessions, 30, least=2), split, sets)


def test_means_count_frames_and_not_pieces() -> None:
    score = pooled([_score(2.0, 30, 10.0), _score(5.0, 10, float("nan"))])
    assert score.error == pytest.approx(2.75)
    assert score.moving == pytest.approx(2.75)
    assert score.jitter == pytest.approx(10.0)
    assert (score.sequences, score.frames) == (2, 40)
    uneven = np.zeros(ANGLES)
    uneven[moving_angles()] = 3.9
    assert pooled([PieceScore("who", "take", (), 5, uneven, 1.0)]).moving == pytest.approx(3.9)


def test_jitter_is_the_third_derivative() -> None:
    times = np.arange(60) / 50
    angles = np.zeros((60, ANGLES))
    angles[:, 4] = np.radians(7.0 * times**3)
    assert jitter_of(angles, 50.0) == pytest.approx(6 * 7.0 / ANGLES)
    assert np.isnan(jitter_of(angles[:3], 50.0))
    # A change of branch is no movement.
    turning = np.zeros((40, ANGLES))
    turning[:, 0] = np.linspace(2.9, 3.5, 40)
    wrapped = turning.copy()
    wrapped[wrapped > np.pi] -= 2 * np.pi
    assert jitter_of(wrapped, 50.0) == pytest.approx(jitter_of(turning, 50.0), abs=1e-3)


def test_intervals_are_students() -> None:
    for count in (2, 3, 5, 9):
        values = np.random.default_rng(count).normal(size=count)
        low, high = stats.t.interval(0.95, count - 1, loc=values.mean(), scale=stats.sem(values))
        assert half_interval(values.tolist()) == pytest.approx((high - low) / 2, rel=2e-3)
    assert np.isnan(half_interval([1.0]))


def test_pairs_are_differences_seed_by_seed() -> None:
    names = ("Bi-LSTM", "Bi-LSTM-C", "Bi-LSTM-M", "Bi-LSTM-CM", "Bi-LSTM-M, centred", "Bi-LSTM-CM, centred")
    found = {name: [[_score(5.0 + seed - 0.1 * place, 10)] for seed in range(3)] for place, name in enumerate(names)}
    rows = {(row.method, row.metric): row.value for row in paired(WITHIN, found)}
    assert rows["C", "error_less_deg"] == pytest.approx(0.1)
    # The seeds differ by whole degrees, the differences not at all.
    assert rows["C", "error_less_deg_ci95"] == pytest.approx(0.0, abs=1e-9)
    assert rows["M", "error_less_deg"] == pytest.approx(0.2)


def test_tables_group_by_motion_and_joint() -> None:
    found = {"x": [[_score(2.0, 10, tags=("walk",)), _score(4.0, 30, tags=("climb", "swing"))]]}
    motions = {row.setting: row.value for row in by_motion(WITHIN, found)}
    assert motions == pytest.approx({"walk": 2.0, "climb, swing (playground)": 4.0})
    joints = by_joint(WITHIN, found)
    assert [row.setting for row in joints] == list(FLEX_JOINTS)
    assert motion_of(("elbow", "knee")) == "elbow to knee"
    assert motion_of(("nonsense",)) == "other"


def test_people_are_on_one_side_each() -> None:
    assert part_of("hdm05:bd") is Part.TEST
    assert part_of("hdm05:bk") is Part.TRAIN
    assert part_of("cmu131") is Part.VALIDATE


def test_the_exponential_maps_are_one_person(material: Material) -> None:
    clip = replace(material.library.clips[0], subject="cmu_expmap:walking")
    assert person_of(clip) == "cmu_expmap"
    assert person_of(replace(clip, subject="cmu02")) == "cmu02"


def _heard(seed: int, frames: int = 80) -> Heard:
    generator = np.random.default_rng(seed)
    return Heard(
        generator.random((frames, 8)).astype(np.float32), generator.random((frames, ANGLES)).astype(np.float32), 0
    )


def test_the_nearest_window_of_what_was_learnt_is_itself() -> None:
    heard = _heard(0)
    told = nearest_windows([heard], (0, 1, 2), 1)(heard.inputs)
    np.testing.assert_allclose(told[::8], heard.angles[::8], atol=1e-6)


def test_ridge_is_least_squares_with_a_penalty() -> None:
    heard = _heard(1, 400)
    told = ridge([heard], (0, 2), 1e-9)(heard.inputs)
    design = np.column_stack([lagged(heard.inputs, (0, 2)), np.ones(400)]).astype(np.float64)
    kept = design[::8]
    weights = np.linalg.lstsq(kept, heard.angles[::8].astype(np.float64), rcond=None)[0]
    np.testing.assert_allclose(told, design @ weights, atol=1e-4)
    strong = ridge([heard], (0, 2), 1e9)(heard.inputs)
    assert np.abs(strong).max() < 0.01


def test_windows_end_now_and_repeat_the_first() -> None:
    inputs = np.arange(40, dtype=np.float32).reshape(5, 8)
    windows = lagged(inputs, (0, 2))
    np.testing.assert_array_equal(windows[0], [0, 1, 2, 3, 0, 1, 2, 3])
    np.testing.assert_array_equal(windows[4], [32, 33, 34, 35, 16, 17, 18, 19])


def test_the_centred_median_looks_one_ahead() -> None:
    told = np.random.default_rng(3).normal(size=(20, 2))
    filtered = centred_median(told)
    for frame in range(1, 19):
        np.testing.assert_array_equal(filtered[frame], np.median(told[frame - 1 : frame + 2], axis=0))


def test_a_teller_hears_a_piece_from_its_beginning(material: Material) -> None:
    lengths: list[int] = []

    def tell(inputs: np.ndarray) -> np.ndarray:
        lengths.append(len(inputs))
        return np.zeros((len(inputs), ANGLES))

    inputs = material.heard(1000, 5.0)
    pieces = material.within.test
    scores = score_pieces(material.sessions, pieces, inputs, tell)
    assert lengths == [piece.stop - piece.heard for piece in pieces]
    assert [score.frames for score in scores] == [len(piece) for piece in pieces]


def test_conditions_cover_ageing_faults_and_replacement(material: Material) -> None:
    mean = mean_pose([Heard(material.sets[0][1][0], material.sessions[0].angles, 0)])
    heard: list[np.ndarray] = []

    def tell(inputs: np.ndarray) -> np.ndarray:
        heard.append(inputs)
        return mean(inputs)

    aged = ageing_rows(material, BY_SUBJECT, {"mean pose": tell}, "range learnt on line")
    errors = [row.value for row in aged if row.metric == "error_deg"]
    assert len(errors) == 5
    assert np.ptp(errors) < 1e-9  # the mean pose hears nothing
    faults = fault_rows(material, BY_SUBJECT, {"mean pose": tell})
    assert [row.setting for row in faults] == ["none", *SPOILT]
    replaced = replacement_rows(material, BY_SUBJECT, {"mean pose": tell})
    ratios = [row.value for row in replaced if row.metric == "error_over_none"]
    assert ratios == pytest.approx([1.0] * len(ratios))
    assert ratios
    silent = [each for each in heard if (each[:, 4:] == 0).all(axis=0).any()]
    assert silent


def test_a_whole_run_at_a_tiny_size(material: Material, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poseloom.benchmark.flex.run.prepare", lambda *_: material)
    effort = Effort(epochs=1, stride=64, hidden=8, our_epochs=1, our_hidden=8)
    plan = Plan(tmp_path, tmp_path, {WITHIN: 1, BY_SUBJECT: 1}, 1, effort, lengths=(40,))
    done: list[str] = []
    results = run_flex(plan, lambda name, *_: done.append(name))
    tables = {row.table for row in results.rows}
    assert tables >= {"2", "3", "5", "6", "paired", "people", "ageing", "faults", "replaced", "speed", "other sensors"}
    write_results(results, tmp_path / "flex.json")
    page = flex_figures(results, "deadbeef")
    for name in ("Bi-LSTM-CM", "flex-scales", "nearest windows", "Transformer", "ridge"):
        assert f"| {name} |" in page
    # A second run goes on from the checkpoints: nothing is trained again.
    assert done
    done.clear()
    fit_trial(material, Trial("FCN", WITHIN), effort, tmp_path / "trials", lambda *_: done.append("again"))
    assert not done


def test_figures_and_picture(tmp_path: Path) -> None:
    found = {
        name: [[_score(5.0 + place + seed, 10, 1e4)] for seed in range(2)]
        for place, name in enumerate(
            (
                *("Bi-LSTM", "Bi-LSTM-C", "Bi-LSTM-M", "Bi-LSTM-CM", "Bi-LSTM-M, centred", "Bi-LSTM-CM, centred"),
                *("flex-scales", "nearest windows", "mean pose"),
            )
        )
    }
    rows = [row for split in (WITHIN, BY_SUBJECT) for row in summarised("5", split, found) + paired(split, found)]
    rows += by_joint(WITHIN, found) + by_motion(WITHIN, found)
    rows += [Row("speed", "flex-scales", "", "none", "step_ms_p99", 0.4)]
    rows += [Row("ageing", "flex-scales", f"on line, {m} minutes", WITHIN, "error_deg", 5.0) for m in (0, 60)]
    write_results(Results("flex", "abc", tuple(rows)), tmp_path / "flex.json")
    page = flex_figures(read_results(tmp_path / "flex.json"), "deadbeef")
    assert "| Bi-LSTM-CM | 4.51 / 2.45 |" in page
    assert "## Table 3" in page
    assert "nan" not in page
    picture = ElementTree.fromstring(accuracy_and_jitter_svg(rows))
    words = [each.text for each in picture.iter("{http://www.w3.org/2000/svg}text")]
    assert "flex-scales" in words


def test_trials_have_names_of_their_own() -> None:
    trials = [
        Trial("Bi-LSTM", WITHIN), Trial("Bi-LSTM", BY_SUBJECT), Trial("Bi-LSTM-C", WITHIN),
        Trial("Bi-LSTM", WITHIN, 1), Trial("Bi-LSTM", WITHIN, window=80), Trial("Bi-LSTM", WITHIN, hidden=512),
        Trial("Bi-LSTM", WITHIN, fixed=True),
    ]  # fmt: skip
    assert len({trial.name for trial in trials}) == len(trials)


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    build_library(["samples"], tmp_path / "library", rate=50.0, workers=1)
    model, out = tmp_path / "model.npz", tmp_path / "walk.bvh"
    fitted = ["fit", "flex-scales", "-l", str(tmp_path / "library"), "-o", str(model), "--epochs", "1", "--hidden", "8"]
    assert run(fitted) == 0
    assert "degrees on takes left out" in capsys.readouterr().out
    assert not (tmp_path / "model.checkpoint").exists()
    recording = tmp_path / "walk.mcap"
    assert run(["simulate", "sample:walk", "--layout", "flex-four", "-o", str(recording)]) == 0
    for with_model in ([], ["--model", str(model)]):
        assert run(["reconstruct", str(recording), "-m", "flex-scales", "-o", str(out), *with_model]) == 0
        assert out.is_file()
        out.unlink()
    assert run(["reconstruct", str(recording), "-m", "flex-lstm", "-o", str(out)]) == 2
    assert "poseloom fit flex-lstm" in capsys.readouterr().err
    assert run(["fit", "flex-lstm", "-l", str(tmp_path / "library"), "-o", str(tmp_path / "model.onnx")]) == 2
    assert run(["benchmark", "flex", "--data", str(tmp_path / "nowhere")]) == 2
