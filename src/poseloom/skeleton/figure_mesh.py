"""A simple visible body for any skeleton: tapered capsules along the bones, a broader trunk and a head.

Everything is found from the hierarchy and the bones' sizes, not from names, so that it fits a skeleton of any family.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Ints
from poseloom.rotations import aligning_matrix
from poseloom.skeleton.skeleton import Skeleton

_AROUND, _CAP = 14, 4
_ADULT_REACH = 1.1
"""Metres from an adult's root to the farthest bone's end: sizes below are an adult's and scale with this."""
_LIMB = 0.4
"""Metres that hang from a joint if that is a limb; at a joint with two limbs, and above it, is the trunk."""
_TRUNK = (0.118, 0.088)
"""Radii of the trunk: to the side and to the front."""
_HEAD = 0.088


_FAR = 0.5
"""An end point farther from its joint than this part of the longest way along the bones is not of the body."""

_Segment = tuple[Floats[Array, "3"], Floats[Array, "3"], tuple[float, float, float, float]]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles around a skeleton in its rest pose, the root at the origin.

    Attributes:
        vertices: Metres.
        normals: Unit vectors.
        joints: The joint that carries each vertex.
        triangles: Three vertices each, counter-clockwise from outside.
    """

    vertices: Floats[Array, "vertices 3"]
    normals: Floats[Array, "vertices 3"]
    joints: Ints[Array, "vertices"]
    triangles: Ints[Array, "triangles 3"]


def figure_mesh(skeleton: Skeleton) -> Mesh:
    """The body's surface; empty if all bones have length zero."""
    shape = _Shape(skeleton)
    rest = skeleton.rest_positions()
    parts: list[tuple[int, Floats[Array, "vertices 3"], Ints[Array, "triangles 3"]]] = []
    for joint in range(len(skeleton)):
        for start, end, radii in shape.segments(joint):
            vertices, triangles = capsule(start, end, radii, shape.side(joint))
            parts.append((joint, vertices + rest[joint], triangles))
    return joined(parts)


class _Shape:
    """How thick a skeleton's bones are."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        self._lengths = np.linalg.norm(skeleton.offsets, axis=1)
        tips = np.where(np.isfinite(skeleton.tips), skeleton.tips, 0.0)
        alone = self._reaches(np.zeros_like(tips))[0]
        # An end point that far away is a thing in the hand, not a part of the body.
        far = (np.linalg.norm(tips, axis=1) > _FAR * alone) & (alone > 0)
        self._tips = np.where(far[:, None], 0.0, tips)
        self._reach = self._reaches(self._tips)
        self.scale = float(self._reach[0]) / _ADULT_REACH
        self._trunk = np.zeros(len(skeleton), dtype=np.bool_)
        for joint in range(len(skeleton) - 1, -1, -1):
            children = list(skeleton.children(joint))
            limbs = self._reach[children] + self._lengths[children] >= _LIMB * self.scale
            self._trunk[joint] = self._trunk[children].any() or np.sum(limbs) >= 2
        self._head, self._face = self._find_head()

    def _reaches(self, tips: Floats[Array, "joints 3"]) -> Floats[Array, "joints"]:
        """From each joint the longest way along the bones below it."""
        reach = np.linalg.norm(tips, axis=1)
        for joint in range(len(reach) - 1, 0, -1):
            parent = self._skeleton.parents[joint]
            reach[parent] = max(reach[parent], reach[joint] + self._lengths[joint])
        return reach

    def side(self, joint: int) -> Floats[Array, "3"]:
        """Direction to the side in the nearest joint, upwards, from which two limbs part."""
        while joint >= 0:
            places = self._skeleton.offsets[list(self._skeleton.children(joint))]
            gaps = (places[:, None] - places[None, :]).reshape(-1, 3)
            if self._trunk[joint] and len(gaps) and np.linalg.norm(gaps, axis=1).max() > 0.02 * self.scale:
                return gaps[np.argmax(np.linalg.norm(gaps, axis=1))]
            joint = int(self._skeleton.parents[joint])
        return np.array([1.0, 0.0, 0.0])

    def segments(self, joint: int) -> list[_Segment]:
        """Pieces that a joint carries, in its frame: start, end, and radii to the side and front, at start and end."""
        if self.scale <= 0 or joint in self._face:
            return []
        origin = np.zeros(3)
        if joint == self._head:
            return [self._head_segment()]
        pieces: list[_Segment] = []
        for child in self._skeleton.children(joint):
            end = self._skeleton.offsets[child]
            if np.linalg.norm(end) > 1e-3 * self.scale:
                pieces.append((origin, end, (*self._radii(joint), *self._radii(child))))
        if self._trunk[joint] and not self._trunk[list(self._skeleton.children(joint))].any():
            pieces.append((origin, self._chest_end(joint), (*self._radii(joint), *self._radii(joint))))
        tip = self._tips[joint]
        if tip.any() or not self._skeleton.children(joint):
            thick = self._radii(joint)
            thin = (0.8 * thick[0], 0.8 * thick[1])
            # The round end stands inside the tip, so that feet and hands do not grow.
            length = float(np.linalg.norm(tip))
            end = tip * max(length - thin[0], 0.1 * length) / length if length > 0 else tip
            pieces.append((origin, end, (*thick, *thin)))
        return pieces

    def _chest_end(self, joint: int) -> Floats[Array, "3"]:
        """From the uppermost trunk joint towards the middle of neck and shoulders, less the chest's round end."""
        middle = self._skeleton.offsets[list(self._skeleton.children(joint))].mean(axis=0)
        length = float(np.linalg.norm(middle))
        return middle * (max(length - 0.7 * _TRUNK[1] * self.scale, 0.0) / length) if length > 0 else middle

    def _radii(self, joint: int) -> tuple[float, float]:
        if self._trunk[joint]:
            return _TRUNK[0] * self.scale, _TRUNK[1] * self.scale
        radius = float(np.clip(0.022 * self.scale + 0.058 * self._reach[joint], 0.0, 0.08 * self.scale))
        return radius, radius

    def _find_head(self) -> tuple[int, frozenset[int]]:
        """The head, at the end of the chain that leaves the uppermost trunk joint least to the side, and all that hangs
        from it; -1 where there is no trunk."""
        if not self._trunk.any():
            return -1, frozenset()
        top = int(np.flatnonzero(self._trunk)[-1])
        side = self.side(top) / np.linalg.norm(self.side(top))
        rest = self._skeleton.rest_positions()
        chains = [self._chain(child) for child in self._skeleton.children(top)]
        chain = min(chains, key=lambda joints: abs(float((rest[joints[-1]] - rest[top]) @ side)))
        head = chain[-1]
        # A last joint without extent, after a long bone, is the top of the head.
        if len(chain) > 1 and self._reach[head] < 0.05 * self.scale and self._lengths[head] > 0.1 * self.scale:
            head = chain[-2]
        face: set[int] = set()
        for joint in range(head + 1, len(self._skeleton)):
            if (parent := int(self._skeleton.parents[joint])) == head or parent in face:
                face.add(joint)
        return head, frozenset(face)

    def _chain(self, joint: int) -> list[int]:
        """A joint and those below it, up to the first fork."""
        chain = [joint]
        while len(children := self._skeleton.children(chain[-1])) == 1:
            chain.append(children[0])
        return chain

    def _head_segment(self) -> _Segment:
        radius = _HEAD * self.scale
        children = self._skeleton.children(self._head)
        along = self._tips[self._head]
        if not along.any():
            along = self._skeleton.offsets[children[0] if len(children) == 1 else self._head]
        length = float(np.linalg.norm(along))
        along = along / length if length > 0 else np.array([0.0, 1.0, 0.0])
        top = max(length, 0.2 * self.scale)
        return along * 0.5 * radius, along * max(top - radius, radius), (0.9 * radius, 0.9 * radius, radius, radius)


