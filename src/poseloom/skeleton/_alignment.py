"""How the body lies in a source skeleton: which joints its bones follow, how their frames turn, how long they are."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.rotations import aligning_matrix, matrix_from_rotvec
from poseloom.skeleton._family import Family, plain_name
from poseloom.skeleton._rest_pose import choose_rest, rest_positions
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.kinematics import BoneFrames
from poseloom.skeleton.motion import RestChoice
from poseloom.skeleton.skeleton import Skeleton

_SIDES = ("left", "right")


def _pairs(*pairs: tuple[str, str]) -> dict[str, str]:
    return {f"{side}{first}": f"{side}{second}" for side in _SIDES for first, second in pairs}


NEXT: Mapping[str, str] = {
    "spine": "chest",
    "chest": "upperChest",
    "upperChest": "neck",
    "neck": "head",
    **_pairs(("Shoulder", "UpperArm"), ("UpperArm", "LowerArm"), ("LowerArm", "Hand")),
    **_pairs(("UpperLeg", "LowerLeg"), ("LowerLeg", "Foot"), ("Foot", "Toes")),
}
"""The bone at whose beginning a bone ends; head, hands and toes end at their tips, and the hips have no direction."""

_AS_FACING = ("hips", "leftShoulder", "rightShoulder")
"""Bones whose frames are not turned onto the source's bones. Collar bones are drawn level by some families and sloping
by others: turned onto them, the upper arms of one and the same pose would differ by up to 30 degrees."""

_CARRIED: Mapping[str, str] = {
    **_pairs(("LowerArm", "UpperArm"), ("Hand", "LowerArm")),
    **_pairs(("LowerLeg", "UpperLeg"), ("Foot", "LowerLeg"), ("Toes", "Foot")),
}
"""Bones whose frame at rest is carried along from the bone before; the others start from the way the body faces."""

_SNAP = np.radians(15.0)
"""A rest pose that stands along, or faces, an axis of the world to within this is meant to: people are uneven."""

_POINT = 1e-6
"""Metres below which a bone has no direction."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """The body laid into a source skeleton.

    Attributes:
        turns: For each body bone, the source joint with which it turns.
        R_turn_bone: The bone's frame in that joint's frame.
        root: The source joint where the hips begin.
        skeleton: The body with the source's sizes.
        aims: For bones whose far end is not fixed to that joint, the source joints where they begin and end; -1 for all
            others.
        ideals: The direction of each bone in its own frame.
        origin: Where the pose that is laid over the T-pose comes from: "zero pose", "family" or "motion".
        unsure: Body bones whose turn about themselves is a guess.
    """

    turns: Ints[Array, "bones"]
    R_turn_bone: Floats[Array, "bones 3 3"]
    root: int
    skeleton: Skeleton
    aims: Ints[Array, "bones 2"]
    ideals: Floats[Array, "bones 3"]
    origin: str
    unsure: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Rest:
    """A source skeleton in the pose that is laid over the body's T-pose."""

    skeleton: Skeleton
    family: Family
    index: Mapping[str, int]
    rotations: Floats[Array, "joints 3 3"]
    positions: Floats[Array, "joints 3"]

    def start(self, bone: str) -> int | None:
        """The joint where a body bone begins."""
        return self.index.get(self.family.start(bone))

    def turn(self, bone: str) -> int | None:
        """The joint with which a body bone turns."""
        return self.index.get(self.family.turn(bone))

    def end(self, bone: str, far: bool = False) -> Floats[Array, "3"] | None:
        """Where the joint with which a bone turns has its end, or the whole chain its; None if none is stated."""
        joint = self.turn(bone)
        following = self.index.get(self.family.ends.get(bone, ""))
        while joint is not None:
            children = self.skeleton.children(joint)
            if following is None and len(children) == 1:
                following = children[0]
            if following is None:
                tip = self.skeleton.tips[joint]
                return self.positions[joint] + self.rotations[joint] @ tip if np.isfinite(tip).all() else None
            if not far:
                return self.positions[following]
            joint, following = following, None
        return None


