"""Exponential-map CSV and DeepMimic JSON: their conventions against scipy, and errors with the place."""

import json
import random
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poseloom.errors import FormatError, PoseloomError, SkeletonError
from poseloom.formats.deepmimic import deepmimic_skeleton, read_deepmimic
from poseloom.formats.expmap_csv import read_expmap
from poseloom.skeleton.kinematics import motion_frames

BONES = {
    "metres_per_unit": 0.5,
    "frame_rate_hz": 120,
    "up_axis": "y",
    "joints": [
        {"name": "Hips", "parent": None, "offset": [0, 0, 0]},
        {"name": "Leg", "parent": "Hips", "offset": [1, -2, 0.5]},
        {"name": "Leg_end", "parent": "Leg", "offset": [0, -3, 0]},
        {"name": "Spine", "parent": "Hips", "offset": [0, 2, 0]},
    ],
}
TABLE = """1,2,3,0.1,-0.2,0.3,-0.4,0,0,9,9,9,0,-0,1e-3
1,2,3,0.1,-0.2,0.4,-0.5,0,0,9,9,9,0,-0,2e-3
1,2,4,0.1,-0.2,0.5,-0.6,0,0,9,9,9,0,-0,3e-3
"""


def save_table(folder: Path, table: str = TABLE, bones: object = BONES) -> Path:
    (folder / "train" / "walk").mkdir(parents=True, exist_ok=True)
    (folder / "skeleton.json").write_text(json.dumps(bones) if not isinstance(bones, str) else bones)
    path = folder / "train" / "walk" / "walk_1.txt"
    path.write_text(table)
    return path


def test_exponential_maps_are_inverse_rotations(tmp_path):
    motion = read_expmap(save_table(tmp_path))
    assert motion.skeleton.names == ("Hips", "Leg", "Spine")
    assert motion.rate == 120.0
    np.testing.assert_allclose(motion.skeleton.offsets[1], [0.5, -1, 0.25])
    np.testing.assert_allclose(motion.skeleton.tips[1], [0, -1.5, 0])
    frames = motion_frames(motion)
    hips = Rotation.from_rotvec([-0.1, 0.2, -0.4])
    leg = hips * Rotation.from_rotvec([0.5, 0, 0])
    np.testing.assert_allclose(frames.rotations[1, 1], leg.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(
        frames.positions[1, 1], np.array([0.5, 1, 1.5]) + hips.apply([0.5, -1, 0.25]), atol=1e-12
    )
    given_skeleton = read_expmap(save_table(tmp_path), tmp_path / "skeleton.json")
    np.testing.assert_array_equal(given_skeleton.q, motion.q)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("0.4,-0.5", "nan,-0.5", 2, "'nan' is not a finite number"),
        ("0.4,-0.5", "1e999,-0.5", 2, "'1e999'"),
        ("0.4,-0.5", "-0.5", 2, "14 values, but 4 joints need 15"),
        ("0.5,-0.6", "0.5,-0.6,1", 3, "16 values"),
        (",", " ", None, "no commas"),
    ],
)
def test_table_errors_name_the_line(tmp_path, old, new, line, words):
    table = TABLE.replace(old, new) if old == "," else TABLE.replace(old, new, 1)
    path = save_table(tmp_path, table)
    with pytest.raises(FormatError) as caught:
        read_expmap(path)
    assert words in str(caught.value)
    assert (caught.value.file, caught.value.line) == (str(path), line)


