"""The loop over sequences and methods, what it leaves out of the library, and the command."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.cli._app import run
from poseloom.errors import PoseloomError
from poseloom.evaluation.cases import Case, Conditions, case_of_motion, read_cases
from poseloom.evaluation.experiment import evaluate_cases as evaluate
from poseloom.evaluation.metrics import evaluate_motion
from poseloom.evaluation.observed import Observed, _turned
from poseloom.evaluation.plan import Experiment
from poseloom.evaluation.request import evaluate as front_door
from poseloom.evaluation.rows import read_results
from poseloom.evaluation.splits import LeftOut, Split, allowed_poses, left_out, split_named
from poseloom.formats import write_motion
from poseloom.formats.recording import read_recording, write_recording
from poseloom.library import MotionLibrary, build_library, open_library
from poseloom.methods import InverseKinematics, choose, reconstruct
from poseloom.methods.imus.baselines.driving import save_comparator
from poseloom.methods.imus.baselines.fitting import fit_comparator
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.pairs import pair_of_recording
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, layout
from poseloom.skeleton.mirror import mirror_motion
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_imus, simulate_trackers

IK = "inverse-kinematics"
LOCAL = "local-regression"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    """The built-in motions, mirrored, and a walk of somebody else."""
    folder = tmp_path_factory.mktemp("evaluate")
    (folder / "other").mkdir()
    write_motion(slower(sample_motions()["punch"]), folder / "other" / "punching.bvh")
    build_library(["samples", folder / "other"], folder / "library", mirror=True, workers=1)
    return open_library(folder / "library")


def slower(motion: Motion) -> Motion:
    """The same poses at another pace and with one arm kept lower: nobody's copy."""
    q = motion.q.copy()
    q[:, 3:] *= np.linspace(0.4, 0.7, len(q))[:, None]
    return make_motion(motion.skeleton, q, 0.6 * motion.rate, "punching")


def short(name: str, seconds: float = 0.8) -> Motion:
    motion = sample_motions()[name]
    return motion.cut(0, round(seconds * motion.rate) + 1)


def short_case(library: MotionLibrary, name: str, conditions: Conditions, seconds: float = 0.8) -> Case:
    digest = library.clip(f"samples/{name}").digest
    return case_of_motion(short(name, seconds), conditions, name, digest)


def names(library: MotionLibrary, forbidden: LeftOut) -> set[str]:
    return {clip.name for clip in library.clips if clip.take in forbidden.takes}


def test_by_sequence_leaves_out_the_take_and_its_mirror_image_only(library: MotionLibrary) -> None:
    cases = read_cases(["sample:walk"], Conditions())
    (forbidden,) = left_out(library, cases, Split.BY_SEQUENCE)
    assert names(library, forbidden) == {"samples/walk", "samples/walk~mirror"}
    mask = allowed_poses(library, forbidden)
    assert mask is not None
    assert (~mask).sum() == forbidden.poses > 0
    for clip in library.clips:
        assert mask[clip.rows].all() != (clip.name in names(library, forbidden))


@pytest.mark.parametrize("suffix", [".bvh", ".npz"])
def test_a_copy_under_another_name_is_found(library: MotionLibrary, tmp_path: Path, suffix: str) -> None:
    """Mirrored, cut and written in another format: neither name nor digest tell where it comes from."""
    motion = mirror_motion(sample_motions()["run"])
    write_motion(motion.cut(30, 240), tmp_path / f"unknown{suffix}")
    (case,) = read_cases([str(tmp_path / f"unknown{suffix}")], Conditions())
    (forbidden,) = left_out(library, [case], Split.BY_SEQUENCE)
    assert names(library, forbidden) == {"samples/run", "samples/run~mirror"}


def test_by_subject_leaves_out_the_person(library: MotionLibrary) -> None:
    cases = read_cases(["sample:walk"], Conditions())
    (forbidden,) = left_out(library, cases, Split.BY_SUBJECT)
    assert names(library, forbidden) == {clip.name for clip in library.clips if clip.subject == "deepmimic"}
    assert forbidden.poses < len(library.poses)


