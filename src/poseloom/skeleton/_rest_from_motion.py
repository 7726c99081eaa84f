"""How a source's joints would stand in a T-pose, found from how it moves, for files whose zero pose is none.

Joint positions show where each bone points and in which plane knees and elbows bend; how two neighbours are turned to
each other on average shows the rest. All of it is measured in the joints' own frames, so a constant turn of any of
these frames cancels: the result is the same motion on the body.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import RetargetError
from poseloom.rotations import aligning_matrix, matrix_from_rotvec, rotvec_from_matrix
from poseloom.skeleton._family import Family
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.forearms import NEUTRAL
from poseloom.skeleton.kinematics import BoneFrames
from poseloom.skeleton.skeleton import Skeleton

MOST_FRAMES = 1000
"""Frames of a motion that are looked at, evenly spaced: more say nothing new."""

_LEFT, _UP, _FRONT = np.eye(3)
_LEAST_BEND = np.sin(np.radians(4.0))
"""Root mean square of the sine of a joint's bend below which it is too straight to show the plane it bends in."""

_LEAST_AGREEMENT = 0.5
"""Share of the bends, added as vectors, that must be left: less, and the joint bends in all directions."""

_AXIS = np.radians(25.0)
"""A rig in which each joint has an axis across its bone to within this is built along such axes."""

_HINGE = 0.9995
"""Agreement from which on a joint is a hinge: the rest is rounding."""

_NEAR_AXIS = np.radians(10.0)
"""The same, for joints whose axis across the body the motion shows."""

_CLEAR_AXIS = np.radians(35.0)
"""In a rig that is known for one along axes: how near a joint's axis must come for no other one to be meant."""

_PELVIS_ANGLE = np.radians(25.0)
"""By how much the place of the hip joints in the pelvis and the trunk's direction may contradict each other."""

_STEADY = np.radians(1.0)
"""Standard deviation of a joint's unseen turn to the joint before, up to which the two count as fixed to each other."""

_ACROSS = ("spine", "chest", "upperChest", "neck", "head", "leftFoot", "rightFoot", "leftToes", "rightToes")
_AHEAD = ("leftShoulder", "rightShoulder", "leftHand", "rightHand")
_UNDIRECTED = ("head", "leftShoulder", "rightShoulder", "leftHand", "rightHand")


@dataclass(frozen=True, eq=False)
class RestFromMotion:
    """A T-pose that was found from a motion.

    Attributes:
        rotations: World rotations of all joints in a T-pose that faces +Z, left hand to +X.
        unsure: Body bones whose turn to the bone before is only that of the motion's mean pose.
    """

    rotations: Floats[Array, "joints 3 3"]
    unsure: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Bend:
    """A knee or elbow, as it bends.

    Attributes:
        normals: World normal of the plane of bending in each frame, as long as the square of the bend's sine: nearly
            straight joints say next to nothing about their plane.
        least: Whether it bends enough to show its plane.
    """

    normals: Floats[Array, "frames 3"]
    clear: bool

    def axis(self, rotations: Floats[Array, "frames 3 3"]) -> tuple[Floats[Array, "3"], float]:
        """The mean normal in a joint's frame, and how far the frames agree on it: 1 for a hinge, 0 for none."""
        mean = np.einsum("fji,fj->i", rotations, self.normals)
        length, whole = float(np.linalg.norm(mean)), float(np.linalg.norm(self.normals, axis=1).sum())
        return mean / max(length, 1e-12), length / max(whole, 1e-12)


def bend(first: Floats[Array, "frames 3"], middle: Floats[Array, "frames 3"], last: Floats[Array, "frames 3"]) -> Bend:
    """How a joint bends between the one before and the one after it."""
    normals = np.cross(unit(middle - first), unit(last - middle))
    sines = np.linalg.norm(normals, axis=1, keepdims=True)
    return Bend(normals * sines, bool(np.sqrt((sines**2).mean()) > _LEAST_BEND))


