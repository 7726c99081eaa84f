"""Retargeting: directions, places, sizes, floors, families; the same take in several formats."""

from pathlib import Path

import numpy as np
import pytest

from counting import calls_of
from poseloom.errors import RetargetError
from poseloom.formats import read_motion
from poseloom.rotations import (
    geodesic_angle,
    heading_angle,
    heading_matrix,
    quat_from_matrix,
    quat_from_rotvec,
    rotvec_from_matrix,
)
from poseloom.skeleton import (
    BODY_BONES,
    FAMILIES,
    Family,
    Motion,
    average_body,
    contacts,
    make_motion,
    make_skeleton,
    motion_frames,
    recognise,
    retarget,
    sole_positions,
)
from poseloom.skeleton._alignment import NEXT
from poseloom.skeleton._family import plain_name
from poseloom.skeleton.families import (
    BANDAI,
    BODY,
    CMU_ASF,
    CMU_ASF_BVH,
    CMU_BVH,
    CMU_BVH_DAZ,
    CMU_BVH_MAX,
    DEEPMIMIC,
    MIXAMO,
    XSENS,
)
from sources import axes_matrix, facing, hanging_arms, source_skeleton

POSES = {
    "CMU ASF names in BVH, axes as in the ASF": {},
    "CMU BVH for 3ds Max": hanging_arms(),
    "DeepMimic": hanging_arms(),
}
"""Poses in which families rest, where that is not the T-pose once their frames are turned."""

LIMBS = [
    f"{side}{bone}"
    for side in ("left", "right")
    for bone in ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")
]
SPINE = ["spine", "chest", "upperChest", "neck", "head"]

REAL = {
    "mocap/cmu_asfamc/35/35_01.amc": CMU_ASF,
    "mocap/cmu_asfamc/01/01_02.amc": CMU_ASF,
    "mocap/hdm05/HDM_mm_sneak2StepsLStart_011_120.amc": CMU_ASF,
    "mocap/cmu_bvh/16/16_15.bvh": CMU_ASF_BVH,
    "mocap/cmu_bvh/05/05_03.bvh": CMU_BVH,
    "mocap/cmu_bvh/131/131_01.bvh": CMU_BVH_MAX,
    "mocap/cmu_bvh/11/11_01.bvh": CMU_BVH_DAZ,
    "mocap/cmu_expmap/train/walking/walking_1.txt": CMU_BVH,
    "mocap/bandai/Bandai-Namco-Research-Motiondataset-1/data/dataset-1_walk_normal_001.bvh": BANDAI,
    "imu/neura_walk/xsens/S02-Trial-Walk-1.bvh": XSENS,
    "imu/xsens_mvnx/io_anim_mvnx_utest/data/test_mocap.bvh": XSENS,
    "mocap/deepmimic/humanoid3d_walk.txt": DEEPMIMIC,
}
WALKS = [
    "mocap/cmu_asfamc/35/35_01.amc",
    "mocap/cmu_asfamc/02/02_01.amc",
    "mocap/cmu_bvh/16/16_15.bvh",
    "mocap/cmu_bvh/11/11_01.bvh",
    "mocap/cmu_expmap/train/walking/walking_1.txt",
    "mocap/bandai/Bandai-Namco-Research-Motiondataset-2/data/dataset-2_walk_normal_007.bvh",
    "mocap/deepmimic/humanoid3d_walk.txt",
]


def random_motion(skeleton, frames: int = 20, seed: int = 0, scale: float = 0.6) -> Motion:
    rng = np.random.default_rng(seed)
    q = rng.normal(scale=scale, size=(frames, skeleton.size))
    return make_motion(skeleton, q, 30.0, "random")


def recorded(path: Path) -> Motion:
    """A recording without frame 0, which in some is a T-pose."""
    motion = read_motion(path)
    return motion.cut(1, len(motion))


