"""Kernels over whole recordings: Euler angles to rotation vectors that are continuous in time."""

import math

import numpy as np

from poseloom.arrays import Array, Floats, Ints, compiled


@compiled
def rotvecs_from_euler(
    angles: Floats[Array, "frames joints turns"],
    axes: Ints[Array, "joints turns"],
    out: Floats[Array, "frames joints 3"],
) -> None:
    """Fills rotation vectors of products of turns, left to right, each on the branch nearest to the frame before."""
    frames, joints, turns = angles.shape
    for joint in range(joints):
        px, py, pz = 0.0, 0.0, 0.0
        for frame in range(frames):
            w, x, y, z = 1.0, 0.0, 0.0, 0.0
            for turn in range(turns):
                axis = axes[joint, turn]
                if axis < 0:
                    continue
                half = 0.5 * angles[frame, joint, turn]
                c, s = math.cos(half), math.sin(half)
                if axis == 0:
                    w, x, y, z = c * w - s * x, c * x + s * w, c * y + s * z, c * z - s * y
                elif axis == 1:
                    w, x, y, z = c * w - s * y, c * x - s * z, c * y + s * w, c * z + s * x
                else:
                    w, x, y, z = c * w - s * z, c * x + s * y, c * y - s * x, c * z + s * w
            if w < 0.0:
                w, x, y, z = -w, -x, -y, -z
            sine = math.sqrt(x * x + y * y + z * z)
            angle = 2.0 * math.atan2(sine, w)
            factor = 2.0 if sine < 1e-12 else angle / sine
            x, y, z = factor * x, factor * y, factor * z
            if frame > 0:
                x, y, z = _nearest_branch(x, y, z, angle, px, py, pz)
            out[frame, joint, 0], out[frame, joint, 1], out[frame, joint, 2] = x, y, z
            px, py, pz = x, y, z


@compiled
def _nearest_branch(
    x: float, y: float, z: float, angle: float, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """As `nearest_branch`, for one rotation vector (x, y, z) of known angle and its reference."""
    if angle < 1e-12:
        size = math.sqrt(px * px + py * py + pz * pz)
        if size < 1e-12:
            return x, y, z
        ax, ay, az = px / size, py / size, pz / size
    else:
        ax, ay, az = x / angle, y / angle, z / angle
    turn = 2.0 * math.pi
    whole = turn * np.round((ax * px + ay * py + az * pz - angle) / turn)
    return x + whole * ax, y + whole * ay, z + whole * az
