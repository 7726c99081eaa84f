"""The measures of the field's papers on six IMUs, as TransPose (2021) defines them.

The root's rotation is made identity in both poses; wrists, hands, ankles and feet follow forearms and shanks in both,
for no sensor sees them. Means go over 24 joints, the root's zero and two joints within the hands among them, so that
figures stand beside published ones; other bodies and data still keep them from being the same thing.
"""

from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.rotations import rotvec_from_matrix
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.skeleton import Skeleton

_SIP = tuple(BODY_BONES.index(f"{side}{bone}") for bone in ("UpperLeg", "UpperArm") for side in ("left", "right"))
_HANDS = tuple(BODY_BONES.index(f"{side}Hand") for side in ("left", "right"))


class SparseInertialMeasures(NamedTuple):
    """One frame's, or their means.

    Attributes:
        sip_deg: Mean angle between rotations of both upper legs and both upper arms.
        angle_deg: Mean angle between rotations over the 24 joints.
        position_cm: Mean distance of the 24 joints.
    """

    sip_deg: Floats[Array, "frames"]
    angle_deg: Floats[Array, "frames"]
    position_cm: Floats[Array, "frames"]


def sparse_inertial_measures(
    truth: Floats[Array, "frames joints 3 3"],
    estimate: Floats[Array, "frames joints 3 3"],
    skeleton: Skeleton | None = None,
) -> SparseInertialMeasures:
    """The three measures of each frame.

    Args:
        truth: Rotations of the body's bones, in any axes that all bones of a frame share.
        estimate: The same of the estimate; its axes may be others.
        skeleton: The body whose joints are compared; the average one if left out.
    """
    body = skeleton or average_body()
    aligned, other = _from_root(truth), _from_root(estimate)
    angles = np.degrees(np.linalg.norm(rotvec_from_matrix(aligned.swapaxes(-1, -2) @ other), axis=-1))
    apart = 100 * np.linalg.norm(_joints(aligned, body) - _joints(other, body), axis=-1)
    return SparseInertialMeasures(
        angles[:, _SIP].mean(axis=1), (angles.sum(axis=1) + angles[:, _HANDS].sum(axis=1)) / 24, apart.mean(axis=1)
    )


def _from_root(rotations: Floats[Array, "frames joints 3 3"]) -> Floats[Array, "frames joints 3 3"]:
    """Root made identity; feet turn with shanks, hands with forearms."""
    out = rotations[:, :1].swapaxes(-1, -2) @ rotations
    for side in ("left", "right"):
        shank = out[:, BODY_BONES.index(f"{side}LowerLeg")]
        for bone in ("Foot", "Toes"):
            out[:, BODY_BONES.index(f"{side}{bone}")] = shank
        out[:, BODY_BONES.index(f"{side}Hand")] = out[:, BODY_BONES.index(f"{side}LowerArm")]
    return out


def _joints(rotations: Floats[Array, "frames joints 3 3"], body: Skeleton) -> Floats[Array, "frames 24 3"]:
    """The 22 joints and the middle of both hands, relative to the root."""
    places = np.zeros(rotations.shape[:3])
    for joint in range(1, len(body)):
        parent = int(body.parents[joint])
        places[:, joint] = places[:, parent] + rotations[:, parent] @ body.offsets[joint]
    hands = [places[:, hand] + 0.5 * rotations[:, hand] @ body.tips[hand] for hand in _HANDS]
    return np.concatenate([places, np.stack(hands, axis=1)], axis=1)
