"""The 39 angles that flex methods speak of: rotation vectors of 13 joints of the body.

The flex paper predicts three angles for each of 13 joints (its table 3) without naming a convention. Here they are the
components of the joints' rotation vectors, as everywhere in poseloom: Euler angles wrap within ordinary arm movement.
"""

from functools import cache

import numpy as np

from poseloom.arrays import Array, Floats, Ints, frozen
from poseloom.rotations import nearest_branch
from poseloom.skeleton.body import BODY_BONES, mirror_bones, moving_dofs
from poseloom.skeleton.mirror import MIRROR_TURN

FLEX_JOINTS: tuple[str, ...] = (
    *("rightShoulder", "leftShoulder", "rightUpperLeg", "rightLowerLeg", "leftUpperLeg", "leftLowerLeg"),
    *("spine", "chest", "upperChest", "rightUpperArm", "rightLowerArm", "leftUpperArm", "leftLowerArm"),
)
"""The joints of the paper's table 3, in its order: two shoulders, two legs, the spine's three, two arms."""

ANGLES = 3 * len(FLEX_JOINTS)
"""Number of angles."""


@cache
def angle_columns() -> Ints[Array, "angles"]:
    """Columns of the pose vector that hold the angles, in order."""
    return frozen(
        np.array([3 + 3 * BODY_BONES.index(joint) + axis for joint in FLEX_JOINTS for axis in range(3)], dtype=np.int64)
    )


@cache
def moving_angles() -> Ints[Array, "moving"]:
    """Which of the angles move: not the shoulders, which no recording here turns, nor the hinges' still axes."""
    moves = moving_dofs()[angle_columns()].reshape(-1, 3).copy()
    for joint in ("leftShoulder", "rightShoulder"):
        moves[FLEX_JOINTS.index(joint)] = False
    return frozen(np.flatnonzero(moves.reshape(-1)).astype(np.int64))


def flex_angles(
    q: Floats[Array, "frames dofs"], reference: Floats[Array, "angles"] | None = None
) -> Floats[Array, "frames angles"]:
    """The angles of pose vectors, radians.

    Args:
        q: Pose vectors of the body.
        reference: Angles near which each rotation vector's branch is chosen, whatever came before it in time; without
            one, they stay on the branch on which they are.
    """
    angles = q[:, angle_columns()]
    if reference is None:
        return angles
    turns = angles.reshape(len(q), -1, 3)
    near = np.broadcast_to(reference.reshape(-1, 3), turns.shape)
    return nearest_branch(turns, near).reshape(len(q), -1)


def mirrored_angles(angles: Floats[Array, "frames angles"]) -> Floats[Array, "frames angles"]:
    """The angles of the mirror image: sides exchanged, turns (x, -y, -z)."""
    other = mirror_bones()
    order = [FLEX_JOINTS.index(BODY_BONES[other[BODY_BONES.index(joint)]]) for joint in FLEX_JOINTS]
    return (angles.reshape(len(angles), -1, 3)[:, order] * MIRROR_TURN).reshape(len(angles), -1)


def angle_errors(
    truth: Floats[Array, "frames angles"], estimate: Floats[Array, "frames angles"]
) -> Floats[Array, "frames angles"]:
    """Absolute differences in degrees, each estimated rotation vector on the branch nearest to the truth's."""
    true_turns = truth.reshape(len(truth), -1, 3)
    near = nearest_branch(estimate.reshape(true_turns.shape), true_turns)
    return np.degrees(np.abs(near - true_turns)).reshape(len(truth), -1)
