"""BVH: any channel order, exact round trips, units told from the body's size, and errors that name the line."""

import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from counting import calls_of
from poseloom.errors import FormatError, PoseloomError, SkeletonError
from poseloom.formats._numbers import scan
from poseloom.formats.bvh import read_bvh, write_bvh
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import make_skeleton

SMALL = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 10.5 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 50 0
    }
  }
  JOINT Leg
  {
    OFFSET 5 -90 1e-1
    CHANNELS 3 Yrotation Xrotation Zrotation
    End Site
    {
      OFFSET 0 0 12
    }
  }
}
MOTION
Frames: 3
Frame Time: .0083333
1 90 2 10 20 30 1 2 3 -4 5 6
1.5 91 2 11 21 31 1 2 3 -4 5 6
2 92 2 12 22 32 1 2 3.25e0 -4 5 -6e-1
"""


def save(folder: Path, text: str | bytes, name: str = "take.bvh") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def wandering_motion(seed: int, joints: int = 9, frames: int = 20, moving: bool = False) -> Motion:
    """A random tree in random motion; its joints stand in the order in which a BVH file lists them."""
    rng = np.random.default_rng(seed)
    parents = [-1]
    branch = [0]
    for joint in range(1, joints):
        branch = branch[: int(rng.integers(1, len(branch) + 1))]
        parents.append(branch[-1])
        branch.append(joint)
    offsets = rng.normal(size=(joints, 3)) * 0.3
    offsets[0] = 0
    leaves = [joint for joint in range(joints) if joint not in parents]
    tips = {f"joint {leaf}": rng.normal(size=3) * 0.1 for leaf in leaves}
    skeleton = make_skeleton([f"joint {joint}" for joint in range(joints)], parents, offsets, tips)
    q = rng.normal(size=skeleton.size) + np.cumsum(rng.normal(size=(frames, skeleton.size)) * 0.3, axis=0)
    moves = np.zeros((frames, joints, 3))
    if moving:
        moves[:, 1::2] = rng.normal(size=moves[:, 1::2].shape) * 0.1
    return make_motion(skeleton, q, float(rng.integers(1, 240)), "wandering", moves if moving else None)


def assert_same_movement(first: Motion, second: Motion, tolerance: float = 1e-6) -> None:
    assert first.skeleton.names == second.skeleton.names
    assert first.skeleton.parents.tolist() == second.skeleton.parents.tolist()
    one, two = motion_frames(first), motion_frames(second)
    np.testing.assert_allclose(one.positions, two.positions, atol=tolerance)
    np.testing.assert_allclose(one.rotations, two.rotations, atol=tolerance)
    np.testing.assert_allclose(first.skeleton.tips, second.skeleton.tips, atol=tolerance)
    assert first.rate == pytest.approx(second.rate, rel=1e-12)


@given(st.integers(0, 10**6), st.permutations("XYZ").map("".join), st.booleans(), st.sampled_from([0.01, 1.0, 0.0254]))
@settings(max_examples=60, deadline=None)
def test_a_motion_survives_the_way_through_a_file(tmp_path_factory, seed, order, moving, unit):
    motion = wandering_motion(seed, moving=moving)
    path = tmp_path_factory.mktemp("bvh") / "motion.bvh"
    write_bvh(motion, path, unit, order)
    again = read_bvh(path, unit)
    assert_same_movement(motion, again)
    assert again.name == "motion"
    assert (again.displacements is None) == (not moving)


def test_angles_at_the_gimbal_lock_survive(tmp_path):
    skeleton = make_skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [0, 1, 0]])
    for order in ("ZXY", "XYZ", "YZX"):
        middle = np.linspace(88, 92, 41)
        matrices = Rotation.from_euler(order, np.stack([np.full(41, 30.0), middle, np.full(41, -50.0)], 1), True)
        q = np.zeros((41, 9))
        q[:, 3:6] = matrices.as_rotvec()
        motion = make_motion(skeleton, q, 30.0)
        write_bvh(motion, tmp_path / "lock.bvh", order=order)
        assert_same_movement(motion, read_bvh(tmp_path / "lock.bvh", 0.01), 1e-6)


def test_written_angles_do_not_jump(tmp_path):
    body = average_body()
    q = np.zeros((200, body.size))
    q[:, 4] = np.linspace(0, 6 * np.pi, 200)
    write_bvh(make_motion(body, q, 60.0, "turns"), tmp_path / "turns.bvh")
    rows = [line.split() for line in (tmp_path / "turns.bvh").read_text().partition("Frame Time")[2].splitlines()[1:]]
    assert np.abs(np.diff(np.array(rows, dtype=float), axis=0)).max() < 10
    again = read_bvh(tmp_path / "turns.bvh")
    np.testing.assert_allclose(again.q[:, 4], q[:, 4], atol=1e-6)


CHANNELS = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ"]


@st.composite
def channel_lists(draw: st.DrawFn) -> list[str]:
    positions = draw(st.lists(st.sampled_from(CHANNELS[:3]), unique=True, max_size=3))
    turns = draw(st.lists(st.sampled_from(CHANNELS[3:]), max_size=3))
    return draw(st.permutations(positions + turns))


@given(st.lists(channel_lists(), min_size=1, max_size=5), st.integers(0, 10**6))
@settings(max_examples=80, deadline=None)
def test_channels_in_any_order_and_number(tmp_path_factory, channels, seed):
    """Oracle: scipy's Euler angles and a walk down a chain, position channels in the place of offsets."""
    assume(sum(map(len, channels)) > 0)
    rng = np.random.default_rng(seed)
    offsets = np.round(rng.normal(size=(len(channels), 3)) * 20, 3)
    offsets[0] = 0
    values = np.round(rng.uniform(-200, 200, size=(4, sum(map(len, channels)))), 4)
    text = chain_text(channels, offsets, values)
    positions, matrices = walk_chain(channels, offsets, values)
    motion = read_bvh(save(tmp_path_factory.mktemp("bvh"), text), 0.01)
    frames = motion_frames(motion)
    np.testing.assert_allclose(frames.positions, positions * 0.01, atol=1e-9)
    np.testing.assert_allclose(frames.rotations, matrices, atol=1e-9)


