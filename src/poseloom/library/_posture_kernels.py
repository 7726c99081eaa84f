"""Postures of many poses, and how nearly two windows of them are the same movement."""

import math

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints, compiled
from poseloom.skeleton._kernels import forward


@compiled
def joint_places(
    parents: Ints[Array, "joints"],
    offsets: Floats[Array, "joints 3"],
    poses: Floats32[Array, "poses dofs"],
    joints: Ints[Array, "points"],
    out: Floats32[Array, "poses coordinates"],
) -> None:
    """Places of joints in the hips' frame, metres."""
    count = parents.shape[0]
    q = np.empty(poses.shape[1])
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    for i in range(poses.shape[0]):
        q[:6] = 0.0
        q[6:] = poses[i, 6:]
        forward(parents, offsets, q, positions, rotations)
        for p in range(joints.shape[0]):
            for a in range(3):
                out[i, 3 * p + a] = positions[joints[p], a]


@compiled
def window_misfits(
    postures: Floats32[Array, "poses coordinates"],
    others: Floats32[Array, "other_poses coordinates"],
    width: int,
    starts: Ints[Array, "pairs"],
    other_starts: Ints[Array, "pairs"],
    lowest: Ints[Array, "pairs"],
    highest: Ints[Array, "pairs"],
    length: int,
    out: Floats[Array, "pairs"],
) -> None:
    """For pairs of windows the root mean square difference as a share of the first one's movement.

    The first `width` coordinates count. Their constant difference is taken out, and the second window may lie up to one
    frame earlier or later, between frames too, as long as it stays within the rows `lowest` to `highest` - 1.
    """
    sums, shift_sums, own_sums = np.empty(width), np.empty(width), np.empty(width)
    squares, shift_squares, products, own_squares = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    for pair in range(starts.shape[0]):
        t, u = starts[pair], other_starts[pair]
        best, movement = math.inf, 0.0
        for side in range(-1, 2, 2):
            if u + side < lowest[pair] or u + side + length > highest[pair]:
                continue
            for column in range(width):
                sums[column] = shift_sums[column] = own_sums[column] = 0.0
                squares[column] = shift_squares[column] = products[column] = own_squares[column] = 0.0
            for k in range(length):
                for column in range(width):
                    own = float(postures[t + k, column])
                    other = float(others[u + k, column])
                    difference = own - other
                    shift = float(others[u + side + k, column]) - other
                    own_sums[column] += own
                    own_squares[column] += own * own
                    sums[column] += difference
                    squares[column] += difference * difference
                    shift_sums[column] += shift
                    shift_squares[column] += shift * shift
                    products[column] += difference * shift
            dd = ds = ss = movement = 0.0
            for column in range(width):
                dd += squares[column] - sums[column] * sums[column] / length
                ds += products[column] - sums[column] * shift_sums[column] / length
                ss += shift_squares[column] - shift_sums[column] * shift_sums[column] / length
                movement += own_squares[column] - own_sums[column] * own_sums[column] / length
            fraction = min(max(ds / ss, 0.0), 1.0) if ss > 0.0 else 0.0
            best = min(best, max(dd - 2.0 * fraction * ds + fraction * fraction * ss, 0.0))
        out[pair] = math.sqrt(best / movement) if movement > 0.0 else math.inf
