"""Motion libraries: what goes in comes out, nothing is dropped in silence, damage is named, masks hide whole takes."""

import dataclasses
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import typer

from poseloom.cli import _app, libraries
from poseloom.errors import LibraryError
from poseloom.formats import write_motion
from poseloom.formats.artefact_arrays import ArtefactArrays
from poseloom.library import MotionLibrary, SkipKind, add_to_library, build_library, open_library, store
from poseloom.library import index as index_module
from poseloom.library.build import six_trackers
from poseloom.library.catalogue import CATALOGUE_FILE
from poseloom.library.features import FeatureSettings
from poseloom.library.folders import writing
from poseloom.library.moments import moments_folder
from poseloom.library.poses import POSES_FILE
from poseloom.library.similar import similar_poses
from poseloom.samples import sample_motions
from poseloom.skeleton.body import average_body
from poseloom.skeleton.mirror import mirror_motion
from poseloom.skeleton.motion import make_motion
from poseloom.skeleton.resample import resample

NAMES = ("walk", "kick", "spin")


def put(folder: Path, *names: str) -> Path:
    """A folder with sample motions as files."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        write_motion(sample_motions()[name], folder / f"{name}.npz")
    return folder


def generation(folder: Path) -> Path:
    """Where the files of a library are."""
    return folder / store.read_header(folder).generation


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def moves(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return put(tmp_path_factory.mktemp("sources") / "moves", *NAMES)


@pytest.fixture(scope="module")
def built(moves: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library with mirror images. Not to be changed."""
    folder = tmp_path_factory.mktemp("built") / "library"
    build_library([moves], folder, mirror=True, workers=1)
    return folder


@pytest.fixture
def mine(built: Path, tmp_path: Path) -> Path:
    """A copy of the library, to be changed."""
    return Path(shutil.copytree(built, tmp_path / "library"))


# What goes in comes out


def test_poses_are_the_motions_on_the_body_at_the_rate_and_their_mirror_images(built: Path) -> None:
    library = open_library(built)
    assert library.rate == 40
    assert library.skeleton is average_body()
    assert [clip.name for clip in library.clips] == [
        f"moves/{name}{mark}" for name in sorted(NAMES) for mark in ("", "~mirror")
    ]
    row = 0
    for clip in library.clips:
        sample = resample(sample_motions()[Path(clip.source).stem], 40.0)
        wanted = mirror_motion(sample).q if clip.mirrored else sample.q
        assert (clip.start, len(clip)) == (row, len(wanted))
        # The floor is found again, so only the height may move, and by little.
        np.testing.assert_allclose(library.poses[clip.rows], wanted, atol=2e-3)
        np.testing.assert_allclose(library.motion(clip).q, library.poses[clip.rows])
        row = clip.stop
    assert len(library) == row
    with pytest.raises(ValueError, match="read-only"):
        library.poses[0] = 0


def test_the_catalogue_tells_where_clips_are_from(built: Path, moves: Path) -> None:
    clip = open_library(built).clip("moves/walk~mirror")
    assert clip.source == "moves/walk.npz"
    assert clip.digest == store.file_digest(moves / "walk.npz")
    assert clip.source_rate == 60
    assert clip.subject == "moves"
    assert clip.tags == ("walk",)
    assert clip.licence == "not stated"
    assert "body" in clip.family
    with pytest.raises(LibraryError, match="Did you mean 'moves/walk'"):
        open_library(built).clip("moves/wlk")


def test_the_catalogue_opens_in_sqlite(built: Path) -> None:
    with closing(sqlite3.connect(generation(built) / CATALOGUE_FILE)) as connection:
        assert connection.execute("SELECT count(*) FROM clips WHERE mirrored").fetchone() == (3,)


def test_a_row_finds_its_clip(built: Path) -> None:
    library = open_library(built)
    for clip in library.clips:
        assert library.clip_of(clip.start) is clip
        assert library.clip_of(clip.stop - 1) is clip
    for row in (-1, len(library)):
        with pytest.raises(IndexError):
            library.clip_of(row)