def source_ends(motion: Motion, bone: str) -> tuple[np.ndarray, np.ndarray] | None:
    """World places where a body bone's source begins and ends; None where the source does not say."""
    family, skeleton = recognise(motion.skeleton), motion.skeleton
    index = {plain_name(name): i for i, name in reversed(list(enumerate(skeleton.names)))}
    frames = motion_frames(motion)
    if bone in NEXT:
        following = NEXT[bone]
        begin, end = index.get(family.start(bone)), index.get(family.start(following))
        if begin is None or end is None:
            return None
        return frames.positions[:, begin], frames.positions[:, end]
    joint = index.get(family.turn(bone))
    if joint is None:
        return None
    children = skeleton.children(joint)
    end = index.get(family.ends.get(bone, ""), children[0] if len(children) == 1 else None)
    begin = frames.positions[:, joint]
    if end is not None:
        return begin, frames.positions[:, end]
    if not np.isfinite(skeleton.tips[joint]).all():
        return None
    return begin, begin + frames.rotations[:, joint] @ skeleton.tips[joint]


def body_direction(motion: Motion, bone: str) -> np.ndarray:
    skeleton, frames = motion.skeleton, motion_frames(motion)
    i = skeleton.index(bone)
    local = skeleton.offsets[skeleton.index(NEXT[bone])] if bone in NEXT else skeleton.tips[i]
    way = frames.rotations[:, i] @ local
    return way / np.linalg.norm(way, axis=1, keepdims=True)


def direction_errors(source: Motion, body: Motion) -> dict[str, float]:
    """The largest angle in degrees between a source's and the body's bone, by bone."""
    errors: dict[str, float] = {}
    for bone in LIMBS + SPINE:
        ends = source_ends(source, bone)
        if ends is None:
            continue
        way = ends[1] - ends[0]
        length = np.linalg.norm(way, axis=1, keepdims=True)
        if length.min() < 1e-6:
            continue
        ours = body_direction(body, bone)
        sine = np.linalg.norm(np.cross(way / length, ours), axis=1)
        errors[bone] = float(np.degrees(np.arctan2(sine, np.sum(way / length * ours, axis=1))).max())
    return errors


FACINGS = [(family, turn) for family in FAMILIES for turn in (0.0, np.pi / 2, -0.6)]
"""Families whose map says how they face, or how their arms rest, cannot face otherwise."""


@pytest.mark.parametrize(
    ("family", "turn"),
    [(family, turn) for family, turn in FACINGS if not turn or not (family.frames or family.left_arm)],
    ids=lambda value: value.name if isinstance(value, Family) else f"{value:.1f}",
)
def test_directions_are_kept_in_every_family_however_it_faces(family, turn):
    pose = POSES.get(family.name, {}) | (facing(turn) if turn else {})
    source = random_motion(source_skeleton(family, pose))
    assert recognise(source.skeleton) is family
    for size in ("keep", average_body()):
        errors = direction_errors(source, retarget(source, size))
        assert len(errors) >= 10
        assert max(errors.values()) < 1e-3, errors


@pytest.mark.parametrize("family", [f for f in FAMILIES if not f.lost_segment], ids=lambda family: family.name)
def test_joints_stay_where_they_are_when_the_size_is_kept(family):
    source = random_motion(source_skeleton(family, POSES.get(family.name)), scale=0.3)
    body = retarget(source)
    index = {plain_name(name): i for i, name in enumerate(source.skeleton.names)}
    ours, theirs = motion_frames(body).positions, motion_frames(source).positions
    shift = np.zeros(3)
    shift[1] = np.median(ours[:, 0, 1] - theirs[:, index[family.start("hips")], 1])
    for i, bone in enumerate(BODY_BONES):
        joint = index.get(family.start(bone))
        # The bridged spine joint of Xsens bends where the body's chest is one straight bone.
        if joint is not None and not (family is XSENS and i >= BODY_BONES.index("upperChest") and i < 14):
            np.testing.assert_allclose(ours[:, i], theirs[:, joint] + shift, atol=1e-9, err_msg=bone)


@pytest.mark.parametrize("family", [BODY, MIXAMO, XSENS, BANDAI, DEEPMIMIC], ids=lambda family: family.name)
def test_a_source_in_its_t_pose_is_the_body_in_its_t_pose(family):
    skeleton = source_skeleton(family)
    rotations = np.stack([axes_matrix(family.frames.get(name, "+X +Y +Z")) for name in skeleton.names])
    parents = np.concatenate([np.eye(3)[None], rotations[skeleton.parents[1:]]])
    turns = rotvec_from_matrix(np.swapaxes(parents, 1, 2) @ rotations)
    q = np.concatenate([np.zeros(3), turns.ravel()])[None]
    found = retarget(make_motion(skeleton, q, 30.0), average_body())
    mapped = [i for i, bone in enumerate(BODY_BONES) if bone in family.bones]
    angles = np.degrees(np.linalg.norm(found.rotvecs[0, mapped], axis=1))
    # Xsens, Bandai and DeepMimic draw one straight segment where the body's spine bends by 4 degrees.
    assert angles.max() < (1e-9 if family in (BODY, MIXAMO) else 4.5)