def chain_text(channels, offsets, values) -> str:
    lines = ["HIERARCHY"]
    for joint, names in enumerate(channels):
        lines += [f"{'JOINT' if joint else 'ROOT'} j{joint}", "{", "OFFSET " + " ".join(map(str, offsets[joint]))]
        lines += [f"CHANNELS {len(names)} {' '.join(names)}"]
    lines += ["End Site", "{", "OFFSET 0 0 0", "}"] + ["}"] * len(channels)
    lines += ["MOTION", f"Frames: {len(values)}", "Frame Time: 0.04"]
    return "\n".join(lines + [" ".join(map(str, row)) for row in values]) + "\n"


def walk_chain(channels, offsets, values):
    positions, matrices = np.empty((len(values), len(channels), 3)), np.empty((len(values), len(channels), 3, 3))
    for frame, row in enumerate(values):
        place, matrix, column = np.zeros(3), np.eye(3), 0
        for joint, names in enumerate(channels):
            move, turn = np.array(offsets[joint]), np.eye(3)
            for name in names:
                axis, value = "XYZ".index(name[0]), row[column]
                column += 1
                if name.endswith("position"):
                    move[axis] = value
                else:
                    turn = turn @ Rotation.from_euler(name[0], value, degrees=True).as_matrix()
            place, matrix = place + matrix @ move, matrix @ turn
            positions[frame, joint], matrices[frame, joint] = place, matrix
    return positions, matrices


