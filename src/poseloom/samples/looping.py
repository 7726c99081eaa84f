"""One cycle of a motion, repeated into a longer one."""

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import PoseloomError
from poseloom.rotations import (
    heading_angle,
    heading_matrix,
    matrix_from_rotvec,
    quat_conjugate,
    quat_from_matrix,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
    unwrap_rotvec,
)
from poseloom.skeleton.motion import Motion, make_motion


def loop(motion: Motion, cycles: int, blend: float = 0.25) -> Motion:
    """The motion `cycles` times in a row, each cycle beginning where, and heading as, the one before ended.

    The last frame of a cycle is the first of the next, once the next is moved along the floor and turned about the
    vertical. What is then left between the two poses (recorded cycles do not close by themselves) is taken up by halves
    before and after each seam.

    Args:
        motion: One cycle, of at least two frames.
        cycles: How often it is played, 1 or more.
        blend: Seconds before and after a seam over which the gap is closed, at most half a cycle.

    Raises:
        PoseloomError: for a motion of one frame, or no cycles.
    """
    if cycles < 1 or len(motion) < 2:
        raise PoseloomError(
            f"{len(motion)} frames cannot be repeated {cycles} times",
            remedy="Give two frames or more, and one cycle or more",
        )
    start, stop = _seam_corrections(motion, blend)
    parts: list[Floats[Array, "frames dofs"]] = []
    heading, place = 0.0, motion.q[0, [0, 2]]
    turn, way = _cycle_step(motion)
    for cycle in range(cycles):
        q = np.array(motion.q)
        if cycle > 0:
            q = _corrected(q, start)
        if cycle < cycles - 1:
            q = _corrected(q, stop)
        parts.append(_moved(q, motion.q[0, [0, 2]], heading, place)[1 if cycle else 0 :])
        place = place + _turned(way, heading)
        heading += turn
    q = np.concatenate(parts)
    q[:, 3:] = unwrap_rotvec(q[:, 3:].reshape(len(q), -1, 3)).reshape(len(q), -1)
    return make_motion(motion.skeleton, frozen_float(q), motion.rate, motion.name)


def _cycle_step(motion: Motion) -> tuple[float, Floats[Array, "2"]]:
    """How far one cycle turns about the vertical, radians, and leads over the floor (x, z), metres."""
    first, last = matrix_from_rotvec(motion.q[[0, -1], 3:6])
    turn = float(heading_angle(quat_from_matrix(last @ first.T)))
    return turn, motion.q[-1, [0, 2]] - motion.q[0, [0, 2]]


def _turned(way: Floats[Array, "*batch 2"], heading: float) -> Floats[Array, "*batch 2"]:
    sine, cosine = np.sin(heading), np.cos(heading)
    return np.stack([cosine * way[..., 0] + sine * way[..., 1], cosine * way[..., 1] - sine * way[..., 0]], axis=-1)


def _moved(
    q: Floats[Array, "frames dofs"], origin: Floats[Array, "2"], heading: float, place: Floats[Array, "2"]
) -> Floats[Array, "frames dofs"]:
    """The poses turned about the vertical through `origin` and carried from there to `place`."""
    out = np.array(q)
    out[:, [0, 2]] = place + _turned(q[:, [0, 2]] - origin, heading)
    turn = quat_from_matrix(heading_matrix(np.array(heading)))
    out[:, 3:6] = rotvec_from_quat(quat_multiply(turn, quat_from_rotvec(q[:, 3:6])))
    return out


class _Correction:
    """Turns (applied on the right of each joint's rotation) and root heights to be added over a stretch of frames."""

    def __init__(
        self, frames: slice, turns: Floats[Array, "stretch joints 3"], heights: Floats[Array, "stretch"]
    ) -> None:
        self.frames = frames
        self.turns = turns
        self.heights = heights


def _seam_corrections(motion: Motion, blend: float) -> tuple[_Correction, _Correction]:
    """What closes half of the gap at a cycle's start, and the other half at its end."""
    turn, _ = _cycle_step(motion)
    first, last = quat_from_rotvec(motion.rotvecs[[0, -1]])
    first = first.copy()
    first[0] = quat_multiply(quat_from_matrix(heading_matrix(np.array(turn))), first[0])
    gap = rotvec_from_quat(quat_multiply(quat_conjugate(last), first))
    rise = motion.q[0, 1] - motion.q[-1, 1]
    count = int(np.clip(round(blend * motion.rate), 1, len(motion) // 2))
    share = np.linspace(1.0, 0.0, count + 1)[:-1]
    share = 0.5 * share**2 * (3 - 2 * share)
    size = len(motion)
    start = _Correction(slice(0, count), -share[:, None, None] * gap, -share * rise)
    stop = _Correction(slice(size - count, size), share[::-1, None, None] * gap, share[::-1] * rise)
    return start, stop


def _corrected(q: Floats[Array, "frames dofs"], correction: _Correction) -> Floats[Array, "frames dofs"]:
    out = np.array(q)
    stretch = out[correction.frames]
    joints = quat_from_rotvec(stretch[:, 3:].reshape(correction.turns.shape))
    turned = rotvec_from_quat(quat_multiply(joints, quat_from_rotvec(correction.turns)))
    stretch[:, 3:] = turned.reshape(len(stretch), -1)
    stretch[:, 1] += correction.heights
    return out
