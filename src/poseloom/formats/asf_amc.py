"""ASF/AMC (Acclaim): a skeleton in one file, its motions in others; the form of CMU's and HDM05's recordings.

A bone's angles in a frame are turns about the axes that the skeleton states for it: with C that frame (`R_rest_axis`)
and M the product of the turns, its rotation relative to its parent and to the rest pose is C M C^-1. Source: Acclaim
skeleton file definition 1.10, and "Acclaim Format - ASF line details" of CMU's course notes.
"""

import os
import re
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats._asf import AcclaimSkeleton, AsfBone, read_asf
from poseloom.formats._files import read_bytes
from poseloom.formats._numbers import Tokens, scan
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, settle
from poseloom.rotations import rotvec_series_from_euler
from poseloom.skeleton.motion import Motion, make_motion

__all__ = ["AcclaimSkeleton", "AsfBone", "find_asf", "read_amc", "read_asf"]

RATE = 120.0
"""Frames a second of CMU's and HDM05's recordings; the files do not state theirs."""
_COMMENT = re.compile(rb"#[^\n]*")


def read_amc(
    path: Path, skeleton: Path | None = None, rate: float = RATE, choices: MotionChoices = NOTHING_SAID
) -> Motion:
    """An AMC file as a motion in metres, on its ASF skeleton.

    Args:
        path: The file.
        skeleton: The ASF file; found beside it where it is None (`find_asf`). Any skeleton with the same bones and
            degrees of freedom serves.
        rate: Frames a second.
        choices: What else the user says of the file.

    Raises:
        FormatError: with the line, for a file that is not AMC, is cut off, or does not fit the skeleton.
        SkeletonError: for a broken skeleton.
    """
    content = _COMMENT.sub(b"", read_bytes(path))
    acclaim = read_asf(find_asf(path) if skeleton is None else skeleton)
    tokens = scan(content, file=path)
    degrees, first = _header(tokens, acclaim, path)
    values = _values(tokens, first, acclaim, path)
    try:
        motion = _motion(values, acclaim, degrees, rate, path.stem)
        return settle(motion, path, choices, acclaim.metres_per_unit)
    except PoseloomError as error:
        raise error.at(path) from None


def find_asf(path: Path) -> Path:
    """The skeleton of an AMC file: in its folder the ASF file with its name or the longest beginning of its name up to
    an underscore (01.asf for 01_07.amc), else the only ASF file there.

    Raises:
        FormatError: where there is none, or several that could be meant.
    """
    files = sorted(name for name in os.listdir(path.parent) if name.lower().endswith(".asf"))
    here = {Path(name).stem.lower(): path.parent / name for name in files}
    parts = path.stem.lower().split("_")
    for count in range(len(parts), 0, -1):
        if (name := "_".join(parts[:count])) in here:
            return here[name]
    if len(here) == 1:
        return next(iter(here.values()))
    raise FormatError(
        "the skeleton of this AMC file is missing",
        cause=f"its folder holds {f'{len(here)} ASF files, none with its name' if here else 'no ASF file'}",
        remedy="Put its ASF file beside it, or name one with the same bones (--skeleton FILE.asf)",
        file=path,
    )


def _header(tokens: Tokens, acclaim: AcclaimSkeleton, path: Path) -> tuple[bool, int]:
    """Whether angles are in degrees, and the index of the first frame's number."""
    numbers = np.flatnonzero(tokens.words == 0)
    first = int(numbers[0]) if numbers.size else len(tokens)
    degrees = acclaim.degrees
    for token in range(first):
        word = tokens.word(token)
        if not word.startswith(":"):
            raise FormatError(
                f"here should stand a keyword with a colon or a frame's number, not {word[:40]!r}",
                cause="this is no AMC file, or its first frame's number is missing",
                remedy="Give a file of the kind its suffix says",
                file=path,
                line=int(tokens.lines[token]),
            )
        degrees = {":degrees": True, ":radians": False}.get(word.lower(), degrees)
    if first == len(tokens):
        raise FormatError("there are no frames", cause="the file is cut off", remedy="Get it again", file=path)
    return degrees, first


def _values(tokens: Tokens, first: int, acclaim: AcclaimSkeleton, path: Path) -> Floats[Array, "frames columns"]:
    """Values of all frames; columns are the degrees of freedom of the skeleton's bones, in its order."""
    opens_line = np.diff(tokens.lines[first:], prepend=-1) != 0
    heads = first + np.flatnonzero(opens_line & (tokens.words[first:] == 0))
    _check_numbering(tokens, heads, path)
    ends = np.append(heads[1:], len(tokens))
    if _uniform(tokens, heads, ends):
        where = heads[:, None] + _frame(tokens, int(heads[0]), int(ends[0]), acclaim, path) - heads[0]
    else:
        pairs = zip(heads.tolist(), ends.tolist(), strict=True)
        where = np.stack([_frame(tokens, head, end, acclaim, path) for head, end in pairs])
    values = tokens.values[where]
    if not np.isfinite(values).all():
        token = int(where.reshape(-1)[np.flatnonzero(~np.isfinite(values))[0]])
        raise FormatError(
            f"{tokens.word(token)[:40]!r} is not a finite number",
            remedy="Mend or cut out that frame",
            file=path,
            line=int(tokens.lines[token]),
        )
    return values


