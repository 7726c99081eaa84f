"""Which file is read and written how; NPZ without loss; the rest frame; `convert` and `info`; bad input."""

import json

import numpy as np
import pytest
import typer

from poseloom import formats
from poseloom.cli import _app, motion_files
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats.npz import read_npz, write_npz
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import make_skeleton


def striding(frames: int = 30, displaced: bool = False) -> Motion:
    """The body walking one metre a second and bending a knee."""
    body = average_body()
    q = np.zeros((frames, body.size))
    q[:, 1], q[:, 2] = 0.95, np.arange(frames) / 30
    q[:, 3 + 3 * body.index("leftLowerLeg")] = np.linspace(0.1, 1.2, frames)
    moves = np.zeros((frames, len(body), 3))
    moves[:, 5, 1] = 0.01
    return make_motion(body, q, 30.0, "striding", moves if displaced else None)


@pytest.mark.parametrize("displaced", [False, True])
def test_npz_keeps_every_bit(tmp_path, displaced):
    rng = np.random.default_rng(1)
    skeleton = make_skeleton(
        ["hips", "knee ü", "foot"],
        [-1, 0, 1],
        rng.normal(size=(3, 3)),
        {"foot": rng.normal(size=3)},
        {"knee ü": np.array([False, True, True])},
    )
    moves = rng.normal(size=(7, 3, 3)) if displaced else None
    motion = make_motion(skeleton, rng.normal(size=(7, 12)) * 1e-7, 59.94, "a name", moves)
    write_npz(motion, tmp_path / "motion.npz")
    again = read_npz(tmp_path / "motion.npz")
    np.testing.assert_array_equal(again.q, motion.q)
    assert (again.rate, again.name) == (motion.rate, motion.name)
    for part in ("parents", "offsets", "tips", "locked"):
        np.testing.assert_array_equal(getattr(again.skeleton, part), getattr(skeleton, part))
    assert again.skeleton.names == skeleton.names
    if displaced:
        np.testing.assert_array_equal(again.displacements, moves)
    else:
        assert again.displacements is None


def test_damaged_npz_files_tell_why(tmp_path):
    path = tmp_path / "motion.npz"
    write_npz(striding(), path)
    whole = path.read_bytes()
    for end in range(0, len(whole), 97):
        path.write_bytes(whole[:end])
        with pytest.raises(FormatError) as caught:
            read_npz(path)
        assert caught.value.file == str(path)
    for at in range(0, len(whole), 53):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        try:
            read_npz(path)
        except PoseloomError as error:
            assert error.file == str(path)  # noqa: PT017


def test_npz_of_another_kind(tmp_path):
    np.savez(tmp_path / "other.npz", q=np.zeros(3))
    with pytest.raises(FormatError, match=r"other\.npz"):
        formats.read_motions(tmp_path / "other.npz")
    assert not formats.is_motion_file(tmp_path / "other.npz")
    np.save(tmp_path / "evil.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    (tmp_path / "evil.npy").rename(tmp_path / "evil.npz")
    with pytest.raises(FormatError):
        formats.read_motions(tmp_path / "evil.npz")


@pytest.mark.parametrize("suffix", [".bvh", ".npz", ".BVH", ".NPZ"])
def test_writing_and_reading_by_suffix(tmp_path, suffix):
    path = tmp_path / f"walk{suffix}"
    formats.write_motion(striding(), path)
    assert formats.is_motion_file(path)
    (motion,) = formats.read_motions(path)
    np.testing.assert_allclose(motion.q, striding().q, atol=1e-7)
    np.testing.assert_allclose(formats.read_motion(path).q, motion.q)


def test_suffixes():
    assert set(formats.motion_suffixes()) == {".bvh", ".amc", ".txt", ".csv", ".json", ".npz", ".glb"}
    assert set(formats.writable_suffixes()) == {".bvh", ".glb", ".npz"}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("walk.fbx", b"x", "hold no motion"),
        ("walk", b"x", "files without suffix"),
        ("01.asf", b":version", "Name the AMC file"),
        ("empty.bvh", b"", "is empty"),
        ("empty.txt", b" \n", "is empty"),
        ("labels.txt", b"1 1 1 1 6 6 6\n", "no commas"),
        ("page.json", b"<html>", "not whole JSON"),
    ],
)
def test_what_cannot_be_read(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=words) as caught:
        formats.read_motions(tmp_path / name)
    assert caught.value.file == str(tmp_path / name)


