"""Mirror images of motions of the body."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from poseloom.errors import SkeletonError
from poseloom.skeleton import (
    average_body,
    make_motion,
    make_skeleton,
    mirror_bones,
    mirror_motion,
    mirror_skeleton,
    motion_frames,
)

BODY = average_body()
REFLECTION = np.diag([-1.0, 1.0, 1.0])


def uneven_body():
    rng = np.random.default_rng(0)
    return BODY.with_offsets(BODY.offsets * rng.uniform(0.8, 1.2, (22, 1)), BODY.tips * rng.uniform(0.8, 1.2, (22, 1)))


@settings(max_examples=25)
@given(arrays(np.float64, (2, BODY.size), elements=st.floats(-2.5, 2.5)))
def test_joints_and_frames_are_reflected(q):
    motion = make_motion(uneven_body(), q, 30.0, "clip")
    image = mirror_motion(motion)
    before, after, other = motion_frames(motion), motion_frames(image), list(mirror_bones())
    np.testing.assert_allclose(after.positions, before.positions[:, other] @ REFLECTION, atol=1e-12)
    np.testing.assert_allclose(after.rotations, REFLECTION @ before.rotations[:, other] @ REFLECTION, atol=1e-12)
    assert (image.rate, image.name) == (30.0, "clip")


@settings(max_examples=25)
@given(arrays(np.float64, (2, BODY.size), elements=st.floats(-9, 9)))
def test_the_mirror_of_the_mirror_is_the_motion(q):
    motion = make_motion(uneven_body(), q, 30.0)
    twice = mirror_motion(mirror_motion(motion))
    np.testing.assert_array_equal(twice.q, motion.q)
    np.testing.assert_array_equal(twice.skeleton.offsets, motion.skeleton.offsets)
    np.testing.assert_array_equal(twice.skeleton.tips, motion.skeleton.tips)


def test_sizes_and_locks_change_sides():
    image = mirror_skeleton(uneven_body())
    left, right = BODY.index("leftLowerLeg"), BODY.index("rightLowerLeg")
    assert image.offsets[left, 1] == uneven_body().offsets[right, 1]
    same = mirror_skeleton(BODY)
    np.testing.assert_allclose(same.offsets, BODY.offsets)
    hinge = {"leftLowerLeg": [False, True, True]}
    locked = make_skeleton(BODY.names, BODY.parents, BODY.offsets, locked=hinge)
    assert mirror_skeleton(locked).locked[right].tolist() == [False, True, True]


def test_only_the_body_has_a_mirror_image():
    other = make_skeleton(["a", "b"], [-1, 0], np.zeros((2, 3)))
    with pytest.raises(SkeletonError, match="Retarget the motion"):
        mirror_motion(make_motion(other, np.zeros((1, 9)), 30.0))
