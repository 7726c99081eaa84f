"""ASF/AMC: units, axes and orders against an oracle, the same recordings in two formats, and errors with lines."""

import itertools
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poseloom.errors import FormatError, PoseloomError, SkeletonError
from poseloom.formats.asf_amc import find_asf, read_amc, read_asf
from poseloom.formats.bvh import read_bvh
from poseloom.skeleton.kinematics import motion_frames

SECTIONS = {
    "version": ":version 1.10\n",
    "units": ":units\n  mass 1.0\n  length 0.45\n  angle deg\n",
    "documentation": ":documentation\n  no bones here: begin end\n",
    "root": ":root\n  order TX TY TZ RX RY RZ\n  axis XYZ\n  position 0 0 0\n  orientation 0 0 0\n",
    "bonedata": """:bonedata
  begin
    id 1
    name hip   # a joint without freedom
    direction 0.6 -0.8 0
    length 2
    axis 0 0 0 XYZ
  end
  begin
    id 2
    name thigh
    direction 0 -2 0
    length 7
    axis 10 -20 30 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
    id 3
    name shank
    direction 0 -1 0
    length 8
    axis 15 90 -30 ZXY
    dof rz
  end
""",
    "hierarchy": ":hierarchy\n  begin\n    root hip\n    hip thigh\n    thigh shank\n  end\n",
}
ASF = "# a comment in Köln\n" + "".join(SECTIONS.values())
AMC = """#!OML:ASF X:\\für Bonn\\take.ASF
:FULLY-SPECIFIED
:DEGREES
1
root 1 17 3 10 20 30
thigh 5 6 7
shank -40
2
root 1.5 17 3 11 21 31
thigh 5.5 6 7e0
shank -41
3
root 2 17 3.03e-015 12 22 32
thigh 6 6 7
shank -42
"""
UNIT = 0.0254 / 0.45


def save(folder: Path, asf: str = ASF, amc: str = AMC, encoding: str = "latin-1") -> Path:
    (folder / "take.asf").write_bytes(asf.encode(encoding))
    (folder / "take.amc").write_bytes(amc.encode(encoding))
    return folder / "take.amc"


def euler(axes: str, angles) -> np.ndarray:
    """Turns about still axes, the first named first (scipy's small letters)."""
    return Rotation.from_euler(axes.lower(), angles, degrees=True).as_matrix()


def expected_frames(row) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations of root, hip, thigh and shank, by the format's definition: L = C M C^-1."""
    place = np.array(row[:3]) * UNIT
    root = euler("xyz", row[3:6])
    axes_thigh, axes_shank = euler("xyz", [10, -20, 30]), euler("zxy", [-30, 15, 90])
    thigh = root @ axes_thigh @ euler("xyz", row[6:9]) @ axes_thigh.T
    shank = thigh @ axes_shank @ euler("z", row[9]) @ axes_shank.T
    knee = place + root @ np.array([0.6, -0.8, 0]) * 2 * UNIT
    foot = knee + thigh @ np.array([0, -7, 0]) * UNIT
    return np.stack([place, place, knee, foot]), np.stack([root, root, thigh, shank])


ROWS = [
    [1, 17, 3, 10, 20, 30, 5, 6, 7, -40],
    [1.5, 17, 3, 11, 21, 31, 5.5, 6, 7, -41],
    [2, 17, 3.03e-15, 12, 22, 32, 6, 6, 7, -42],
]


def assert_take(path: Path, skeleton: Path | None = None) -> None:
    motion = read_amc(path, skeleton)
    frames = motion_frames(motion)
    for frame, row in enumerate(ROWS):
        positions, rotations = expected_frames(row)
        np.testing.assert_allclose(frames.positions[frame], positions, atol=1e-12)
        np.testing.assert_allclose(frames.rotations[frame], rotations, atol=1e-12)
    assert motion.skeleton.names == ("root", "hip", "thigh", "shank")
    np.testing.assert_allclose(motion.skeleton.tips[3], [0, -8 * UNIT, 0])
    assert np.isnan(motion.skeleton.tips[:3]).all()
    assert motion.skeleton.locked.tolist() == [[False] * 3, [True] * 3, [False] * 3, [False] * 3]
    assert motion.rate == 120.0
    assert motion.name == "take"


