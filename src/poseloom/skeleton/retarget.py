"""Any source skeleton's motion on the 22-bone body, by the names of its joints."""

from dataclasses import replace
from typing import Literal

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import RetargetError
from poseloom.rotations import matrix_from_rotvec
from poseloom.skeleton._alignment import align, leg_length
from poseloom.skeleton._retarget_kernels import bone_rotvecs
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.contacts import floor_height
from poseloom.skeleton.families import recognise
from poseloom.skeleton.forearms import share_arm_twist
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, RestChoice, make_motion
from poseloom.skeleton.skeleton import Skeleton


def retarget(motion: Motion, size: Skeleton | Literal["keep"] = "keep", rest: RestChoice | None = None) -> Motion:
    """The motion on the body, with the direction of every limb and spine bone as in the source and the floor at y = 0.

    A body bone turns with its source joint (`families`): `R_world_bone = R_world_joint @ R_joint_bone`, where the
    constant `R_joint_bone` lays the body's T-pose over the source's rest pose with the smallest turn of each bone.
    A zero pose that no body could take is replaced by one found from the motion (`_rest_from_motion`).
    Where a family's straight arms twist at random, twist goes from forearm to upper arm (`share_arm_twist`). Only the
    root's place depends on `size`; all rotations are the same.

    Args:
        motion: A motion of a skeleton of one of the known families, Y up, metres.
        size: "keep" gives the body the source's bone lengths, so that joints stay where they were; a skeleton with the
            body's hierarchy, such as `average_body()`, gives it that size, and the way between the feet's and the hips'
            places is scaled by the ratio of leg lengths.
        rest: Which pose of the source is laid over the T-pose (`RestChoice`); as its conventions say where it is None.

    Raises:
        RetargetError: if the joint names belong to no family (it lists the unmapped names), `size` is not the body, or
            the zero pose is no body's and the motion does not show how its bones are turned about themselves.
    """
    family = recognise(motion.skeleton)
    source = motion_frames(motion)
    told = motion.conventions
    alignment = align(motion.skeleton, family, source, rest or (told.rest if told else "auto"))
    own = alignment.skeleton
    turns = np.empty((len(motion), len(BODY_BONES), 3))
    bone_rotvecs(
        own.parents,
        alignment.turns,
        alignment.R_turn_bone,
        alignment.aims,
        alignment.ideals,
        source.positions,
        source.rotations,
        turns,
    )
    q = np.concatenate([source.positions[:, alignment.root], turns.reshape(len(motion), -1)], axis=1)
    if family.loose_forearms:
        q = share_arm_twist(q)
    body = own
    if not isinstance(size, str):
        body = _checked_body(size)
        q[:, :3] = _scaled_roots(q, own, body)
    q[:, 1] -= floor_height(make_motion(body, q, motion.rate, motion.name))
    found = None if told is None else replace(told, rest_origin=alignment.origin, unsure=alignment.unsure)
    return replace(make_motion(body, q, motion.rate, motion.name), conventions=found)


def _scaled_roots(q: Floats[Array, "frames dofs"], own: Skeleton, body: Skeleton) -> Floats[Array, "frames 3"]:
    """Root places for a body of another size: the middle between the thighs' heads travels, scaled with the legs.

    Families put the root at different heights in the pelvis; the thighs are where they agree.
    """
    R_world_hips = matrix_from_rotvec(q[:, 3:6])
    between = q[:, :3] + R_world_hips @ _between_thighs(own)
    return between * (leg_length(body) / leg_length(own)) - R_world_hips @ _between_thighs(body)


def _between_thighs(skeleton: Skeleton) -> Floats[Array, "3"]:
    return skeleton.offsets[[skeleton.index("leftUpperLeg"), skeleton.index("rightUpperLeg")]].mean(axis=0)


def _checked_body(size: Skeleton) -> Skeleton:
    if size.names != BODY_BONES:
        raise RetargetError(
            f"the size to take on is a skeleton of {len(size)} joints, not the body of {len(BODY_BONES)} bones",
            remedy='Give a skeleton with the body\'s hierarchy, such as average_body(), or "keep"',
        )
    return size