def test_nothing_is_left_out_where_the_split_says_so_or_the_library_does_not_hold_it(library: MotionLibrary) -> None:
    case = case_of_motion(slower(sample_motions()["kick"]), Conditions())
    assert left_out(library, [case], Split.NONE) == (LeftOut(),)
    assert left_out(library, [case], Split.BY_SEQUENCE) == (LeftOut(),)
    assert allowed_poses(library, LeftOut()) is None


def test_what_is_too_short_to_be_known_again_is_refused(library: MotionLibrary) -> None:
    case = case_of_motion(short("walk"), Conditions(), "brief")
    with pytest.raises(PoseloomError, match="'brief' is too short to tell whether the library holds it"):
        left_out(library, [case], Split.BY_SEQUENCE)
    assert left_out(library, [case], Split.NONE) == (LeftOut(),)


def test_the_figures_say_what_they_are_of(library: MotionLibrary) -> None:
    conditions = Conditions(seed=5)
    cases = [short_case(library, name, conditions) for name in ("walk", "run")]
    told: list[tuple[str, int, int]] = []
    experiment = Experiment((LOCAL, IK), library.path, Split.BY_SEQUENCE, conditions)
    evaluation = evaluate(cases, experiment, lambda *step: told.append(step))
    assert told[-1] == ("evaluating", 4, 4)
    assert [sequence.name for sequence in evaluation.sequences] == ["walk", "run"]
    assert [result.name for result in evaluation.sequences[0].results] == [LOCAL, IK]
    assert all(entry.poses > 0 for entry in evaluation.left_out)
    rows = evaluation.results().rows
    angle = {row.method: row for row in rows if row.metric == "joint_angle_deg"}
    assert set(angle) == {LOCAL, IK}
    for row in angle.values():
        assert (row.table, row.split, row.sequences, row.seed) == ("evaluate", "by-sequence", 2, 5)
        assert row.setting == "six-trackers, 3 mm and 0.5°"
        assert row.frames == sum(len(sequence.truth) for sequence in evaluation.sequences)
        assert row.spread is not None
        assert 0 < row.value < 15
    facts = evaluation.facts()
    assert facts["seed"] == "5 to 6"
    assert facts["split"].startswith("by-sequence, ")
    assert f"{evaluation.frames} frames" in facts["data"]


def test_a_run_is_repeatable_in_any_number_of_processes(library: MotionLibrary) -> None:
    conditions = Conditions()
    cases = [short_case(library, name, conditions, 0.6) for name in ("walk", "jump")]
    found = [
        evaluate(cases, Experiment((LOCAL, IK), library.path, Split.BY_SEQUENCE, conditions, workers))
        for workers in (1, 2)
    ]
    assert found[0].data_digest == found[1].data_digest
    for one, two in zip(found[0].sequences, found[1].sequences, strict=True):
        for a, b in zip(one.results, two.results, strict=True):
            assert np.array_equal(a.motion.q, b.motion.q)
    other = evaluate(cases, Experiment((IK,), conditions=Conditions(seed=1)))
    same_method = found[0].sequences[0].results[1]
    assert not np.array_equal(other.sequences[0].results[0].motion.q, same_method.motion.q)


def test_the_truth_does_not_help_a_method() -> None:
    """The same recording with another truth beside it gives the same estimate."""
    conditions = Conditions()
    honest = case_of_motion(short("walk"), conditions, "walk")
    shifted = make_motion(honest.truth.skeleton, honest.truth.q + 0.3, honest.truth.rate)
    lying = Case("walk", shifted, honest.motion)
    first, second = (evaluate([case], Experiment((IK,))).sequences[0].results[0] for case in (honest, lying))
    assert np.array_equal(first.motion.q, second.motion.q)
    assert second.metrics["root_position_cm"] > first.metrics["root_position_cm"] + 20