def test_the_small_file(tmp_path):
    motion = read_bvh(save(tmp_path, SMALL), 0.01)
    assert motion.skeleton.names == ("Hips", "Spine", "Leg")
    assert motion.rate == 120.0
    np.testing.assert_allclose(motion.root_positions[1], [0.015, 0.91, 0.02])
    np.testing.assert_allclose(motion.skeleton.offsets[2], [0.05, -0.9, 0.001])
    np.testing.assert_allclose(motion.skeleton.tips[2], [0, 0, 0.12])
    expected = Rotation.from_euler("YXZ", [-4, 5, -0.6], degrees=True).as_rotvec()
    np.testing.assert_allclose(motion.rotvecs[2, 2], expected, atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("\n", " \t\n"),
        lambda text: text.replace("  ", "\t").replace(" ", "\t"),
        lambda text: text.replace("\n{", " {").replace("End Site\n", "End Site "),
        lambda text: text.lower().replace("hips", "Hips").replace("spine", "Spine").replace("leg", "Leg"),
        lambda text: text.upper().replace("HIPS", "Hips").replace("SPINE", "Spine").replace("LEG", "Leg"),
        lambda text: "\ufeff" + text,
        lambda text: text + "\n\n  \n",
        lambda text: text.removesuffix("\n"),
        lambda text: text.replace("MOTION\n", "MOTION\n\n").replace("Frames: 3\n", "Frames: 3\n\n"),
        lambda text: text.replace("End Site", "End Site top"),
        lambda text: text.replace("Frames: 3", "Frames:\t3").replace("Frame Time: ", "Frame Time:\t"),
        lambda text: text.replace("1.5 91", "+1.50000000000000000000 9.1e+1"),
    ],
)
def test_spellings_of_the_same_file(tmp_path, change):
    plain = read_bvh(save(tmp_path, SMALL, "plain.bvh"))
    other = read_bvh(save(tmp_path, change(SMALL), "other.bvh"))
    assert other.skeleton.names == plain.skeleton.names
    np.testing.assert_array_equal(other.q, plain.q)
    assert other.rate == plain.rate


def test_names_may_hold_blanks_and_latin_letters(tmp_path):
    text = SMALL.replace("Spine", "Rücken oben").encode("latin-1")
    assert read_bvh(save(tmp_path, text)).skeleton.names[1] == "Rücken oben"


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        (".0083333", 120.0),
        ("0.00833333", 120.0),
        ("0.0083", 120.0),
        ("0.0333333", 30.0),
        ("0.033", 30.0),
        ("0.016667", 60.0),
        ("0.01", 100.0),
        ("0.04", 25.0),
        ("0.03336667", 1 / 0.03336667),
        ("1e-2", 100.0),
        ("1", 1.0),
    ],
)
def test_rounded_frame_times_mean_whole_rates(tmp_path, text, rate):
    assert read_bvh(save(tmp_path, SMALL.replace(".0083333", text))).rate == rate


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001, 0.0254, 0.0254 / 0.45])
@pytest.mark.parametrize("size", [0.75, 1.0, 1.2])
def test_the_unit_is_told_from_the_size(tmp_path, unit, size):
    body = average_body()
    body = body.with_offsets(body.offsets * size, body.tips * size)
    motion = make_motion(body, np.zeros((2, body.size)), 30.0)
    write_bvh(motion, tmp_path / "rest.bvh", unit)
    np.testing.assert_allclose(read_bvh(tmp_path / "rest.bvh").skeleton.offsets, body.offsets, atol=1e-7)


def test_what_is_no_person_is_in_centimetres(tmp_path):
    skeleton = make_skeleton(["cup", "lid"], [-1, 0], [[0, 0, 0], [0, 0.1, 0]])
    write_bvh(make_motion(skeleton, np.ones((2, 9)), 30.0), tmp_path / "cup.bvh")
    np.testing.assert_allclose(read_bvh(tmp_path / "cup.bvh").skeleton.offsets[1], [0, 0.1, 0])


