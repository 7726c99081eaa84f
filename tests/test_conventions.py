"""What motion files leave open: unit of length, up axis, rates, and the dialects of their text."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from poseloom.cli._app import build_app
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats import read_motion
from poseloom.formats.bvh import read_bvh, write_bvh
from poseloom.formats.conventions import check_human
from poseloom.library import build_library, open_library
from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix
from poseloom.samples import sample_motions
from poseloom.skeleton import Motion, average_body, make_motion, make_skeleton, motion_frames, retarget

WALK = sample_motions()["walk"]
TO_Z_UP = matrix_from_rotvec(np.array([np.pi / 2, 0.0, 0.0]))


def _movement_turned(motion: Motion) -> Motion:
    q = motion.q.copy()
    q[:, :3] = q[:, :3] @ TO_Z_UP.T
    q[:, 3:6] = rotvec_from_matrix(TO_Z_UP @ matrix_from_rotvec(q[:, 3:6]))
    return make_motion(motion.skeleton, q, motion.rate, motion.name)


def same_on_body(first: Motion, second: Motion) -> None:
    a, b = (motion_frames(retarget(motion)).positions for motion in (first, second))
    a, b = (p - p[:1, :1] * [1, 0, 1] for p in (a, b))
    distances = [np.linalg.norm(a - b @ turn.T, axis=-1).max() for turn in _headings()]
    assert min(distances) < 1e-3


def _headings() -> list[np.ndarray]:
    return [matrix_from_rotvec(np.array([0.0, k * np.pi / 2, 0.0])) for k in range(4)]


def saved(folder: Path, motion: Motion, unit: float = 0.01) -> Path:
    path = folder / "take.bvh"
    write_bvh(motion, path, unit)
    return path


def ran(*arguments: object):
    return CliRunner().invoke(build_app(), [str(argument) for argument in arguments])


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001, 0.0254, 0.0254 / 0.45, 0.3048])
@pytest.mark.parametrize("size", [0.85, 1.0, 1.15])
def test_units_are_told_by_limbs_whatever_hangs_above_the_hips(tmp_path, unit, size):
    body = average_body()
    names = ["Reference", *body.names]
    offsets = np.concatenate([np.zeros((1, 3)), body.offsets * size])
    offsets[1] = [0.0, 0.97 * size, 0.0]
    skeleton = make_skeleton(names, [-1, *(body.parents + 1).tolist()], offsets)
    read = read_bvh(saved(tmp_path, make_motion(skeleton, np.zeros((3, skeleton.size)), 30.0), unit))
    np.testing.assert_allclose(read.skeleton.offsets[2:], offsets[2:], atol=1e-6)
    assert read.conventions is not None
    assert (read.conventions.metres_per_unit, read.conventions.unit_origin) == (pytest.approx(unit), "guessed")


@pytest.mark.parametrize("whole", [True, False], ids=["zero pose too", "movement only"])
def test_z_up_files_stand(tmp_path, whole):
    turned = _movement_turned(WALK) if not whole else _whole_turned(WALK)
    read = read_bvh(saved(tmp_path, turned))
    assert read.conventions is not None
    assert (read.conventions.up, read.conventions.up_origin) == ("z", "guessed")
    same_on_body(read, WALK)


def _whole_turned(motion: Motion) -> Motion:
    q = motion.q.copy()
    q[:, :3] = q[:, :3] @ TO_Z_UP.T
    q[:, 3:] = (q[:, 3:].reshape(len(q), -1, 3) @ TO_Z_UP.T).reshape(len(q), -1)
    skeleton = motion.skeleton.with_offsets(motion.skeleton.offsets @ TO_Z_UP.T, motion.skeleton.tips @ TO_Z_UP.T)
    return make_motion(skeleton, q, motion.rate, motion.name)


@pytest.mark.parametrize("name", ["getup_faceup", "crawl", "roll", "cartwheel", "backflip"])
def test_who_lies_or_tumbles_in_a_y_up_file_stays_so(tmp_path, name):
    read = read_bvh(saved(tmp_path, sample_motions()[name]))
    assert read.conventions is not None
    assert read.conventions.up == "y"


@pytest.mark.parametrize("up", ["x", "z", "-x", "-y", "-z"])
def test_the_axis_can_be_given(tmp_path, up):
    read = read_motion(saved(tmp_path, WALK), up=up)
    axis = (-1 if up[0] == "-" else 1) * np.eye(3)["xyz".index(up[-1])]
    np.testing.assert_allclose(read.root_positions[:, 1], WALK.root_positions @ axis, atol=1e-6)
    with pytest.raises(FormatError, match="no axis"):
        read_motion(saved(tmp_path, WALK), up="w")


@pytest.mark.parametrize("size", [0.03, 4.5])
def test_what_no_unit_makes_a_human_is_refused_unless_told(tmp_path, size):
    body = average_body()
    skeleton = body.with_offsets(body.offsets * size, body.tips * size)
    path = saved(tmp_path, make_motion(skeleton, np.tile(WALK.q[0], (60, 1)), 30.0), 1.0)
    read = read_motion(path)
    with pytest.raises(FormatError, match="m tall"):
        check_human(read, path)
    refused = ran("simulate", path, "-o", tmp_path / "r.mcap")
    assert isinstance(refused.exception, PoseloomError)
    with pytest.raises(PoseloomError, match="m tall"):
        build_library([path], tmp_path / "lib", workers=1)
    check_human(read_motion(path, metres_per_unit=1 / size), path)
    assert ran("simulate", path, "-o", tmp_path / "r.mcap", "--unit", 1 / size).exit_code == 0


def test_guesses_are_told_by_info_convert_and_libraries(tmp_path):
    path = saved(tmp_path, _whole_turned(WALK), 0.0254)
    told = ran("info", path).output
    assert "inches, guessed" in told
    assert "z, guessed" in told
    assert "inches, guessed" in ran("convert", path, tmp_path / "out.npz").output
    assert "read as inches" in ran("library", "build", path, "-o", tmp_path / "lib", "--workers", 1).output
    assert open_library(tmp_path / "lib").clips[0].conventions == "inches (guessed), z up (guessed)"
    assert "y, given" in ran("info", path, "--up", "y").output
    assert "metres, given" in ran("info", path, "--unit", "m").output


@pytest.mark.parametrize("time", ["33.333", "2.5", "120", "0.0003"])
def test_impossible_frame_times_are_refused_unless_the_rate_is_told(tmp_path, time):
    path = saved(tmp_path, WALK)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(f"Frame Time: {time}" if line.startswith("Frame Time") else line for line in lines))
    with pytest.raises(FormatError, match="--source-rate") as caught:
        read_motion(path)
    assert time != "33.333" or "milliseconds" in str(caught.value)
    assert read_motion(path, rate=30.0).rate == 30.0


def _commas(text: str) -> bytes:
    return text.replace(".", ",").encode()


def _separated(mark: str):
    def change(text: str) -> bytes:
        head, motion = text.split("Frame Time:")
        first, rest = motion.split("\n", 1)
        return (head + "Frame Time:" + first + "\n" + rest.replace(" ", mark)).encode()

    return change


@pytest.mark.parametrize(
    "dialect",
    [
        _commas,
        lambda text: text.encode("utf-16"),
        lambda text: text.encode("utf-16-le"),
        lambda text: text.encode("utf-16-be"),
        lambda text: text.encode("utf-8-sig"),
        lambda text: text.replace("\n", "\t\n").encode(),
        lambda text: (text + "\n \t\n\n").encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
        _separated(","),
        _separated(", "),
        _separated(";"),
        _separated("\t"),
        lambda text: text.replace(" ", "\t").replace("Frame\tTime", "Frame Time").replace(".", ",").encode("utf-16"),
    ],
)
def test_dialects_of_text_are_read(tmp_path, dialect):
    path = saved(tmp_path, WALK)
    plain = read_motion(path)
    path.write_bytes(dialect(path.read_text()))
    again = read_motion(path)
    np.testing.assert_array_equal(again.q, plain.q)
    np.testing.assert_array_equal(again.skeleton.offsets, plain.skeleton.offsets)
    assert again.rate == plain.rate