@pytest.mark.parametrize(
    "bones",
    [
        "no json",
        "[]",
        "{}",
        {**BONES, "joints": []},
        {**BONES, "joints": "none"},
        {**BONES, "metres_per_unit": 0},
        {**BONES, "metres_per_unit": "wide"},
        {**BONES, "up_axis": "z"},
        {**BONES, "joints": [*BONES["joints"][:3], {"name": "Spine", "parent": "Hips", "offset": [0, 2]}]},
        {**BONES, "joints": [*BONES["joints"][:3], {"name": "Spine", "parent": "Nobody", "offset": [0, 2, 0]}]},
        {**BONES, "joints": [*BONES["joints"][:3], {"name": "Leg", "parent": "Hips", "offset": [0, 2, 0]}]},
        {**BONES, "joints": [BONES["joints"][0], {"name": "Leg", "parent": "Leg", "offset": [0, 2, 0]}]},
    ],
)
def test_bad_skeletons_are_named(tmp_path, bones):
    path = save_table(tmp_path, bones=bones)
    with pytest.raises((FormatError, SkeletonError)) as caught:
        read_expmap(path)
    assert caught.value.file == str(tmp_path / "skeleton.json")


def test_a_table_without_skeleton(tmp_path):
    path = save_table(tmp_path)
    (tmp_path / "skeleton.json").unlink()
    with pytest.raises(FormatError, match=r"skeleton\.json"):
        read_expmap(path)


def test_every_truncated_table_reads_or_tells_why(tmp_path):
    for end in range(len(TABLE)):
        path = save_table(tmp_path, TABLE[:end])
        try:
            assert 1 <= len(read_expmap(path)) <= 3
        except PoseloomError as error:
            assert error.file == str(path)  # noqa: PT017


def pose(duration: float, seed: int) -> list[float]:
    rng = np.random.default_rng(seed)
    values = [duration, *rng.normal(size=3)]
    for count in (4, 4, 4, 4, 1, 4, 4, 1, 4, 1, 4, 4, 1):
        part = rng.normal(size=count)
        values += list(part / np.linalg.norm(part) if count == 4 else part)
    return values


def save_clip(folder: Path, frames: object, **more: object) -> Path:
    path = folder / "clip.txt"
    path.write_text(json.dumps({"Loop": "wrap", "Frames": frames, **more}))
    return path


FRONT = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
"""From DeepMimic's axes to ours: its front +X becomes +Z, its right +Z becomes -X."""


def test_deepmimic_joints_against_scipy(tmp_path):
    rows = [pose(0.0333333, seed) for seed in range(4)]
    motion, cyclic = read_deepmimic(save_clip(tmp_path, rows))
    assert cyclic
    assert motion.rate == 30.0
    frames, names = motion_frames(motion), motion.skeleton.names
    row = np.array(rows[2])
    order = ("chest", "neck", "right_hip", "right_knee", "right_ankle", "right_shoulder", "right_elbow")
    order += ("left_hip", "left_knee", "left_ankle", "left_shoulder", "left_elbow")
    theirs = {"root": Rotation.from_quat(row[4:8], scalar_first=True)}
    column = 8
    for name in order:
        hinge = name.endswith(("knee", "elbow"))
        turn = Rotation.from_euler("z", row[column]) if hinge else None
        turn = turn or Rotation.from_quat(row[column : column + 4], scalar_first=True)
        column += 1 if hinge else 4
        theirs[name] = theirs[names[motion.skeleton.parents[names.index(name)]]] * turn
    assert column == 44
    for name, turn in theirs.items():
        expected = FRONT @ turn.as_matrix() @ FRONT.T
        np.testing.assert_allclose(frames.rotations[2, names.index(name)], expected, atol=1e-12)
    np.testing.assert_allclose(motion.root_positions[2], FRONT @ row[1:4], atol=1e-12)


def test_the_humanoid_stands_as_a_person():
    skeleton = deepmimic_skeleton()
    rest = dict(zip(skeleton.names, skeleton.rest_positions(), strict=True))
    assert rest["left_hip"][0] > 0.08 > -0.08 > rest["right_hip"][0]
    assert rest["left_wrist"][1] < rest["left_elbow"][1] < rest["left_shoulder"][1]
    assert rest["left_shoulder"][0] == pytest.approx(rest["left_wrist"][0])
    assert skeleton.tips[skeleton.index("left_ankle")][2] > 0.1
    assert rest["neck"][1] - rest["left_ankle"][1] == pytest.approx(1.29, abs=0.01)
    assert skeleton.locked[skeleton.index("left_knee")].tolist() == [False, True, True]


