"""The built-in motions."""

from pathlib import Path

import numpy as np
import pytest

from poseloom.errors import FormatError, PoseloomError
from poseloom.formats.deepmimic import DeepMimicMotion, deepmimic_skeleton, read_deepmimic
from poseloom.rotations import geodesic_angle, heading_angle, heading_matrix, quat_from_rotvec
from poseloom.samples import sample_motion_names, sample_motions
from poseloom.samples.encoding import decode_samples, encode_samples
from poseloom.samples.looping import loop
from poseloom.skeleton import (
    BODY_BONES,
    average_body,
    contacts,
    make_motion,
    make_skeleton,
    motion_frames,
    sole_positions,
)

FOLDER = Path(__file__).parents[1] / "src" / "poseloom" / "samples"
NAMES = [
    "backflip",
    "cartwheel",
    "crawl",
    "dance_a",
    "dance_b",
    "getup_facedown",
    "getup_faceup",
    "jump",
    "kick",
    "punch",
    "roll",
    "run",
    "spin",
    "spinkick",
    "walk",
]
ONCE = {"getup_facedown", "getup_faceup", "kick", "punch"}


def test_there_are_fifteen_on_the_average_body():
    motions = sample_motions()
    assert sorted(motions) == NAMES == sorted(sample_motion_names())
    for name, motion in motions.items():
        assert motion.skeleton is average_body()
        assert (motion.rate, motion.name) == (60.0, name)
        assert np.isfinite(motion.q).all()
        assert motion.duration >= (1.5 if name in ONCE else 6.0)
        assert motion.duration < 10.0


def test_nothing_jumps_and_rotation_vectors_are_continuous():
    for name, motion in sample_motions().items():
        quats = quat_from_rotvec(motion.rotvecs)
        steps = np.degrees(geodesic_angle(quats[1:], quats[:-1]))
        assert steps.max() < 35, (name, steps.max())
        # The root's may swing round where somersaults come past a whole turn: no rotation vector can avoid that.
        assert np.linalg.norm(np.diff(motion.rotvecs[:, 1:], axis=0), axis=-1).max() < 1.5, name
        assert np.linalg.norm(np.diff(motion.q[:, :3], axis=0), axis=1).max() < 0.12, name


def test_feet_are_on_the_floor_and_nobody_is_in_it():
    for name, motion in sample_motions().items():
        lowest = motion_frames(motion).positions[..., 1].min(axis=1)
        assert lowest.min() > -0.12, name
        found = contacts(motion)
        stands = found.left | found.right
        if name not in ("crawl", "roll", "dance_b", "run"):
            assert stands.mean() > 0.25, name
        if stands.any():
            assert abs(np.median(sole_positions(motion)[..., 1].min(axis=1)[stands])) < 0.02, name


def test_the_walk_goes_ahead_on_both_feet():
    walk = sample_motions()["walk"]
    heading = heading_matrix(heading_angle(quat_from_rotvec(walk.rotvecs[:, 0])))
    way = walk.q[60:, :3] - walk.q[:-60, :3]
    assert np.median(np.sum(way * heading[:-60, :, 2], axis=1)) > 0.8
    found = contacts(walk)
    assert 0.5 < found.left.mean() < 0.7
    assert 0.5 < found.right.mean() < 0.7
    knees = walk.rotvecs[:, [BODY_BONES.index("leftLowerLeg"), BODY_BONES.index("rightLowerLeg")]]
    assert knees[..., 0].max() > 0.8
    np.testing.assert_allclose(knees[..., 1:], 0.0, atol=1e-9)


def test_the_file_is_small_and_its_origin_told():
    assert (FOLDER / "motions.npz").stat().st_size <= 500_000
    text = (FOLDER / "PROVENANCE.md").read_text()
    for words in ("EIA-0196217", "zlib", "DeepMimic", "pybullet", "encode_samples.py", "misrepresented"):
        assert words in text