def test_folders_and_missing_files(tmp_path):
    with pytest.raises(FormatError, match="folder"):
        formats.read_motions(tmp_path)
    with pytest.raises(FormatError, match="no such file"):
        formats.read_motions(tmp_path / "walk.bvh")
    assert not formats.is_motion_file(tmp_path)
    assert not formats.is_motion_file(tmp_path / "walk.bvh")


def test_arguments_without_meaning_are_refused(tmp_path):
    formats.write_motion(striding(), tmp_path / "walk.bvh")
    formats.write_motion(striding(), tmp_path / "walk.npz")
    with pytest.raises(FormatError, match="skeleton was given"):
        formats.read_motions(tmp_path / "walk.bvh", tmp_path / "some.asf")
    with pytest.raises(FormatError, match="rate was given"):
        formats.read_motions(tmp_path / "walk.bvh", rate=30.0)
    with pytest.raises(FormatError, match="unit of length was given"):
        formats.read_motions(tmp_path / "walk.npz", metres_per_unit=1.0)
    with pytest.raises(FormatError, match="unit of length is -1"):
        formats.read_motions(tmp_path / "walk.bvh", metres_per_unit=-1.0)


def test_which_files_are_meant_as_motions(tmp_path):
    files = {
        "take.bvh": b"damaged",
        "take.amc": b"",
        "clip.txt": b'{\n"Loop": "wrap",\n"Frames": [',
        "table.txt": b"10.4,16.7,-30.1,-0,-0,0\n",
        "labels.txt": b"1 1 1 1 6 6 6 5 5 5",
        "notes.txt": b"one, two, three, four, five, six",
        "skeleton.json": b'{"joints": []}',
        "table.csv": b"subject,clip,joint,x,y,z\n",
        "README.md": b"# Motions",
        "01.asf": b":version",
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    meant = {name for name in files if formats.is_motion_file(tmp_path / name)}
    assert meant == {"take.bvh", "take.amc", "clip.txt", "table.txt"}


def test_a_drawn_pose_in_front_is_dropped():
    walk = striding()
    q = np.array(walk.q)
    q[1:, 3:6] = [0.2, 0.5, 0.1]
    q[0, 3:] = 0
    q[1:, 40:50] = 1.0
    drawn = make_motion(walk.skeleton, q, 30.0)
    assert formats.starts_with_rest_frame(drawn)
    assert len(formats.drop_rest_frame(drawn)) == len(walk) - 1
    assert not formats.starts_with_rest_frame(formats.drop_rest_frame(drawn))


def test_a_movement_keeps_its_first_frame():
    walk = striding()
    assert formats.drop_rest_frame(walk) is walk
    still = make_motion(walk.skeleton, np.zeros((5, walk.skeleton.size)), 30.0)
    assert formats.drop_rest_frame(still) is still
    assert formats.drop_rest_frame(still.cut(0, 1)) is not None


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch):
    """Runs a command line with the commands of motion files only."""

    def build() -> typer.Typer:
        app = typer.Typer(pretty_exceptions_enable=False)
        motion_files.register(app)
        return app

    monkeypatch.setattr(_app, "build_app", build)
    return _app.run


def facts(text: str) -> dict[str, str]:
    return {line.split("  ")[0].strip(): " ".join(line.split()[1:]) for line in text.splitlines() if line.strip()}


@pytest.mark.parametrize("suffix", [".glb", ".npz", ".bvh"])
def test_convert(run, tmp_path, capsys, suffix):
    formats.write_motion(striding(), tmp_path / "walk.bvh")
    target = tmp_path / f"out{suffix}"
    assert run(["convert", str(tmp_path / "walk.bvh"), str(target), "--rate", "15"]) == 0
    told = facts(capsys.readouterr().out)
    assert told["frames"] == "15 at 15 Hz"
    assert target.stat().st_size > 1000
    if suffix != ".glb":
        assert len(formats.read_motion(target)) == 15


