"""Files from strangers: what may be opened, and that nothing but errors of our own comes out."""

import json
import os
import socket
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import pytest

from poseloom.cli._app import run
from poseloom.errors import FormatError, LibraryError, PoseloomError
from poseloom.formats import write_motion
from poseloom.formats._files import beginning, open_regular, read_bytes, read_json, reading
from poseloom.formats.atomic import atomic_file
from poseloom.formats.imus import read_imu_tracks
from poseloom.library import build_library
from poseloom.library.sources import Selection, find_sources
from poseloom.samples import sample_motions

TRIALS = 60


def test_damaged_files_of_every_kind_are_read_or_refused(tmp_path: Path) -> None:
    script = Path(__file__).with_name("fuzz_files.py")
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(TRIALS)], capture_output=True, text=True, timeout=300
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 0, f"ended by {done.returncode} at {lines[-1:]}: {done.stderr[-2000:]}"
    assert lines[-1] == "escaped 0", [line for line in lines if line.startswith("ESCAPED")][:10]


def hostile_files(folder: Path) -> dict[str, list[str]]:
    """Files that a stranger may send, written to a folder, and the commands that would read such files."""
    head = ",index,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z\n"
    frame = [1e-5, 0.0, 0.9, 0.0, 1.0, 0.0, 0.0, 0.0, *[0.5] * 36]
    texts = {
        "encoding.mvnx": '<?xml version="1.0" encoding="UTF-98"?><mvnx/>',
        "field.csv": head + "2" * 150_000 + ",1,2,3,4,5\n",
        "quote.csv": head + "0,1,2,3,4,5,6,7\n" + '"' + "y" * 150_000 + "\n",
        "flexgap.csv": "time,c1,c2,c3,c4\n" + "".join(f"{t},1,2,3,4\n" for t in [*range(8), 10**14]),
        "flexlong.csv": "time,c1,c2,c3,c4\n" + "".join(f"{t}00000000000,1,2,3,4\n" for t in range(9)),
        "integer.txt": '{"Loop": "none", "Frames": [[' + "3" * 6000 + "]]}",
        "uneven.txt": json.dumps({"Frames": [frame, frame, [3e6, *frame[1:]], frame, frame]}),
        "endless.txt": json.dumps({"Frames": [frame, frame, [1e300, *frame[1:]], frame, frame]}),
        "gap.sto": "DataType=Quaternion\nendheader\ntime\ta\n0\t1,0,0,0\n0.02\t1,0,0,0\n1e14\t1,0,0,0\n",
        "gap.csv": "time,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z\n"
        + "".join(f"{t},0,9.81,0,0.1,0,0\n" for t in (0, 0.01, 0.02, 0.03, 1e9)),
        "nested.bvh": "HIERARCHY\n" + "ROOT a\n{\n" * 30_000,
        "deep.json": "[" * 200_000,
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    glb = json.dumps({"asset": [], "nodes": [{"name": "a" * 60}]}).encode()
    whole = (
        struct.pack("<4sIII4s", b"glTF", 2, 28 + len(glb), len(glb), b"JSON") + glb + struct.pack("<I4s", 0, b"BIN\0")
    )
    (folder / "asset.glb").write_bytes(whole)
    write_motion(sample_motions()["walk"].cut(0, 5), folder / "sound.npz")
    with zipfile.ZipFile(folder / "sound.npz") as sound, zipfile.ZipFile(folder / "shape.npz", "w") as out:
        for name in sound.namelist():
            header = "{'descr': '<f8', 'fortran_order': False, 'shape': (77777777777,), }".ljust(117) + "\n"
            array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()
            out.writestr(name, array if name == "q.npy" else sound.read(name))
    (folder / "sound.npz").unlink()
    target = str(folder / "out")
    commands: dict[str, list[str]] = {}
    for file in sorted(path.name for path in folder.iterdir()):
        path = str(folder / file)
        commands[f"{file} info"] = ["info", path]
        commands[f"{file} convert"] = ["convert", path, f"{target}.bvh"]
        commands[f"{file} import-imu"] = ["import-imu", path, "--sensors", "right-foot=a", "-o", f"{target}.mcap"]
        commands[f"{file} import-flex"] = ["import-flex", path, "-o", f"{target}.mcap"]
        commands[f"{file} import-trackers"] = ["import-trackers", path, "-o", f"{target}.mcap"]
    return commands


COMMANDS = """
import contextlib, io, json, resource, sys, time
from pathlib import Path
from poseloom.cli._app import run

for name, command in json.loads(Path(sys.argv[1]).read_text()).items():
    said, begin = io.StringIO(), time.process_time()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        code = run(command)
    print(json.dumps([name, code, time.process_time() - begin, " ".join(said.getvalue().split())]), flush=True)
    if name.endswith("import-trackers"):  # what is needed is loaded by now
        limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + (1 << 30)
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
"""


def test_every_command_refuses_hostile_files_at_once(tmp_path: Path) -> None:
    (tmp_path / "files").mkdir()
    commands = hostile_files(tmp_path / "files")
    (tmp_path / "commands.json").write_text(json.dumps(commands))
    before = sorted(tmp_path.rglob("*"))
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS, str(tmp_path / "commands.json")], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-2000:]
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == len(commands)
    for index, (name, code, seconds, said) in enumerate(lines):
        assert code == 2, (name, said)
        assert name.split()[0] in said, (name, said)
        assert "Traceback" not in said, (name, said)
        assert "more memory than there is" not in said, (name, said)
        assert seconds < 1 or index < 5, (name, seconds)  # the first of each import what they need
    assert sorted(tmp_path.rglob("*")) == before


def test_a_matlab_file_may_not_unpack_without_end(tmp_path: Path) -> None:
    head = b"MATLAB".ljust(124) + b"\x00\x01IM"
    packed = zlib.compress(bytes(300 << 20), 1)
    (tmp_path / "bomb.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    matrix = struct.pack("<IIIIIIii", 6, 8, 1, 0, 5, 8, 1, 1 << 30) + struct.pack("<II", 1, 0)
    (tmp_path / "cells.mat").write_bytes(head + struct.pack("<II", 14, len(matrix)) + matrix)
    for file, what in (("bomb.mat", "unpack to far more"), ("cells.mat", "does not fit its")):
        with pytest.raises(FormatError, match=what) as raised:
            read_imu_tracks(tmp_path / file)
        assert raised.value.file == str(tmp_path / file)


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


def test_an_unknown_sensor_suggests_names(tmp_path: Path) -> None:
    (tmp_path / "a.sto").write_text("DataType=Quaternion\nendheader\ntime\tfoot_l\n0\t1,0,0,0\n0.01\t1,0,0,0\n")
    with pytest.raises(FormatError, match=r"Did you mean 'foot_l'\?"):
        read_imu_tracks(tmp_path / "a.sto")["foot_r"]


def test_fitting_says_which_clips_it_left_out_and_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("one", "two"):
        write_motion(sample_motions()["walk"].cut(0, 150), tmp_path / f"{name}.bvh")
    write_motion(sample_motions()["walk"].cut(0, 12), tmp_path / "short.bvh")
    build_library([tmp_path], tmp_path / "library")
    command = ["fit", "phase-hmm", "-l", str(tmp_path / "library"), "--layout", "right-foot-imu"]
    assert run([*command, "-o", str(tmp_path / "foot.npz")]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "left out 1 of" in said
    assert "short" in said.partition("left out 1 of")[2]


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
