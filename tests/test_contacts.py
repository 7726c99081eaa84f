"""Heels and toes on the floor."""

from itertools import pairwise

import numpy as np
import pytest

from poseloom.errors import SkeletonError
from poseloom.formats import read_motion
from poseloom.rotations import matrix_from_rotvec
from poseloom.skeleton import (
    Contacts,
    ContactThresholds,
    average_body,
    contacts,
    floor_height,
    make_motion,
    make_skeleton,
    mirror_motion,
    resample,
    retarget,
    sole_points,
    sole_positions,
)
from poseloom.skeleton.contacts import _hysteresis

BODY = average_body()
WALKS = {
    "mocap/cmu_asfamc/35/35_01.amc": 120,
    "mocap/cmu_asfamc/02/02_01.amc": 120,
    "mocap/cmu_bvh/16/16_15.bvh": 120,
    "mocap/bandai/Bandai-Namco-Research-Motiondataset-2/data/dataset-2_walk_normal_007.bvh": 30,
    "mocap/hdm05/HDM_bk_sneak2StepsLStart_004_120.amc": 120,
}


def stepping(seconds: float = 6.0, rate: float = 60.0):
    """Marching on the spot, one leg at a time: thigh and shank fold so that the foot goes up 20 cm and back."""
    times = np.arange(int(seconds * rate)) / rate
    q = np.zeros((len(times), BODY.size))
    q[:, 1] = -sole_points(BODY, "left").heel[1] - BODY.rest_positions()[BODY.index("leftFoot"), 1]
    lifted = {}
    for side, phase in (("left", 0.0), ("right", 0.5)):
        cycle = np.mod(times + phase, 1.0)
        lift = np.where(cycle < 0.4, np.sin(np.pi * cycle / 0.4) ** 2, 0.0)
        for bone, angle in (("UpperLeg", -0.7), ("LowerLeg", 1.4), ("Foot", -0.7)):
            q[:, 3 + 3 * BODY.index(f"{side}{bone}")] = angle * lift
        lifted[side] = (cycle > 0.1) & (cycle < 0.3)
    return make_motion(BODY, q, rate), lifted


def test_marching_stands_on_one_leg_and_then_on_the_other():
    motion, lifted = stepping()
    found = contacts(motion)
    for side, heel, toe in (("left", found.left_heel, found.left_toe), ("right", found.right_heel, found.right_toe)):
        assert not heel[lifted[side]].any()
        assert not toe[lifted[side]].any()
    assert 0.55 < found.left.mean() < 0.75
    assert (found.left | found.right).all()
    np.testing.assert_array_equal(found.left, found.left_heel | found.left_toe)


def test_the_mirror_image_has_the_other_foots_contacts():
    motion, _ = stepping()
    found, image = contacts(motion), contacts(mirror_motion(motion))
    np.testing.assert_array_equal(image.left_heel, found.right_heel)
    np.testing.assert_array_equal(image.right_toe, found.left_toe)


def test_standing_is_contact_and_flying_is_none():
    q = np.zeros((240, BODY.size))
    ground = stepping()[0].q[0, 1]
    times = np.arange(240) / 60
    flying = (times > 1) & (times < 3)
    q[:, 1] = ground + np.where(flying, 0.8 * np.sin(np.pi * (times - 1) / 2), 0.0)
    found = contacts(make_motion(BODY, q, 60.0))
    well_up = (times > 1.1) & (times < 2.9)
    for point in (found.left_heel, found.left_toe, found.right_heel, found.right_toe):
        assert not point[well_up].any()
        assert point[times < 0.95].all()
        assert point[times > 3.1].all()


def test_a_tilted_floor_does_not_lift_contacts():
    """A capture whose floor rises by 1.2 % along a walk of 5 m, as some of CMU's do."""
    motion, lifted = stepping(seconds=10.0)
    q = np.array(motion.q)
    # Forward in steps: the body advances only while nothing stands, which no test of heights notices.
    q[:, 2] = np.floor(np.arange(len(q)) / 60) * 0.5
    q[:, 1] += 0.012 * q[:, 2]
    found = contacts(make_motion(BODY, q, 60.0))
    still = np.abs(np.gradient(q[:, 2])) == 0
    for side, point in (("left", found.left_heel), ("right", found.right_heel)):
        cycle = np.mod(np.arange(len(q)) / 60 + (0.0 if side == "left" else 0.5), 1.0)
        standing = still & (cycle > 0.5) & (cycle < 0.9)
        assert point[standing].mean() > 0.9
        assert not point[lifted[side] & still].any()