def test_a_place_above_the_hips_is_no_bone(tmp_path):
    """As in Bandai's files: a root above the hips, whose OFFSET is where the actor stood."""
    text = SMALL.replace("ROOT Hips\n{", "ROOT World\n{\nOFFSET 0 0 0\nCHANNELS 0\nJOINT Hips\n{\n").replace(
        "}\nMOTION", "}\n}\nMOTION"
    )
    text = text.replace("OFFSET 0 0 0\n  CHANNELS 6", "OFFSET 1 90 -400\n  CHANNELS 6")
    motion = read_bvh(save(tmp_path, text))
    assert motion.displacements is not None
    np.testing.assert_array_equal(motion.skeleton.offsets[1], 0)
    plain = motion_frames(read_bvh(save(tmp_path, SMALL, "plain.bvh")))
    np.testing.assert_allclose(motion_frames(motion).positions[:, 1:], plain.positions, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("HIERARCHY", "HIERARCHIE", 1, "begins with the word HIERARCHY"),
        ("ROOT Hips", "JOINT Hips", 2, "first joint must be the ROOT"),
        ("JOINT Leg", "ROOT Leg", 15, "second ROOT"),
        ("ROOT Hips\n", "ROOT Hips\n}\n", 3, "no opening brace"),
        ("OFFSET 0 10.5 0", "OFFSET 0 10.5", 9, "'CHANNELS' is none"),
        ("OFFSET 0 10.5 0", "OFFSET 0 nan 0", 8, "not finite"),
        ("    OFFSET 0 10.5 0\n", "", 13, "no OFFSET"),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 4 Zrotation Xrotation Yrotation", 10, "'End' where one"),
        ("CHANNELS 3 Zrotation", "CHANNELS 3 Wrotation", 9, "'Wrotation'"),
        ("CHANNELS 6 Xposition", "CHANNELS 6 Yposition", 5, "doubled position"),
        ("CHANNELS 3 Z", "CHANNELS x Z", 9, "number from 0 to 6"),
        ("    End Site\n    {\n      OFFSET 0 50 0\n", "    End Site\n    {\n      TIP 0 50 0\n", 12, "End Site holds"),
        ("JOINT Leg", "BONE Leg", 15, "'BONE' is not a word"),
        ("}\nMOTION", "}\n}\nMOTION", 24, "instead of MOTION"),
        ("}\nMOTION", "MOTION", None, "ends where"),
        ("Frames: 3", "Frames: 0", 26, "number of frames is '0'"),
        ("Frames: 3", "Frames: many", 26, "'many'"),
        ("Frames: 3", "Count: 3", 26, "'Frames:' and a number"),
        ("Frame Time: .0083333", "Frame Time: 0", 27, "frame time is '0'"),
        ("Frame Time: .0083333", "Frame Time: -0.01", 27, "'-0.01'"),
        ("Frame Time: .0083333", "Frame Time: nan", 27, "'nan'"),
        ("Frame Time: .0083333", "Frame Time: inf", 27, "'inf'"),
        ("Frame Time: .0083333\n", "", 27, "'Frame Time:'"),
        ("1.5 91", "1.5 nan", 29, "'nan' is not a finite number"),
        ("1.5 91", "1.5 -inf", 29, "'-inf'"),
        ("1.5 91", "1.5 1e999", 29, "'1e999'"),
        ("1.5 91", "1.5 9x", 29, "'9x'"),
        ("1.5 91", "91", 29, "11 values, but the hierarchy has 12"),
        ("1.5 91", "1.5 1.5 91", 29, "13 values"),
        ("Frames: 3", "Frames: 4", 30, "3 whole ones follow"),
        ("Frames: 3", "Frames: 2", 30, "'Frames:' is wrong"),
        ("\n2 92 2", "\n2 92 2\n", 30, "3 values"),
    ],
)
def test_errors_name_the_line(tmp_path, old, new, line, words):
    assert old in SMALL
    path = save(tmp_path, SMALL.replace(old, new, 1))
    with pytest.raises(FormatError) as caught:
        read_bvh(path)
    assert words in str(caught.value)
    assert caught.value.file == str(path)
    if line is not None:
        assert caught.value.line == line
    assert caught.value.remedy


def test_joints_with_one_name_are_refused(tmp_path):
    path = save(tmp_path, SMALL.replace("Leg", "Spine"))
    with pytest.raises(SkeletonError, match="Spine") as caught:
        read_bvh(path)
    assert caught.value.file == str(path)


@pytest.mark.parametrize("content", [b"", b"  \n", bytes(range(256)) * 20, b"\x00" * 100, b"HIERARCHY", b"MOTION\n"])
def test_what_is_no_bvh(tmp_path, content):
    with pytest.raises(FormatError, match=r"take\.bvh"):
        read_bvh(save(tmp_path, content))


def test_every_truncation_reads_or_tells_why(tmp_path):
    for end in range(len(SMALL)):
        path = save(tmp_path, SMALL[:end])
        try:
            motion = read_bvh(path)
        except PoseloomError as error:
            assert error.file == str(path)  # noqa: PT017
            assert error.remedy  # noqa: PT017
        else:
            # Only figures of the last number can be missing without a trace.
            assert len(motion) == 3
            assert end >= len(SMALL) - len(".6e-1\n") - 1