def test_convert_to_the_body_without_the_rest_frame(run, tmp_path, capsys):
    body = average_body()
    q = np.tile(striding().q, (2, 1))
    q[1:, 3:6] = 0.3
    q[1:, 20:60] += 0.5
    formats.write_motion(make_motion(body, q, 30.0), tmp_path / "walk.bvh")
    arguments = ["convert", str(tmp_path / "walk.bvh"), str(tmp_path / "out.npz"), "--drop-rest-frame", "--body"]
    assert run(arguments) == 0
    assert facts(capsys.readouterr().out)["frames"] == "59 at 30 Hz"
    assert formats.read_motion(tmp_path / "out.npz").skeleton.names == body.names


def test_info(run, tmp_path, capsys):
    formats.write_motion(striding(), tmp_path / "walk.bvh")
    assert run(["info", str(tmp_path / "walk.bvh")]) == 0
    told = facts(capsys.readouterr().out)
    assert told["motion"] == "walk"
    assert told["format"] == "BVH"
    assert told["frames"] == "30 at 30 Hz"
    assert told["duration"] == "0.97 s"
    assert told["height"].startswith("1.61 m")
    assert told["travel"].startswith("0.97 m")
    assert told["joints"].startswith("22 (poseloom's body")
    assert run(["info", str(tmp_path / "walk.bvh"), "--unit", "0.02"]) == 0
    assert facts(capsys.readouterr().out)["height"].startswith("3.21 m")


@pytest.mark.parametrize(
    "arguments",
    [
        ["info", "{}/missing.bvh"],
        ["info", "{}/damaged.bvh"],
        ["info", "{}/lonely.amc"],
        ["info", "{}"],
        ["convert", "{}/walk.bvh", "{}/walk.fbx"],
        ["convert", "{}/walk.bvh", "{}/missing/walk.glb"],
        ["convert", "{}/walk.bvh", "{}/out.glb", "--rate", "-3"],
        ["convert", "{}/walk.bvh", "{}/out.glb", "--skeleton", "{}/some.asf"],
        ["convert", "{}/damaged.bvh", "{}/out.glb"],
    ],
)
def test_bad_input_exits_with_2_and_leaves_nothing(run, tmp_path, capsys, arguments):
    formats.write_motion(striding(), tmp_path / "walk.bvh")
    (tmp_path / "damaged.bvh").write_bytes((tmp_path / "walk.bvh").read_bytes()[:-100])
    (tmp_path / "lonely.amc").write_text("1\nroot 0 0 0 0 0 0\n")
    before = sorted(file.name for file in tmp_path.iterdir())
    assert run([argument.format(tmp_path) for argument in arguments]) == 2
    told = capsys.readouterr()
    assert told.err.startswith("poseloom: ")
    assert "Traceback" not in told.err
    assert sorted(file.name for file in tmp_path.iterdir()) == before


@pytest.mark.recordings
def test_info_of_each_kind_of_recording(run, recordings, capsys):
    folder = recordings / "mocap"
    expected = {
        "cmu_asfamc/02/02_01.amc": "ASF/AMC",
        "cmu_bvh/16/16_15.bvh": "BVH",
        "cmu_expmap/train/walking/walking_1.txt": "exponential-map CSV",
        "deepmimic/humanoid3d_walk.txt": "DeepMimic JSON",
    }
    for file, kind in expected.items():
        if not (folder / file).is_file():
            pytest.skip(f"{file} is not there")
        assert run(["info", str(folder / file)]) == 0
        told = facts(capsys.readouterr().out)
        assert told["format"] == kind
        assert "no known family" not in told["joints"]
        assert 1.3 < float(told["height"].split()[0]) < 1.8


def test_json_numbers_do_not_pass_as_tables(tmp_path):
    (tmp_path / "numbers.json").write_text(json.dumps([1, 2, 3]))
    assert not formats.is_motion_file(tmp_path / "numbers.json")
    with pytest.raises(FormatError):
        formats.read_motions(tmp_path / "numbers.json")
