"""A motion that can be played for ever: a way that goes on becomes a circle, anything else goes there and back."""

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.rotations import (
    geodesic_angle,
    heading_angle,
    heading_matrix,
    quat_from_matrix,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
    unwrap_rotvec,
)
from poseloom.samples.looping import loop
from poseloom.skeleton.motion import Motion, make_motion

_TRAVELS = 1.0
"""Metres that a motion must lead away to be bent into a circle."""
_LEAST_ROUND = 9.0
"""Metres of the circle at least."""
_LIKE = np.deg2rad(25.0)
"""How far joints may turn between the last pose and the first, in the mean, for a motion to count as cyclic."""


def endless_motion(motion: Motion) -> Motion:
    """The motion so that its first frame follows its last as any frame follows the one before.

    One that leads away and ends as it began (a walk) is looped and bent into a closed circle: at each frame it turns by
    the same angle about the vertical. Any other is played to its end and then backwards.
    """
    away = motion.q[-1, [0, 2]] - motion.q[0, [0, 2]]
    gap = geodesic_angle(quat_from_rotvec(motion.rotvecs[0, 1:]), quat_from_rotvec(motion.rotvecs[-1, 1:]))
    if float(np.hypot(*away)) < _TRAVELS or float(gap.mean()) > _LIKE or motion.displacements is not None:
        return _there_and_back(motion)
    thrice, size = loop(motion, 3), len(motion)
    cycle = thrice.cut(size - 1, 2 * size - 1)  # both of its ends are mended seams
    return _circle(cycle, max(1, int(np.ceil(_LEAST_ROUND / float(np.hypot(*away))))))


def _there_and_back(motion: Motion) -> Motion:
    q = np.concatenate([motion.q, motion.q[-2:0:-1]])
    return make_motion(motion.skeleton, q, motion.rate, motion.name)


def _circle(cycle: Motion, turns: int) -> Motion:
    frames = len(cycle) - 1
    total = frames * turns
    first, last = quat_from_rotvec(cycle.q[[0, -1], 3:6])
    own = float(heading_angle(quat_multiply(last, first * np.array([1.0, -1.0, -1.0, -1.0]))))
    # The cycle's own turn is taken out evenly, and an even turn of one round put in its place.
    place = np.arange(total)
    angles = 2 * np.pi * place / total - own * (place % frames) / frames
    steps = np.tile(np.diff(cycle.q[:, [0, 2]], axis=0), (turns, 1))
    ways = _turned(steps, angles + 0.5 * (2 * np.pi / total - own / frames))
    ways -= ways.mean(axis=0)  # what is left of closing the circle, a fraction of a millimetre a frame
    q = np.tile(cycle.q[:-1], (turns, 1))
    q[:, [0, 2]] = np.concatenate([np.zeros((1, 2)), np.cumsum(ways, axis=0)[:-1]])
    q[:, [0, 2]] -= q[:, [0, 2]].mean(axis=0)
    q[:, 3:6] = rotvec_from_quat(quat_multiply(quat_from_matrix(heading_matrix(angles)), quat_from_rotvec(q[:, 3:6])))
    q[:, 3:] = unwrap_rotvec(q[:, 3:].reshape(total, -1, 3)).reshape(total, -1)
    return make_motion(cycle.skeleton, q, cycle.rate, cycle.name)


def _turned(ways: Floats[Array, "frames 2"], angles: Floats[Array, "frames"]) -> Floats[Array, "frames 2"]:
    """Ways over the floor (x, z), each turned about the vertical."""
    sine, cosine = np.sin(angles), np.cos(angles)
    return np.stack([cosine * ways[:, 0] + sine * ways[:, 1], cosine * ways[:, 1] - sine * ways[:, 0]], axis=-1)