def align(source: Skeleton, family: Family, frames: BoneFrames | None = None, choice: RestChoice = "auto") -> Alignment:
    """Lays the body into a source skeleton of a family that fits.

    Args:
        source: The skeleton.
        family: Its family.
        frames: Its motion, which decides whether the zero pose can be believed; None if it has none.
        choice: Where the rest pose comes from (`choose_rest`).

    Raises:
        RetargetError: if neither the zero pose nor the motion tells how bones are turned.
    """
    # Where names double once their prefixes are gone, the joint nearer to the root counts.
    index = {plain_name(name): joint for joint, name in reversed(list(enumerate(source.names)))}
    pose = choose_rest(source, family, index, frames, choice)
    if pose.origin == "motion":  # how elbows bend is in it
        family = replace(family, rolls={})
    rest = _Rest(source, family, index, pose.rotations, rest_positions(source, pose.rotations))
    facing = _facing(rest) if pose.facing is None else pose.facing
    starts = _starts(rest, facing)
    frames_at_rest = _bone_frames(rest, starts, facing)
    turns = _turns(rest)
    R_world_bone = np.stack([frames_at_rest[bone] for bone in BODY_BONES])
    return Alignment(
        turns=turns,
        R_turn_bone=np.swapaxes(rest.rotations[turns], 1, 2) @ R_world_bone,
        root=rest.index[family.start("hips")],
        skeleton=_sized_body(rest, starts, frames_at_rest),
        aims=_aims(rest, turns),
        ideals=np.stack([_ideal(bone) for bone in BODY_BONES]),
        origin=pose.origin,
        unsure=pose.unsure,
    )


def leg_length(skeleton: Skeleton) -> float:
    """Thigh plus shank of a body, metres, the mean of both sides."""
    bones = [skeleton.index(f"{side}{bone}") for side in _SIDES for bone in ("LowerLeg", "Foot")]
    return float(np.linalg.norm(skeleton.offsets[bones], axis=1).sum() / 2)


def _facing(rest: _Rest) -> Floats[Array, "3 3"]:
    """The rotation from the body's T-pose to the way in which the source rests, by its hips and shoulders."""

    def places(bone: str) -> tuple[Floats[Array, "3"], Floats[Array, "3"]]:
        left, right = (rest.positions[rest.index[rest.family.start(f"{side}{bone}")]] for side in _SIDES)
        return left, right

    (left_hip, right_hip), (left_arm, right_arm) = places("UpperLeg"), places("UpperArm")
    up = _snapped(left_arm + right_arm - left_hip - right_hip)
    left = left_hip - right_hip + left_arm - right_arm
    left = _snapped(left - (left @ up) * up)
    return np.stack([left, up, np.cross(left, up)], axis=1)


def _snapped(direction: Floats[Array, "3"]) -> Floats[Array, "3"]:
    """The axis of the world that a direction is meant to have, or the direction itself, as a unit vector."""
    unit = direction / np.linalg.norm(direction)
    largest = int(np.argmax(np.abs(unit)))
    return np.sign(unit[largest]) * np.eye(3)[largest] if abs(unit[largest]) > np.cos(_SNAP) else unit


def _starts(rest: _Rest, facing: Floats[Array, "3 3"]) -> dict[str, Floats[Array, "3"]]:
    """Where every body bone begins in the rest pose; bones without a source are put where the average body has them."""
    average = average_body()
    found = ((bone, rest.start(bone)) for bone in BODY_BONES)
    starts = {bone: rest.positions[joint] for bone, joint in found if joint is not None}
    if rest.family.lost_segment:
        _restore_segment(starts, facing)
    scale = _leg_length(starts) / leg_length(average)
    _fill(starts, ("hips", "spine", "chest", "upperChest", "neck", "head"))
    for i, bone in enumerate(BODY_BONES):
        if bone in starts:
            continue
        parent = BODY_BONES[int(average.parents[i])]
        guess = starts[parent] + scale * facing @ average.offsets[i]
        if bone.endswith("Shoulder"):
            starts[bone] = starts.get("neck", guess)
        elif bone.endswith(("Hand", "Toes")):
            end = rest.end(parent)
            starts[bone] = guess if end is None or np.linalg.norm(end - starts[parent]) < _POINT else end
        else:
            starts[bone] = guess
    return starts


def _restore_segment(starts: dict[str, Floats[Array, "3"]], facing: Floats[Array, "3 3"]) -> None:
    """Lifts neck, head and arms straight up by the mean length of the two spine segments below."""
    below = [starts["chest"] - starts["spine"], starts["upperChest"] - starts["chest"]]
    lift = facing[:, 1] * np.linalg.norm(below, axis=1).mean()
    for bone in starts:
        if bone in ("neck", "head") or bone.endswith(("Shoulder", "Arm", "Hand")):
            starts[bone] = starts[bone] + lift


def _fill(starts: dict[str, Floats[Array, "3"]], chain: tuple[str, ...]) -> None:
    """Puts bones without a source on the straight line between those that have one, spaced as on the average body."""
    average = average_body()
    steps = [np.linalg.norm(average.offsets[average.index(bone)]) for bone in chain]
    reach = np.cumsum(steps) - steps[0]
    present = [i for i, bone in enumerate(chain) if bone in starts]
    for low, high in pairwise(present):
        for i in range(low + 1, high):
            part = (reach[i] - reach[low]) / (reach[high] - reach[low])
            starts[chain[i]] = (1 - part) * starts[chain[low]] + part * starts[chain[high]]