def test_the_sensors_take_in_the_wearers_own_bones() -> None:
    motion = short("walk")
    tall = make_motion(
        motion.skeleton.with_offsets(1.15 * motion.skeleton.offsets, 1.15 * motion.skeleton.tips), motion.q, motion.rate
    )
    case = case_of_motion(tall, Conditions())
    assert np.allclose(case.truth.skeleton.offsets, tall.skeleton.offsets)


def test_what_cannot_be_evaluated_is_told(tmp_path: Path) -> None:
    with pytest.raises(PoseloomError, match="unknown split 'by-take'"):
        split_named("by-take")
    with pytest.raises(PoseloomError, match="nothing to evaluate"):
        evaluate([], Experiment((IK,)))
    with pytest.raises(PoseloomError, match="needs a motion library"):
        evaluate(read_cases(["sample:walk"], Conditions()), Experiment((LOCAL,)))
    with pytest.raises(PoseloomError, match="unknown sample motion 'wlak'"):
        read_cases(["sample:wlak"], Conditions())
    with pytest.raises(PoseloomError, match=r"lasts 0\.\d\d s"):
        case_of_motion(short("walk", 0.3), Conditions())
    recording = simulate_trackers(short("walk"), layout("six-trackers"))
    blind = recording.__class__(**{**vars(recording), "truth": None})
    write_recording(blind, tmp_path / "blind.mcap")
    with pytest.raises(PoseloomError, match="holds no truth"):
        read_cases([str(tmp_path / "blind.mcap")], Conditions())


# --- any sensors ------------------------------------------------------------------------------------------------------


def test_what_no_sensor_observes_is_not_measured() -> None:
    """Turned about the vertical and moved as a whole, an estimate of IMUs is as good as before; one of trackers not."""
    truth = case_of_motion(short("walk", 1.5), Conditions()).truth
    off = make_motion(truth.skeleton, truth.q + 0.02 * np.sin(np.arange(len(truth)))[:, None], truth.rate)
    moved = _turned(off, np.full(len(off), 2.0), about_origin=True)
    q = moved.q.copy()
    q[:, [0, 2]] += [3.0, -1.0]
    moved = make_motion(truth.skeleton, q, truth.rate)
    blind = Observed(heading=False, place=False)
    near, far = (evaluate_motion(truth, estimate, blind) for estimate in (off, moved))
    assert far == pytest.approx(near, rel=1e-6, abs=1e-6)
    assert near["root_position_cm"] < 10.0
    seen = evaluate_motion(truth, moved)
    assert seen["root_position_cm"] > 200.0
    assert seen["global_rotation_deg"] > 60.0 > far["global_rotation_deg"]
    # A heading that drifts is the path's error, not the pose's.
    drifting = _turned(off, np.linspace(0.0, 1.0, len(off)))
    assert evaluate_motion(truth, drifting, blind)["joint_position_cm"] == pytest.approx(
        near["joint_position_cm"], rel=0.05
    )


@pytest.mark.parametrize(("worn", "method"), [("flex-four+hips-imu", "flex-scales"), ("right-foot-imu", None)])
def test_every_layout_is_measured(worn: str, method: str | None, tmp_path: Path) -> None:
    model = ()
    if method is None:
        foot = layout(worn)
        walking = resample(sample_motions()["run"], foot.rate)
        pair = pair_of_recording(simulate_imus(walking, foot, seed=1), Behaviour.RUNNING, "run", "run")
        save_comparator(fit_comparator("nearest-window", [pair], foot), tmp_path / "model.npz")
        model = (tmp_path / "model.npz",)
    found = front_door(short("walk"), layout=worn, models=model)
    assert found.experiment.methods == (method or "nearest-window", "constant-pose")
    assert "heading removed" in found.facts()["not observed"]
    assert all(np.isfinite(result.metrics["joint_position_cm"]) for result in found.sequences[0].results)
    assert "fitted" in found.notes[0]


