"""Which files become sources, and what is said of them."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseloom.errors import LibraryError
from poseloom.formats import write_motion
from poseloom.library.catalogue import SkipKind
from poseloom.library.naming import describe, words
from poseloom.library.sources import Found, Selection, find_sources, matches
from poseloom.samples import sample_motions

BVH = "HIERARCHY\n"
DEEPMIMIC = '{"Loop": "wrap", "Frames": []}'
TABLE = "0.1,0.2,0.3,0,0,0\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with what collections of motions hold."""
    files = {
        "LICENSE": "\n  Some Terms 4.0\n====\nmore",
        "README.md": "# About\nLicence: other terms\n",
        "a/02_01.amc": "",
        "a/02_01.txt": "1 1 1 6 6",
        "a/02.asf": "",
        "a/readme.txt": "hello",
        "b/walk.BVH": BVH,
        "b/walk.json": DEEPMIMIC,
        "c/jump_high2.csv": TABLE,
        "b/deep.txt": DEEPMIMIC,
        "b/table.csv": TABLE,
        "b/notes.json": '{"a": 1}',
        "b/skeleton.json": "{}",
        "b/take.c3d": "",
        "b/picture.png": "",
        "b/.hidden.bvh": BVH,
        ".git/x.bvh": BVH,
        "c/README": "**License**: *theirs*\n",
        "c/jump_high2.bvh": BVH,
    }
    for name, text in files.items():
        path = tmp_path / "mocap" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    write_motion(sample_motions()["walk"], tmp_path / "mocap" / "b" / "own.npz")
    return tmp_path / "mocap"


def names(found: Found) -> list[str]:
    return [source.name for source in found.sources]


def test_motions_are_found_in_a_fixed_order_and_the_rest_is_accounted_for(root: Path) -> None:
    found = find_sources([root], Selection())
    assert names(found) == [
        "mocap/a/02_01.amc",
        "mocap/b/deep.txt",
        "mocap/b/own.npz",
        "mocap/b/table.csv",
        "mocap/b/walk.BVH",
        "mocap/b/walk.json",
        "mocap/c/jump_high2.bvh",
    ]
    assert {entry.source.removeprefix("mocap/"): entry.kind for entry in found.aside} == {
        "a/02_01.txt": SkipKind.COMPANION,
        "a/readme.txt": SkipKind.COMPANION,
        "b/notes.json": SkipKind.COMPANION,
        "b/skeleton.json": SkipKind.COMPANION,
        "b/take.c3d": SkipKind.UNREADABLE,
        "c/jump_high2.csv": SkipKind.COMPANION,
    }


def test_licences_are_those_stated_nearest(root: Path) -> None:
    licences = {source.name: source.licence for source in find_sources([root], Selection(licence="mine")).sources}
    assert licences["mocap/a/02_01.amc"] == "Some Terms 4.0"
    assert licences["mocap/c/jump_high2.bvh"] == "theirs"
    alone = find_sources([root / "b" / "walk.BVH"], Selection(licence="mine")).sources[0]
    assert (alone.name, alone.licence) == ("b/walk.BVH", "other terms")


def test_a_table_overrides_what_names_tell(root: Path) -> None:
    (root / "tags.csv").write_text("file,subject,tags\na,ann,\n*high*,,leap far\n")
    by_name = {source.name: source for source in find_sources([root], Selection()).sources}
    assert (by_name["mocap/a/02_01.amc"].subject, by_name["mocap/a/02_01.amc"].tags) == ("ann", ("walk",))
    assert by_name["mocap/c/jump_high2.bvh"].tags == ("leap", "far")
    (root / "tags.csv").write_text("name,tags\n")
    with pytest.raises(LibraryError, match=r"tags\.csv:1: the columns are name, tags"):
        find_sources([root], Selection())


