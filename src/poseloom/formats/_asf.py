"""ASF (Acclaim skeleton file): the bones that an AMC file moves."""

import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NoReturn

import numpy as np

from poseloom.arrays import Array, Bools, Floats, frozen_float
from poseloom.errors import FormatError, PoseloomError, SkeletonError
from poseloom.formats._files import decode, read_bytes
from poseloom.rotations import matrix_from_euler
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

_INCH = 0.0254
_ROOT_ORDER = ("tx", "ty", "tz", "rx", "ry", "rz")
_DOFS = frozenset(_ROOT_ORDER)
_NOISE = re.compile(r"[(),]")


@dataclass(frozen=True, eq=False)
class AsfBone:
    """What an AMC file needs to know of a bone.

    Attributes:
        name: The bone's name.
        dofs: Which of tx, ty, tz, rx, ry, rz its line in a frame lists, in that order. The turns are made in that order
            about axes that stand still.
        R_rest_axis: The frame in which they are meant, `axis` in the file, seen from the bone's rest frame.
    """

    name: str
    dofs: tuple[str, ...]
    R_rest_axis: Floats[Array, "3 3"]


@dataclass(frozen=True, eq=False)
class AcclaimSkeleton:
    """An ASF file.

    Attributes:
        skeleton: One joint a bone, where the bone starts, and the root first; leaf bones keep their end as tip. All
            rest frames are aligned with the world's.
        bones: One for each joint, in the skeleton's order.
        root_position: Added to the root's place, metres.
        metres_per_unit: The file's unit of length.
        degrees: Whether its angles are in degrees.
    """

    skeleton: Skeleton
    bones: tuple[AsfBone, ...]
    root_position: Floats[Array, "3"]
    metres_per_unit: float
    degrees: bool


@dataclass
class _Bone:
    """A bone's block while it is read, in the file's units."""

    line: int
    name: str = ""
    direction: Floats[Array, "3"] = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    stated: set[str] = field(default_factory=set[str])
    axis: Floats[Array, "3"] = field(default_factory=lambda: np.zeros(3))
    axis_order: str = "XYZ"
    dofs: tuple[str, ...] = ()


def read_asf(path: Path) -> AcclaimSkeleton:
    """Reads an Acclaim skeleton; sections may come in any order.

    A `length` of 0.45 in its units says that one unit is 0.0254 / 0.45 m, as in CMU's and HDM05's files: the value
    scales inches. Where the root's order is missing it is TX TY TZ RX RY RZ.

    Raises:
        FormatError: with the line, for a file that is not ASF, is cut off, or uses what is not supported (a length that
            changes in motion, a turned root).
        SkeletonError: for a hierarchy that is cyclic, disconnected or names unknown bones.
    """
    return _parse(read_bytes(path), path)


@lru_cache(maxsize=8)
def _parse(content: bytes, path: Path) -> AcclaimSkeleton:
    # Hundreds of motions share one skeleton, which cannot be changed: the same bytes need be read but once.
    return _Reader(content, path).skeleton()