def test_channels_and_sensors_can_be_left_out() -> None:
    heard: list[Recording] = []

    class Ears(InverseKinematics):
        def step(self, state, sample):
            heard.append(sample)
            return super().step(state, sample)

    worn = layout("six-trackers")
    for channels, drop in (("position", ["head"]), ("orientation", []), ("both", ["leftHand", "rightHand"])):
        heard.clear()
        found = front_door(short("walk", 0.6), [Ears(worn), "constant-pose"], channels=channels, drop=drop)
        assert found.experiment.names == ("Ears", "constant-pose")
        places = [np.isfinite(sample.positions).all(axis=1) for sample in heard]
        turns = [np.isfinite(sample.quats_wxyz).all(axis=1) for sample in heard]
        kept = np.array([name not in drop for name in worn.names])
        assert (np.array(places) == (kept & (channels != "orientation"))).all()
        assert (np.array(turns) == (kept & (channels != "position"))).all()
        observed = found.sequences[0].results[0].observed
        assert (observed.heading, observed.place) == (True, channels != "orientation")
    with pytest.raises(PoseloomError, match="no trackers whose position"):
        front_door(short("walk"), layout="right-foot-imu", channels="position", methods="constant-pose")
    with pytest.raises(PoseloomError, match="Did you mean 'leftHand'"):
        front_door(short("walk"), IK, drop=["leftHnad"])


def test_a_recording_of_another_rate_is_measured_at_the_librarys(library: MotionLibrary) -> None:
    recording = simulate_trackers(short("walk", 1.2), replace(layout("six-trackers"), rate=60.0), seed=2)
    found = front_door(recording, [LOCAL, IK], library=library, split="none")
    assert found.sequences[0].truth.rate == 40.0
    assert {len(result.motion) for result in found.sequences[0].results} == {len(found.sequences[0].truth)}
    assert "60 samples a second" in found.notes[0]
    offline = reconstruct(choose(recording.layout, LOCAL, library=library).method, recording)
    assert np.array_equal(offline.motion.q, found.sequences[0].results[0].motion.q)


def test_the_person_of_a_recording_is_hidden_or_asked_for(library: MotionLibrary, tmp_path: Path) -> None:
    motion = slower(sample_motions()["kick"])
    recording = simulate_trackers(motion, layout("six-trackers"))
    with pytest.raises(PoseloomError, match="nobody says who moves"):
        front_door(recording, LOCAL, library=library, split="by-subject")
    told = front_door(recording, LOCAL, library=library, split="by-subject", subject="other", stop=1.3)
    assert names(library, told.left_out[0]) == {c.name for c in library.clips if c.subject == "other"}
    knowing = replace(recording, settings={**recording.settings, "subject": "deepmimic"})
    write_recording(knowing, tmp_path / "a.mcap")
    (case,) = read_cases([str(tmp_path)], Conditions())
    assert case.subject == "deepmimic"
    assert run(["simulate", "sample:walk", "-o", str(tmp_path / "b.mcap"), "--stop", "0.6"]) == 0
    assert read_recording(tmp_path / "b.mcap").settings["subject"] == "deepmimic"


def test_parts_and_what_is_too_short(library: MotionLibrary, tmp_path: Path) -> None:
    recording = simulate_trackers(short("walk", 1.5), layout("six-trackers"))
    write_recording(recording, tmp_path / "walk.mcap")
    write_recording(recording.cut(0, 8), tmp_path / "brief.mcap")
    write_recording(replace(recording, truth=None), tmp_path / "blind.mcap")
    write_motion(short("run", 1.5), tmp_path / "run.npz")
    found = front_door(tmp_path, IK, start=0.5, stop=1.25)
    assert [len(sequence.truth) for sequence in found.sequences] == [31, 31]
    assert len(found.skipped) == 2
    assert any("brief.mcap" in text for text in found.skipped)
    assert any("blind.mcap" in text and "no truth" in text for text in found.skipped)
    np.testing.assert_array_equal(found.sequences[0].truth.q, recording.truth.q[20:51])
    given = [short("walk", 0.8), sample_motions()["kick"].cut(0, 90)]
    found = front_door(given, LOCAL, library=library)
    assert [sequence.name for sequence in found.sequences] == [given[1].name]
    assert "too short to tell" in found.skipped[0]
    with pytest.raises(PoseloomError, match="no sequence is left"):
        front_door(tmp_path, IK, start=30.0)