def test_a_foot_held_up_in_stillness_does_not_stand():
    q = np.zeros((120, BODY.size))
    q[:, 1] = stepping()[0].q[0, 1]
    q[:, 3 + 3 * BODY.index("rightUpperLeg")] = -1.0
    q[:, 3 + 3 * BODY.index("rightLowerLeg")] = 1.0
    found = contacts(make_motion(BODY, q, 60.0))
    assert found.left.all()
    assert not found.right.any()


def test_a_lying_body_does_not_stand():
    q = np.zeros((60, BODY.size))
    q[:, 1], q[:, 3] = 0.1, np.pi / 2
    found = contacts(make_motion(BODY, q, 60.0))
    assert not (found.left | found.right).any()
    assert floor_height(make_motion(BODY, q, 60.0)) == 0.0


def test_hysteresis_holds_between_its_two_conditions():
    on = np.array([0, 1, 0, 0, 0, 0, 1, 1, 0], dtype=bool)
    off = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0], dtype=bool)
    assert _hysteresis(on, off).tolist() == [False, True, True, False, False, False, True, False, False]


def test_thresholds_can_be_chosen():
    motion, _ = stepping()
    eager = contacts(motion, ContactThresholds(0.1, 0.12, 5.0, 6.0))
    assert eager.left.mean() > contacts(motion).left.mean() + 0.1


def test_a_motion_of_one_frame_has_contacts():
    motion, _ = stepping()
    found = contacts(motion.cut(0, 1))
    assert isinstance(found, Contacts)
    assert found.right.tolist() == [True]


def test_sole_points_grow_with_the_foot():
    large = BODY.with_offsets(BODY.offsets * 1.2, BODY.tips * 1.2)
    for one, other in zip(sole_points(BODY, "left"), sole_points(large, "left"), strict=True):
        np.testing.assert_allclose(other, 1.2 * one)
    for left, right in zip(sole_points(BODY, "left"), sole_points(BODY, "right"), strict=True):
        np.testing.assert_allclose(left, right)
    with pytest.raises(SkeletonError, match="unknown bone 'upFoot'"):
        sole_points(BODY, "up")


def test_sole_positions_move_with_the_root():
    q = np.zeros((2, BODY.size))
    q[1, :3], q[1, 4] = [1.0, 2.0, 3.0], 0.5
    places = sole_positions(make_motion(BODY, q, 30.0))
    np.testing.assert_allclose(
        places[1], places[0] @ matrix_from_rotvec(np.array([0, 0.5, 0])).T + [1, 2, 3], atol=1e-12
    )


def test_only_the_body_has_soles():
    other = make_skeleton(["a"], [-1], np.zeros((1, 3)))
    with pytest.raises(SkeletonError, match="only the body has soles"):
        contacts(make_motion(other, np.zeros((1, 6)), 30.0))


@pytest.mark.recordings
@pytest.mark.parametrize("size", ["keep", "average"])
@pytest.mark.parametrize("file", WALKS)
def test_walks_stand_on_each_foot_for_six_tenths_in_turn(recordings, file, size):
    source = read_motion(recordings / file)
    body = retarget(source.cut(1, len(source)), "keep" if size == "keep" else BODY)
    found = contacts(body)
    for share in (found.left.mean(), found.right.mean()):
        assert 0.48 < share < 0.75
    assert (found.left & found.right).mean() > 0.05  # double support: nobody runs here
    assert (found.left | found.right).mean() > 0.92
    # Left and right begin to stand in turn.
    begins = sorted(
        (int(frame), side)
        for side, stands in (("left", found.left), ("right", found.right))
        for frame in np.flatnonzero(stands[1:] & ~stands[:-1])
    )
    sides = [side for _, side in begins]
    changes = sum(one != other for one, other in pairwise(sides))
    assert changes >= 0.7 * (len(sides) - 1)
    assert len(sides) >= 2


@pytest.mark.recordings
def test_contacts_hardly_depend_on_the_rate(recordings):
    source = read_motion(recordings / "mocap/cmu_asfamc/35/35_01.amc")
    body = retarget(source)
    fast, slow = contacts(body), contacts(resample(body, 40.0))
    assert (fast.left[::3] == slow.left).mean() > 0.93
    assert (fast.right[::3] == slow.right).mean() > 0.93