def test_what_is_excluded_is_left_out(root: Path) -> None:
    assert names(find_sources([root], Selection(exclude=("b", "*high*")))) == ["mocap/a/02_01.amc"]
    with pytest.raises(LibraryError, match="7 were found and all are excluded"):
        find_sources([root], Selection(exclude=("mocap",)))


def test_skeletons_are_lent_to_those_without(root: Path) -> None:
    lent = root / "a" / "02.asf"
    (root / "b" / "13_01.amc").write_text("")
    selection = Selection(skeletons=(("b", lent),))
    by_name = {source.name: source.skeleton for source in find_sources([root], selection).sources}
    assert {name for name, skeleton in by_name.items() if skeleton} == {"mocap/b/13_01.amc"}


def test_a_library_among_the_motions_is_no_source(root: Path) -> None:
    (root / "library").mkdir()
    (root / "library" / "library.json").write_text('{"kind": "poseloom-library"}')
    (root / "library" / "x.bvh").write_text(BVH)
    assert "mocap/library/x.bvh" not in names(find_sources([root], Selection()))


def test_the_same_file_given_twice_is_one_source(root: Path) -> None:
    assert len(find_sources([root / "c", root / "c"], Selection()).sources) == 1


def test_nothing_to_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match=r"no motion files in .*\.bvh"):
        find_sources([tmp_path], Selection())
    with pytest.raises(LibraryError, match="no such file or folder"):
        find_sources([tmp_path / "nowhere"], Selection())


@pytest.mark.parametrize(
    ("pattern", "fits"),
    [("bandai", True), ("data/*.bvh", True), ("mocap/bandai/*/*", True), ("*.amc", False), ("mocap/data", False)],
)
def test_patterns_fit_any_run_of_parts(pattern: str, fits: bool) -> None:
    assert matches(pattern, "mocap/bandai/data/walk_01.bvh") == fits


@given(st.lists(st.text("abc.", min_size=1).filter(lambda part: part.strip(".")), min_size=1, max_size=5), st.data())
def test_every_run_of_parts_fits_its_own_path(parts: list[str], data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(parts) - 1))
    stop = data.draw(st.integers(start + 1, len(parts)))
    assert matches("/".join(parts[start:stop]), "/".join(parts))


@pytest.mark.parametrize(
    ("source", "subject", "tags"),
    [
        ("mocap/02/02_05.amc", "cmu02", "punch strike"),
        ("mocap/131/131_01.bvh", "cmu131", "start walk stop hop"),
        ("hdm05/HDM_bk_depositFloorR_011_120.amc", "hdm05:bk", "deposit floor"),
        ("data/dataset-2_raise-up-both-hands_active_001.bvh", "bandai2", "raise up both hands active"),
        ("deepmimic/humanoid3d_long_walk1.txt", "deepmimic", "walk"),
        ("samples/dance_a", "deepmimic", "dance"),
        ("ann/My Walk-12.bvh", "ann", "my walk"),
        ("1_2.bvh", "1_2", ""),
    ],
)
def test_names_tell_subject_and_tags(source: str, subject: str, tags: str) -> None:
    assert describe(source) == (subject, tuple(tags.split()))


def test_exponential_maps_are_of_people_unknown() -> None:
    told = describe("cmu_expmap/train/basketball_signal/basketball_signal_1.txt", exponential_maps=True)
    assert told == ("cmu_expmap:basketball_signal", ("basketball", "signal"))


@given(st.text())
def test_words_are_lower_case_and_come_once(text: str) -> None:
    found = words(text)
    assert len(set(found)) == len(found)
    assert all(word == word.lower() and len(word) > 1 for word in found)


@pytest.mark.recordings
def test_every_recording_is_a_source_or_accounted_for(recordings: Path) -> None:
    found = find_sources([recordings / "mocap"], Selection(exclude=("bandai",)))
    assert len(found.sources) == 402
    assert {entry.source.rsplit("/")[-1] for entry in found.aside} == {
        "13_29.txt",
        "13_30.txt",
        "14_14.txt",
        "14_20.txt",
        "skeleton.json",
    }
