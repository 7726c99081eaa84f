"""Library poses seen from the newest reconstructed pose."""

import math

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints, compiled
from poseloom.library._kernels import heading_of
from poseloom.rotations._kernels import exp_matrix, log_rotation

_SAFE = 2.0
"""Radians below which two rotation vectors are on each other's nearest branch, whatever their directions."""


@compiled
def nearest_branches_in_place(q: Floats[Array, "dofs"], reference: Floats[Array, "dofs"]) -> None:
    """Adds whole turns to a pose's rotation vectors so that they come as near as can be to the reference's."""
    for at in range(3, q.shape[0], 3):
        square = q[at] * q[at] + q[at + 1] * q[at + 1] + q[at + 2] * q[at + 2]
        other = reference[at] ** 2 + reference[at + 1] ** 2 + reference[at + 2] ** 2
        if square < 1e-18 or (square < _SAFE * _SAFE and other < 1.0):
            continue
        angle = math.sqrt(square)
        along = (q[at] * reference[at] + q[at + 1] * reference[at + 1] + q[at + 2] * reference[at + 2]) / angle
        turns = math.floor((along - angle) / (2.0 * math.pi) + 0.5)
        if turns != 0:
            factor = 1.0 + 2.0 * math.pi * turns / angle
            for a in range(3):
                q[at + a] *= factor


@compiled
def root_heading(q: Floats[Array, "dofs"]) -> float:
    """Turn about world up of a pose's root."""
    turn = np.empty((3, 3))
    exp_matrix(float(q[3]), float(q[4]), float(q[5]), turn)
    return heading_of(turn)


@compiled
def into_heading(q: Floats[Array, "dofs"], x: float, z: float, heading: float, out: Floats[Array, "dofs"]) -> None:
    """A pose seen from a ground point and heading (its root's rotation vector on the branch below half a turn)."""
    for d in range(6, q.shape[0]):
        out[d] = q[d]
    _root_into_heading(q, x, z, heading, out, np.empty((3, 3)), np.empty((3, 3)))


@compiled
def _root_into_heading(
    q: Floats[Array, "dofs"],
    x: float,
    z: float,
    heading: float,
    out: Floats[Array, "dofs"],
    turn: Floats[Array, "3 3"],
    local: Floats[Array, "3 3"],
) -> None:
    c, s = math.cos(heading), math.sin(heading)
    dx, dz = q[0] - x, q[2] - z
    out[0] = c * dx - s * dz
    out[1] = q[1]
    out[2] = s * dx + c * dz
    exp_matrix(float(q[3]), float(q[4]), float(q[5]), turn)
    for b in range(3):
        local[0, b] = c * turn[0, b] - s * turn[2, b]
        local[1, b] = turn[1, b]
        local[2, b] = s * turn[0, b] + c * turn[2, b]
    log_rotation(local, out[3:6])


@compiled
def gather_outputs(
    poses: Floats32[Array, "poses dofs"],
    rows: Ints[Array, "neighbours"],
    previous: Floats[Array, "dofs"],
    scale: float,
    persistence: float,
    out: Floats[Array, "neighbours dofs"],
    moved: Floats[Array, "neighbours dofs"],
) -> None:
    """What each row says of the next pose, from the ground point and heading of the pose before it.

    A row says partly "be where I am" and partly, with the share `persistence`, "move as I moved": its pose is shifted
    by that share of the difference between the previous pose and the pose before the row; in `moved`, by all of it.
    Rotation vectors are brought to the branches of `previous`; `scale` turns the library's metres into the wearer's.
    """
    size = out.shape[1]
    now, before = np.empty(size), np.empty(size)
    turn, local = np.empty((3, 3)), np.empty((3, 3))
    for i in range(rows.shape[0]):
        for d in range(size):
            before[d] = poses[rows[i] - 1, d]
            now[d] = poses[rows[i], d]
            out[i, d] = now[d]
        x, z = before[0], before[2]
        exp_matrix(float(before[3]), float(before[4]), float(before[5]), turn)
        heading = heading_of(turn)
        _root_into_heading(now, x, z, heading, out[i], turn, local)
        _root_into_heading(before, x, z, heading, before, turn, local)
        for d in range(3):
            before[d] *= scale
            out[i, d] *= scale
        nearest_branches_in_place(before, previous)
        nearest_branches_in_place(out[i], before)
        for d in range(size):
            moved[i, d] = out[i, d] + (previous[d] - before[d])
            out[i, d] += persistence * (previous[d] - before[d])


@compiled
def turn_gaps(
    offsets: Floats[Array, "sensors 3"],
    measured: Floats[Array, "sensors 3 3"],
    last: Floats[Array, "sensors 3 3"],
    carried: Floats[Array, "sensors 3 3"],
    swings: Floats[Array, "sensors 3"],
    gaps: Floats[Array, "sensors 3"],
) -> None:
    """Fills the rotation vectors that lead from exp(offset) measured to `last`, and from the measured to `carried`.

    A missing orientation leaves NaN.
    """
    turn, turned = np.empty((3, 3)), np.empty((3, 3))
    for s in range(offsets.shape[0]):
        exp_matrix(float(offsets[s, 0]), float(offsets[s, 1]), float(offsets[s, 2]), turn)
        for a in range(3):
            for b in range(3):
                turned[a, b] = 0.0
                for c in range(3):
                    turned[a, b] += turn[a, c] * measured[s, c, b]
        _log_between(last[s], turned, turn, swings[s])
        _log_between(carried[s], measured[s], turn, gaps[s])


@compiled
def _log_between(
    to: Floats[Array, "3 3"], start: Floats[Array, "3 3"], work: Floats[Array, "3 3"], out: Floats[Array, "3"]
) -> None:
    """Rotation vector of to start'; NaN where either is missing."""
    for a in range(3):
        for b in range(3):
            work[a, b] = 0.0
            for c in range(3):
                work[a, b] += to[a, c] * start[b, c]
    if math.isfinite(work[0, 0]):
        log_rotation(work, out)
    else:
        for a in range(3):
            out[a] = math.nan
