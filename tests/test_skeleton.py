"""Skeletons, the body, poses and motions: what is checked on making them."""

import numpy as np
import pytest

from poseloom.errors import PoseloomError, SkeletonError
from poseloom.skeleton import BODY_BONES, average_body, make_motion, make_skeleton, mirror_bones, moving_dofs


def chain(**changes):
    arguments = {"names": ["a", "b", "c"], "parents": [-1, 0, 1], "offsets": np.zeros((3, 3))} | changes
    return make_skeleton(**arguments)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"names": ["a", "b", "b"]}, "more than once: b"),
        ({"parents": [-1, -1, 0]}, "roots are: a, b"),
        ({"parents": [1, 2, 0]}, "cyclic"),
        ({"parents": [-1, 2, 1]}, "does not come before them: b"),
        ({"parents": [-1, 1, 0]}, "does not come before them: b"),
        ({"parents": [-1, 0, 7]}, "does not come before them: c"),
        ({"offsets": [[0, 0, 0], [0, np.nan, 0], [0, 0, 0]]}, "joint 'b' is not finite"),
        ({"offsets": np.zeros((2, 3))}, "do not fit together"),
        ({"names": [], "parents": [], "offsets": np.zeros((0, 3))}, "do not fit together"),
        ({"tips": {"d": [0, 0, 0]}}, "unknown bone 'd'"),
        ({"locked": {"bb": [True] * 3}}, "unknown bone 'bb'"),
    ],
)
def test_impossible_hierarchies_are_refused(changes, words):
    with pytest.raises(SkeletonError, match=words):
        chain(**changes)


def test_unknown_bones_are_answered_with_the_nearest_name():
    with pytest.raises(SkeletonError, match=r"Did you mean 'leftHand'.*rightToes"):
        average_body().index("lefthand")


def test_rest_positions_add_up_and_children_are_found():
    skeleton = chain(offsets=[[0, 0, 0], [0, 1, 0], [2, 0, 0]], tips={"c": [0, 0, 3]})
    np.testing.assert_array_equal(skeleton.rest_positions(), [[0, 0, 0], [0, 1, 0], [2, 1, 0]])
    assert skeleton.children(0) == (1,)
    assert skeleton.children(2) == ()
    assert skeleton.size == 12
    assert np.isnan(skeleton.tips[0]).all()
    longer = skeleton.with_offsets(skeleton.offsets * 2)
    assert longer.rest_positions()[2].tolist() == [4, 2, 0]


def test_skeletons_and_motions_cannot_be_changed():
    body = average_body()
    with pytest.raises(ValueError, match="read-only"):
        body.offsets[1, 1] = 3.0
    motion = make_motion(body, np.zeros((2, body.size)), 30.0)
    with pytest.raises(ValueError, match="read-only"):
        motion.q[0, 0] = 1.0


def test_the_body_is_a_symmetric_t_pose():
    body, other = average_body(), list(mirror_bones())
    assert body.names == BODY_BONES
    assert len(body) == 22
    rest = body.rest_positions()
    np.testing.assert_allclose(rest[other] * [-1, 1, 1], rest, atol=1e-12)
    np.testing.assert_allclose(body.tips[other] * [-1, 1, 1], body.tips, atol=1e-12)
    height = rest[body.index("head"), 1] + body.tips[body.index("head"), 1] - rest[body.index("leftToes"), 1]
    assert 1.5 < height < 1.8
    arm = rest[body.index("leftHand")] - rest[body.index("leftUpperArm")]
    np.testing.assert_allclose(arm[1:], 0.0, atol=1e-12)
    assert arm[0] > 0.4  # the left hand points towards +X
    assert body.tips[body.index("leftToes"), 2] > 0  # and the toes towards +Z


def test_mirrored_bones_swap_sides_and_nothing_else():
    other = mirror_bones()
    assert [other[i] for i in other] == list(range(22))
    for i, bone in enumerate(BODY_BONES):
        swapped = bone.replace("left", "#").replace("right", "left").replace("#", "right")
        assert BODY_BONES[other[i]] == swapped


def test_moving_degrees_of_freedom():
    moving = moving_dofs()
    assert not moving[:3].any()
    assert moving[3:6].all()
    assert int(moving.sum()) == 66 - 6 - 2 * 2 - 2
    knee = 3 + 3 * BODY_BONES.index("leftLowerLeg")
    assert moving[knee : knee + 3].tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("q", "rate", "words"),
    [
        (np.zeros((3, 12)), 0.0, "rate of 0"),
        (np.zeros((3, 12)), float("nan"), "rate of nan"),
        (np.zeros((3, 11)), 30.0, r"shape \(3, 11\).*12 columns"),
        (np.zeros((0, 12)), 30.0, "no frames"),
        (np.full((3, 12), np.inf), 30.0, "not finite in frame 0, column 0"),
    ],
)
def test_impossible_motions_are_refused(q, rate, words):
    with pytest.raises(PoseloomError, match=words):
        make_motion(chain(), q, rate, "clip")


def test_displacements_need_one_vector_a_frame_and_joint():
    with pytest.raises(PoseloomError, match="displacements of shape"):
        make_motion(chain(), np.zeros((3, 12)), 30.0, displacements=np.zeros((2, 3, 3)))


def test_cutting_and_taking_poses():
    q = np.arange(60.0).reshape(5, 12)
    motion = make_motion(chain(), q, 10.0, "clip", np.zeros((5, 3, 3)))
    part = motion.cut(1, 4)
    np.testing.assert_array_equal(part.q, q[1:4])
    assert part.displacements is not None
    assert part.displacements.shape == (3, 3, 3)
    assert (part.name, part.rate, part.duration) == ("clip", 10.0, 0.2)
    np.testing.assert_array_equal(motion.pose(2).q, q[2])
    assert motion.rotvecs.shape == (5, 3, 3)