def _check_numbering(tokens: Tokens, heads: Ints[Array, "frames"], path: Path) -> None:
    numbers = tokens.values[heads]
    wrong = np.flatnonzero(np.diff(numbers) != 1)
    if wrong.size:
        at = int(wrong[0]) + 1
        raise FormatError(
            f"frame {tokens.word(int(heads[at]))} follows frame {tokens.word(int(heads[at - 1]))}",
            cause="frames are missing, doubled or out of order",
            remedy="Get the file again, or number its frames one after the other",
            file=path,
            line=int(tokens.lines[heads[at]]),
        )


def _uniform(tokens: Tokens, heads: Ints[Array, "frames"], ends: Ints[Array, "frames"]) -> bool:
    """Whether every frame has the same words, numbers and line breaks in the same places as the first."""
    size = int(ends[0] - heads[0])
    if ((ends - heads) != size).any():
        return False
    span = slice(int(heads[0]), int(ends[-1]))
    words = tokens.words[span].reshape(len(heads), size)
    lines = tokens.lines[span].reshape(len(heads), size)
    return bool((words == words[0]).all() and (lines - lines[:, :1] == lines[0] - lines[0, 0]).all())


def _frame(tokens: Tokens, head: int, end: int, acclaim: AcclaimSkeleton, path: Path) -> Ints[Array, "columns"]:
    """For each degree of freedom of the skeleton the token of its value in one frame."""

    def wrong(fact: str, token: int, cause: str = "") -> FormatError:
        remedy = "Mend the frame, or give the ASF file that belongs to this motion (--skeleton FILE.asf)"
        return FormatError(fact, cause=cause, remedy=remedy, file=path, line=int(tokens.lines[token]))

    if head + 1 < end and tokens.lines[head + 1] == tokens.lines[head]:
        raise wrong("a frame's number should stand alone in its line", head)
    dofs = {bone.name: len(bone.dofs) for bone in acclaim.bones}
    found: dict[str, list[int]] = {}
    token = head + 1
    while token < end:
        name = tokens.word(token)
        last = token + 1
        while last < end and tokens.lines[last] == tokens.lines[token]:
            last += 1
        if name not in dofs:
            raise wrong(f"{name[:40]!r} is no bone of the skeleton", token, "the skeleton belongs to another motion")
        if name in found:
            raise wrong(f"the bone {name!r} stands twice in one frame", token)
        if last - token - 1 != dofs[name]:
            fact = f"the bone {name!r} has {last - token - 1} values, but {dofs[name]} degrees of freedom"
            raise wrong(fact, token, "the line is damaged, or the skeleton belongs to another motion")
        found[name] = list(range(token + 1, last))
        token = last
    missing = [name for name, count in dofs.items() if count and name not in found]
    if missing:
        cause = "the file is cut off, or the skeleton belongs to another motion"
        raise wrong(f"this frame has no values for: {', '.join(missing)}", head, cause)
    return np.array([at for name, count in dofs.items() if count for at in found[name]], dtype=np.int64)


def _motion(
    values: Floats[Array, "frames columns"], acclaim: AcclaimSkeleton, degrees: bool, rate: float, name: str
) -> Motion:
    frames, joints = len(values), len(acclaim.bones)
    angles, axes = np.zeros((frames, joints, 3)), np.full((joints, 3), -1)
    moves = np.zeros((frames, joints, 3))
    column = 0
    for joint, bone in enumerate(acclaim.bones):
        turns = [dof for dof in bone.dofs if dof[0] == "r"]
        for dof in bone.dofs:
            axis = "xyz".index(dof[1])
            if dof[0] == "t":
                moves[:, joint, axis] = values[:, column] * acclaim.metres_per_unit
            else:
                # The first turn acts first, so it stands last in the product.
                place = len(turns) - 1 - turns.index(dof)
                angles[:, joint, place], axes[joint, place] = values[:, column], axis
            column += 1
    if degrees:
        angles = np.deg2rad(angles)
    R_rest_axis = np.stack([bone.R_rest_axis for bone in acclaim.bones])
    # C exp(w) C^-1 = exp(C w).
    rotvecs = _turned(R_rest_axis, rotvec_series_from_euler(angles, axes))
    moves = _turned(R_rest_axis, moves)
    q = np.empty((frames, acclaim.skeleton.size))
    q[:, :3] = moves[:, 0] + acclaim.root_position
    q[:, 3:] = rotvecs.reshape(frames, -1)
    moves[:, 0] = 0.0
    return make_motion(acclaim.skeleton, q, rate, name, moves if moves.any() else None)


def _turned(
    matrices: Floats[Array, "joints 3 3"], vectors: Floats[Array, "frames joints 3"]
) -> Floats[Array, "frames joints 3"]:
    return np.matmul(vectors.transpose(1, 0, 2), matrices.transpose(0, 2, 1)).transpose(1, 0, 2)
