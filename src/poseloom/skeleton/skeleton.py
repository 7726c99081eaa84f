"""A hierarchy of bones in its rest pose."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseloom.arrays import Array, Bools, Floats, Ints, frozen, frozen_float
from poseloom.errors import SkeletonError, unknown_name


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Bones, each named after the joint it begins at; in the rest pose every bone's frame is aligned with the world's.

    Make one with `make_skeleton`, which checks. Parents stand before their children; joint 0 is the root.

    Attributes:
        names: One name a joint.
        parents: Index of each joint's parent, -1 for the root.
        offsets: Position of each joint in its parent's frame at rest, in metres; the root's is zero.
        tips: End point of each leaf bone in its own frame at rest, in metres; NaN where a bone states none.
        locked: True where a joint cannot turn about an axis of its rest frame (hinges).
    """

    names: tuple[str, ...]
    parents: Ints[Array, "joints"]
    offsets: Floats[Array, "joints 3"]
    tips: Floats[Array, "joints 3"]
    locked: Bools[Array, "joints 3"]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def size(self) -> int:
        """Number of entries of a pose vector: 3 for the root's place and 3 for each joint's rotation vector."""
        return 3 + 3 * len(self.names)

    def index(self, name: str) -> int:
        """Index of a joint. Raises SkeletonError, with the valid names, for an unknown one."""
        try:
            return self.names.index(name)
        except ValueError:
            raise unknown_name("bone", name, self.names, SkeletonError) from None

    def children(self, joint: int) -> tuple[int, ...]:
        """Indices of the joints whose parent is `joint`."""
        return tuple(int(child) for child in np.flatnonzero(self.parents == joint))

    def rest_positions(self) -> Floats[Array, "joints 3"]:
        """Joint positions at rest, the root at the origin."""
        positions = np.zeros_like(self.offsets)
        for joint in range(1, len(self)):
            positions[joint] = positions[self.parents[joint]] + self.offsets[joint]
        return positions

    def with_offsets(
        self, offsets: Floats[Array, "joints 3"], tips: Floats[Array, "joints 3"] | None = None
    ) -> "Skeleton":
        """The same hierarchy with other bone sizes."""
        return replace(self, offsets=frozen_float(offsets), tips=self.tips if tips is None else frozen_float(tips))


def make_skeleton(
    names: Sequence[str],
    parents: Sequence[int] | NDArray[np.int64],
    offsets: ArrayLike,
    tips: Mapping[str, ArrayLike] | None = None,
    locked: Mapping[str, ArrayLike] | None = None,
) -> Skeleton:
    """Checks a hierarchy and freezes it.

    Args:
        names: One a joint, all different.
        parents: Index of each joint's parent, -1 for the one root, which comes first; parents before children.
        offsets: (joints, 3) in metres.
        tips: End points of leaf bones by name, in metres.
        locked: Locked axes by bone name, three booleans each.

    Raises:
        SkeletonError: for doubled names, no or several roots, a cycle, a parent that comes later or does not exist, or
            numbers that are not finite.
    """
    count = len(names)
    index = np.asarray(parents, dtype=np.int64)
    places = np.asarray(offsets, dtype=np.float64)
    if count == 0 or index.shape != (count,) or places.shape != (count, 3):
        raise SkeletonError(
            f"{count} names, {index.size} parents and offsets of shape {places.shape} do not fit together",
            remedy="Give one name, one parent and one offset of three numbers for each joint",
        )
    _check_hierarchy(names, index)
    if not np.isfinite(places).all():
        joint = names[int(np.flatnonzero(~np.isfinite(places).all(axis=1))[0])]
        raise SkeletonError(f"the offset of joint {joint!r} is not finite", remedy="Mend the skeleton's file")
    ends = np.full((count, 3), np.nan)
    joints = {name: joint for joint, name in enumerate(names)}
    for name, tip in (tips or {}).items():
        ends[_position(joints, name)] = np.asarray(tip, dtype=np.float64)
    lock = np.zeros((count, 3), dtype=np.bool_)
    for name, axes in (locked or {}).items():
        lock[_position(joints, name)] = np.asarray(axes, dtype=np.bool_)
    return Skeleton(tuple(names), frozen(index), frozen_float(places), frozen_float(ends), frozen(lock))


def _position(joints: Mapping[str, int], name: str) -> int:
    if name not in joints:
        raise unknown_name("bone", name, joints, SkeletonError)
    return joints[name]


def _check_hierarchy(names: Sequence[str], parents: Ints[Array, "joints"]) -> None:
    doubled = sorted(name for name, count in Counter(names).items() if count > 1)
    if doubled:
        raise SkeletonError(
            f"joint names appear more than once: {', '.join(doubled)}", remedy="Give each joint a name of its own"
        )
    if parents[0] != -1 or (parents[1:] < 0).any():
        roots = [name for name, parent in zip(names, parents, strict=True) if parent < 0]
        raise SkeletonError(
            f"a skeleton needs exactly one root, and first; here the roots are: {', '.join(roots) or 'none'}",
            cause="the hierarchy is disconnected or cyclic",
            remedy="Connect every joint to one root",
        )
    late = [name for i, name in enumerate(names) if parents[i] >= i]
    if late:
        raise SkeletonError(
            f"joints whose parent does not come before them: {', '.join(late)}",
            cause="the hierarchy is cyclic or out of order",
            remedy="List parents before children",
        )