def test_six_methods_fit_on_a_narrow_terminal(
    library: MotionLibrary, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    methods = ("local-filter", "local-gaussian", LOCAL, "nearest-example", IK, "constant-pose")
    options = ["-l", str(library.path), "--stop", "0.55", "--workers", "1", "--json", str(tmp_path / "rows.json")]
    code = run(["evaluate", "sample:walk", "sample:run", *options, *(f"--method={name}" for name in methods)])
    assert code == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    for name in methods:  # never broken, never cut: the three blocks each have a line of it
        assert sum(line.split()[:1] == [name] for line in lines) == 3
    assert not any("…" in line for line in lines)
    content = json.loads((tmp_path / "rows.json").read_text(encoding="utf-8"))
    assert [sequence["name"] for sequence in content["sequences"]] == ["walk", "run"]
    assert set(content["sequences"][1]["methods"]) == set(methods)
    means = {(row["method"], row["metric"]): row["value"] for row in content["rows"]}
    for name in methods:
        each = [sequence["methods"][name]["sip_deg"] for sequence in content["sequences"]]
        assert np.mean(each) == pytest.approx(means[name, "sip_deg"])
    assert read_results(tmp_path / "rows.json").sequences[0].frames == 23


# --- the command -----------------------------------------------------------------------------------------------------


def test_the_command_leaves_rows_and_a_report(
    library: MotionLibrary, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = simulate_trackers(short("jump", 1.1), layout("six-trackers"), seed=3)
    write_recording(recording, tmp_path / "jump.mcap")
    write_motion(short("punch", 1.1), tmp_path / "punch.bvh")
    given = [str(tmp_path / "jump.mcap"), str(tmp_path / "punch.bvh")]
    outputs = ["--json", str(tmp_path / "rows.json"), "--report", str(tmp_path / "report.html")]
    methods = ["-m", LOCAL, "-m", IK]
    code = run(["evaluate", *given, *methods, "-l", str(library.path), *outputs, "--workers", "1", "--seed", "9"])
    told = capsys.readouterr().out
    assert code == 0
    assert "2 sequences" in told
    assert "by-sequence" in told
    assert "9 to 10" in told
    assert "joint angle" in told
    content = json.loads((tmp_path / "rows.json").read_text(encoding="utf-8"))
    assert content["benchmark"] == "evaluate"
    assert {row["method"] for row in content["rows"]} == {LOCAL, IK}
    assert {"joint_angle_deg", "joint_position_cm", "foot_skate_cm_s", "step_ms_p99", "look_ahead_ms"} <= {
        row["metric"] for row in content["rows"]
    }
    assert all(row["sequences"] == 2 and row["seed"] == 9 for row in content["rows"] if row["metric"] == "sip_deg")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "by-sequence" in page
    assert "No truth enters a method" in page


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["sample:walk", "-m", "no-such-method"], "unknown method 'no-such-method'"),
        (["sample:walk", "-m", IK, "--split", "random"], "unknown split 'random'"),
        (["sample:walk", "-m", LOCAL], "needs a motion library"),
        (["sample:walk", "-m", LOCAL, "-l", "no-library-here"], "no such folder"),
        (["nothing-here.bvh", "-m", IK], "nothing-here.bvh"),
        (["sample:walk", "-m", IK, "--json", "no-folder/rows.json"], "folder does not exist"),
        (["sample:walk", "-m", IK, "--layout", "seven-trackers"], "seven-trackers"),
    ],
)
def test_the_command_refuses_with_a_reason(
    arguments: list[str], told: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["evaluate", *arguments]) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
