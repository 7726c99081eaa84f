"""The poses of a library that look like a given one, by exact search."""

from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.library.catalogue import Clip
from poseloom.library.library import MotionLibrary
from poseloom.library.postures import JOINT_COORDINATES, JOINTS, postures

_CHUNK = 1 << 16


class SimilarPose(NamedTuple):
    """A pose that looks like the one asked for.

    Attributes:
        clip: Its clip.
        row: Its row among the library's poses.
        distance: Root mean square distance of head, elbows, wrists, knees and ankles, seen from the hips, in metres.
    """

    clip: Clip
    row: int
    distance: float


def similar_poses(library: MotionLibrary, q: Floats[Array, "dofs"], count: int = 10) -> list[SimilarPose]:
    """The nearest pose of each of the `count` nearest clips, nearest first. Place and heading do not matter.

    Args:
        library: Where to look.
        q: Pose vector of the body, of any size.
        count: How many clips.
    """
    wanted = postures(q[None].astype(np.float32))[0, :JOINT_COORDINATES]
    squares = np.empty(len(library.poses))
    for start in range(0, len(squares), _CHUNK):
        part = postures(library.poses[start : start + _CHUNK])[:, :JOINT_COORDINATES] - wanted
        squares[start : start + len(part)] = np.einsum("ij,ij->i", part, part)
    nearest = [clip.start + int(squares[clip.rows].argmin()) for clip in library.clips]
    best = sorted(zip(library.clips, nearest, strict=True), key=lambda pair: squares[pair[1]])[:count]
    return [SimilarPose(clip, row, float(np.sqrt(squares[row] / len(JOINTS)))) for clip, row in best]
