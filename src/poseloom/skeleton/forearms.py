"""How an arm's twist is shared between upper arm and forearm where the elbow is too straight to tell."""

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.rotations import quat_from_rotvec, rotvec_from_quat, unwrap_rotvec
from poseloom.skeleton._forearm_kernels import share_twist
from poseloom.skeleton.body import BODY_BONES

NEUTRAL = np.radians(30.0)
"""The forearm's roll where CMU's model rests (its elbows' axes are rolled by as much, see `families`), and about the
median of its recordings: 24 to 36 degrees in each collection and on each side, elbows bent by 30 to 100 degrees."""

FREEDOM = 2.0
"""By how much the roll may leave `NEUTRAL`, as a multiple of the elbow's bend, up to `STRAIGHT`: from there on nine
tenths of CMU's frames lie within."""

STRAIGHT = np.radians(20.0)
"""The bend up to which an elbow is too straight for a fit to know its axis."""

BENT = np.radians(45.0)
"""The bend from which the axis counts as known: what roll remains is the forearm's own, or the recording's fault."""


def share_arm_twist(q: Floats[Array, "frames dofs"]) -> Floats[Array, "frames dofs"]:
    """The same poses of the body with no more roll in a forearm than its elbow's bend speaks for.

    The axis of an elbow says how the upper arm is twisted; where the elbow is nearly straight it says next to nothing,
    and fits of recordings put any roll up to half a turn into the forearm and its opposite into the upper arm. What
    exceeds `FREEDOM` times the bend is moved into the upper arm, less and less of it between `STRAIGHT` and `BENT`. No
    joint moves by it and no bone but the upper arms turns; an elbow that was changed bends about another axis than its
    hinge. Poses within the bounds stay as they are, so a second time changes nothing.

    Args:
        q: Pose vectors of the body.
    """
    shared = q.copy()
    for side in ("left", "right"):
        upper, lower = (3 + 3 * BODY_BONES.index(f"{side}{bone}") for bone in ("UpperArm", "LowerArm"))
        upper_quats, lower_quats = quat_from_rotvec(q[:, upper : upper + 3]), quat_from_rotvec(q[:, lower : lower + 3])
        before = upper_quats.copy()
        share_twist(upper_quats, lower_quats, NEUTRAL, FREEDOM, STRAIGHT, BENT)
        changed = (before != upper_quats).any(axis=1)
        if changed.any():
            for column, quats in ((upper, upper_quats), (lower, lower_quats)):
                turns = np.where(changed[:, None], rotvec_from_quat(quats), q[:, column : column + 3])
                shared[:, column : column + 3] = unwrap_rotvec(turns)
    return shared