def test_a_take_against_the_format_definition(tmp_path):
    assert_take(save(tmp_path))


@pytest.mark.parametrize("order", list(itertools.permutations(["units", "root", "bonedata", "hierarchy"]))[::3])
def test_sections_in_any_order(tmp_path, order):
    assert_take(save(tmp_path, "".join(SECTIONS[name] for name in order)))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("  order TX TY TZ RX RY RZ\n", ""),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("  ", "\t"),
        lambda text: text.replace("direction 0.6 -0.8 0", "direction (0.6, -0.8, 0)"),
        lambda text: text.replace("TX TY TZ RX", "tx ty tz rx").replace(":units", ":UNITS").replace("begin", "Begin"),
        lambda text: text.replace(":documentation", ":skin\n some.obj\n:documentation"),
        lambda text: text.replace(SECTIONS["root"], ""),
    ],
)
def test_spellings_of_the_same_skeleton(tmp_path, change):
    assert change(ASF) != ASF
    assert_take(save(tmp_path, change(ASF)))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(" ", "\t"),
        lambda text: text.replace("root 1.5", "# in between\nroot 1.5"),
        lambda text: text.replace("thigh 5.5 6 7e0\nshank -41", "shank -41\nthigh 5.5 6 7e0"),
        lambda text: text.replace("\n2\n", "\n\n  2\n"),
        lambda text: text.replace(":FULLY-SPECIFIED\n:DEGREES\n", ""),
        lambda text: text.replace("\n1\n", "\n101\n").replace("\n2\n", "\n102\n").replace("\n3\n", "\n103\n"),
        lambda text: text.replace("\nshank -4", "\nhip\nshank -4"),
    ],
)
def test_spellings_of_the_same_motion(tmp_path, change):
    assert change(AMC) != AMC
    assert_take(save(tmp_path, amc=change(AMC)))


def test_radians_and_inches(tmp_path):
    degrees = read_amc(save(tmp_path))
    asf = ASF.replace("length 0.45", "length 1.0").replace("angle deg", "angle rad")
    for numbers in ("10 -20 30", "15 90 -30"):
        asf = asf.replace(
            f"axis {numbers}", "axis " + " ".join(repr(float(np.deg2rad(float(n)))) for n in numbers.split())
        )
    amc = AMC.replace(":DEGREES", ":RADIANS")
    lines = []
    for line in amc.splitlines():
        words = line.split()
        if words and words[0] in ("root", "thigh", "shank"):
            skip = 4 if words[0] == "root" else 1
            words[skip:] = [repr(float(np.deg2rad(float(word)))) for word in words[skip:]]
        lines.append(" ".join(words))
    radians = read_amc(save(tmp_path, asf, "\n".join(lines)))
    np.testing.assert_allclose(radians.rotvecs, degrees.rotvecs, atol=1e-12)
    np.testing.assert_allclose(radians.root_positions, degrees.root_positions * 0.45, atol=1e-12)
    np.testing.assert_allclose(radians.skeleton.offsets, degrees.skeleton.offsets * 0.45, atol=1e-12)