def test_retargeting_the_body_changes_nothing():
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.normal(scale=0.02, size=(50, average_body().size)), axis=0)
    q[:, 1] += 1.0
    once = retarget(make_motion(average_body(), q, 60.0))
    twice = retarget(once)
    np.testing.assert_allclose(once.q[:, 3:], q[:, 3:], atol=1e-12)
    np.testing.assert_allclose(twice.q, once.q, atol=1e-9)
    np.testing.assert_allclose(twice.skeleton.offsets, average_body().offsets, atol=1e-12)
    np.testing.assert_allclose(retarget(once, average_body()).q, once.q, atol=1e-9)


@pytest.mark.parametrize("family", [CMU_ASF, CMU_BVH, XSENS], ids=lambda family: family.name)
def test_the_size_changes_the_root_only_and_a_second_retargeting_nothing(family):
    source = random_motion(source_skeleton(family), scale=0.3)
    kept, replaced = retarget(source), retarget(source, average_body())
    np.testing.assert_allclose(kept.q[:, 3:], replaced.q[:, 3:], atol=1e-12)
    again = retarget(kept, average_body())
    np.testing.assert_allclose(again.q[:, 3:], replaced.q[:, 3:], atol=1e-8)
    np.testing.assert_allclose(again.q[:, [0, 2]], replaced.q[:, [0, 2]], atol=1e-8)


def test_another_size_scales_the_way_by_the_legs():
    small = average_body().with_offsets(average_body().offsets * 0.5, average_body().tips * 0.5)
    q = np.zeros((3, small.size))
    q[:, 0], q[:, 1] = [0.0, 1.0, 2.0], 0.5
    large = retarget(make_motion(small, q, 30.0), average_body())
    np.testing.assert_allclose(np.diff(large.q[:, 0]), 2.0, atol=1e-9)


def test_the_lost_segment_is_restored():
    source = source_skeleton(CMU_BVH)
    offsets = source.offsets.copy()
    lost = [source.index(name) for name in ("Neck", "LeftShoulder", "RightShoulder")]
    offsets[lost] = 0.0
    body = retarget(make_motion(source.with_offsets(offsets), np.zeros((2, source.size)), 30.0)).skeleton
    expected = np.linalg.norm(average_body().offsets[[2, 3]], axis=1).mean()
    for bone in ("neck", "leftShoulder", "rightShoulder"):
        np.testing.assert_allclose(body.offsets[body.index(bone)], [0, expected, 0], atol=1e-9)


@pytest.mark.parametrize("prefix", ["mixamorig:", "mixamorig", "mixamorig_", "Armature:mixamorig:"])
def test_prefixes_do_not_matter(prefix):
    assert recognise(source_skeleton(MIXAMO, prefix=prefix)) is MIXAMO


def test_unknown_names_are_listed_with_the_families():
    skeleton = source_skeleton(MIXAMO)
    names = ["Pelvis" if name == "Hips" else "Tail" if name == "Head" else name for name in skeleton.names]
    renamed = make_skeleton(names, skeleton.parents, skeleton.offsets)
    with pytest.raises(RetargetError) as caught:
        retarget(make_motion(renamed, np.zeros((1, renamed.size)), 30.0))
    message = str(caught.value)
    assert "unmapped: Pelvis, Tail" in message
    assert "Mixamo, also needs: Hips, Head" in message
    for family in FAMILIES:
        assert family.name in message


def test_only_the_body_can_be_a_size():
    motion = random_motion(source_skeleton(MIXAMO))
    with pytest.raises(RetargetError, match="not the body of 22 bones"):
        retarget(motion, source_skeleton(MIXAMO))