def capsule(
    start: Floats[Array, "3"],
    end: Floats[Array, "3"],
    radii: tuple[float, float, float, float],
    side: Floats[Array, "3"],
    fineness: int = 1,
) -> tuple[Floats[Array, "vertices 3"], Ints[Array, "triangles 3"]]:
    """A rounded tapered tube; its cross-section is an ellipse whose wide axis lies as near to `side` as it can.

    Args:
        start: Centre of the first end, metres.
        end: Centre of the other end.
        radii: Half width and half depth at the start, then at the end.
        side: Direction along which the half width is measured.
        fineness: How many times as many vertices around, and from the ends to the tube, as a small figure needs.

    Returns:
        Vertices, and triangles of three vertices each, counter-clockwise from outside.
    """
    axis = end - start
    length = float(np.linalg.norm(axis))
    up = np.array([0.0, 1.0, 0.0])
    turn = aligning_matrix(up, axis) if length > 0 else np.eye(3)
    wide = turn.T @ side
    heading = float(np.arctan2(-wide[2], wide[0])) if np.hypot(wide[0], wide[2]) > 1e-9 else 0.0
    # Rings from the lower pole to the upper one: height, and how far out, as parts of the radii.
    angles = np.linspace(0.0, np.pi / 2, fineness * _CAP + 1)
    low, high = radii[:2], radii[2:]
    rings = [(-np.cos(a) * min(low), np.sin(a) * low[0], np.sin(a) * low[1]) for a in angles]
    rings += [(length + np.sin(a) * min(high), np.cos(a) * high[0], np.cos(a) * high[1]) for a in angles]
    around = np.arange(fineness * _AROUND) * (2 * np.pi / (fineness * _AROUND))
    points = np.array([[(b * np.cos(t), h, c * np.sin(t)) for t in around] for h, b, c in rings]).reshape(-1, 3)
    cosine, sine = np.cos(heading), np.sin(heading)
    spin = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    return points @ (turn @ spin).T + start, _ring_triangles(len(rings), len(around))


def _ring_triangles(rings: int, around: int) -> Ints[Array, "triangles 3"]:
    ring, step = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    a, b = ring * around + step, ring * around + (step + 1) % around
    lower = np.stack([a, a + around, b], axis=-1)
    upper = np.stack([b, a + around, b + around], axis=-1)
    return np.concatenate([lower, upper], axis=1).reshape(-1, 3).astype(np.int64)


def joined(parts: Sequence[tuple[int, Floats[Array, "vertices 3"], Ints[Array, "triangles 3"]]]) -> Mesh:
    """One mesh of several parts: for each the joint that carries it, its vertices and its triangles."""
    if not parts:
        none: NDArray[np.int64] = np.empty((0, 3), dtype=np.int64)
        return Mesh(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int64), none)
    vertices = np.concatenate([part[1] for part in parts])
    joints = np.concatenate([np.full(len(part[1]), part[0], dtype=np.int64) for part in parts])
    firsts = np.cumsum([0, *(len(part[1]) for part in parts)])
    triangles = np.concatenate([part[2] + first for part, first in zip(parts, firsts, strict=False)])
    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Poles are rings without width: triangles without area carry no normal and are left out.
    solid = np.linalg.norm(areas, axis=1) > 1e-12
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], areas)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(sizes > 0, normals / np.where(sizes > 0, sizes, 1.0), np.array([0.0, 1.0, 0.0]))
    return Mesh(vertices, normals, joints, triangles[solid])