@pytest.mark.recordings
def test_the_encoding_loses_next_to_nothing(recordings, tmp_path):
    """DeepMimic's own files are at hand under the recordings; most are the same as those in the package."""
    originals = {
        name: read_deepmimic(recordings / f"mocap/deepmimic/humanoid3d_{name}.txt") for name in ("walk", "spin")
    }
    encode_samples(originals, tmp_path / "some.npz", "recordings")
    for name, (motion, cyclic) in decode_samples(tmp_path / "some.npz").items():
        assert cyclic == originals[name].cyclic
        assert motion.rate == originals[name].motion.rate
        frames, true = motion_frames(motion), motion_frames(originals[name].motion)
        assert np.abs(frames.positions - true.positions).max() < 5e-4
    packed = decode_samples(FOLDER / "motions.npz")["walk"].motion
    np.testing.assert_allclose(packed.q, originals["walk"].motion.q, atol=1.1e-4)


def test_what_does_not_fit_or_is_missing_is_refused(tmp_path):
    skeleton = deepmimic_skeleton()
    far = np.zeros((2, skeleton.size))
    far[1, 0] = 4.0
    with pytest.raises(FormatError, match="'far' moves too far"):
        encode_samples({"far": DeepMimicMotion(make_motion(skeleton, far, 30.0), False)}, tmp_path / "far.npz", "test")
    with pytest.raises(FormatError, match="no such file"):
        decode_samples(tmp_path / "missing.npz")


def circling(frames: int = 31):
    """A quarter of a circle walked in one cycle, with a swinging joint that closes."""
    skeleton = make_skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [1, 0, 0]])
    part = np.linspace(0, 1, frames)
    q = np.zeros((frames, 9))
    q[:, 0], q[:, 2] = 5 - np.cos(part * np.pi / 2), 3 + np.sin(part * np.pi / 2)
    q[:, 1] = 1.0
    q[:, 4] = part * np.pi / 2
    q[:, 6] = np.sin(2 * np.pi * part)
    return make_motion(skeleton, q, 30.0, "circle")


def test_four_quarters_make_a_circle():
    motion = loop(circling(), 4)
    assert len(motion) == 4 * 30 + 1
    np.testing.assert_allclose(motion.q[-1, :3], motion.q[0, :3], atol=1e-9)
    angle = np.linspace(0, 2 * np.pi, 121)
    np.testing.assert_allclose(motion.q[:, 0], 5 - np.cos(angle), atol=1e-9)
    np.testing.assert_allclose(motion.q[:, 2], 3 + np.sin(angle), atol=1e-9)
    np.testing.assert_allclose(motion.q[:, 4], angle, atol=1e-9)
    np.testing.assert_allclose(motion.q[:, 6], np.sin(4 * angle), atol=1e-9)


def test_gaps_are_closed_on_both_sides_of_the_seam():
    one = circling()
    q = np.array(one.q)
    q[:, 6] += np.linspace(0, 0.5, 31)
    q[:, 1] += np.linspace(0, 0.1, 31)
    motion = loop(make_motion(one.skeleton, q, 30.0), 3)
    plain = np.abs(np.diff(np.sin(4 * np.linspace(0, 2 * np.pi, 121)))).max()
    assert np.abs(np.diff(motion.q[:, 6])).max() < plain + 0.09
    assert np.abs(np.diff(motion.q[:, 1])).max() < 0.03
    np.testing.assert_allclose(motion.q[:20], q[:20], atol=1e-12)  # before the seam nothing has changed
    np.testing.assert_allclose(motion.q[-20:, 6], q[-20:, 6], atol=1e-12)


def test_one_cycle_is_the_motion_and_none_is_refused():
    np.testing.assert_allclose(loop(circling(), 1).q, circling().q, atol=1e-12)
    for motion, cycles in ((circling(), 0), (circling().cut(0, 1), 2)):
        with pytest.raises(PoseloomError, match="cannot be repeated"):
            loop(motion, cycles)