def test_rotation_vectors_do_not_jump_in_a_long_spin():
    skeleton = source_skeleton(MIXAMO)
    q = np.zeros((300, skeleton.size))
    q[:, 4] = np.linspace(0.0, 25.0, 300)
    body = retarget(make_motion(skeleton, q, 60.0))
    np.testing.assert_allclose(body.q[:, 4], q[:, 4], atol=1e-9)


def standing(height: float, frames: int = 60) -> Motion:
    q = np.zeros((frames, average_body().size))
    q[:, 1] = height
    return make_motion(average_body(), q, 60.0)


@pytest.mark.parametrize("height", [-3.0, 0.0, 0.8, 1.1])
def test_feet_come_to_the_floor(height):
    body = retarget(standing(height))
    assert sole_positions(body)[..., 1].min() == pytest.approx(0.0, abs=1e-9)


def test_someone_high_above_a_files_zero_stays_there():
    body = retarget(standing(2.5))
    np.testing.assert_allclose(body.q[:, 1], 2.5)


def test_a_climb_leaves_the_floor_where_it_was():
    low, high = retarget(standing(1.0)).q[0, 1], 1.4
    q = np.tile(standing(1.0).q[0], (600, 1))
    q[:, 1] = low + high * np.clip((np.arange(600) - 120) / 120, 0, 1)
    body = retarget(make_motion(average_body(), q, 60.0))
    assert body.q[0, 1] == pytest.approx(low, abs=1e-3)
    assert body.q[-1, 1] == pytest.approx(low + high, abs=1e-3)


def test_retargeting_does_not_go_through_frames_one_by_one():
    counts: list[int] = []
    for frames in (300, 3000):
        source = random_motion(source_skeleton(CMU_BVH), frames=frames, scale=0.2)
        retarget(source)
        counts.append(calls_of(lambda source=source: retarget(source)))
    assert counts[1] < counts[0] + 300


@pytest.mark.recordings
@pytest.mark.parametrize("file", REAL, ids=lambda file: Path(file).stem)
def test_directions_and_places_on_real_recordings(recordings, file):
    source = recorded(recordings / file)
    source = source.cut(0, min(len(source), 900))
    assert recognise(source.skeleton) is REAL[file]
    for size in ("keep", average_body()):
        body = retarget(source, size)
        errors = direction_errors(source, body)
        assert len(errors) >= 11
        assert max(errors.values()) < 0.5, errors


@pytest.mark.recordings
@pytest.mark.parametrize("file", REAL, ids=lambda file: Path(file).stem)
def test_knees_and_elbows_are_hinges_in_every_family(recordings, file):
    source = recorded(recordings / file)
    frames = motion_frames(retarget(source.cut(0, min(len(source), 900)), average_body()))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        local = {
            bone: np.swapaxes(frames.rotations[:, BODY_BONES.index(f"{side}Upper{bone}")], 1, 2)
            @ frames.rotations[:, BODY_BONES.index(f"{side}Lower{bone}")]
            for bone in ("Leg", "Arm")
        }
        shank, forearm = -local["Leg"][:, :, 1], sign * local["Arm"][:, :, 0]
        # Shanks bend backwards and forearms forwards; where the source has a hinge nothing leaves its plane.
        assert np.median(shank[:, 2]) < 0.02
        assert np.median(forearm[:, 2]) > -0.02
        if REAL[file] is not XSENS:
            assert np.abs(shank[:, 0]).max() < 0.03
            assert np.median(np.abs(forearm[:, 1])) < 0.06


@pytest.mark.recordings
@pytest.mark.parametrize("file", WALKS, ids=lambda file: Path(file).stem)
@pytest.mark.parametrize("size", ["keep", "average"])
def test_walkers_face_where_they_go_with_their_feet_on_the_floor(recordings, file, size):
    source = recorded(recordings / file)
    body = retarget(source, "keep" if size == "keep" else average_body())
    heading = heading_matrix(heading_angle(quat_from_rotvec(body.rotvecs[:, 0])))
    step = max(int(body.rate), 1)
    way = body.q[step:, :3] - body.q[:-step, :3]
    ahead = np.sum(way * heading[: len(way), :, 2], axis=1) / np.linalg.norm(way[:, [0, 2]], axis=1)
    assert np.median(ahead) > 0.85
    standing_ = contacts(body)
    lowest = sole_positions(body)[..., 1].min(axis=1)[standing_.left | standing_.right]
    assert abs(np.median(lowest)) < 0.02
    assert np.percentile(lowest, 5) > -0.05


