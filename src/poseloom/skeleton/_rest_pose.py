"""Which pose of a source is laid over the body's T-pose: the file's zero pose, if it is one that a body could take,
else the one that the family's map spells out, else one found from the motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import RetargetError
from poseloom.rotations import rotvec_from_matrix
from poseloom.skeleton._family import Family
from poseloom.skeleton._rest_from_motion import bend, mean_rotation, rest_from_motion, sampled, unit
from poseloom.skeleton.kinematics import BoneFrames
from poseloom.skeleton.motion import RestChoice
from poseloom.skeleton.skeleton import Skeleton

_SIDES = ("left", "right")
_LEG, _ARM = ("UpperLeg", "LowerLeg", "Foot"), ("UpperArm", "LowerArm", "Hand")
_LIMBS = (_LEG, _ARM)
_CHAIN = ("spine", "chest", "upperChest", "neck", "leftShoulder", "rightShoulder")
"""Bones that cannot be twisted against the one before. (Feet are, by half a turn, in some of CMU's and HDM05's.)"""
_STRAIGHT = np.cos(np.radians(60.0))
_TWISTED = np.radians(80.0)
"""Mean turn between neighbours, in a whole motion, that no body holds: then their frames do not rest alike."""
_SIDEWAYS = np.cos(np.radians(70.0))
_FEW = 200
"""Frames that are enough to speak against a pose."""

_BENDS = np.sin(np.radians(5.0))
"""By how much the sine of a bend must change to speak against a pose."""

_AGREED = 0.9
"""Share of the bends of a knee or elbow that must agree on its axis to speak against a pose."""


@dataclass(frozen=True, eq=False)
class RestPose:
    """A pose of a source to be laid over the T-pose.

    Attributes:
        rotations: World rotations of the source's joints in it.
        facing: The rotation from the body's T-pose to the way it faces; None where its own hips and shoulders say so.
        origin: Where it comes from: "zero pose", "family" or "motion".
        unsure: Body bones whose turn about themselves is a guess.
    """

    rotations: Floats[Array, "joints 3 3"]
    facing: Floats[Array, "3 3"] | None
    origin: str
    unsure: tuple[str, ...] = ()


def choose_rest(
    source: Skeleton,
    family: Family,
    index: Mapping[str, int],
    frames: BoneFrames | None,
    choice: RestChoice = "auto",
) -> RestPose:
    """The rest pose of a source of a family that fits.

    Args:
        source: The skeleton.
        family: Which joint is which bone, and where their axes point in a T-pose if the zero pose is none.
        index: Joints by plain name.
        frames: The source's motion; None if there is none, and the zero pose must do.
        choice: "zero" takes the zero pose (or the family's) unasked, "motion" a guess from the motion.

    Raises:
        RetargetError: if the zero pose is none that a body could take and the motion leaves open how bones are turned.
    """
    stated = _stated(source, family, index)
    if frames is None or choice == "zero":
        return stated
    few = sampled(frames, _FEW)
    bodily = choice == "auto" and is_bodily(source, family, index, stated.rotations)
    backwards = bodily and _bend_backwards(source, family, index, stated.rotations, few)
    if bodily and not backwards and not _twisted(source, family, index, stated.rotations, few):
        return stated
    try:
        found = rest_from_motion(source, family, index, frames)
    except RetargetError:
        if bodily and not backwards:  # an odd motion; what speaks against the zero pose is not certain
            return stated
        raise
    if found.unsure and choice == "auto":
        if bodily and not backwards:
            return stated
        raise RetargetError(
            f"how these bones are turned about themselves cannot be told: {', '.join(found.unsure)}",
            cause="the file's zero pose is no T-pose, its joints' axes follow no pattern, and they move in ways that "
            "joint positions do not show",
            remedy="Export the motion with a T-pose as its zero pose, accept a guess that may err by some degrees "
            "(--rest-pose motion), or take the zero pose as it is (--rest-pose zero)",
        )
    return RestPose(found.rotations, np.eye(3), "motion", found.unsure)


def rest_positions(source: Skeleton, rotations: Floats[Array, "joints 3 3"]) -> Floats[Array, "joints 3"]:
    """Joint positions in a pose that is given by world rotations, the root at the origin."""
    positions = np.zeros((len(source), 3))
    for joint in range(1, len(source)):
        parent = source.parents[joint]
        positions[joint] = positions[parent] + rotations[parent] @ source.offsets[joint]
    return positions


def _stated(source: Skeleton, family: Family, index: Mapping[str, int]) -> RestPose:
    rotations = np.tile(np.eye(3), (len(source), 1, 1))
    for name, axes in family.frames.items():
        if name in index:
            rotations[index[name]] = _axes_matrix(axes)
    return RestPose(rotations, None, "family" if family.frames else "zero pose")


def _axes_matrix(axes: str) -> Floats[Array, "3 3"]:
    """The rotation whose x, y and z axes point as in "+Y -X +Z"."""
    columns = [(1.0 if axis[0] == "+" else -1.0) * np.eye(3)["XYZ".index(axis[1])] for axis in axes.split()]
    return np.stack(columns, axis=1)


def is_bodily(
    source: Skeleton, family: Family, index: Mapping[str, int], rotations: Floats[Array, "joints 3 3"]
) -> bool:
    """Whether a pose is near enough to standing with straight limbs, arms aside or down, that its frames can be meant
    to be aligned in it."""
    P = rest_positions(source, rotations)

    def at(bone: str) -> Floats[Array, "3"]:
        return P[index[family.start(bone)]]

    hips, arms = ([at(f"{side}{bone}") for side in _SIDES] for bone in ("UpperLeg", "UpperArm"))
    up, left = arms[0] + arms[1] - hips[0] - hips[1], hips[0] - hips[1]
    if min(np.linalg.norm(up), np.linalg.norm(left), np.linalg.norm(arms[0] - arms[1])) < 1e-6:
        return False
    up = unit(up)
    left = unit(left - (left @ up) * up)
    front = np.cross(left, up)
    shoulders = unit(arms[0] - arms[1])
    if shoulders @ left < _STRAIGHT or abs(shoulders @ up) > 1 - _STRAIGHT:
        return False
    for side, outward in zip(_SIDES, (left, -left), strict=True):
        knee, ankle, elbow = at(f"{side}LowerLeg"), at(f"{side}Foot"), at(f"{side}LowerArm")
        thigh, shank = unit(knee - at(f"{side}UpperLeg")), unit(ankle - knee)
        if min(-thigh @ up, -shank @ up, thigh @ shank) < _STRAIGHT:
            return False
        upper = unit(elbow - at(f"{side}UpperArm"))
        if max(upper @ outward, -upper @ up) < _STRAIGHT or upper @ outward < -0.3:
            return False
        hand, toes = index.get(family.start(f"{side}Hand")), index.get(family.start(f"{side}Toes"))
        if hand is not None and upper @ unit(P[hand] - elbow) < _STRAIGHT:
            return False
        if toes is not None and unit(P[toes] - ankle) @ front < _SIDEWAYS and unit(P[toes] - ankle) @ -up < 0.9:
            return False
    above = index.get(family.start("head"))
    return above is None or bool((P[above] - (arms[0] + arms[1]) / 2) @ up > 0)


def _bend_backwards(
    source: Skeleton,
    family: Family,
    index: Mapping[str, int],
    rotations: Floats[Array, "joints 3 3"],
    frames: BoneFrames,
) -> bool:
    """Whether a knee or an elbow would bend to the wrong side if joints' frames were aligned in a pose."""
    rest = rest_positions(source, rotations)
    hips, arms = ([index[family.start(f"{side}{bone}")] for side in _SIDES] for bone in ("UpperLeg", "UpperArm"))
    up = unit(rest[arms].sum(axis=0) - rest[hips].sum(axis=0))
    left = rest[hips[0]] - rest[hips[1]]
    left = unit(left - (left @ up) * up)
    for bones in _LIMBS:
        for side in _SIDES:
            chain = [index[name] for bone in bones if (name := family.start(f"{side}{bone}")) in index]
            if len(chain) < len(bones):
                continue
            turn = index[family.turn(f"{side}{bones[0]}")]
            flexion = bend(*(frames.positions[:, joint] for joint in chain))
            axis, agreement = flexion.axis(frames.rotations[:, turn])
            if not flexion.clear or agreement < _AGREED or not _moves(flexion.normals):
                continue
            way = unit(rest[chain[1]] - rest[chain[0]])
            expected = left if bones is _LEG else np.cross(way, np.cross(left, up))
            if (rotations[turn] @ axis) @ (expected - (expected @ way) * way) < 0:
                return True
    return False


def _moves(normals: Floats[Array, "frames 3"]) -> bool:
    """Whether a joint bends more and less: a pose that is held may be any. Normals are as long as the squared sine."""
    sines = np.sqrt(np.linalg.norm(normals, axis=1))
    return bool(sines.max() - sines.min() > _BENDS)


def _twisted(
    source: Skeleton,
    family: Family,
    index: Mapping[str, int],
    rotations: Floats[Array, "joints 3 3"],
    frames: BoneFrames,
) -> bool:
    """Whether the trunk or a shoulder would be twisted all the time if joints' frames were aligned in a pose."""
    for joint in (index[family.turn(bone)] for bone in _CHAIN if family.turn(bone) in index):
        parent = int(source.parents[joint])
        if parent >= 0:
            middle = mean_rotation(frames.rotations[:, parent], frames.rotations[:, joint])
            if np.linalg.norm(rotvec_from_matrix(rotations[parent] @ middle @ rotations[joint].T)) > _TWISTED:
                return True
    return False