def test_uneven_durations_are_evened_out(tmp_path):
    """The root walks and turns steadily; its frames come at uneven times."""
    durations = [0.02, 0.02, 0.02, 0.05, 0.02, 0.013, 0.02, 0.0]
    times = np.concatenate([[0], np.cumsum(durations[:-1])])
    rows = []
    for time, duration in zip(times, durations, strict=True):
        row = pose(duration, 1)
        row[1:4] = [2 * time, 0.9, -time]
        row[4:8] = Rotation.from_euler("y", 3 * time).as_quat(scalar_first=True).tolist()
        rows.append(row)
    motion = read_deepmimic(save_clip(tmp_path, rows)).motion
    assert motion.rate == 50.0
    assert len(motion) == int(times[-1] * 50) + 1
    steady = np.arange(len(motion)) / 50
    np.testing.assert_allclose(motion.root_positions[:, 2], 2 * steady, atol=1e-12)
    np.testing.assert_allclose(motion.rotvecs[:, 0, 1], 3 * steady, atol=1e-12)


def test_a_clip_that_does_not_repeat(tmp_path):
    path = save_clip(tmp_path, [pose(0.0, 1)])
    path.write_text(path.read_text().replace("wrap", "none"))
    motion, cyclic = read_deepmimic(path)
    assert (len(motion), cyclic) == (1, False)


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([], "at least one frame"),
        ("many", "at least one frame"),
        ([pose(0.1, 1), pose(0.1, 2)[:43]], "frame 1 has 43 values instead of 44"),
        ([pose(0.1, 1), 3], "frame 1 has 0 values"),
        ([pose(0.1, 1), [*pose(0.1, 2)[:43], "x"]], "frame 1 holds something that is no number"),
        ([pose(0.1, 1), [*pose(0.1, 2)[:43], True]], "frame 1 holds something that is no number"),
        ([pose(0.1, 1), [*pose(0.1, 2)[:43], float("nan")]], "frame 1 holds a number that is not finite"),
        ([pose(0.1, 1), [*pose(0.1, 2)[:43], 10**400]], "not finite"),
        ([pose(0.1, 1), pose(0.0, 2), pose(0.1, 3)], "frame 1 lasts 0 s"),
        ([pose(-0.1, 1), pose(0.1, 3)], "frame 0 lasts -0.1 s"),
        (
            [pose(0.1, 1), [0.1, 0, 0, 0, 0, 0, 0, 0, *pose(0.1, 2)[8:]]],
            "frame 1 the quaternion of root is nearly zero",
        ),
    ],
)
def test_deepmimic_errors_name_the_frame(tmp_path, frames, words):
    path = save_clip(tmp_path, frames)
    with pytest.raises(FormatError) as caught:
        read_deepmimic(path)
    assert words in str(caught.value)
    assert caught.value.file == str(path)


@pytest.mark.parametrize("content", ["", "{", "[1, 2]", "{}", '{"Frames": [}', "[" * 100_000, "\x00\xff"])
def test_what_is_no_clip(tmp_path, content):
    path = tmp_path / "clip.txt"
    path.write_text(content)
    with pytest.raises(FormatError, match=r"clip\.txt"):
        read_deepmimic(path)


def test_damaged_clips_read_or_tell_why(tmp_path):
    whole = save_clip(tmp_path, [pose(0.02, seed) for seed in range(3)]).read_text()
    path = tmp_path / "clip.txt"
    for end in range(0, len(whole), 7):
        path.write_text(whole[:end])
        with pytest.raises(FormatError):
            read_deepmimic(path)
    rng = random.Random(5)
    for _ in range(300):
        content = bytearray(whole.encode())
        for _ in range(rng.randint(1, 3)):
            content[rng.randrange(len(content))] = rng.choice(b'0123456789.-e,[]{}" \xff')
        path.write_bytes(content)
        try:
            read_deepmimic(path)
        except PoseloomError as error:
            assert error.file == str(path)  # noqa: PT017