def unit(vectors: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3"]:
    """Vectors of length one; those of length zero stay."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def sampled(frames: BoneFrames, most: int = MOST_FRAMES) -> BoneFrames:
    """At most so many frames, evenly spaced."""
    step = -(-len(frames.positions) // most)
    return BoneFrames(frames.positions[::step], frames.rotations[::step])


def mean_rotation(first: Floats[Array, "frames 3 3"], second: Floats[Array, "frames 3 3"]) -> Floats[Array, "3 3"]:
    """The mean of the second frames in the first ones (chordal)."""
    u, _, vt = np.linalg.svd(np.einsum("fji,fjk->ik", first, second))
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def rest_from_motion(source: Skeleton, family: Family, index: Mapping[str, int], frames: BoneFrames) -> RestFromMotion:
    """Finds a T-pose from a motion.

    Thighs, shanks, upper arms and forearms are laid straight, their knees and elbows bending as a body's do. The pelvis
    stands by its hip joints and the trunk above. All others stand to the joint before as they do on average; where
    every joint of the rig then has an axis nearly across its bone, it is meant to, and is taken for exactly across.

    Args:
        source: The skeleton.
        family: Which joint is which bone.
        index: Joints by plain name.
        frames: The source's motion.

    Raises:
        RetargetError: if the motion does not show how an arm is turned.
    """
    estimate = _Estimate(source, family, index, sampled(frames))
    plain = estimate.chain(snap=False)
    if estimate.along_axes(plain):
        return RestFromMotion(estimate.chain(snap=True), ())
    return RestFromMotion(plain, estimate.unsure())


class _Estimate:
    def __init__(self, source: Skeleton, family: Family, index: Mapping[str, int], frames: BoneFrames) -> None:
        self._source, self._family, self._index = source, family, index
        self._P, self._R = frames.positions, frames.rotations
        self._hips = self._index[family.turn("hips")]
        self._rolled: list[str] = []
        self._limbs = self._straight_limbs()
        self._pelvis, self._pelvis_sure = self._upright_pelvis()
        self._bone = {index[family.turn(bone)]: bone for bone in BODY_BONES if family.turn(bone) in index}

    def chain(self, snap: bool) -> Floats[Array, "joints 3 3"]:
        """Rotations of all joints: of pelvis and limbs as found, of others as they stand on average to a neighbour."""
        rest = np.full((len(self._source), 3, 3), np.nan)
        for joint, neighbour in self._order():
            if joint == self._hips:
                rest[joint] = self._pelvis.T
            elif joint in self._limbs:
                rest[joint] = self._limbs[joint]
            else:
                rest[joint] = rest[neighbour] @ mean_rotation(self._R[:, neighbour], self._R[:, joint])
            bone = self._bone.get(joint, "")
            if snap and (bone in _ACROSS or bone in _AHEAD or bone == "hips" or bone in self._rolled):
                rest[joint] = self._snapped(rest[joint], bone, joint)
        return rest

    def along_axes(self, rest: Floats[Array, "joints 3 3"]) -> bool:
        """Whether the rig's joints have an axis of their own that lies across the body, or to the front for the arms.

        Hip joints and knees show theirs to within a few degrees, which no chance does for all five; else each of the
        others must come near one.
        """
        if np.abs(self._pelvis[:, 0]).max() < np.cos(_AXIS):
            return False
        legs = [joint for joint, bone in self._bone.items() if bone.endswith("Leg") and bone not in self._rolled]
        near = np.cos(_NEAR_AXIS)
        shown = len(legs) == 4 and min(np.abs(rest[legs, 0]).max(axis=1).min(), np.abs(self._pelvis[:, 0]).max()) > near
        least = np.cos(_CLEAR_AXIS if shown else _AXIS)
        rows = [(joint, 0 if bone in _ACROSS else 2) for joint, bone in self._bone.items() if bone in _ACROSS + _AHEAD]
        rows += [(joint, 1) for joint, bone in self._bone.items() if bone in _UNDIRECTED]
        return all(float(np.abs(rest[joint, row]).max()) > least for joint, row in rows)

    def unsure(self) -> tuple[str, ...]:
        """Bones that move against the bone before in a way that joint positions do not show."""
        found = ([] if self._pelvis_sure else ["hips"]) + self._rolled
        for joint, neighbour in self._order():
            bone = self._bone.get(joint, "")
            if bone not in _ACROSS and bone not in _AHEAD:
                continue
            middle = mean_rotation(self._R[:, neighbour], self._R[:, joint])
            apart = rotvec_from_matrix(np.einsum("ji,fkj,fkl->fil", middle, self._R[:, neighbour], self._R[:, joint]))
            along = self._along(joint)
            if bone not in _UNDIRECTED and along is not None:
                apart = apart @ along[:, None]
            if np.sqrt((apart**2).sum(axis=1).mean()) > _STEADY:
                found.append(bone)
        return tuple(found)

    def _order(self) -> list[tuple[int, int]]:
        """All joints from the hips on, each with a neighbour that comes before it."""
        parents = self._source.parents
        order = [(self._hips, -1)]
        joint = self._hips
        while parents[joint] >= 0:  # files may hang the hips below something else
            order.append((int(parents[joint]), joint))
            joint = int(parents[joint])
        known = {joint for joint, _ in order}
        return order + [(j, int(parents[j])) for j in range(len(parents)) if j not in known]

    def _start(self, bone: str) -> Floats[Array, "frames 3"]:
        return self._P[:, self._index[self._family.start(bone)]]

    def _local(self, joint: int, vectors: Floats[Array, "frames 3"]) -> Floats[Array, "3"]:
        return np.einsum("fji,fj->i", self._R[:, joint], vectors) / len(vectors)

    def _upright_pelvis(self) -> tuple[Floats[Array, "3 3"], bool]:
        """The hips' frame in their joint's, and whether the pelvis' shape or a stiff trunk vouches for its tilt."""
        hips = self._hips
        left_hip, right_hip, origin = self._start("leftUpperLeg"), self._start("rightUpperLeg"), self._start("hips")
        left = unit(self._local(hips, left_hip - right_hip))
        trunk = [b for b in ("spine", "chest", "upperChest", "neck") if self._family.start(b) in self._index]
        points = [self._start(bone) for bone in trunk] or [
            (self._start("leftUpperArm") + self._start("rightUpperArm")) / 2
        ]
        width = float(np.linalg.norm(left_hip - right_hip, axis=1).mean()) / 2
        first = next((p for p in points if np.linalg.norm(p - origin, axis=1).mean() > 0.5 * width), points[-1])
        ways = np.einsum("fji,fj->fi", self._R[:, hips], unit(first - origin))
        up = ways.mean(axis=0)
        up = unit(up - (up @ left) * left)
        frame = np.stack([left, up, np.cross(left, up)], axis=1)
        middle = frame.T @ self._local(hips, (left_hip + right_hip) / 2 - origin)
        size = float(np.hypot(middle[1], middle[2])) / width
        expected = self._expected_pelvis(size)
        if expected is not None:
            angle = float(np.arctan2(middle[2], -middle[1])) - expected
            angle = (angle + np.pi) % (2 * np.pi) - np.pi
            if abs(angle) < _PELVIS_ANGLE or self._family.pelvis_deg is not None:
                return frame @ matrix_from_rotvec(np.array([-angle, 0.0, 0.0])), bool(
                    abs(size / _body_pelvis() - 1) < 0.01
                )
        return frame, bool(np.linalg.norm(ways - ways.mean(axis=0), axis=1).max() < _STEADY)

    def _expected_pelvis(self, size: float) -> float | None:
        """By which angle the hip joints lie in front of the hips' joint, where anything says so; `size` is their
        distance from it as a multiple of half their own."""
        if abs(size / _body_pelvis() - 1) < (0.1 if self._family.pelvis_deg is None else 0.01):
            _, y, z = average_body().offsets[average_body().index("leftUpperLeg")]
            return float(np.arctan2(z, -y))
        if self._family.pelvis_deg is not None:
            return float(np.radians(self._family.pelvis_deg))
        return 0.0 if size > 0.15 else None

    def _straight_limbs(self) -> dict[int, Floats[Array, "3 3"]]:
        found: dict[int, Floats[Array, "3 3"]] = {}
        roll = NEUTRAL if self._family.loose_forearms else 0.0
        for side, sign in (("left", 1.0), ("right", -1.0)):
            legs = (f"{side}UpperLeg", f"{side}LowerLeg", f"{side}Foot")
            arms = (f"{side}UpperArm", f"{side}LowerArm", f"{side}Hand")
            found |= self._straight_limb(legs, -_UP, _LEFT, np.eye(3))
            # The forearm's roll about +X on both sides, as in the body
            found |= self._straight_limb(arms, sign * _LEFT, -sign * _UP, matrix_from_rotvec(-roll * _LEFT))
        return found

    def _straight_limb(
        self,
        bones: tuple[str, str, str],
        along: Floats[Array, "3"],
        across: Floats[Array, "3"],
        roll: Floats[Array, "3 3"],
    ) -> dict[int, Floats[Array, "3 3"]]:
        """Rotations of the joints of a limb's two bones, which lie along and bend about given axes of the T-pose."""
        ends = (self._start(bones[0]), self._start(bones[1]), self._limb_end(bones))
        flexion = bend(*ends)
        found: dict[int, Floats[Array, "3 3"]] = {}
        for bone, (begin, end), rolled in zip(bones[:2], (ends[:2], ends[1:]), (np.eye(3), roll), strict=True):
            for joint in self._between(bone):
                side, agreement = flexion.axis(self._R[:, joint])
                if not flexion.clear or agreement < _LEAST_AGREEMENT:
                    side = self._other_side(bone, joint, flexion.clear)
                elif agreement < _HINGE and bone not in self._rolled:
                    self._rolled.append(bone)
                own = basis(self._local(joint, unit(end - begin)), side)
                found[joint] = rolled @ basis(along, across) @ own.T
        return found

    def _limb_end(self, bones: tuple[str, str, str]) -> Floats[Array, "frames 3"]:
        """Where a limb's second bone ends: at the third one, or at its own stated tip."""
        end = self._index.get(self._family.start(bones[2]))
        if end is not None:
            return self._P[:, end]
        joint = self._index[self._family.turn(bones[1])]
        tip = self._source.tips[joint]
        if not np.isfinite(tip).all():
            raise RetargetError(f"the skeleton does not state where {bones[1]} ends", remedy="Export it with its hands")
        return self._P[:, joint] + self._R[:, joint] @ tip

    def _other_side(self, bone: str, joint: int, bent: bool) -> Floats[Array, "3"]:
        """The axis across a leg's bone where its knee does not show it: the pelvis' left, as it is on average."""
        if "Arm" in bone:
            raise RetargetError(
                f"how {bone} is turned about itself cannot be told",
                cause="the file's zero pose is no T-pose, and "
                + ("its elbow bends in all directions" if bent else "the elbow stays straight throughout the motion"),
                remedy="Export the motion so that its zero pose is a T-pose, or take a motion in which the elbows bend",
            )
        return unit(self._local(joint, unit(self._start("leftUpperLeg") - self._start("rightUpperLeg"))))

    def _between(self, bone: str) -> list[int]:
        """The joints from where a bone begins to the one with which it turns."""
        first, last = self._index[self._family.start(bone)], self._index[self._family.turn(bone)]
        path = [last]
        while path[-1] != first and self._source.parents[path[-1]] >= 0:
            path.append(int(self._source.parents[path[-1]]))
        return path if path[-1] == first else [last]

    def _snapped(self, rest: Floats[Array, "3 3"], bone: str, joint: int) -> Floats[Array, "3 3"]:
        """A joint's rotation with its nearest axis exactly across the body (to the front, for the arms' bones), and
        where nothing else fixes its turn about that one, with the next axis upright."""
        row = 2 if bone in _AHEAD or "Arm" in bone else 0
        if bone in self._rolled and np.abs(rest[row]).max() < np.cos(_AXIS):
            return rest
        rest = _onto(rest, row) if bone != "hips" else rest
        along = self._along(joint)
        sloping = bone.endswith("Shoulder") and along is not None and float(np.abs(along).max()) > 1 - 1e-6
        if (bone == "hips" or bone in _UNDIRECTED) and not sloping:
            upright = _onto(rest, 1)
            if bone != "hips" or np.abs(rest[1]).max() > np.cos(_AXIS):
                rest = upright
        return rest

    def _along(self, joint: int) -> Floats[Array, "3"] | None:
        """The direction in which a joint's bone lies in its own frame; None if the source does not say."""
        children = self._source.children(joint)
        way = self._source.offsets[children[0]] if children else self._source.tips[joint]
        return unit(way) if np.isfinite(way).all() and way.any() else None


def _onto(rest: Floats[Array, "3 3"], row: int) -> Floats[Array, "3 3"]:
    """A rotation turned as little as possible so that one of its columns lies along an axis of the world."""
    column = int(np.argmax(np.abs(rest[row])))
    goal = np.sign(rest[row, column]) * np.eye(3)[row]
    return aligning_matrix(rest[:, column], goal) @ rest


def _body_pelvis() -> float:
    """How far from the hips' joint the average body's hip joints lie, as a multiple of half their own distance."""
    x, y, z = average_body().offsets[average_body().index("leftUpperLeg")]
    return float(np.hypot(y, z) / x)


def basis(along: Floats[Array, "3"], across: Floats[Array, "3"]) -> Floats[Array, "3 3"]:
    """The rotation whose first axis lies along a direction, and whose second as near to another one as can be."""
    first = unit(along)
    second = unit(across - (across @ first) * first)
    return np.stack([first, second, np.cross(first, second)], axis=1)