class _Reader:
    """One method a section; units are applied at the end, for they may come last."""

    def __init__(self, content: bytes, path: Path) -> None:
        self._content = content
        self._path = path
        self._length = 1.0
        self._degrees = True
        self._root = _Bone(1, "root", dofs=_ROOT_ORDER)
        self._position = np.zeros(3)
        self._bones: dict[str, _Bone] = {"root": self._root}
        self._parents: dict[str, str] = {}
        self._children: dict[str, list[str]] = {}

    def skeleton(self) -> AcclaimSkeleton:
        sections = self._sections()
        readers = {
            "units": self._read_units,
            "root": self._read_root,
            "bonedata": self._read_bones,
            "hierarchy": self._read_hierarchy,
        }
        for needed in ("bonedata", "hierarchy"):
            if needed not in sections:
                self._fail(f"there is no :{needed} section", None, "this is no ASF file, or it is cut off")
        for name, reader in readers.items():
            reader(sections.get(name, []))
        try:
            return self._assemble()
        except PoseloomError as error:
            raise error.at(self._path) from None

    def _sections(self) -> dict[str, list[tuple[int, list[str]]]]:
        """Lines of each section as words, with their numbers; comments and documentation are left out."""
        sections: dict[str, list[tuple[int, list[str]]]] = {}
        current = ""
        for line, text in enumerate(decode(self._content).split("\n"), start=1):
            words = _NOISE.sub(" ", text.partition("#")[0]).split()
            if words and words[0].startswith(":"):
                current = words[0][1:].lower()
                sections.setdefault(current, [])
            elif words and current:
                sections[current].append((line, words))
        return sections

    def _read_units(self, lines: list[tuple[int, list[str]]]) -> None:
        for line, words in lines:
            key = words[0].lower()
            if key == "length":
                self._length = float(self._numbers(words[1:], 1, line)[0])
                if self._length <= 0:
                    self._fail(f"the unit of length is {self._length:g}", line)
            elif key == "angle":
                if words[1:2] not in (["deg"], ["rad"]):
                    self._fail(f"the unit of angles is {' '.join(words[1:])!r}, neither deg nor rad", line)
                self._degrees = words[1] == "deg"

    def _read_root(self, lines: list[tuple[int, list[str]]]) -> None:
        for line, words in lines:
            key = words[0].lower()
            if key == "order":
                self._root.dofs = self._dofs(words[1:], line)
            elif key == "position":
                self._position = self._numbers(words[1:], 3, line)
            elif key == "orientation" and self._numbers(words[1:], 3, line).any():
                self._fail(
                    "the root's rest orientation is not zero",
                    line,
                    "programs disagree on what that means, so it is not supported",
                    "Turn the motion instead, and set the orientation to 0 0 0",
                )

    def _read_bones(self, lines: list[tuple[int, list[str]]]) -> None:
        bone: _Bone | None = None
        for line, words in lines:
            key = words[0].lower()
            if key == "begin":
                bone = _Bone(line)
            elif bone is None:
                self._fail(f"{words[0]!r} stands outside of any bone's begin and end", line)
            elif key == "end":
                self._finish(bone)
                bone = None
                continue
            bone.stated.add(key)
            if key == "name":
                bone.name = " ".join(words[1:])
            elif key == "direction":
                bone.direction = self._numbers(words[1:], 3, line)
            elif key == "length":
                bone.length = float(self._numbers(words[1:], 1, line)[0])
            elif key == "axis":
                bone.axis = self._numbers(words[1:4], 3, line)
                bone.axis_order = (words[4:] or ["XYZ"])[0].upper()
                if sorted(bone.axis_order) != ["X", "Y", "Z"]:
                    self._fail(f"the axis order {bone.axis_order!r} is not three different axes", line)
            elif key == "dof":
                bone.dofs = self._dofs(words[1:], line)
        if bone is not None:
            self._fail("the bone that begins here has no end", bone.line, "the file is cut off")

    def _finish(self, bone: _Bone) -> None:
        missing = [part for part in ("name", "direction", "length") if part not in bone.stated]
        if missing:
            self._fail(f"the bone that begins here has no {' and no '.join(missing)}", bone.line)
        if bone.name in self._bones:
            self._fail(f"there are two bones named {bone.name!r}", bone.line)
        self._bones[bone.name] = bone

    def _read_hierarchy(self, lines: list[tuple[int, list[str]]]) -> None:
        for line, words in lines:
            if words[0].lower() in ("begin", "end") and len(words) == 1:
                continue
            for name in words:
                if name not in self._bones:
                    cause = "the hierarchy is damaged, or the bone's block is missing"
                    self._fail(f"the hierarchy names {name!r}, which is no bone", line, cause, kind=SkeletonError)
            for child in words[1:]:
                if child in self._parents or child == "root":
                    cause = "the hierarchy is cyclic, or a bone has two parents"
                    self._fail(
                        f"the bone {child!r} is made a child twice, or is the root", line, cause, kind=SkeletonError
                    )
                self._parents[child] = words[0]
                self._children.setdefault(words[0], []).append(child)

    def _order(self) -> list[str]:
        """Bones with parents first; those that the root does not reach are an error."""
        order: list[str] = []
        waiting = ["root"]
        while waiting:
            name = waiting.pop()
            order.append(name)
            waiting += reversed(self._children.get(name, []))
        lost = [name for name in self._bones if name not in order]
        if lost:
            cause = "the hierarchy is cyclic, disconnected or cut off"
            self._fail(f"bones that the root does not reach: {', '.join(lost)}", None, cause, kind=SkeletonError)
        return order

    def _assemble(self) -> AcclaimSkeleton:
        scale = _INCH / self._length
        order = self._order()
        ends = {name: self._end(self._bones[name]) * scale for name in order}
        places = [np.zeros(3) if name == "root" else ends[self._parents[name]] for name in order]
        bones = tuple(AsfBone(name, self._bones[name].dofs, self._axes(self._bones[name])) for name in order)
        skeleton = make_skeleton(
            order,
            [-1 if name == "root" else order.index(self._parents[name]) for name in order],
            np.stack(places),
            {name: ends[name] for name in order if name not in self._children and ends[name].any()},
            {bone.name: _locked(bone) for bone in bones},
        )
        return AcclaimSkeleton(skeleton, bones, frozen_float(self._position * scale), scale, self._degrees)

    def _end(self, bone: _Bone) -> Floats[Array, "3"]:
        size = float(np.linalg.norm(bone.direction))
        return bone.direction * (bone.length / size if size > 0 else 0.0)

    def _axes(self, bone: _Bone) -> Floats[Array, "3 3"]:
        angles = np.deg2rad(bone.axis) if self._degrees else bone.axis
        # Turns about still axes, the first named first: the product stands in the opposite order.
        order = bone.axis_order[::-1]
        return frozen_float(matrix_from_euler(angles[["XYZ".index(axis) for axis in order]], order))

    def _dofs(self, words: list[str], line: int) -> tuple[str, ...]:
        dofs = tuple(word.lower() for word in words)
        for dof in dofs:
            if dof not in _DOFS or dofs.count(dof) > 1:
                self._fail(
                    f"{dof!r} is not a degree of freedom, or stands here twice",
                    line,
                    "bones that change their length are not supported" if dof == "l" else "",
                    f"Use each of {', '.join(_ROOT_ORDER)} at most once",
                )
        return dofs

    def _numbers(self, words: list[str], count: int, line: int) -> Floats[Array, "numbers"]:
        try:
            values = np.array([float(word) for word in words])
        except ValueError:
            values = np.full(count, np.nan)
        if len(values) != count or not np.isfinite(values).all():
            self._fail(f"here should stand {count} finite numbers, not {' '.join(words)!r}", line)
        return values

    def _fail(
        self,
        fact: str,
        line: int | None,
        cause: str = "",
        remedy: str = "Mend the skeleton or export it again",
        kind: type[PoseloomError] = FormatError,
    ) -> NoReturn:
        raise kind(fact, cause=cause, remedy=remedy, file=self._path, line=line)


def _locked(bone: AsfBone) -> Bools[Array, "3"]:
    """Axes of the rest frame about which a bone can never turn. With two turns a rotation vector leaves their plane, so
    only bones with none, or with one about an axis of the rest frame, have any."""
    turns = [dof for dof in bone.dofs if dof[0] == "r"]
    if len(turns) > 1:
        return np.zeros(3, dtype=np.bool_)
    if not turns:
        return np.ones(3, dtype=np.bool_)
    axis = bone.R_rest_axis[:, "xyz".index(turns[0][1])]
    return np.asarray(np.abs(axis) < 1e-9) if np.sum(np.abs(axis) > 1e-9) == 1 else np.zeros(3, dtype=np.bool_)
