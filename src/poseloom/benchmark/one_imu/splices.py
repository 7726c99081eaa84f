"""Motions put together from two takes by a motion graph's blend, to have changes of behaviour whose moment is known."""

from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.one_imu.measures import headings, placed_joints
from poseloom.rotations import (
    heading_matrix,
    matrix_from_rotvec,
    quat_from_rotvec,
    rotvec_from_matrix,
    rotvec_from_quat,
    slerp,
    unwrap_rotvec,
)
from poseloom.skeleton.differences import derivative
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.retarget import retarget

_BLEND = 1 / 3
"""Seconds of a blend, as Kovar et al. 2002 have it."""

_VELOCITY = 0.2
"""Seconds by which velocities are multiplied to be compared with places."""


class Splice(NamedTuple):
    """A motion put together.

    Attributes:
        motion: It.
        change: The frame in the middle of the blend.
    """

    motion: Motion
    change: int


def splice(first: Motion, second: Motion, lead: float, tail: float) -> Splice:
    """The first motion up to where it looks most like some moment of the second, then the second from there on.

    Args:
        first: On the body.
        second: On the body, at the same rate; put on the first one's bones.
        lead: Seconds of the first that there must be before the blend.
        tail: Seconds of the second that there must be after it.

    Returns:
        The motion, of exactly `lead` + blend + `tail` seconds where the takes are long enough.
    """
    other = retarget(second, first.skeleton)
    rate, blend = first.rate, max(round(_BLEND * first.rate), 2)
    before, after = round(lead * rate), round(tail * rate)
    ours = np.arange(min(before, len(first) - blend - 1), len(first) - blend)
    theirs = np.arange(0, max(len(other) - blend - after, 1))
    looks, looks_other = _looks(first), _looks(other)
    apart = np.square(looks[ours][:, None] - looks_other[theirs][None]).mean(axis=2)
    i, j = np.unravel_index(int(apart.argmin()), apart.shape)
    leave, enter = int(ours[i]), int(theirs[j])
    start, stop = max(leave - before, 0), min(enter + blend + after, len(other))
    head = first.q[start : leave + blend]
    turned = _moved(other.q[enter:stop], first.q[leave + blend // 2], blend // 2)
    faded = _faded(head[-blend:], turned[:blend])
    q = np.concatenate([head[:-blend], faded, turned[blend:]])
    q[:, 3:] = unwrap_rotvec(q[:, 3:].reshape(len(q), -1, 3)).reshape(len(q), -1)
    name = f"{first.name} to {second.name}"
    return Splice(make_motion(first.skeleton, q, rate, name), leave - start + blend // 2)


def _looks(motion: Motion) -> Floats[Array, "frames columns"]:
    """Places of joints seen from the hips, their velocities, and the way of the hips, all in metres."""
    places = placed_joints(motion).reshape(len(motion), -1)
    velocity = derivative(places, motion.rate)
    back = heading_matrix(-headings(motion))
    way = derivative(motion.q[:, :3], motion.rate)
    speed = np.einsum("fij,fj->fi", back, way)
    return np.concatenate([places, _VELOCITY * velocity, 2 * _VELOCITY * speed], axis=1)


def _moved(q: Floats[Array, "frames dofs"], onto: Floats[Array, "dofs"], at: int) -> Floats[Array, "frames dofs"]:
    """Poses turned and moved over the ground so that pose `at` stands and faces as `onto` does."""
    facing = quat_from_rotvec(np.stack([onto[3:6], q[at, 3:6]]))
    angles = 2 * np.arctan2(facing[:, 2], facing[:, 0])
    turn = heading_matrix(np.array(angles[0] - angles[1]))
    out = np.array(q)
    level = np.array([1.0, 0.0, 1.0])
    out[:, :3] = (q[:, :3] - level * q[at, :3]) @ turn.T + level * onto[:3]
    out[:, 3:6] = rotvec_from_matrix(turn @ matrix_from_rotvec(q[:, 3:6]))
    return out


def _faded(first: Floats[Array, "frames dofs"], second: Floats[Array, "frames dofs"]) -> Floats[Array, "frames dofs"]:
    """From one run of poses to another, with Kovar's weights."""
    where = np.arange(1, len(first) + 1, dtype=np.float64) / (len(first) + 1)
    share = 3 * where**2 - 2 * where**3
    root = (1 - share)[:, None] * first[:, :3] + share[:, None] * second[:, :3]
    quats = [quat_from_rotvec(q[:, 3:].reshape(len(q), -1, 3)) for q in (first, second)]
    both = slerp(quats[0], quats[1], np.repeat(share[:, None], quats[0].shape[1], axis=1))
    return np.concatenate([root, rotvec_from_quat(both).reshape(len(first), -1)], axis=1)
