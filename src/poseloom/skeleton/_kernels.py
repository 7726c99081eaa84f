"""Forward kinematics and Jacobians, one frame at a time, for the inner loops."""

import numpy as np

from poseloom.arrays import Array, Floats, Ints, compiled
from poseloom.rotations._kernels import exp_matrix, left_jacobian_matrix


@compiled
def forward(
    parents: Ints[Array, "joints"],
    offsets: Floats[Array, "joints 3"],
    q: Floats[Array, "dofs"],
    positions: Floats[Array, "joints 3"],
    rotations: Floats[Array, "joints 3 3"],
) -> None:
    """Fills world positions and rotations of all joints: R_j = R_parent exp(w_j), p_j = p_parent + R_parent o_j."""
    local = np.empty((3, 3))
    for j in range(parents.shape[0]):
        exp_matrix(q[3 + 3 * j], q[4 + 3 * j], q[5 + 3 * j], local)
        parent = parents[j]
        if parent < 0:
            for a in range(3):
                positions[j, a] = q[a]
                for b in range(3):
                    rotations[j, a, b] = local[a, b]
        else:
            for a in range(3):
                r0, r1, r2 = rotations[parent, a, 0], rotations[parent, a, 1], rotations[parent, a, 2]
                positions[j, a] = positions[parent, a] + r0 * offsets[j, 0] + r1 * offsets[j, 1] + r2 * offsets[j, 2]
                for b in range(3):
                    rotations[j, a, b] = r0 * local[0, b] + r1 * local[1, b] + r2 * local[2, b]


@compiled
def forward_batch(
    parents: Ints[Array, "joints"],
    offsets: Floats[Array, "one_or_frames joints 3"],
    q: Floats[Array, "frames dofs"],
    positions: Floats[Array, "frames joints 3"],
    rotations: Floats[Array, "frames joints 3 3"],
) -> None:
    """Forward kinematics of many frames; `offsets` has one row for all, or one a frame."""
    for frame in range(q.shape[0]):
        row = frame if offsets.shape[0] > 1 else 0
        forward(parents, offsets[row], q[frame], positions[frame], rotations[frame])


@compiled
def rotation_axes(
    parents: Ints[Array, "joints"],
    q: Floats[Array, "dofs"],
    rotations: Floats[Array, "joints 3 3"],
    axes: Floats[Array, "joints 3 3"],
) -> None:
    """Fills, for each joint, the matrix that turns a change of its rotation vector into a world angular change."""
    local = np.empty((3, 3))
    for j in range(parents.shape[0]):
        left_jacobian_matrix(q[3 + 3 * j], q[4 + 3 * j], q[5 + 3 * j], local)
        parent = parents[j]
        for a in range(3):
            for b in range(3):
                if parent < 0:
                    axes[j, a, b] = local[a, b]
                else:
                    axes[j, a, b] = (
                        rotations[parent, a, 0] * local[0, b]
                        + rotations[parent, a, 1] * local[1, b]
                        + rotations[parent, a, 2] * local[2, b]
                    )


@compiled
def frame_jacobian(
    parents: Ints[Array, "joints"],
    positions: Floats[Array, "joints 3"],
    axes: Floats[Array, "joints 3 3"],
    bone: int,
    point: Floats[Array, "3"],
    linear: Floats[Array, "3 dofs"],
    angular: Floats[Array, "3 dofs"],
) -> None:
    """Fills the Jacobians, by the pose vector, of a world point on a bone and of the bone's world rotation.

    `linear` and `angular` must be zero on entry where the bone's chain does not reach. A column of `linear` is axis x
    (point - joint), a column of `angular` the axis itself.
    """
    for a in range(3):
        linear[a, a] = 1.0
    joint = bone
    while joint >= 0:
        x = point[0] - positions[joint, 0]
        y = point[1] - positions[joint, 1]
        z = point[2] - positions[joint, 2]
        for b in range(3):
            column = 3 + 3 * joint + b
            ax, ay, az = axes[joint, 0, b], axes[joint, 1, b], axes[joint, 2, b]
            linear[0, column] = ay * z - az * y
            linear[1, column] = az * x - ax * z
            linear[2, column] = ax * y - ay * x
            angular[0, column] = ax
            angular[1, column] = ay
            angular[2, column] = az
        joint = parents[joint]


@compiled
def frames_and_jacobians(
    parents: Ints[Array, "joints"],
    offsets: Floats[Array, "joints 3"],
    q: Floats[Array, "dofs"],
    bones: Ints[Array, "points"],
    locals_: Floats[Array, "points 3"],
    positions: Floats[Array, "joints 3"],
    rotations: Floats[Array, "joints 3 3"],
    axes: Floats[Array, "joints 3 3"],
    points: Floats[Array, "points 3"],
    linear: Floats[Array, "points 3 dofs"],
    angular: Floats[Array, "points 3 dofs"],
) -> None:
    """Forward kinematics, then world place and Jacobians of points fixed to bones."""
    forward(parents, offsets, q, positions, rotations)
    rotation_axes(parents, q, rotations, axes)
    for i in range(bones.shape[0]):
        bone = bones[i]
        for a in range(3):
            points[i, a] = positions[bone, a] + (
                rotations[bone, a, 0] * locals_[i, 0]
                + rotations[bone, a, 1] * locals_[i, 1]
                + rotations[bone, a, 2] * locals_[i, 2]
            )
        frame_jacobian(parents, positions, axes, bone, points[i], linear[i], angular[i])
