"""`poseloom demo`: what it promises is there, its library is kept and renewed, nothing of the user's is lost."""

import subprocess
import sys
from pathlib import Path

import pytest

from poseloom.cli._app import run
from poseloom.cli.demonstrating import choose_clip
from poseloom.errors import LibraryError
from poseloom.formats import read_motions, write_motion
from poseloom.library import Clip, open_library
from poseloom.samples import sample_motions

MADE = {"library", "library.sources", "report.html", "walk.bvh", "walk.glb", "walk.svg"}


@pytest.fixture
def motions(tmp_path: Path) -> Path:
    """A folder of two motion files, one of them in a subfolder, and one that is none."""
    folder = tmp_path / "motions"
    (folder / "more").mkdir(parents=True)
    write_motion(sample_motions()["kick"], folder / "kick.bvh")
    write_motion(sample_motions()["walk"].cut(0, 200), folder / "more" / "walk.bvh")
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT hips\n{\n", encoding="utf-8")
    return folder


def poseloom(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The command as users run it: in a process of its own, without the tests' checks of shapes, which cost time."""
    command = [sys.executable, "-m", "poseloom", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True)


def test_the_built_in_motions(tmp_path: Path):
    out = tmp_path / "demo"
    first = poseloom("demo", "-o", out)
    assert {path.name for path in out.iterdir()} == MADE
    assert len(read_motions(out / "walk.bvh")[0]) > 100
    assert "joint angle" in first.stdout
    assert "make demo DATA=FOLDER" in first.stdout
    assert "reading motions" in first.stderr
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "local-regression" in page
    assert "inverse-kinematics" in page
    assert open_library(out / "library").mirror
    before = (out / "library" / "library.json").stat().st_mtime_ns

    again = poseloom("demo", "-o", out)
    assert "reading motions" not in again.stderr
    assert (out / "library" / "library.json").stat().st_mtime_ns == before


def test_without_the_extra_for_charts_all_else_is_made(motions: Path, capsys: pytest.CaptureFixture[str], monkeypatch):
    monkeypatch.setattr("poseloom.report.charts.find_spec", lambda _name: None)
    assert run(["demo", "--data", str(motions), "-o", str(motions / "demo")]) == 0
    told = capsys.readouterr()
    assert "poseloom[report]" in told.err
    assert "walk.svg in a browser" in told.out
    made = {path.name for path in (motions / "demo").iterdir()}
    assert made == MADE - {"report.html"}
    before = len(list(motions.iterdir()))
    assert run(["evaluate", "sample:walk", "--report", str(motions / "report.html")]) == 2
    assert "poseloom[report]" in capsys.readouterr().err
    assert len(list(motions.iterdir())) == before


def test_motions_of_ones_own(motions: Path):
    out = motions / "demo"  # within the data: what the demo makes must not become a source
    first = poseloom("demo", "--data", motions, "-o", out)
    assert "broken.bvh" in first.stderr
    assert (out / "walk.glb").is_file()
    sources = {clip.source for clip in open_library(out / "library").clips}
    assert sources == {"motions/kick.bvh", "motions/more/walk.bvh"}

    write_motion(sample_motions()["punch"], motions / "punch.bvh")
    (out / "library" / "library.json").write_text("damaged", encoding="utf-8")
    poseloom("demo", "--data", motions, "--exclude", "kick.bvh", "-o", out)
    sources = {clip.source for clip in open_library(out / "library").clips}
    assert sources == {"motions/punch.bvh", "motions/more/walk.bvh"}


def test_a_folder_in_the_way_is_not_touched(motions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    mine = tmp_path / "out" / "library" / "mine.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("keep", encoding="utf-8")
    assert run(["demo", "--data", str(motions), "-o", str(tmp_path / "out")]) == 2
    assert "in the way" in capsys.readouterr().err
    assert mine.read_text(encoding="utf-8") == "keep"


def test_a_folder_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["demo", "--data", str(tmp_path / "none"), "-o", str(tmp_path / "out")]) == 2
    assert "no such folder" in capsys.readouterr().err


def clip(name: str, take: str, tags: str, subject: str = "x", frames: int = 200, mirrored: bool = False) -> Clip:
    return Clip(
        id=0,
        name=name,
        take=take,
        subject=subject,
        source=name,
        digest="",
        start=0,
        stop=frames,
        mirrored=mirrored,
        source_rate=120.0,
        family="",
        licence="",
        tags=tuple(tags.split()),
    )


def test_a_cmu_walk_of_handy_length_is_chosen():
    clips = (
        clip("a", "a", "walk", "hdm05:bd"),
        clip("b", "b", "run", "cmu02"),
        clip("c", "c", "start walk", "cmu131"),
        clip("d", "d", "walk", "cmu02", frames=20),
        clip("e~mirror", "e", "walk", "cmu02", mirrored=True),
        clip("e", "e", "walk", "cmu02"),
    )
    assert choose_clip(clips, 40.0).name == "e"
    assert choose_clip(clips[:2], 40.0).name == "a"


def test_one_take_alone_is_not_enough():
    with pytest.raises(LibraryError, match="only motion"):
        choose_clip((clip("a", "a", "walk"), clip("a~mirror", "a", "walk", mirrored=True)), 40.0)