def test_damaged_bytes_read_or_tell_why(tmp_path):
    rng = random.Random(7)
    for _ in range(600):
        content = bytearray(SMALL.encode())
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(content))
            content[at : at + rng.choice([0, 1, 5, 40])] = rng.randbytes(rng.choice([0, 1, 3]))
        try:
            read_bvh(save(tmp_path, bytes(content)))
        except PoseloomError as error:
            assert error.file  # noqa: PT017


def test_very_deep_and_wide_hierarchies(tmp_path):
    channels = [["Zrotation"]] * 2000
    text = chain_text(channels, np.ones((2000, 3)), np.ones((1, 2000)))
    assert len(read_bvh(save(tmp_path, text)).skeleton) == 2000


def test_twenty_thousand_nested_joints_are_read_in_two_seconds(tmp_path):
    """Of this work's own time, whatever else the machine does, and without the checks of types that tests add."""
    count = 20_000
    channels = [["Zrotation", "Xrotation", "Yrotation"]] * count
    deep = save(tmp_path, chain_text(channels, np.full((count, 3), 0.1), np.ones((2, 3 * count))), "deep.bvh")
    script = (
        "import sys, time; from pathlib import Path; from poseloom.formats.bvh import read_bvh; "
        "read_bvh(Path(sys.argv[1])); begin = time.process_time(); size = len(read_bvh(Path(sys.argv[2])).skeleton); "
        "print(size, time.process_time() - begin)"
    )
    command = [sys.executable, "-c", script, str(save(tmp_path, SMALL)), str(deep)]
    joints, seconds = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert int(joints) == count
    assert float(seconds) < 2


def test_texts_of_more_numbers_than_memory_is_taken_for_are_refused(tmp_path):
    head = SMALL[: SMALL.index("Frames:")] + "Frames: 9\nFrame Time: 0.04\n"
    with pytest.raises(FormatError, match="more than memory is taken for") as raised:
        read_bvh(save(tmp_path, head.encode() + b"0 " * 28_000_000))
    assert raised.value.file == str(tmp_path / "take.bvh")


def test_writing_is_whole_or_not_at_all(tmp_path):
    motion = wandering_motion(1)
    target = save(tmp_path, "old", "old.bvh")
    with pytest.raises(FormatError, match="order of rotations"):
        write_bvh(motion, target, order="ZXZ")
    with pytest.raises(FormatError, match="cannot be written"):
        write_bvh(motion, tmp_path / "missing" / "new.bvh")
    braces = make_skeleton(["a", "b {"], [-1, 0], np.ones((2, 3)))
    with pytest.raises(FormatError, match="cannot stand in a BVH file"):
        write_bvh(make_motion(braces, np.zeros((1, 9)), 30.0), target)
    assert [file.name for file in tmp_path.iterdir()] == ["old.bvh"]
    assert target.read_text() == "old"


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(["%r", "%.6f", "%.3e", "%.17g", "%.25f"]))
@settings(max_examples=300)
def test_numbers_are_read_exactly(value, pattern):
    text = pattern % value
    assert scan(text.encode()).values.tolist() == [float(text)]


@pytest.mark.parametrize("text", ["nan", "inf", "1e", "1.2.3", "--3", "+", ".", "0x10", "1d5", "e5", "1_0", "٣"])
def test_what_is_no_number_is_a_word(text):
    tokens = scan(f"1 {text},\n2".encode())
    assert np.isnan(tokens.values).tolist() == [False, True, False]
    assert tokens.lines.tolist() == [1, 1, 2]


def test_reading_does_not_go_through_frames_one_by_one(tmp_path):
    """As many calls for 3,000 frames as for 300: counted, for how long they take depends on the machine."""
    counts: list[int] = []
    for frames in (300, 3000):
        path = tmp_path / f"{frames}.bvh"
        write_bvh(wandering_motion(3, joints=31, frames=frames), path)
        read_bvh(path, 0.01)
        counts.append(calls_of(lambda path=path: read_bvh(path, 0.01)))
    assert counts[1] < counts[0] + 300