@pytest.mark.recordings
@pytest.mark.parametrize("file", WALKS, ids=lambda file: Path(file).stem)
def test_a_walk_is_nearly_the_same_pose_vectors_in_every_family(recordings, file):
    """Mean world rotations over a walk, heading removed: of legs and trunk they differ little between people."""
    source = recorded(recordings / file)
    body = retarget(source, average_body())
    rotations = motion_frames(body).rotations
    heading = heading_matrix(heading_angle(quat_from_rotvec(body.rotvecs[:, 0])))
    relative = np.swapaxes(heading, 1, 2)[:, None] @ rotations
    limits = {"hips": 16, "spine": 23, "chest": 28, "upperChest": 36, "leftUpperLeg": 26, "rightLowerLeg": 38}
    for bone, limit in limits.items():
        mean = relative[:, BODY_BONES.index(bone)].mean(axis=0)
        u, _, vt = np.linalg.svd(mean)
        angle = np.degrees(geodesic_angle(quat_from_matrix((u @ vt)[None]), np.array([[1.0, 0, 0, 0]])))[0]
        assert angle < limit, (bone, angle)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        # Arms hang: the upper arm's frame is turned down by about 80 degrees and its elbow points back, not aside.
        arm = relative[:, BODY_BONES.index(f"{side}UpperArm")].mean(axis=0)
        assert sign * arm[1, 0] < -0.6
        assert sign * arm[0, 1] > 0.4


def same_take(first: Motion, second: Motion, bones: list[str]) -> np.ndarray:
    picked = [BODY_BONES.index(bone) for bone in bones]
    quats = [quat_from_rotvec(motion.rotvecs[:, picked]) for motion in (first, second)]
    return np.degrees(geodesic_angle(quats[0], quats[1]))


@pytest.mark.recordings
def test_the_same_take_as_amc_and_as_bvh_with_the_asfs_axes(recordings):
    amc = retarget(read_motion(recordings / "mocap/cmu_asfamc/16/16_15.amc").cut(5, 471))
    bvh = retarget(read_motion(recordings / "mocap/cmu_bvh/16/16_15.bvh").cut(5, 471))
    places = np.linalg.norm(motion_frames(amc).positions - motion_frames(bvh).positions, axis=-1)
    assert np.median(places) < 0.003
    assert np.median(same_take(amc, bvh, list(BODY_BONES)), axis=0).max() < 0.6
    np.testing.assert_allclose(bvh.skeleton.offsets, amc.skeleton.offsets, atol=1e-3)


@pytest.mark.recordings
def test_the_same_take_as_amc_and_as_bvh_without_the_thorax(recordings):
    amc = retarget(read_motion(recordings / "mocap/cmu_asfamc/01/01_01.amc").cut(1, 2751))
    bvh = retarget(recorded(recordings / "mocap/cmu_bvh/01/01_01.bvh").cut(1, 2751))
    places = np.linalg.norm(motion_frames(amc).positions - motion_frames(bvh).positions, axis=-1)
    assert places.max() < 0.006  # the restored segment's direction is the mean one, not this man's
    exact = [bone for bone in BODY_BONES if bone not in ("upperChest", "neck", "leftShoulder", "rightShoulder")]
    assert same_take(amc, bvh, exact).max() < 0.01
    assert same_take(amc, bvh, list(BODY_BONES)).max() < 2.0


@pytest.mark.recordings
def test_the_same_take_as_exponential_maps_and_as_bvh(recordings):
    """The tables have another person's bones, so only joints that lie in one straight line at rest agree wholly."""
    table = retarget(recorded(recordings / "mocap/cmu_expmap/train/basketball/basketball_1.txt"))
    bvh = retarget(recorded(recordings / "mocap/cmu_bvh/06/06_02.bvh"))
    assert len(table) == len(bvh)
    legs_and_arms = [f"{side}{bone}" for side in ("left", "right") for bone in ("UpperLeg", "LowerLeg", "LowerArm")]
    assert same_take(table, bvh, legs_and_arms).max() < 0.01
    assert same_take(table, bvh, list(BODY_BONES)).max() < 10.0
