"""Files from strangers: what may be opened, and that nothing but errors of our own comes out."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from poseloom.errors import FormatError, LibraryError, PoseloomError
from poseloom.formats import write_motion
from poseloom.formats._files import beginning, open_regular, read_bytes, read_json, reading
from poseloom.formats.atomic import atomic_file
from poseloom.library import build_library
from poseloom.library.sources import Selection, find_sources
from poseloom.samples import sample_motions


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    pipe, folder, plug = tmp_path / "pipe.bvh", tmp_path / "folder.bvh", tmp_path / "plug.bvh"
    os.mkfifo(pipe)
    folder.mkdir()
    with socket.socket(socket.AF_UNIX) as unix:
        unix.bind(str(plug))
        for path, what in (
            (pipe, "a named pipe"),
            (folder, "a folder"),
            (plug, "a socket"),
            (Path("/dev/zero"), "a device"),
            (tmp_path / "absent", "no such file"),
            (tmp_path / "a\0b", "cannot be read"),
        ):
            for read in (open_regular, read_bytes):
                with pytest.raises(FormatError, match=what) as raised:
                    read(path)
                assert raised.value.file == str(path)
            assert beginning(path, 10) == b""
            with pytest.raises(LibraryError, match=what):
                read_json(path, "a header", LibraryError)


def test_links_to_regular_files_are_followed(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("x")
    (tmp_path / "b.txt").symlink_to(tmp_path / "a.txt")
    assert read_bytes(tmp_path / "b.txt") == b"x"


def test_a_file_larger_than_is_read_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "sparse.bvh"
    with path.open("wb") as stream:
        stream.truncate(1 << 40)
    with pytest.raises(FormatError, match="more than"):
        read_bytes(path)


@pytest.mark.parametrize("text", ["", " \n", "{", "[" * 100_000, '{"a": ' + "9" * 5000 + "}", "\xff\xfe"])
def test_what_is_no_json_ends_in_one_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(FormatError) as raised:
        read_json(path, "a thing")
    assert raised.value.file == str(path)


def test_damage_becomes_one_error_and_defects_pass() -> None:
    for damage in (
        KeyError("a"),
        RecursionError(),
        MemoryError(),
        OverflowError("x"),
        UnicodeDecodeError("a", b"", 0, 1, "b"),
    ):
        with pytest.raises(FormatError, match="cannot be read as a thing") as raised, reading("file.x", "a thing"):
            raise damage
        assert raised.value.file == "file.x"
    with pytest.raises(PoseloomError) as named, reading("file.x"):
        raise PoseloomError("a fact", line=3)
    assert (named.value.file, named.value.line) == ("file.x", 3)
    with pytest.raises(AssertionError), reading("file.x"):
        raise AssertionError


def test_a_full_disk_names_the_target_and_leaves_nothing(tmp_path: Path) -> None:
    def fill() -> None:
        with atomic_file(tmp_path / "out.bin") as part:
            part.write_bytes(b"half")
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match=r"out\.bin") as raised:
        fill()
    assert raised.value.filename == str(tmp_path / "out.bin")
    assert list(tmp_path.iterdir()) == []


def test_a_named_pipe_in_a_folder_is_listed_and_waits_for_nobody(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.bvh")
    os.mkfifo(tmp_path / "pipe.csv")
    write_motion(sample_motions()["walk"].cut(0, 60), tmp_path / "walk.bvh")
    report = build_library([tmp_path], tmp_path.parent / f"{tmp_path.name}-library")
    assert report.clips == 1
    assert any("named pipe" in entry.reason for entry in report.skipped)


def test_an_unknown_sample_suggests_names() -> None:
    with pytest.raises(PoseloomError, match=r"Did you mean 'walk'\?"):
        sample_motions()["walking"]


def test_a_readme_one_level_up_states_the_licence(tmp_path: Path) -> None:
    table = "| folder | what | licence |\n|---|---|---|\n| `a/01 02` | x | Terms A |\n| `b` | y | same |\n"
    (tmp_path / "README.md").write_text(table)
    for name in ("a", "b", "c"):
        (tmp_path / "mocap" / name).mkdir(parents=True)
        write_motion(sample_motions()["walk"].cut(0, 60), tmp_path / "mocap" / name / "walk.bvh")
    found = find_sources([tmp_path / "mocap"], Selection(licence="mine")).sources
    assert [source.licence for source in found] == ["Terms A", "Terms A", "mine"]


def test_a_library_is_built_from_a_plain_script(tmp_path: Path) -> None:
    script = tmp_path / "plain.py"
    script.write_text("from poseloom.library import build_library\nprint(build_library(['samples'], 'out').clips)\n")
    done = subprocess.run([sys.executable, script.name], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.strip()) == (0, "15"), done.stderr
