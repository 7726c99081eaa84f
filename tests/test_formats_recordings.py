"""Every reader over every real recording: all are read whole, in metres, the right way up and on one branch."""

from pathlib import Path

import numpy as np
import pytest

from poseloom import formats
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion

pytestmark = pytest.mark.recordings

LEAST = {"cmu_asfamc": 32, "cmu_bvh": 40, "cmu_expmap": 72, "deepmimic": 26, "hdm05": 232}
"""Number of motions in each folder, at least."""
DRAWN = ("cmu_bvh", "cmu_expmap")
"""Folders whose motions begin with the pose in which the skeleton was drawn, but for some."""
UNDRAWN = ("16_15", "131_01", "131_02", "131_03")
LENT = {"13": "35", "14": "35"}


def read(path: Path) -> Motion:
    lender = LENT.get(path.parent.name)
    skeleton = path.parents[1] / lender / f"{lender}.asf" if lender and path.suffix == ".amc" else None
    return formats.read_motion(path, skeleton)


def assert_is_a_person(motion: Motion, path: Path) -> None:
    frames = motion_frames(motion)
    assert np.isfinite(frames.positions).all(), path
    hips = next(joint for joint in range(len(motion.skeleton)) if len(motion.skeleton.children(joint)) > 1)
    extent = np.ptp(frames.positions[:, hips:], axis=1)
    size = np.percentile(np.linalg.norm(extent, axis=1), 90)
    assert 1.0 < size < 2.8, (path, size)
    assert frames.positions[:, :, 1].min() > -0.6, path
    assert 15 <= motion.rate <= 120, path


def assert_rotations_are_continuous(motion: Motion, path: Path) -> None:
    """Each rotation vector lies nearer to the frame before than with a whole turn more or less."""
    before, after = motion.rotvecs[:-1], motion.rotvecs[1:]
    angles = np.linalg.norm(after, axis=-1, keepdims=True)
    turn = 2 * np.pi * after / np.where(angles > 1e-9, angles, np.inf)
    steps = np.linalg.norm(after - before, axis=-1)
    for other in (after + turn, after - turn):
        assert (steps <= np.linalg.norm(other - before, axis=-1) + 1e-9).all(), path


@pytest.mark.parametrize("folder", LEAST)
def test_every_recording_is_read(recordings, folder):
    root = recordings / "mocap" / folder
    if not root.is_dir():
        pytest.skip(f"{folder} is not unpacked")
    files = [file for file in sorted(root.rglob("*")) if formats.is_motion_file(file)]
    assert len(files) >= LEAST[folder]
    for file in files:
        motion = read(file)
        assert_is_a_person(motion, file)
        assert_rotations_are_continuous(motion, file)
        drawn = folder in DRAWN and file.stem not in UNDRAWN
        assert formats.starts_with_rest_frame(motion) == drawn, file
        assert len(formats.drop_rest_frame(motion)) == len(motion) - drawn


@pytest.mark.parametrize("dataset", ["1", "2"])
def test_every_twentieth_of_bandai_is_read(recordings, dataset):
    root = recordings / "mocap" / "bandai" / f"Bandai-Namco-Research-Motiondataset-{dataset}"
    if not root.is_dir():
        pytest.skip("bandai is not unpacked")
    for file in sorted(root.rglob("*.bvh"))[::20]:
        motion = read(file)
        assert motion.rate == 30.0
        assert motion.displacements is not None
        assert_is_a_person(motion, file)
        # Every clip has the same body, wherever the actor stood: the reader must not take the place for a bone.
        assert np.linalg.norm(motion.skeleton.offsets, axis=1).max() < 0.6


def test_bvh_files_of_inertial_suits_are_read(recordings):
    files = sorted((recordings / "imu").rglob("*.bvh"))
    if not files:
        pytest.skip("no BVH among the inertial recordings")
    for file in files:
        motion = formats.read_motion(file)
        height = np.ptp(motion_frames(motion).positions[0, :, 1])
        assert 1.3 < height < 1.8, file


def test_deepmimic_people_bend_as_people_do(recordings):
    """Shanks go back, forearms forward, walkers the way they face."""
    root = recordings / "mocap" / "deepmimic"
    if not root.is_dir():
        pytest.skip("deepmimic is not unpacked")
    for file in sorted(root.glob("*.txt")):
        motion = formats.read_motion(file)
        at = motion.skeleton.index
        places, turns = motion_frames(motion)
        for side in ("left", "right"):
            shank = places[:, at(f"{side}_ankle")] - places[:, at(f"{side}_knee")]
            back = np.einsum("fa,fa->f", turns[:, at(f"{side}_hip"), :, 2], shank)
            assert np.median(back) < 0.02, file
            forearm = places[:, at(f"{side}_wrist")] - places[:, at(f"{side}_elbow")]
            forward = np.einsum("fa,fa->f", turns[:, at(f"{side}_shoulder"), :, 2], forearm)
            assert np.median(forward) > -0.001, file
    for name in ("walk", "run", "jog"):
        motion = formats.read_motion(root / f"humanoid3d_{name}.txt")
        places, turns = motion_frames(motion)
        way = places[-1, 0] - places[0, 0]
        assert way @ turns[:, 0, :, 2].mean(axis=0) > 0.8 * np.linalg.norm(way), name