def _turns(rest: _Rest) -> Ints[Array, "bones"]:
    """The source joint with which each body bone turns; bones without one turn with the bone that carries them."""
    turns = np.empty(len(BODY_BONES), dtype=np.int64)
    for i, bone in enumerate(BODY_BONES):
        joint = rest.turn(bone)
        turns[i] = turns[average_body().parents[i]] if joint is None else joint
    return turns


def _bone_frames(
    rest: _Rest, starts: Mapping[str, Floats[Array, "3"]], facing: Floats[Array, "3 3"]
) -> dict[str, Floats[Array, "3 3"]]:
    """The bones' frames in the rest pose: turned as little as possible from the T-pose onto the source's bones."""
    body = average_body()
    plain = {"hips": facing}
    rolls: dict[str, Floats[Array, "3 3"]] = {}
    for i, bone in enumerate(BODY_BONES[1:], start=1):
        base = plain[_CARRIED[bone]] if bone in _CARRIED else facing
        way = None if bone in _AS_FACING else _direction(rest, starts, bone)
        if way is not None:
            base = aligning_matrix(base @ _ideal(bone), way) @ base
        elif rest.turn(bone) is None and bone not in _AS_FACING:
            base = plain[BODY_BONES[int(body.parents[i])]]
        plain[bone] = base
        if way is None or "Arm" in bone:  # a roll must not turn a bone away from its direction
            angle = np.radians(rest.family.rolls.get(bone, 0.0))
            rolls[bone] = matrix_from_rotvec(np.array([angle, 0.0, 0.0]))
    return {bone: frame @ rolls.get(bone, np.eye(3)) for bone, frame in plain.items()}


def _direction(rest: _Rest, starts: Mapping[str, Floats[Array, "3"]], bone: str) -> Floats[Array, "3"] | None:
    """From where a bone begins to where it ends, at rest; None if the source does not say."""
    if bone in NEXT:
        way = starts[NEXT[bone]] - starts[bone]
    else:
        joint, end = rest.turn(bone), rest.end(bone)
        if joint is None or end is None:
            return None
        way = end - rest.positions[joint]
    return way if np.linalg.norm(way) > _POINT else None


def _sized_body(
    rest: _Rest, starts: Mapping[str, Floats[Array, "3"]], frames: Mapping[str, Floats[Array, "3 3"]]
) -> Skeleton:
    """The body with the source's bone lengths: joints that branch off lie in their bone's frame as they rest."""
    body = average_body()
    offsets, tips = np.zeros((len(body), 3)), body.tips * (_leg_length(starts) / leg_length(body))
    for i, bone in enumerate(BODY_BONES):
        if i:
            parent = BODY_BONES[int(body.parents[i])]
            offsets[i] = frames[parent].T @ (starts[bone] - starts[parent])
        begin, end = rest.start(bone), rest.end(bone, far=True)
        if np.isfinite(body.tips[i]).all() and begin is not None and end is not None:
            length = np.linalg.norm(end - rest.positions[begin])
            if length > _POINT:
                tips[i] = body.tips[i] * (length / np.linalg.norm(body.tips[i]))
    return body.with_offsets(offsets, tips)


def _aims(rest: _Rest, turns: Ints[Array, "bones"]) -> Ints[Array, "bones 2"]:
    """Source joints between which a bone stretches, where its far end is not fixed to the joint with which it turns."""
    aims = np.full((len(BODY_BONES), 2), -1, dtype=np.int64)
    for bone, following in NEXT.items():
        i, begin, end = BODY_BONES.index(bone), rest.start(bone), rest.start(following)
        if begin is None or end is None or rest.skeleton.parents[end] == turns[i] or bone in _AS_FACING:
            continue
        if np.linalg.norm(rest.positions[end] - rest.positions[begin]) > _POINT:
            aims[i] = begin, end
    return aims


def _ideal(bone: str) -> Floats[Array, "3"]:
    """The direction of a bone in the body's T-pose."""
    body = average_body()
    return body.offsets[body.index(NEXT[bone])] if bone in NEXT else body.tips[body.index(bone)]


def _leg_length(starts: Mapping[str, Floats[Array, "3"]]) -> float:
    """Thigh plus shank, metres, the mean of both sides, from where bones begin."""
    segments = [
        starts[f"{side}{below}"] - starts[f"{side}{above}"]
        for side in _SIDES
        for above, below in (("UpperLeg", "LowerLeg"), ("LowerLeg", "Foot"))
    ]
    return float(np.linalg.norm(segments, axis=1).sum() / 2)
