"""Library poses seen from the newest reconstructed pose."""

import math

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints, compiled
from poseloom.library._kernels import heading_of
from poseloom.rotations._kernels import exp_matrix, log_rotation


@compiled
def nearest_branch_in_place(rotvec: Floats[Array, "3"], reference: Floats[Array, "3"]) -> None:
    """Adds whole turns about the axis so that the rotation vector comes as near as can be to the reference."""
    angle = math.sqrt(rotvec[0] ** 2 + rotvec[1] ** 2 + rotvec[2] ** 2)
    if angle < 1e-9:
        return
    along = (rotvec[0] * reference[0] + rotvec[1] * reference[1] + rotvec[2] * reference[2]) / angle
    turns = np.round((along - angle) / (2.0 * math.pi))
    if turns != 0.0:
        factor = 1.0 + 2.0 * math.pi * turns / angle
        for a in range(3):
            rotvec[a] *= factor


@compiled
def into_heading(q: Floats[Array, "dofs"], x: float, z: float, heading: float, out: Floats[Array, "dofs"]) -> None:
    """A pose seen from a ground point and heading (its root's rotation vector on the branch below half a turn)."""
    turn, local = np.empty((3, 3)), np.empty((3, 3))
    c, s = math.cos(heading), math.sin(heading)
    out[:] = q
    dx, dz = q[0] - x, q[2] - z
    out[0] = c * dx - s * dz
    out[2] = s * dx + c * dz
    exp_matrix(float(q[3]), float(q[4]), float(q[5]), turn)
    for b in range(3):
        local[0, b] = c * turn[0, b] - s * turn[2, b]
        local[1, b] = turn[1, b]
        local[2, b] = s * turn[0, b] + c * turn[2, b]
    log_rotation(local, out[3:6])


@compiled
def root_heading(q: Floats[Array, "dofs"]) -> float:
    """Turn about world up of a pose's root."""
    turn = np.empty((3, 3))
    exp_matrix(float(q[3]), float(q[4]), float(q[5]), turn)
    return heading_of(turn)


@compiled
def gather_outputs(
    poses: Floats32[Array, "poses dofs"],
    rows: Ints[Array, "neighbours"],
    previous: Floats[Array, "dofs"],
    scale: float,
    persistence: float,
    out: Floats[Array, "neighbours dofs"],
) -> None:
    """What each row says of the next pose, from the ground point and heading of the pose before it.

    A row says partly "be where I am" and partly, with the share `persistence`, "move as I moved": its pose is shifted
    by that share of the difference between the previous pose and the pose before the row. Rotation vectors are brought
    to the branches of `previous`; `scale` turns the library's metres into the wearer's.
    """
    size = out.shape[1]
    row_before, row_now, before = np.empty(size), np.empty(size), np.empty(size)
    for i in range(rows.shape[0]):
        for d in range(size):
            row_before[d] = poses[rows[i] - 1, d]
            row_now[d] = poses[rows[i], d]
        heading = root_heading(row_before)
        into_heading(row_before, float(row_before[0]), float(row_before[2]), heading, before)
        into_heading(row_now, float(row_before[0]), float(row_before[2]), heading, out[i])
        for d in range(3):
            before[d] *= scale
            out[i, d] *= scale
        for j in range(1, size // 3):
            nearest_branch_in_place(before[3 * j : 3 * j + 3], previous[3 * j : 3 * j + 3])
            nearest_branch_in_place(out[i, 3 * j : 3 * j + 3], before[3 * j : 3 * j + 3])
        for d in range(size):
            out[i, d] += persistence * (previous[d] - before[d])
