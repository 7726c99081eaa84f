"""The inner loop of retargeting: a source's world rotations to the body's rotation vectors."""

import math

import numpy as np

from poseloom.arrays import Array, Floats, Ints, compiled
from poseloom.rotations._kernels import log_rotation


@compiled
def bone_rotvecs(
    parents: Ints[Array, "bones"],
    turns: Ints[Array, "bones"],
    R_turn_bone: Floats[Array, "bones 3 3"],
    aims: Ints[Array, "bones 2"],
    ideals: Floats[Array, "bones 3"],
    positions: Floats[Array, "frames joints 3"],
    rotations: Floats[Array, "frames joints 3 3"],
    out: Floats[Array, "frames bones 3"],
) -> None:
    """Fills rotation vectors relative to the parent bone, each on the branch nearest to the frame before's.

    Bone b is turned like joint `turns[b]` times `R_turn_bone[b]`. Where `aims[b]` names two joints, it is turned
    further, as little as possible, so that its direction `ideals[b]` runs from the first to the second.
    """
    world = np.empty((parents.shape[0], 3, 3))
    local = np.empty((3, 3))
    for frame in range(rotations.shape[0]):
        for j in range(parents.shape[0]):
            source = rotations[frame, turns[j]]
            for a in range(3):
                for b in range(3):
                    world[j, a, b] = (
                        source[a, 0] * R_turn_bone[j, 0, b]
                        + source[a, 1] * R_turn_bone[j, 1, b]
                        + source[a, 2] * R_turn_bone[j, 2, b]
                    )
            if aims[j, 0] >= 0:
                _aim(world[j], ideals[j], positions[frame, aims[j, 0]], positions[frame, aims[j, 1]])
            parent = parents[j]
            for a in range(3):
                for b in range(3):
                    if parent < 0:
                        local[a, b] = world[j, a, b]
                    else:
                        local[a, b] = (
                            world[parent, 0, a] * world[j, 0, b]
                            + world[parent, 1, a] * world[j, 1, b]
                            + world[parent, 2, a] * world[j, 2, b]
                        )
            log_rotation(local, out[frame, j])
            if frame > 0:
                _take_nearest_branch(out[frame, j], out[frame - 1, j])


@compiled
def _aim(
    rotation: Floats[Array, "3 3"], ideal: Floats[Array, "3"], begin: Floats[Array, "3"], end: Floats[Array, "3"]
) -> None:
    """Turns `rotation` by the smallest turn that takes the direction `ideal` of its frame along begin - end."""
    now, way, cross = np.empty(3), np.empty(3), np.empty(3)
    length, size = 0.0, 0.0
    for a in range(3):
        now[a] = rotation[a, 0] * ideal[0] + rotation[a, 1] * ideal[1] + rotation[a, 2] * ideal[2]
        way[a] = end[a] - begin[a]
        size += now[a] ** 2
        length += way[a] ** 2
    cosine = 0.0
    for a in range(3):
        now[a] /= math.sqrt(size)
        way[a] /= math.sqrt(length)
        cosine += now[a] * way[a]
    # Opposite directions have no smallest turn between them; a bone that folds back on itself stays as it is.
    if not cosine > -0.999:
        return
    for a in range(3):
        cross[a] = now[(a + 1) % 3] * way[(a + 2) % 3] - now[(a + 2) % 3] * way[(a + 1) % 3]
    turned = np.empty(3)
    for b in range(3):
        along = (cross[0] * rotation[0, b] + cross[1] * rotation[1, b] + cross[2] * rotation[2, b]) / (1.0 + cosine)
        for a in range(3):
            i, k = (a + 1) % 3, (a + 2) % 3
            turned[a] = (
                cosine * rotation[a, b] + cross[i] * rotation[k, b] - cross[k] * rotation[i, b] + along * cross[a]
            )
        for a in range(3):
            rotation[a, b] = turned[a]


@compiled
def _take_nearest_branch(turn: Floats[Array, "3"], before: Floats[Array, "3"]) -> None:
    """Moves `turn` by whole turns about its axis, as near to `before` as they bring it."""
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    size = math.sqrt(before[0] ** 2 + before[1] ** 2 + before[2] ** 2)
    if angle + size < math.pi:
        return
    axis = np.empty(3)
    along = 0.0
    for a in range(3):
        axis[a] = turn[a] / angle if angle > 1e-12 else before[a] / size
        along += axis[a] * before[a]
    turns = 2.0 * math.pi * np.rint((along - angle) / (2.0 * math.pi))
    for a in range(3):
        turn[a] += axis[a] * turns
