"""Files whose zero pose is no T-pose: the same motion on the body however each joint's frame is turned."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.errors import RetargetError
from poseloom.formats import read_motion
from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix, unwrap_rotvec
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.skeleton import (
    FAMILIES,
    Motion,
    average_body,
    make_motion,
    make_skeleton,
    motion_frames,
    recognise,
    retarget,
)
from poseloom.skeleton._family import Family
from poseloom.skeleton.families import BANDAI, CMU_ASF, MIXAMO, SLIMEVR
from poseloom.skeleton.forearms import NEUTRAL
from poseloom.skeleton.kinematics import BoneFrames
from poseloom.synthesis import NO_IMU_NOISE, simulate_imus
from sources import axes_matrix, source_skeleton

X, Y, Z = np.eye(3)
CYCLIC = np.stack([Y, Z, X], axis=1)
"""A joint's frame whose x axis points up in a T-pose, y to the front, z to the left."""
AXES = np.array(
    [
        np.stack([s * np.eye(3)[a], t * np.eye(3)[b], s * t * np.cross(np.eye(3)[a], np.eye(3)[b])], axis=1)
        for a, b in itertools.permutations(range(3), 2)
        for s, t in itertools.product((1, -1), repeat=2)
    ]
)
"""The 24 turns that lay axes on axes."""


def walk_of_hinges(
    frames: int = 120, roll: float = 0.0, ankles: tuple[float, float, float] = (0.3, 0.0, 0.0)
) -> Motion:
    """A body that walks with knees and elbows on hinges, and a stiff trunk; ankles turn about a constant axis."""
    body = average_body()
    q = np.zeros((frames, body.size))
    phase = np.linspace(0, 4 * np.pi, frames)
    q[:, 1], q[:, 2] = 0.95, 1.2 * phase / (2 * np.pi)
    q[:, 3], q[:, 4] = 0.05 + 0.02 * np.sin(2 * phase), 0.1 * np.sin(phase)

    def column(bone: str) -> slice:
        at = 3 + 3 * body.index(bone)
        return slice(at, at + 3)

    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing = sign * np.sin(phase)
        q[:, column(f"{side}UpperLeg")] = np.stack([-0.1 + 0.5 * swing, 0.1 * swing, 0.03 * np.cos(phase)], axis=1)
        q[:, column(f"{side}LowerLeg")] = np.outer(0.5 + 0.4 * np.sin(phase + sign), X)
        q[:, column(f"{side}Foot")] = np.outer(np.cos(phase + sign), ankles)
        hang = matrix_from_rotvec(np.outer(0.4 * swing, -X)) @ matrix_from_rotvec(-sign * 1.2 * Z)
        q[:, column(f"{side}UpperArm")] = rotvec_from_matrix(hang)
        bent = matrix_from_rotvec(np.outer(-sign * (0.5 + 0.3 * swing), Y)) @ matrix_from_rotvec(roll * X)
        q[:, column(f"{side}LowerArm")] = rotvec_from_matrix(bent)
    return make_motion(body, q, 60.0, "hinges")


def on_family(family: Family, body: Motion) -> Motion:
    """A motion of the average body on a skeleton of a family, so that retargeting gives the motion back."""
    skeleton = source_skeleton(family)
    frames = motion_frames(body)
    bone_of = {family.start(bone): bone for bone in family.bones} | {family.turn(bone): bone for bone in family.bones}
    rotations = np.empty((len(body), len(skeleton), 3, 3))
    for joint, name in enumerate(skeleton.names):
        parent = skeleton.names[skeleton.parents[joint]]
        bone = bone_of.get(name) or bone_of.get(parent) or "spine"
        roll = matrix_from_rotvec(-np.radians(family.rolls.get(bone, 0.0)) * X) if "Arm" in bone else np.eye(3)
        rotations[:, joint] = (
            frames.rotations[:, body.skeleton.index(bone)] @ roll @ axes_matrix(family.frames.get(name, "+X +Y +Z"))
        )
    return _from_rotations(skeleton, rotations, body.root_positions, body.rate)


def _from_rotations(skeleton, rotations, roots, rate) -> Motion:
    relative = rotations.copy()
    relative[:, 1:] = np.swapaxes(rotations[:, skeleton.parents[1:]], 2, 3) @ rotations[:, 1:]
    turns = unwrap_rotvec(rotvec_from_matrix(relative))
    return make_motion(skeleton, np.concatenate([roots, turns.reshape(len(roots), -1)], axis=1), rate, "source")


def turned(motion: Motion, turns: np.ndarray) -> Motion:
    """The same movement of the same joints, each joint's own frame turned by a constant rotation."""
    skeleton = motion.skeleton
    rotations = motion_frames(motion).rotations @ turns
    offsets = skeleton.offsets.copy()
    offsets[1:] = np.einsum("jba,jb->ja", turns[skeleton.parents[1:]], offsets[1:])
    tips = np.einsum("jba,jb->ja", turns, skeleton.tips)
    return _from_rotations(skeleton.with_offsets(offsets, tips), rotations, motion.root_positions, motion.rate)