@given(st.permutations(["tx", "ty", "tz", "rx", "ry", "rz"]), st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_the_root_in_any_order(tmp_path_factory, order, count):
    """Turns are made about still axes in the order of the list; axes that are not listed stay."""
    folder = tmp_path_factory.mktemp("asf")
    order = order[:count]
    values = np.round(np.random.default_rng(count).uniform(-170, 170, size=count), 3)
    asf = ASF.replace("order TX TY TZ RX RY RZ", "order " + " ".join(order))
    amc = "1\n" + f"root {' '.join(map(str, values))}\nthigh 0 0 0\nshank 0\n"
    motion = read_amc(save(folder, asf, amc))
    matrix, place = np.eye(3), np.zeros(3)
    for dof, value in zip(order, values, strict=True):
        if dof[0] == "t":
            place["xyz".index(dof[1])] = value * UNIT
        else:
            matrix = euler(dof[1], value) @ matrix
    frames = motion_frames(motion)
    np.testing.assert_allclose(frames.rotations[0, 0], matrix, atol=1e-12)
    np.testing.assert_allclose(frames.positions[0, 0], place, atol=1e-12)


def test_a_hinge_about_an_axis_of_the_rest_frame_locks_the_others(tmp_path):
    path = save(tmp_path, ASF.replace("axis 15 90 -30 ZXY", "axis 0 90 0 XYZ"))
    assert read_amc(path).skeleton.locked[3].tolist() == [False, True, True]


def test_bones_that_move_are_displaced_along_their_axes(tmp_path):
    asf = ASF.replace("dof rx ry rz", "dof rx ry rz tx")
    amc = AMC.replace("thigh 5 6 7", "thigh 5 6 7 2").replace("thigh 5.5 6 7e0", "thigh 5.5 6 7 0")
    motion = read_amc(save(tmp_path, asf, amc.replace("thigh 6 6 7", "thigh 6 6 7 0")))
    assert motion.displacements is not None
    expected = euler("xyz", [10, -20, 30]) @ np.array([2 * UNIT, 0, 0])
    np.testing.assert_allclose(motion.displacements[0, 2], expected, atol=1e-12)


def test_the_root_position_is_added(tmp_path):
    plain = read_amc(save(tmp_path))
    shifted = read_amc(save(tmp_path, ASF.replace("position 0 0 0", "position 1 2 3")))
    np.testing.assert_allclose(shifted.root_positions - plain.root_positions, [np.array([1, 2, 3]) * UNIT] * 3)


def test_the_skeleton_is_found(tmp_path):
    amc = save(tmp_path)
    assert find_asf(amc) == tmp_path / "take.asf"
    assert find_asf(tmp_path / "other.amc") == tmp_path / "take.asf"
    for name in ("01.ASF", "HDM_bd.asf", "HDM_bk.asf"):
        (tmp_path / name).write_text(ASF)
    assert find_asf(tmp_path / "01_07.amc") == tmp_path / "01.ASF"
    assert find_asf(tmp_path / "HDM_bd_kick_001_120.amc") == tmp_path / "HDM_bd.asf"
    assert find_asf(tmp_path / "hdm_BK_kick.amc") == tmp_path / "HDM_bk.asf"
    with pytest.raises(FormatError, match="--skeleton"):
        find_asf(tmp_path / "02_01.amc")
    (tmp_path / "empty").mkdir()
    lonely = tmp_path / "empty" / "13_29.amc"
    lonely.write_text(AMC, encoding="latin-1")
    with pytest.raises(FormatError, match="no ASF file") as caught:
        read_amc(lonely)
    assert "--skeleton" in caught.value.remedy
    assert len(read_amc(lonely, tmp_path / "take.asf", rate=60.0)) == 3


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("length 0.45", "length 0", 5, "unit of length is 0"),
        ("length 0.45", "length long", 5, "1 finite numbers"),
        ("angle deg", "angle grad", 6, "neither deg nor rad"),
        ("RX RY RZ", "RX RY RX", 10, "'rx' is not a degree of freedom, or stands here twice"),
        ("orientation 0 0 0", "orientation 0 90 0", 13, "rest orientation is not zero"),
        (":bonedata\n", ":bones\n", None, "no :bonedata section"),
        (":hierarchy\n", "", None, "no :hierarchy section"),
        ("    name hip   # a joint without freedom\n", "", 15, "has no name"),
        ("    direction 0 -2 0\n", "", 22, "has no direction"),
        ("direction 0 -2 0", "direction 0 -2", 25, "3 finite numbers"),
        ("direction 0 -2 0", "direction 0 -2 nan", 25, "3 finite numbers"),
        ("name thigh", "name hip", 22, "two bones named 'hip'"),
        ("dof rz", "dof l", 39, "change their length"),
        ("axis 15 90 -30 ZXY", "axis 15 90 -30 ZXX", 38, "not three different axes"),
        ("    dof rz\n  end\n", "    dof rz\n", 33, "has no end"),
    ],
)
def test_skeleton_errors_name_the_line(tmp_path, old, new, line, words):
    assert old in ASF
    path = save(tmp_path, ASF.replace(old, new, 1)).with_suffix(".asf")
    with pytest.raises(FormatError) as caught:
        read_asf(path)
    assert words in str(caught.value)
    assert caught.value.file == str(path)
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("hierarchy", "words"),
    [
        ("root hip\n hip thigh", "does not reach: shank"),
        ("root hip\n hip thigh\n thigh shank hip", "'hip' is made a child twice"),
        ("root hip\n thigh shank\n shank thigh", "does not reach: thigh, shank"),
        ("root hip\n hip thigh\n thigh root", "'root' is made a child twice, or is the root"),
        ("root hip\n hip thigh\n thigh tail", "'tail', which is no bone"),
    ],
)
def test_impossible_hierarchies(tmp_path, hierarchy, words):
    asf = ASF.replace(SECTIONS["hierarchy"], f":hierarchy\n begin\n {hierarchy}\n end\n")
    path = save(tmp_path, asf)
    with pytest.raises(SkeletonError) as caught:
        read_amc(path)
    assert words in str(caught.value)
    assert caught.value.file == str(path.with_suffix(".asf"))


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("\n1\nroot", "\nroot", 4, "not 'root'"),
        (AMC[AMC.index("1\nroot") :], "", None, "no frames"),
        ("shank -41", "shank", 11, "0 values, but 1 degrees of freedom"),
        ("shank -41", "shank -41 3", 11, "2 values"),
        ("shank -41", "shin -41", 11, "'shin' is no bone"),
        ("shank -41\n", "", 8, "no values for: shank"),
        ("shank -41", "thigh 5 6 7", 11, "'thigh' stands twice"),
        ("shank -41", "shank nan", 11, "'nan' is not a finite number"),
        ("shank -41", "shank 1e999", 11, "'1e999'"),
        ("\n3\n", "\n4\n", 12, "frame 4 follows frame 2"),
        ("\n3\n", "\n2\n", 12, "frame 2 follows frame 2"),
        ("\n2\nroot", "\n2 root", 8, "stand alone"),
        ("shank -42\n", "", 12, "no values for: shank"),
    ],
)
def test_motion_errors_name_the_line(tmp_path, old, new, line, words):
    assert old in AMC
    path = save(tmp_path, amc=AMC.replace(old, new, 1))
    with pytest.raises(FormatError) as caught:
        read_amc(path)
    assert words in str(caught.value)
    assert caught.value.file == str(path)
    assert caught.value.line == line
    assert caught.value.remedy


