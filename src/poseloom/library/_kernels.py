"""Features of library poses, row by row."""

import math

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints, compiled
from poseloom.rotations._kernels import exp_matrix
from poseloom.skeleton._kernels import forward


@compiled
def heading_of(rotation: Floats[Array, "3 3"]) -> float:
    """Turn about world up in a rotation matrix: the twist of its swing-twist split."""
    return math.atan2(rotation[0, 2] - rotation[2, 0], rotation[0, 0] + rotation[2, 2])


@compiled
def pose_block(
    q: Floats[Array, "dofs"],
    x: float,
    z: float,
    heading: float,
    bones: Ints[Array, "bones"],
    weights: Floats[Array, "bones"],
    root_weight: float,
    out: Floats[Array, "columns"],
) -> None:
    """One pose seen from a ground point and heading: root place, root tilt, and each bone's rotation (two columns)."""
    turn = np.empty((3, 3))
    c, s = math.cos(heading), math.sin(heading)
    dx, dz = q[0] - x, q[2] - z
    out[0] = root_weight * (c * dx - s * dz)
    out[1] = root_weight * q[1]
    out[2] = root_weight * (s * dx + c * dz)
    exp_matrix(float(q[3]), float(q[4]), float(q[5]), turn)
    for b in range(2):
        out[3 + 3 * b] = c * turn[0, b] - s * turn[2, b]
        out[4 + 3 * b] = turn[1, b]
        out[5 + 3 * b] = s * turn[0, b] + c * turn[2, b]
    for i in range(bones.shape[0]):
        at = 3 + 3 * bones[i]
        exp_matrix(float(q[at]), float(q[at + 1]), float(q[at + 2]), turn)
        for b in range(2):
            for a in range(3):
                out[9 + 6 * i + 3 * b + a] = weights[i] * turn[a, b]


@compiled
def history_block(
    history: Floats[Array, "moments dofs"],
    bones: Ints[Array, "bones"],
    weights: Floats[Array, "bones"],
    root_weight: float,
    change_weight: float,
    out: Floats[Array, "columns"],
) -> None:
    """The newest pose (first row) and, weighted, the changes from each older pose to the next younger one."""
    turn = np.empty((3, 3))
    exp_matrix(float(history[0, 3]), float(history[0, 4]), float(history[0, 5]), turn)
    heading = heading_of(turn)
    width = 9 + 6 * bones.shape[0]
    for moment in range(history.shape[0]):
        block = out[moment * width : (moment + 1) * width]
        pose_block(history[moment], history[0, 0], history[0, 2], heading, bones, weights, root_weight, block)
    for moment in range(history.shape[0] - 1, 0, -1):
        for column in range(width):
            younger = out[(moment - 1) * width + column]
            out[moment * width + column] = change_weight * (younger - out[moment * width + column])


@compiled
def sensor_block(
    positions: Floats[Array, "sensors 3"],
    rotations: Floats[Array, "sensors 3 3"],
    reference: int,
    place_weight: float,
    turn_weight: float,
    out: Floats[Array, "columns"],
) -> None:
    """Sensors' bones seen from the ground below the reference bone, along its heading: places and rotations."""
    heading = heading_of(rotations[reference])
    c, s = math.cos(heading), math.sin(heading)
    for i in range(positions.shape[0]):
        dx, dz = positions[i, 0] - positions[reference, 0], positions[i, 2] - positions[reference, 2]
        at = 9 * i
        out[at] = place_weight * (c * dx - s * dz)
        out[at + 1] = place_weight * positions[i, 1]
        out[at + 2] = place_weight * (s * dx + c * dz)
        turn = rotations[i]
        for b in range(2):
            out[at + 3 + 3 * b] = turn_weight * (c * turn[0, b] - s * turn[2, b])
            out[at + 4 + 3 * b] = turn_weight * turn[1, b]
            out[at + 5 + 3 * b] = turn_weight * (s * turn[0, b] + c * turn[2, b])


@compiled
def library_history(
    poses: Floats32[Array, "poses dofs"],
    rows: Ints[Array, "rows"],
    moments: int,
    bones: Ints[Array, "bones"],
    weights: Floats[Array, "bones"],
    root_weight: float,
    change_weight: float,
    out: Floats32[Array, "rows columns"],
) -> None:
    """History features of many library rows; the history of row r is the poses r - 1, r - 2, ..."""
    history = np.empty((moments, poses.shape[1]))
    block = np.empty(out.shape[1])
    for i in range(rows.shape[0]):
        for moment in range(moments):
            history[moment] = poses[rows[i] - 1 - moment]
        history_block(history, bones, weights, root_weight, change_weight, block)
        out[i] = block


@compiled
def library_sensors(
    parents: Ints[Array, "joints"],
    offsets: Floats[Array, "joints 3"],
    poses: Floats32[Array, "poses dofs"],
    rows: Ints[Array, "rows"],
    bones: Ints[Array, "sensors"],
    points: Floats[Array, "sensors 3"],
    reference: int,
    place_weight: float,
    turn_weight: float,
    out: Floats32[Array, "rows columns"],
) -> None:
    """Sensor features of many library rows, from forward kinematics."""
    count = parents.shape[0]
    q = np.empty(poses.shape[1])
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    places, turns = np.empty((bones.shape[0], 3)), np.empty((bones.shape[0], 3, 3))
    block = np.empty(out.shape[1])
    for i in range(rows.shape[0]):
        q[:] = poses[rows[i]]
        forward(parents, offsets, q, positions, rotations)
        for s in range(bones.shape[0]):
            bone = bones[s]
            turns[s] = rotations[bone]
            for a in range(3):
                places[s, a] = positions[bone, a]
                for b in range(3):
                    places[s, a] += rotations[bone, a, b] * points[s, b]
        sensor_block(places, turns, reference, place_weight, turn_weight, block)
        out[i] = block