def random_turns(count: int, seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))
    q *= np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None]
    return q * np.linalg.det(q)[:, None, None]


def errors(first: Motion, second: Motion) -> tuple[float, float]:
    """Largest distance of joints in metres and largest angle between bones' frames in degrees."""
    a, b = motion_frames(first), motion_frames(second)
    cosines = (np.einsum("fjab,fjab->fj", a.rotations, b.rotations) - 1) / 2
    angle = np.degrees(np.arccos(np.clip(cosines, -1, 1))).max()
    return float(np.linalg.norm(a.positions - b.positions, axis=-1).max()), float(angle)


def frames_of(motion: Motion) -> BoneFrames:
    return motion_frames(motion)


@pytest.mark.parametrize("family", [f for f in FAMILIES if f is not SLIMEVR], ids=lambda family: family.name)
@pytest.mark.parametrize("seed", [0, 1])
def test_each_joints_frame_may_be_turned_in_every_family(family, seed):
    # Feet whose far end the skeleton does not state can only be told if ankles stand still.
    ankles = (0.3, 0.0, 0.0) if "leftToes" in family.bones else (0.0, 0.0, 0.0)
    plain = on_family(family, walk_of_hinges(roll=NEUTRAL if family.loose_forearms else 0.0, ankles=ankles))
    before = retarget(plain)
    other = turned(plain, random_turns(len(plain.skeleton), seed))
    np.testing.assert_allclose(frames_of(other).positions, frames_of(plain).positions, atol=1e-9)
    distance, angle = errors(before, retarget(other))
    # In two conversions a lost segment is put back straight up: by the trunk's mean tilt this may go astray.
    assert distance < (0.005 if family.lost_segment else 0.001)
    assert angle < 1.0


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), some=st.lists(st.booleans(), min_size=30, max_size=30))
def test_any_number_of_joints_may_be_turned(seed, some):
    plain = on_family(MIXAMO, walk_of_hinges(60))
    turns = random_turns(len(plain.skeleton), seed)
    turns[~np.array(some[: len(turns)])] = np.eye(3)
    try:
        found = retarget(turned(plain, turns))
    except RetargetError:
        return  # said, not wrong
    distance, angle = errors(retarget(plain), found)
    assert distance < 0.001
    # A frame turned by less than 80 degrees about its own bone may go unnoticed where no hinge shows it.
    hinged = [plain.skeleton.index(name) for name in ("LeftUpLeg", "RightUpLeg", "LeftArm", "RightArm")]
    if not np.array(some[: len(turns)]).any() or all(some[joint] for joint in hinged):
        assert angle < 1.0


@pytest.mark.parametrize("name", ["walk", "run", "dance_a"])
@pytest.mark.parametrize("rig", ["bones along x", "any axes"])
def test_rigs_along_axes_are_exact_on_any_motion(name, rig):
    motion = sample_motions()[name]
    plain = on_family(MIXAMO, replace(motion, skeleton=average_body()))
    count = len(plain.skeleton)
    turns = (
        np.tile(CYCLIC, (count, 1, 1)) if rig != "any axes" else AXES[np.random.default_rng(3).integers(0, 24, count)]
    )
    found = turned(plain, turns)
    before, after = retarget(plain), retarget(found)
    distance, angle = errors(before, after)
    assert distance < 0.001
    assert angle < 1.0
    worn = layout("right-foot-imu")
    first, second = (simulate_imus(m, worn, NO_IMU_NOISE, seed=1) for m in (before, after))
    np.testing.assert_allclose(second.specific_forces, first.specific_forces, atol=0.05)


def test_what_the_motion_does_not_show_is_refused_unless_a_guess_is_wanted():
    body = walk_of_hinges(ankles=(0.3, 0.1, 0.2))
    body = replace(
        body, q=body.q + 0.05 * np.sin(np.arange(len(body)) / 9)[:, None] * (np.arange(body.q.shape[1]) >= 6)
    )
    plain = on_family(MIXAMO, body)
    other = turned(plain, random_turns(len(plain.skeleton), 5))
    with pytest.raises(RetargetError, match="leftFoot") as caught:
        retarget(other)
    assert "--rest-pose" in str(caught.value)
    distance, angle = errors(retarget(plain), retarget(other, rest="motion"))
    assert distance < 0.001
    assert angle < 15.0


def test_straight_elbows_are_refused():
    body = walk_of_hinges()
    q = body.q.copy()
    for side in ("left", "right"):
        q[:, 3 + 3 * body.skeleton.index(f"{side}LowerArm") :][:, :3] = 0.0
    plain = on_family(MIXAMO, make_motion(body.skeleton, q, body.rate))
    with pytest.raises(RetargetError, match="elbow stays straight"):
        retarget(turned(plain, random_turns(len(plain.skeleton), 1)))


