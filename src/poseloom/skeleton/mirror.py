"""Left-right mirror images: a second motion for the price of one."""

from dataclasses import replace

import numpy as np

from poseloom.arrays import Array, Floats, frozen, frozen_float
from poseloom.errors import SkeletonError
from poseloom.skeleton.body import BODY_BONES, MIRROR, mirror_bones
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton

MIRROR_TURN = np.array([1.0, -1.0, -1.0])
"""Reflection in the body's sagittal plane, for rotation vectors: an axis is a pseudovector."""


def mirror_skeleton(skeleton: Skeleton) -> Skeleton:
    """The body whose left side has the sizes of the right one, and the other way round.

    Raises:
        SkeletonError: if the skeleton is not the 22-bone body.
    """
    _require_body(skeleton)
    other = list(mirror_bones())
    return replace(
        skeleton,
        offsets=frozen_float(skeleton.offsets[other] * MIRROR),
        tips=frozen_float(skeleton.tips[other] * MIRROR),
        locked=frozen(skeleton.locked[other]),
    )


def mirror_pose_vectors(q: Floats[Array, "frames dofs"]) -> Floats[Array, "frames dofs"]:
    """Pose vectors of the body reflected in the plane x = 0: places (-x, y, z), turns (x, -y, -z), sides swapped."""
    out = np.empty_like(q)
    out[:, :3] = q[:, :3] * MIRROR
    turns = q[:, 3:].reshape(len(q), -1, 3)
    out[:, 3:] = (turns[:, list(mirror_bones())] * MIRROR_TURN).reshape(len(q), -1)
    return out


def mirror_motion(motion: Motion) -> Motion:
    """The motion of the body in a mirror that stands in the plane x = 0 of the world; mirroring twice gives it back.

    Raises:
        SkeletonError: if the motion's skeleton is not the 22-bone body (`retarget` it first).
    """
    return make_motion(mirror_skeleton(motion.skeleton), mirror_pose_vectors(motion.q), motion.rate, motion.name)


def _require_body(skeleton: Skeleton) -> None:
    if skeleton.names != BODY_BONES:
        raise SkeletonError(
            f"only the body of {len(BODY_BONES)} bones has a mirror image, not a skeleton of {len(skeleton)} joints",
            remedy="Retarget the motion to the body first",
        )