def test_every_truncation_reads_or_tells_why(tmp_path):
    for end in range(0, len(ASF), 3):
        path = save(tmp_path, asf=ASF[:end])
        try:
            assert_take(path)
        except PoseloomError as error:
            assert error.file == str(path.with_suffix(".asf"))  # noqa: PT017
        else:
            assert end >= ASF.rindex("thigh shank") + len("thigh shank")
    heads = [AMC.index("\n2\n"), AMC.index("\n3\n"), len(AMC)]
    for end in range(len(AMC)):
        path = save(tmp_path, amc=AMC[:end])
        try:
            motion = read_amc(path)
        except PoseloomError as error:
            assert error.file == str(path)  # noqa: PT017
        else:
            # A whole frame, or one whose last number is short of figures.
            assert -1 <= heads[len(motion) - 1] - end <= 2


def test_damaged_bytes_read_or_tell_why(tmp_path):
    rng = random.Random(3)
    for _ in range(400):
        texts = [bytearray(ASF.encode("latin-1")), bytearray(AMC.encode("latin-1"))]
        content = texts[rng.randrange(2)]
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(content))
            content[at : at + rng.choice([0, 1, 5, 40])] = rng.randbytes(rng.choice([0, 1, 3]))
        (tmp_path / "take.asf").write_bytes(texts[0])
        (tmp_path / "take.amc").write_bytes(texts[1])
        try:
            read_amc(tmp_path / "take.amc")
        except PoseloomError as error:
            assert error.file  # noqa: PT017


