"""Interpolation of segments on SO(3), in compiled code."""

import math

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints, compiled


@compiled
def _log(w: float, x: float, y: float, z: float, out: Floats[Array, "3"]) -> None:
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 if sine < 1e-9 else 2.0 * math.atan2(sine, w) / sine
    out[0], out[1], out[2] = factor * x, factor * y, factor * z


@compiled
def _turned(quat: Floats[Array, "4"], x: float, y: float, z: float, out: Floats[Array, "4"]) -> None:
    """quat exp(x, y, z)."""
    angle = math.sqrt(x * x + y * y + z * z)
    factor = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    w = math.cos(0.5 * angle)
    x, y, z = factor * x, factor * y, factor * z
    qw, qx, qy, qz = quat[0], quat[1], quat[2], quat[3]
    out[0] = qw * w - qx * x - qy * y - qz * z
    out[1] = qw * x + qx * w + qy * z - qz * y
    out[2] = qw * y - qx * z + qy * w + qz * x
    out[3] = qw * z + qx * y - qy * x + qz * w


@compiled
def _apart(first: Floats[Array, "4"], second: Floats[Array, "4"], out: Floats[Array, "3"]) -> None:
    """log(first^-1 second)."""
    aw, ax, ay, az = first[0], -first[1], -first[2], -first[3]
    bw, bx, by, bz = second[0], second[1], second[2], second[3]
    _log(
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        out,
    )


@compiled
def interpolate(
    quats: Floats32[Array, "states joints 4"],
    features: Floats32[Array, "states columns"],
    maps: Ints[Array, "states"],
    gains: Floats32[Array, "maps entries columns"],
    variances: Floats32[Array, "maps entries"],
    lower: Ints[Array, "best"],
    upper: Ints[Array, "best"],
    fraction: Floats[Array, "best"],
    weights: Floats[Array, "best"],
    seen: Floats32[Array, "columns"],
    correction: float,
    mean: Floats[Array, "joints 4"],
    spread: Floats[Array, "entries"],
    speed: Floats[Array, "entries"],
    others: Floats[Array, "best others"],
) -> None:
    """The weighted mean on SO(3) of the segments' conditional means, its moment-matched variance, and its velocity.

    Each segment's pose at its own progress is the slerp of two of its frames, turned by the Gaussian map's correction
    gain (seen - features). Rows of `gains` are three a joint, then one for each column of `others`, which on entry
    holds each segment's other features and is corrected in place. `speed` gets the turn to the next frame.
    """
    count, joints = lower.shape[0], quats.shape[1]
    entries = 3 * joints
    poses = np.empty((count, joints, 4))
    here, there, turn = np.empty(4), np.empty(4), np.empty(3)
    turns = np.zeros(gains.shape[1])
    speed[:] = 0.0
    spread[:] = 0.0
    for b in range(count):
        i, j, f = lower[b], upper[b], fraction[b]
        g = maps[i]
        turns[:] = 0.0
        if correction > 0.0:
            for c in range(features.shape[1]):
                away = correction * (seen[c] - ((1.0 - f) * features[i, c] + f * features[j, c]))
                for e in range(gains.shape[1]):
                    turns[e] += gains[g, e, c] * away
        for e in range(others.shape[1]):
            others[b, e] += turns[entries + e]
        for q in range(joints):
            for a in range(4):
                here[a], there[a] = quats[i, q, a], quats[j, q, a]
            _apart(here, there, turn)
            _turned(here, f * turn[0], f * turn[1], f * turn[2], there)
            _turned(there, turns[3 * q], turns[3 * q + 1], turns[3 * q + 2], poses[b, q])
            if j > i:
                for a in range(3):
                    speed[3 * q + a] += weights[b] * turn[a]
        for e in range(entries):
            spread[e] += weights[b] * variances[g, e]
    for q in range(joints):
        for a in range(4):
            here[a] = 0.0
        for b in range(count):
            same = 0.0
            for a in range(4):
                same += poses[b, q, a] * poses[0, q, a]
            sign = 1.0 if same >= 0.0 else -1.0
            for a in range(4):
                here[a] += sign * weights[b] * poses[b, q, a]
        size = math.sqrt(here[0] ** 2 + here[1] ** 2 + here[2] ** 2 + here[3] ** 2)
        for a in range(4):
            here[a] /= size
        # The normalised sum is the mean to first order; one step in the tangent space makes it exact enough.
        for repeat in range(2):
            x = y = z = 0.0
            for b in range(count):
                _apart(here, poses[b, q], turn)
                x += weights[b] * turn[0]
                y += weights[b] * turn[1]
                z += weights[b] * turn[2]
                if repeat == 1:
                    for a in range(3):
                        spread[3 * q + a] += weights[b] * turn[a] * turn[a]
            if repeat == 0:
                _turned(here, x, y, z, there)
                for a in range(4):
                    here[a] = there[a]
        for a in range(4):
            mean[q, a] = here[a]


@compiled
def blend(
    last: Floats[Array, "joints 4"],
    speed: Floats[Array, "entries"],
    target: Floats[Array, "joints 4"],
    share: float,
    limit: float,
    out: Floats[Array, "joints 4"],
) -> None:
    """Each joint's last rotation moved on by its velocity, and from there the share of the way to the target.

    No joint is turned by more than `limit` radians beyond its velocity: a new mind must not jump.
    """
    moved, turn = np.empty(4), np.empty(3)
    for q in range(last.shape[0]):
        _turned(last[q], speed[3 * q], speed[3 * q + 1], speed[3 * q + 2], moved)
        _apart(moved, target[q], turn)
        angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
        part = share if share * angle <= limit else limit / angle
        _turned(moved, part * turn[0], part * turn[1], part * turn[2], out[q])
        size = math.sqrt(out[q, 0] ** 2 + out[q, 1] ** 2 + out[q, 2] ** 2 + out[q, 3] ** 2)
        for a in range(4):
            out[q, a] /= size
