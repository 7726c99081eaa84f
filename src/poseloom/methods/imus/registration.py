"""Registration: segments of one phase, moved to one ground point and heading and warped to one time.

Source: section 4.3 of the single-IMU paper; Kovar and Gleicher, Flexible automatic motion blending with registration
curves, 2003. Each segment's start is put above the origin, facing ahead; then dynamic time warping leads it to the
phase's reference, here the medoid: the segment whose warped distance to all others is least in sum. The same warp is
applied to the sensor's signal, so that motion and signal stay together.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Ints
from poseloom.errors import MethodError
from poseloom.methods.imus import _warping_kernels as kernels
from poseloom.rotations import (
    heading_angle,
    heading_matrix,
    matrix_from_rotvec,
    quat_from_matrix,
    quat_from_rotvec,
    rotvec_from_quat,
)

MOST_CANDIDATES = 40
"""Segments of a phase among which the medoid is sought: all pairs of a thousand would take minutes."""


class Warp(NamedTuple):
    """A time warp between a segment and its reference.

    Attributes:
        cost: Mean squared distance of the pairs on the path.
        path: Pairs of frames, of the segment and of the reference, monotonous in both.
    """

    cost: float
    path: Ints[Array, "steps 2"]

    def of_reference(self, frames: int) -> Ints[Array, "frames"]:
        """For each of the reference's `frames` the segment's frame: of several the middle one."""
        return _middles(self.path[:, 1], self.path[:, 0], frames)

    def of_segment(self, frames: int) -> Ints[Array, "frames"]:
        """For each of the segment's `frames` the reference's frame: of several the middle one."""
        return _middles(self.path[:, 0], self.path[:, 1], frames)


def grounded(q: Floats[Array, "frames dofs"]) -> Floats[Array, "frames dofs"]:
    """Pose vectors moved so that the first frame's root stands above the origin and its heading is zero (+Z).

    The whole stretch moves as one piece; heights, and all joint angles but the root's, stay as they are.
    """
    heading = heading_angle(quat_from_rotvec(q[0, 3:6]))
    back = heading_matrix(np.array(-heading))
    out = q.copy()
    out[:, :3] -= np.array([q[0, 0], 0.0, q[0, 2]])
    out[:, :3] = out[:, :3] @ back.T
    out[:, 3:6] = rotvec_from_quat(quat_from_matrix(back @ matrix_from_rotvec(q[:, 3:6])))
    return out


def time_warp(segment: Floats[Array, "frames columns"], reference: Floats[Array, "others columns"]) -> Warp:
    """Dynamic time warping of a segment's features to its reference's; both ends are tied.

    Raises:
        MethodError: for an empty series, or features of different width.
    """
    if len(segment) == 0 or len(reference) == 0 or segment.shape[1] != reference.shape[1]:
        raise MethodError(
            f"series of shapes {segment.shape} and {reference.shape} cannot be warped to each other",
            remedy="Give series of at least one frame with the same columns",
        )
    path = np.empty((len(segment) + len(reference), 2), dtype=np.int64)
    cost, begin = kernels.warp_path(np.ascontiguousarray(segment), np.ascontiguousarray(reference), path)
    steps = path[begin:]
    return Warp(cost / len(steps), steps)


def medoid(segments: Sequence[NDArray[np.float64]], seed: int = 0) -> int:
    """Index of the segment whose warped distance to the others is least in sum.

    Of more than `MOST_CANDIDATES` segments as many are drawn, and the medoid is theirs.

    Raises:
        MethodError: for no segments.
    """
    if not segments:
        raise MethodError("there is no segment to register to", remedy="Give at least one")
    chosen = np.arange(len(segments))
    if len(chosen) > MOST_CANDIDATES:
        chosen = np.sort(np.random.default_rng(seed).choice(chosen, MOST_CANDIDATES, replace=False))
    apart = np.zeros((len(chosen), len(chosen)))
    pieces = [segments[int(index)] for index in chosen]
    for row, one in enumerate(pieces):
        for column, other in enumerate(pieces[:row]):
            apart[row, column] = apart[column, row] = time_warp(one, other).cost
    return int(chosen[int(np.argmin(apart.sum(axis=1)))])


def register(segments: Sequence[NDArray[np.float64]], reference: int) -> tuple[Warp, ...]:
    """The warp of each segment to the reference segment of this index."""
    return tuple(time_warp(segment, segments[reference]) for segment in segments)


def _middles(keys: Ints[Array, "steps"], values: Ints[Array, "steps"], count: int) -> Ints[Array, "count"]:
    first = np.searchsorted(keys, np.arange(count), side="left")
    last = np.searchsorted(keys, np.arange(count), side="right") - 1
    return values[(first + last) // 2]