NAMES_01 = {
    "Hips": "root",
    "LeftUpLeg": "lfemur",
    "LeftLeg": "ltibia",
    "LeftFoot": "lfoot",
    "LeftToeBase": "ltoes",
    "RightUpLeg": "rfemur",
    "RightLeg": "rtibia",
    "RightFoot": "rfoot",
    "RightToeBase": "rtoes",
    "Spine": "upperback",
    "Spine1": "thorax",
    "Neck1": "upperneck",
    "Head": "head",
    "LeftArm": "lhumerus",
    "LeftForeArm": "lradius",
    "LeftHand": "lwrist",
    "RightArm": "rhumerus",
    "RightForeArm": "rradius",
    "RightHand": "rwrist",
}
ABOVE_THORAX = tuple(NAMES_01)[11:]


def both_formats(recordings: Path, take: str):
    folder = recordings / "mocap"
    files = folder / "cmu_asfamc" / f"{take}.amc", folder / "cmu_bvh" / f"{take}.bvh"
    if not all(file.is_file() for file in files):
        pytest.skip(f"{take} is not there in both formats")
    return read_amc(files[0]), read_bvh(files[1])


@pytest.mark.recordings
def test_01_01_in_both_formats(recordings):
    """Its BVH has a rest pose in front and four decimals, and its conversion dropped the thorax: what hangs from the
    thorax's end keeps its rotation and lies lower by just that bone, everything else lies in the same place."""
    acclaim, bvh = both_formats(recordings, "01/01_01")
    assert len(bvh) == len(acclaim) + 1
    ours, theirs = motion_frames(acclaim), motion_frames(bvh.cut(1, len(bvh)))
    thorax = acclaim.skeleton.offsets[acclaim.skeleton.index("lowerneck")]
    lost = ours.rotations[:, acclaim.skeleton.index("thorax")] @ thorax
    for name, bone in NAMES_01.items():
        a, b = acclaim.skeleton.index(bone), bvh.skeleton.index(name)
        expected = ours.positions[:, a] - (lost if name in ABOVE_THORAX else 0.0)
        np.testing.assert_allclose(theirs.positions[:, b], expected, atol=1e-5)
        np.testing.assert_allclose(theirs.rotations[:, b], ours.rotations[:, a], atol=1e-5)


@pytest.mark.recordings
def test_16_15_in_both_formats(recordings):
    """Its BVH begins with the movement, rests with hanging arms and is in centimetres. Its conversion kept every fourth
    frame of the limbs and drew Euler angles in straight lines between them; root and trunk it kept in all."""
    acclaim, bvh = both_formats(recordings, "16/16_15")
    assert len(bvh) == len(acclaim)
    assert bvh.rate == acclaim.rate == 120.0
    ours, theirs = motion_frames(acclaim), motion_frames(bvh)
    trunk = ("root", "lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head", "lhumerus", "lfemur")
    shared = [name for name in bvh.skeleton.names if name in acclaim.skeleton.names]
    assert len(shared) == 29
    for name in shared:
        a, b = acclaim.skeleton.index(name), bvh.skeleton.index(name)
        apart = np.linalg.norm(ours.positions[:, a] - theirs.positions[:, b], axis=1)
        assert apart[::4].max() < 3e-5
        if name in trunk:
            assert apart.max() < 3e-5
        assert np.median(apart) < 3e-3


@pytest.mark.recordings
def test_a_missing_skeleton_is_lent(recordings):
    folder = recordings / "mocap" / "cmu_asfamc"
    with pytest.raises(FormatError, match="--skeleton"):
        read_amc(folder / "13" / "13_29.amc")
    motion = read_amc(folder / "13" / "13_29.amc", folder / "35" / "35.asf")
    heights = motion_frames(motion).positions[:, :, 1]
    assert 0.0 < np.median(heights.min(axis=1)) < 0.1
    assert 1.4 < np.median(heights.max(axis=1)) < 1.7
