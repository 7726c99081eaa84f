"""The pose that some recordings put before their first frame."""

import numpy as np

from poseloom.rotations import geodesic_angle, quat_from_rotvec
from poseloom.skeleton.motion import Motion

_JUMP = float(np.deg2rad(8.0))
_TIMES = 4.0
_FOLLOWING = 12
_STILL = 1e-6


def starts_with_rest_frame(motion: Motion) -> bool:
    """Whether frame 0 is no part of the movement but the pose in which the skeleton was drawn.

    A joint must jump from it to frame 1 by more than 8 degrees. Then frame 0 is told either by the root and at least
    half of the joints, which are not turned at all (no living body does that), or by the jump itself, if it is more
    than four times the largest step of the twelve frames after. So begin most BVH files made from CMU's recordings and
    the exponential maps made from these; but 131_01 to 131_03 and 16_15 begin with the movement.
    """
    quats = quat_from_rotvec(motion.rotvecs[: _FOLLOWING + 2])
    if len(quats) < 3:
        return False
    steps = geodesic_angle(quats[:-1], quats[1:]).max(axis=1)
    unturned = np.linalg.norm(motion.rotvecs[0], axis=1) < _STILL
    drawn = bool(unturned[0] and 2 * np.count_nonzero(unturned) >= len(unturned))
    first, later = float(steps[0]), float(steps[1:].max())
    return first > _JUMP and (drawn or first > _TIMES * later)


def drop_rest_frame(motion: Motion) -> Motion:
    """The motion without frame 0 where that is no part of the movement (`starts_with_rest_frame`), else unchanged."""
    return motion.cut(1, len(motion)) if starts_with_rest_frame(motion) else motion