def test_the_same_sources_give_the_same_bytes_with_any_number_of_processes(built: Path, moves: Path, tmp_path: Path):
    build_library([moves], tmp_path / "library", mirror=True, workers=2)
    assert files_of(tmp_path / "library") == files_of(built)


def test_built_in_motions_are_a_source(tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    report = build_library(["samples"], tmp_path / "library", workers=1, progress=lambda *state: seen.append(state))
    assert report.clips == 15
    assert report.skipped == ()
    assert {what: (done, total) for what, done, total in seen} == {
        "reading motions": (15, 15),
        "finding copies of takes": (15, 15),
        "indexing poses": (1, 1),
    }
    library = open_library(tmp_path / "library")
    assert len({clip.take for clip in library.clips}) == 15, "different motions must not be taken for copies"
    assert library.clip("samples/walk").subject == "deepmimic"


def test_rates_must_be_positive(tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="a rate of 0"):
        build_library(["samples"], tmp_path / "library", rate=0.0)


# Nothing is dropped in silence


def test_what_cannot_be_read_is_listed_with_its_reason(tmp_path: Path) -> None:
    source = put(tmp_path / "moves", "walk")
    (source / "cut.bvh").write_text("HIERARCHY\nROOT hips\n{\n")
    (source / "empty.amc").write_text("")
    (source / "scan.fbx").write_bytes(b"Kaydara")
    write_motion(sample_motions()["kick"].cut(0, 9), source / "blink.npz")
    write_motion(dataclasses.replace(sample_motions()["walk"], name="again"), source / "again.npz")
    shutil.copy(source / "walk.npz", source / "walk_copy.npz")
    report = build_library([source], tmp_path / "library", workers=2)
    told = {entry.source: entry for entry in report.skipped}
    assert {name: entry.kind for name, entry in told.items()} == {
        "moves/cut.bvh": SkipKind.UNREADABLE,
        "moves/empty.amc": SkipKind.UNREADABLE,
        "moves/scan.fbx": SkipKind.UNREADABLE,
        "moves/blink.npz": SkipKind.SHORT,
        "moves/walk_copy.npz": SkipKind.KNOWN,
    }
    assert "the file is cut off" in told["moves/cut.bvh"].reason
    assert told["moves/blink.npz"].reason == "9 frames at 60 Hz are shorter than 0.2 s"
    assert told["moves/walk_copy.npz"].reason == "the same bytes as moves/walk.npz"
    assert all(str(tmp_path) not in entry.reason for entry in report.skipped)
    library = open_library(tmp_path / "library")
    assert library.skipped == report.skipped
    assert [clip.take for clip in library.clips] == ["moves/again", "moves/again"], "the same motion, other bytes"


def test_nothing_readable_leaves_nothing_behind(tmp_path: Path) -> None:
    source = tmp_path / "moves"
    source.mkdir()
    (source / "cut.bvh").write_text("HIERARCHY\n")
    with pytest.raises(LibraryError, match=r"not one motion could be read.*cut\.bvh"):
        build_library([source], tmp_path / "library", workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["moves"]


def test_a_dying_process_of_the_pool_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from poseloom.library import build

    monkeypatch.setattr(build, "convert", die)
    with pytest.raises(Exception, match="a process of the pool died"):
        build_library([put(tmp_path / "moves", "walk", "kick")], tmp_path / "library", workers=2)
    assert [path.name for path in tmp_path.iterdir()] == ["moves"]


def die(source: object, recipe: object) -> None:
    """Ends the process it runs in, as the system does with one that takes too much memory."""
    import os

    os._exit(9)


def test_another_folder_or_library_is_not_overwritten(mine: Path, moves: Path, tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="in the way"):
        build_library([moves], mine, workers=1)
    other = put(tmp_path / "precious", "walk")
    with pytest.raises(LibraryError, match="no motion library"):
        build_library([moves], other, workers=1, replace_existing=True)
    assert [path.name for path in other.iterdir()] == ["walk.npz"]
    build_library([moves], mine, exclude=["walk*"], workers=1, replace_existing=True)
    assert len(open_library(mine).clips) == 2
    assert len(list(mine.glob("generation-*"))) == 1


# Adding


def test_adding_keeps_what_was_there(mine: Path, built: Path, tmp_path: Path) -> None:
    before = open_library(mine)
    report = add_to_library(
        mine, [put(tmp_path / "more", "walk", "jump"), "samples"], exclude=["samples/[!w]*"], workers=1
    )
    after = open_library(mine, verify=True)
    assert after.clips[: len(before.clips)] == before.clips
    np.testing.assert_array_equal(after.poses[: len(before)], before.poses)
    added = [clip.name for clip in after.clips[len(before.clips) :]]
    assert added == ["more/jump", "more/jump~mirror", "samples/walk", "samples/walk~mirror"]
    assert (report.clips, report.poses) == (4, len(after) - len(before))
    assert [(entry.source, entry.kind) for entry in report.skipped] == [("more/walk.npz", SkipKind.KNOWN)]
    assert after.clip("samples/walk").take == "moves/walk", "the same motion under another name"
    assert [entry["command"] for entry in after.history] == ["build", "add"]
    # Who opened it before still sees what was opened, though its files are gone.
    assert not before._generation.exists()
    np.testing.assert_array_equal(before.poses, open_library(built).poses)
    assert len(before.moments(six_trackers()).rows) > 0


def test_adding_nothing_new_changes_nothing(mine: Path, moves: Path) -> None:
    before = files_of(mine)
    with pytest.raises(LibraryError, match="nothing new could be read"):
        add_to_library(mine, [moves], workers=1)
    assert files_of(mine) == before


def test_two_writers_do_not_meet(mine: Path, tmp_path: Path) -> None:
    with writing(mine), pytest.raises(LibraryError, match="another process is writing"):
        add_to_library(mine, [put(tmp_path / "more", "jump")], workers=1)
    add_to_library(mine, [tmp_path / "more"], workers=1)


def test_an_addition_while_a_library_is_opened_is_waited_out(mine: Path, tmp_path: Path, monkeypatch) -> None:
    read, more = store.read_header, put(tmp_path / "more", "jump")

    def read_then_add(folder: Path) -> store.Header:
        header = read(folder)
        monkeypatch.setattr(store, "read_header", read)
        add_to_library(folder, [more], workers=1)
        return header

    monkeypatch.setattr(store, "read_header", read_then_add)
    assert len(open_library(mine).clips) == 8


def test_what_killed_writers_left_is_cleared_away(mine: Path, moves: Path, tmp_path: Path) -> None:
    (mine / "generation-7").mkdir()
    (mine / "generation-7" / POSES_FILE).write_bytes(b"half")
    abandoned = tmp_path / ".new.building-1-abc"
    abandoned.mkdir()
    (abandoned / ".lock").touch()
    add_to_library(mine, [put(tmp_path / "more", "jump")], workers=1)
    assert [path.name for path in mine.glob("generation-*")] == ["generation-8"]
    build_library([moves], tmp_path / "new", workers=1)
    assert not abandoned.exists()


# Damage is named


@pytest.mark.parametrize("name", [POSES_FILE, CATALOGUE_FILE])
def test_a_damaged_file_is_named(mine: Path, name: str) -> None:
    path = generation(mine) / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(LibraryError, match=rf"{name}: a file of the library is damaged"):
        open_library(mine)
    path.write_bytes(content[:-5])
    with pytest.raises(LibraryError, match=rf"{name}: a file of the library was changed: it has"):
        open_library(mine)
    path.unlink()
    with pytest.raises(LibraryError, match=rf"{name}: a file of the library is missing"):
        open_library(mine)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[: len(text) // 2], "cannot be read as the header"),
        (lambda text: text.replace('"version": 1', '"version": 2'), "format version 2, this poseloom reads version 1"),
        (lambda text: text.replace('"rate": 40.0', '"rate": 60.0'), "header was changed"),
        (lambda text: "[]", "not the header of a motion library"),
        (lambda text: "\x00\xff", "cannot be read as the header"),
    ],
)
def test_a_wrong_header_is_told(mine: Path, change, message: str) -> None:
    path = mine / store.HEADER_FILE
    path.write_text(change(path.read_text()))
    with pytest.raises(LibraryError, match=message) as told:
        open_library(mine)
    assert told.value.file == str(path)
    assert told.value.remedy


def test_poses_of_another_body_are_refused(mine: Path) -> None:
    header = store.read_header(mine)
    store.write_header(mine, dataclasses.replace(header, body="0" * 64))
    with pytest.raises(LibraryError, match="another body"):
        open_library(mine)


def test_no_library_is_told(tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="no motion library in this folder"):
        open_library(tmp_path)
    with pytest.raises(LibraryError, match="no such folder"):
        open_library(tmp_path / "nowhere")


def test_large_files_are_looked_at_in_many_places(mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Files count as large from the first byte on: damage that no block meets is found by reading all of it.
    monkeypatch.setattr(store, "_WHOLE_UP_TO", 0)
    monkeypatch.setattr(store, "_BLOCK", 64)
    header = store.read_header(mine)
    path = generation(mine) / POSES_FILE
    store.write_header(mine, dataclasses.replace(header, files=store.seal(generation(mine))))
    content = bytearray(path.read_bytes())
    last = bytearray(content)
    last[-1] ^= 1
    path.write_bytes(last)
    with pytest.raises(LibraryError, match="damaged"):
        open_library(mine)
    content[200] ^= 1  # between the first block and the second
    path.write_bytes(content)
    open_library(mine)
    with pytest.raises(LibraryError, match="damaged"):
        open_library(mine, verify=True)


# Indexes


def test_moments_are_indexed_once_for_each_way_to_describe_them(mine: Path) -> None:
    library = open_library(mine)
    assert moments_folder(generation(mine), six_trackers()).is_dir()
    other = FeatureSettings(history=2)
    folder = moments_folder(generation(mine), other)
    assert not folder.exists()
    index = library.moments(other)
    assert library.moments(other) is index
    assert folder.is_dir()
    again = open_library(mine).moments(other)
    np.testing.assert_array_equal(again.columns, index.columns)
    np.testing.assert_array_equal(again.rows, index.rows)


def test_a_damaged_index_is_named_and_its_folder_may_go(mine: Path) -> None:
    folder = moments_folder(generation(mine), six_trackers())
    (folder / "rows.npy").write_bytes(b"nonsense")
    library = open_library(mine)
    with pytest.raises(LibraryError, match=r"rows\.npy: a file of the library was changed.*Delete its folder"):
        library.moments(six_trackers())
    with pytest.raises(LibraryError, match=r"rows\.npy"):
        open_library(mine, verify=True)
    shutil.rmtree(folder)
    library.moments(six_trackers())


def test_where_nothing_can_be_written_an_index_is_made_for_the_process(mine: Path, monkeypatch) -> None:
    from poseloom.library import moments

    def refuse(*_: object) -> None:
        raise PermissionError(13, "read-only")

    monkeypatch.setattr(moments, "make_moments", refuse)
    library = open_library(mine)
    assert len(library.moments(FeatureSettings(history=2)).rows)
    assert not moments_folder(generation(mine), FeatureSettings(history=2)).exists()


def test_clips_too_short_for_a_moment_can_be_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from poseloom.library import build

    long_memory = FeatureSettings(history=20)
    monkeypatch.setattr(build, "six_trackers", lambda: long_memory)
    source = tmp_path / "moves"
    source.mkdir()
    write_motion(sample_motions()["walk"].cut(0, 15), source / "step.npz")
    build_library([source], tmp_path / "library", workers=1)
    with pytest.raises(LibraryError, match="no moment to search for"):
        open_library(tmp_path / "library").moments(long_memory)


# Masks


def test_masks_leave_out_mirror_images_and_copies(tmp_path: Path) -> None:
    walk = sample_motions()["walk"]
    source = put(tmp_path / "moves", "walk", "kick")
    # A copy: another format, another rate, begun a part of a frame later, turned and carried off; and a mirrored part.
    write_motion(resample(walk, 97.0).cut(33, 400), source / "other.bvh")
    write_motion(mirror_motion(walk).cut(60, 300), source / "flipped.npz")
    build_library([source], tmp_path / "library", mirror=True, workers=1)
    library = open_library(tmp_path / "library")
    walks = {"moves/walk", "moves/other", "moves/flipped"}
    take = library.clip("moves/walk").take
    for clip in library.clips:
        assert (clip.take == take) == (clip.name.removesuffix("~mirror") in walks), clip.name
    mask = library.rows_excluding(takes=[take])
    for clip in library.clips:
        assert mask[clip.rows].all() == (clip.take != take)
        assert mask[clip.rows].any() == (clip.take != take)
    assert library.rows_excluding().all()
    with pytest.raises(LibraryError, match="unknown take 'nothing'"):
        library.rows_excluding(takes=["nothing"])


def test_a_subject_goes_with_all_copies_of_its_takes(tmp_path: Path) -> None:
    source = put(tmp_path / "moves", "kick")
    write_motion(sample_motions()["walk"], source / "16_15.npz")
    write_motion(resample(sample_motions()["walk"], 50.0), source / "unnamed.npz")
    write_motion(sample_motions()["run"], source / "16_40.npz")
    build_library([source], tmp_path / "library", workers=1)
    library = open_library(tmp_path / "library")
    mask = library.rows_excluding(subjects=["cmu16"])
    left = {clip.name for clip in library.clips if mask[clip.rows].any()}
    assert left == {"moves/kick"}
    with pytest.raises(LibraryError, match="unknown subject"):
        library.rows_excluding(subjects=["cmu17"])


def test_standing_still_is_no_copy(tmp_path: Path) -> None:
    source = tmp_path / "moves"
    source.mkdir()
    rng = np.random.default_rng(0)
    for name in ("one", "two"):
        q = np.zeros((200, average_body().size)) + 1e-4 * rng.normal(size=(200, 1))
        q[:, 1] = 0.9
        write_motion(make_motion(average_body(), q, 40.0), source / f"{name}.npz")
    build_library([source], tmp_path / "library", workers=1)
    assert len({clip.take for clip in open_library(tmp_path / "library").clips}) == 2


# Search


def test_clips_are_found_by_words(built: Path) -> None:
    library = open_library(built)
    assert [clip.name for clip in library.find("WALK")] == ["moves/walk", "moves/walk~mirror"]
    assert [clip.name for clip in library.find("moves mirror kick")] == ["moves/kick~mirror"]
    assert library.find("swim") == ()


def test_a_pose_finds_itself_whatever_its_place_and_heading(built: Path) -> None:
    library = open_library(built)
    clip = library.clip("moves/spin")
    q = library.motion(clip).q[25].copy()
    q[:6] += (3.0, 0.0, -2.0, 0.0, 1.0, 0.0)
    first = similar_poses(library, q, 3)[0]
    assert (first.clip, first.row) == (clip, clip.start + 25)
    assert first.distance < 1e-6


# Real recordings

SKELETON_OF_13_AND_14 = "mocap/cmu_asfamc/35/35.asf"


@pytest.fixture(scope="module")
def crossing(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    """A library of takes that the recordings hold in several formats."""
    mocap = recordings / "mocap"
    folder = tmp_path_factory.mktemp("crossing") / "library"
    report = build_library(
        [mocap / "cmu_asfamc", mocap / "cmu_bvh", mocap / "cmu_expmap"],
        folder,
        exclude=[
            "cmu_asfamc/01",
            "05",
            "13/13_29.amc",
            "14",
            "06_1*",
            "walking_[!2]*.txt",
            "*_signal",
            "directing_traffic",
        ],
        skeletons={"cmu_asfamc/13": recordings / SKELETON_OF_13_AND_14},
        workers=2,
    )
    assert [entry for entry in report.skipped if entry.kind is not SkipKind.COMPANION] == []
    return open_library(folder)


@pytest.mark.recordings
def test_copies_in_other_formats_are_found(crossing: MotionLibrary) -> None:
    take = {clip.source.split("/")[-1]: clip.take for clip in crossing.clips}
    pairs = [
        ("16_15.amc", "16_15.bvh"),
        ("16_15.amc", "walking_27.txt"),
        ("11_01.amc", "11_01.bvh"),
        ("06_02.bvh", "basketball_1.txt"),
        ("06_03.bvh", "basketball_2.txt"),
        ("06_04.bvh", "basketball_3.txt"),
        ("06_05.bvh", "basketball_4.txt"),
        ("06_06.bvh", "basketball_5.txt"),
        ("10_01.bvh", "soccer_1.txt"),
        ("10_03.bvh", "soccer_3.txt"),
    ]
    assert [pair for pair in pairs if take[pair[0]] != take[pair[1]]] == []


@pytest.mark.recordings
def test_other_performances_of_a_movement_are_no_copies(crossing: MotionLibrary) -> None:
    takes: dict[str, list[str]] = {}
    for clip in crossing.clips:
        takes.setdefault(clip.take, []).append(clip.source.split("/")[-1])
    assert max(len(clips) for clips in takes.values()) == 3, takes
    assert not {"02_01.amc", "02_02.amc"} <= set(takes[crossing.clip("cmu_asfamc/02/02_01").take])


@pytest.mark.recordings
def test_a_skeleton_is_lent_where_there_is_none(crossing: MotionLibrary, recordings: Path, tmp_path: Path) -> None:
    assert crossing.clip("cmu_asfamc/13/13_30").subject == "cmu13"
    with pytest.raises(LibraryError, match=r"13_30\.amc: the skeleton of this AMC file is missing"):
        build_library([recordings / "mocap/cmu_asfamc/13/13_30.amc"], tmp_path / "library")


# The command line


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch):
    """Runs the group `library` as the command line does."""
    app = typer.Typer(pretty_exceptions_enable=False)
    app.callback()(lambda: None)
    libraries.register(app)
    monkeypatch.setattr(_app, "build_app", lambda: app)
    return _app.run


def test_the_command_line_end_to_end(run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, folder = put(tmp_path / "moves", "walk", "kick"), tmp_path / "library"
    (source / "broken.bvh").write_text("HIERARCHY\n")
    (source / "README.txt").write_text("Licence: yours\n")
    assert run(["library", "build", str(source), "-o", str(folder), "--mirror", "--workers", "1"]) == 0
    told = capsys.readouterr()
    assert "4 clips" in told.out
    assert "1 files beside them" in told.out
    assert "1 WERE NOT TAKEN IN" in told.err
    assert "moves/broken.bvh: " in told.err
    more = put(tmp_path / "more", "spin")
    assert run(["library", "add", str(folder), str(more), "--licence", "mine", "--workers", "1"]) == 0
    assert run(["library", "info", str(folder), "--verify", "--skipped"]) == 0
    told = capsys.readouterr()
    assert "every byte read" in told.out
    assert "yours" in told.out
    assert "mine" in told.out
    assert "broken.bvh" in told.out
    assert run(["library", "search", str(folder), "walk", "mirror"]) == 0
    assert "1 clips" in capsys.readouterr().out
    assert run(["library", "search", str(folder), "--clip", str(more / "spin.npz"), "--frame", "30"]) == 0
    assert "more/spin" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["library", "build", "nowhere", "-o", "OUT"], "nowhere: no such file or folder"),
        (["library", "build", "samples", "-o", "OUT", "--exclude", "samples"], "all are excluded"),
        (["library", "build", "samples", "-o", "OUT", "--skeleton", "no.asf"], "no such skeleton file"),
        (["library", "build", "samples", "-o", "OUT", "--rate", "-3"], "rate of -3"),
        (["library", "info", "OUT"], "no such folder"),
        (["library", "add", "OUT", "samples"], "no such folder"),
        (["library", "search", "LIBRARY"], "nothing to search for"),
        (["library", "search", "LIBRARY", "--clip", "MOTION", "--frame", "99999"], "there is no frame 99999"),
    ],
)
def test_wrong_requests_exit_with_2_and_leave_nothing(run, argv, message, built, moves, tmp_path, capsys) -> None:
    names = {"OUT": str(tmp_path / "library"), "LIBRARY": str(built), "MOTION": str(moves / "walk.npz")}
    assert run([names.get(word, word) for word in argv]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert message in told
    assert "Traceback" not in told
    assert list(tmp_path.iterdir()) == []


def test_the_header_is_plain_json(built: Path) -> None:
    header = json.loads((built / store.HEADER_FILE).read_text())
    assert (header["kind"], header["version"], header["mirror"]) == ("poseloom-library", 1, True)
    assert {file["name"] for file in header["files"]} == {POSES_FILE, CATALOGUE_FILE}


def test_search_finds_what_is_far_when_all_that_is_near_is_left_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    near, far = rng.normal(size=(20_000, 6)), rng.normal(size=(300, 6)) + 30.0
    columns = np.concatenate([near, far]).astype(np.float32)
    arrays = ArtefactArrays(index_module._learnt("whole", columns), moments=len(columns))
    cells = index_module._searchable(arrays, "whole", columns)
    allowed = np.packbits(np.arange(20_300) >= 20_000, bitorder="little")
    found, distances = index_module._search(cells, np.zeros(6), 128, index_module.Exclusion(allowed, 20_300))
    exact = ((far.astype(np.float32).astype(np.float64)) ** 2).sum(axis=1)
    assert sorted(found) == sorted(20_000 + np.argsort(exact)[:128])
    np.testing.assert_allclose(distances, np.sort(exact)[:128], rtol=1e-4)


@pytest.mark.recordings
def test_walks_of_one_person_are_takes_of_their_own_and_copies_are_found(recordings: Path, tmp_path: Path) -> None:
    """On f1c3923 eight other walks of CMU 35 are one with 35_01, through its ASF/AMC copy on another skeleton.

    07_03 of the BVH files is 07_02 of the ASF/AMC files: joints differ by 0.8 mm over all 139 frames.
    """
    people = recordings / "people"
    if not (people / "cmu_bvh2").is_dir():
        pytest.skip(f"no {people / 'cmu_bvh2'}")
    walks = [people / f"cmu_bvh2/35/35_{number:02}.bvh" for number in range(1, 17)]
    pairs = [recordings / "mocap/cmu_asfamc/35", people / "cmu_bvh2/07", people / "cmu_asfamc2/07"]
    build_library([*walks, *pairs], tmp_path / "library", workers=1)
    library = open_library(tmp_path / "library")
    takes: dict[str, set[str]] = {}
    for clip in library.clips:
        takes.setdefault(clip.take, set()).add(Path(clip.source).name)
    together = sorted(sorted(names) for names in takes.values() if len(names) > 1)
    assert together == [["07_02.amc", "07_03.bvh"], ["35_01.amc", "35_01.bvh"]]
    assert len(takes) == len(library.clips) - 2
