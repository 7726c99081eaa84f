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
def gather_outputs(
    poses: Floats32[Array, "poses dofs"],
    rows: Ints[Array, "neighbours"],
    reference: Floats[Array, "dofs"],
    scale: float,
    out: Floats[Array, "neighbours dofs"],
) -> None:
    """Each row's pose from the ground point and heading of the row before, on the reference's branches.

    `scale` turns the library's metres into the wearer's.
    """
    turn, local = np.empty((3, 3)), np.empty((3, 3))
    for i in range(rows.shape[0]):
        row = rows[i]
        exp_matrix(float(poses[row - 1, 3]), float(poses[row - 1, 4]), float(poses[row - 1, 5]), turn)
        heading = heading_of(turn)
        c, s = math.cos(heading), math.sin(heading)
        dx = float(poses[row, 0]) - float(poses[row - 1, 0])
        dz = float(poses[row, 2]) - float(poses[row - 1, 2])
        out[i, 0] = scale * (c * dx - s * dz)
        out[i, 1] = scale * poses[row, 1]
        out[i, 2] = scale * (s * dx + c * dz)
        exp_matrix(float(poses[row, 3]), float(poses[row, 4]), float(poses[row, 5]), turn)
        for b in range(3):
            local[0, b] = c * turn[0, b] - s * turn[2, b]
            local[1, b] = turn[1, b]
            local[2, b] = s * turn[0, b] + c * turn[2, b]
        log_rotation(local, out[i, 3:6])
        for d in range(6, out.shape[1]):
            out[i, d] = poses[row, d]
        for j in range(1, out.shape[1] // 3):
            nearest_branch_in_place(out[i, 3 * j : 3 * j + 3], reference[3 * j : 3 * j + 3])


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