@pytest.mark.parametrize("bone", ["LeftUpLeg", "RightArm", "LeftArm", "RightUpLeg"])
def test_a_single_bone_rolled_about_itself_is_noticed(bone):
    plain = on_family(MIXAMO, walk_of_hinges())
    turns = np.tile(np.eye(3), (len(plain.skeleton), 1, 1))
    turns[plain.skeleton.index(bone)] = matrix_from_rotvec(np.pi * (X if "Arm" in bone else Y))
    assert errors(retarget(plain), retarget(turned(plain, turns)))[1] < 1.0


@pytest.mark.parametrize("family", [CMU_ASF, BANDAI], ids=lambda family: family.name)
def test_turned_files_keep_their_family(family):
    plain = on_family(family, walk_of_hinges())
    names = recognise(turned(plain, random_turns(len(plain.skeleton), 2)).skeleton).name
    assert names.split()[0] == family.name.split()[0]


@pytest.mark.recordings
def test_bones_along_x_are_the_same_walk(recordings):
    folder = recordings / "cases" / "zero_pose"
    if not folder.is_dir():
        pytest.skip("the cases are not unpacked there")
    along, t_pose = (read_motion(folder / f"walk_{name}.bvh") for name in ("bones_along_x", "tpose"))
    distance, angle = errors(retarget(t_pose), retarget(along))
    assert distance < 0.001
    assert angle < 1.0


def test_slimevr_hangs_from_its_head():
    """Every bone along -Y of its joint, as SlimeVR writes them; arms down and a step ahead with the left knee bent."""
    chain = {
        "HEAD": "",
        "NECK": "HEAD",
        "UPPER_CHEST": "NECK",
        "CHEST": "UPPER_CHEST",
        "WAIST": "CHEST",
        "HIP": "WAIST",
    }
    lengths = {"HEAD": 0.1, "NECK": 0.1, "UPPER_CHEST": 0.16, "CHEST": 0.16, "WAIST": 0.16, "HIP": 0.05}
    for side in ("LEFT", "RIGHT"):
        arm = ("NECK", "UPPER_SHOULDER", "SHOULDER", "UPPER_ARM", "LOWER_ARM", "HAND")
        leg = ("HIP", "HIP", "UPPER_LEG", "LOWER_LEG", "FOOT")
        for bones in (arm, leg):
            for above, bone in itertools.pairwise(bones):
                first = above == bones[0] and bone == bones[1]
                chain[f"{side}_{bone}"] = above if first else f"{side}_{above}"
        sizes = (0.05, 0.15, 0.28, 0.25, 0.08, 0.09, 0.42, 0.42, 0.15)
        lengths |= {f"{side}_{bone}": size for bone, size in zip((*arm[1:], *leg[1:]), sizes, strict=True)}
    names = list(chain)
    offsets = [[0.0, -lengths[chain[name]] if chain[name] else 0.0, 0.0] for name in names]
    parents = [names.index(chain[name]) if chain[name] else -1 for name in names]
    tips = {name: [0.0, -lengths[name], 0.0] for name in ("LEFT_FOOT", "RIGHT_FOOT", "LEFT_HAND", "RIGHT_HAND")}
    skeleton = make_skeleton(names, parents, offsets, tips)
    rotations = np.stack([axes_matrix(SLIMEVR.frames.get(name, "+X +Y +Z")) for name in names])
    down = matrix_from_rotvec(-np.pi / 2 * Z)
    for bone in ("UPPER_ARM", "LOWER_ARM", "HAND"):
        rotations[names.index(f"LEFT_{bone}")] = down @ rotations[names.index(f"LEFT_{bone}")]
        rotations[names.index(f"RIGHT_{bone}")] = down.T @ rotations[names.index(f"RIGHT_{bone}")]
    for bone, bend in (("UPPER_LEG", -0.6), ("LOWER_LEG", 0.3)):
        rotations[names.index(f"LEFT_{bone}")] = matrix_from_rotvec(bend * X)
    motion = _from_rotations(skeleton, np.stack([rotations] * 4), np.tile([0.0, 1.6, 0.0], (4, 1)), 50.0)
    body = retarget(motion)
    found = {name: np.degrees(turn) for name, turn in zip(body.skeleton.names, body.rotvecs[0], strict=True)}
    np.testing.assert_allclose(found["leftUpperLeg"], np.degrees([-0.6, 0, 0]), atol=1e-6)
    np.testing.assert_allclose(found["leftLowerLeg"], np.degrees([0.9, 0, 0]), atol=1e-6)
    np.testing.assert_allclose(found["rightUpperLeg"], 0.0, atol=1e-6)
    np.testing.assert_allclose(found["leftUpperArm"], [0, 0, -90], atol=1e-6)
    np.testing.assert_allclose(found["rightUpperArm"], [0, 0, 90], atol=1e-6)
    heights = dict(zip(body.skeleton.names, motion_frames(body).positions[0, :, 1], strict=True))
    assert heights["head"] > heights["neck"] > heights["upperChest"] > heights["hips"] > heights["rightFoot"]
