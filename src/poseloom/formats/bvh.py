"""BVH (Biovision hierarchy): a skeleton and its motion in one text file.

The format states neither its unit of length, nor its up axis, nor what a joint's position channels mean. Here: unit and
axis are told from the body and its poses (`formats.conventions`); a position channel replaces the joint's OFFSET on its
axis, as it does in Blender and in every file we know, among them some whose root has both. Rotations are the
product of the turns in the order of the channels, left to right, in degrees.
"""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats import _bvh_hierarchy as hierarchy
from poseloom.formats._bvh_hierarchy import BvhJoint
from poseloom.formats._bvh_writing import write_bvh
from poseloom.formats._dialects import plain_numbers, utf8
from poseloom.formats._files import decode, read_bytes
from poseloom.formats._numbers import Tokens, scan
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, check_rate, settle
from poseloom.rotations import rotvec_series_from_euler
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import make_skeleton

__all__ = ["read_bvh", "write_bvh"]

_MOTION = re.compile(rb"^[ \t]*MOTION[ \t\r]*$", re.IGNORECASE | re.MULTILINE)
_FRAMES = re.compile(rb"^Frames\s*:?\s*(\S+)$", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"^Frame\s+Time\s*:?\s*(\S+)$", re.IGNORECASE)


def read_bvh(path: Path, metres_per_unit: float | None = None, choices: MotionChoices = NOTHING_SAID) -> Motion:
    """A BVH file as a motion in metres, Y up.

    Args:
        path: The file.
        metres_per_unit: The file's unit of length; guessed from the body's size where it is None.
        choices: What else the user says of the file.

    Raises:
        FormatError: with the line, for a file that is not BVH, is cut off, or holds values that are no numbers.
        SkeletonError: for joints that share a name.
    """
    if metres_per_unit is not None:
        choices = replace(choices, metres_per_unit=metres_per_unit)
    content = plain_numbers(utf8(read_bytes(path)))
    if b"\n" not in content:
        content = content.replace(b"\r", b"\n")
    mark = _MOTION.search(content)
    if mark is None and b"HIERARCHY" not in content[:4096].upper():
        raise FormatError(
            "a BVH file begins with the word HIERARCHY, and this one does not",
            cause="this is another kind of file",
            remedy="Give a file of the kind its suffix says",
            file=path,
            line=1,
        )
    joints = hierarchy.parse_hierarchy(decode(content[: mark.start()] if mark else content), path)
    if mark is None:
        raise FormatError(
            "there is no MOTION section", cause="the file is cut off", remedy="Export it again", file=path
        )
    columns = sum(len(joint.channels) for joint in joints)
    if columns == 0:
        raise FormatError("no joint has any channels, so nothing moves", remedy="Export it with its motion", file=path)
    line = content.count(b"\n", 0, mark.start()) + 2
    frames, rate, body, line = _motion_header(content, mark.end() + 1, line, path, choices)
    values = _values(scan(body, line, path), frames, columns, line, path)
    try:
        return settle(_motion(joints, values, rate, path.stem), path, choices)
    except PoseloomError as error:
        raise error.at(path) from None


def _motion_header(
    content: bytes, start: int, line: int, path: Path, choices: MotionChoices
) -> tuple[int, float, bytes, int]:
    """Number of frames, rate, the text of the values, and the line they begin in."""
    found: list[bytes] = []
    for pattern, name in ((_FRAMES, "Frames:"), (_FRAME_TIME, "Frame Time:")):
        text = b""
        while start < len(content) and not text:
            end = content.find(b"\n", start)
            end = len(content) if end < 0 else end
            text = content[start:end].strip()
            start, line = end + 1, line + 1
        match = pattern.match(text)
        if match is None:
            raise FormatError(
                f"here should stand {name!r} and a number",
                cause="the file is cut off" if not text else f"it reads {text[:40].decode('latin-1')!r}",
                remedy="Export the file again",
                file=path,
                line=line - 1 if text else None,
            )
        found.append(match.group(1))
    frames_text, time_text = (item.decode("latin-1") for item in found)
    if not re.fullmatch("[0-9]{1,9}", frames_text) or int(frames_text) == 0:
        raise FormatError(
            f"the number of frames is {frames_text[:40]!r}", remedy="Give at least one frame", file=path, line=line - 2
        )
    return int(frames_text), _rate(time_text, path, line - 1, choices), content[start:], line


def _rate(text: str, path: Path, line: int, choices: MotionChoices) -> float:
    """Frames a second from a frame time as it stands in the file.

    Frame times are rounded: where the time of a whole number of frames a second rounds to the same figures, the rate is
    that number.
    """
    try:
        time = float(text)
    except ValueError:
        time = math.nan
    if not (math.isfinite(time) and time > 1e-9):
        raise FormatError(
            f"the frame time is {text[:40]!r}",
            remedy="Give the seconds from frame to frame, a positive number",
            file=path,
            line=line,
        )
    rate = 1 / time
    whole = max(round(rate), 1)
    figures = len(text.partition(".")[2]) if text.replace(".", "", 1).isdigit() else 17
    rounded = abs(1 / whole - time) <= 0.5 * 10.0**-figures + 1e-16
    return check_rate(float(whole) if rounded else rate, path, choices, line)


def _values(tokens: Tokens, frames: int, columns: int, first_line: int, path: Path) -> Floats[Array, "frames columns"]:
    """The motion's numbers, checked: a finite number everywhere and the right count in each line."""
    wrong = np.flatnonzero(~np.isfinite(tokens.values))
    if wrong.size:
        token = int(wrong[0])
        raise FormatError(
            f"{tokens.word(token)[:40]!r} is not a finite number",
            cause="the motion is damaged, or the file is cut off and continued with something else",
            remedy="Mend or cut out that frame",
            file=path,
            line=int(tokens.lines[token]),
        )
    if len(tokens) == frames * columns:
        grid = tokens.lines.reshape(frames, columns)
        if (grid[:, 0] == grid[:, -1]).all() and (grid[1:, 0] > grid[:-1, -1]).all():
            return tokens.values.reshape(frames, columns)
    lines, counts = np.unique(tokens.lines, return_counts=True)
    uneven = np.flatnonzero(counts != columns)
    if uneven.size and not (uneven[0] == len(lines) - 1 and len(lines) < frames):
        line, count = int(lines[uneven[0]]), int(counts[uneven[0]])
        raise FormatError(
            f"this frame has {count} values, but the hierarchy has {columns} channels",
            cause="the line is damaged or the hierarchy belongs to another motion",
            remedy="Mend the line or export the file again",
            file=path,
            line=line,
        )
    raise FormatError(
        f"{frames} frames are announced, but {len(lines) - uneven.size} whole ones follow",
        cause="the file is cut off" if len(lines) < frames else "the number after 'Frames:' is wrong",
        remedy="Get the file again, or correct its 'Frames:' line",
        file=path,
        line=int(lines[-1]) if len(lines) else first_line,
    )


def _offset(joint: BvhJoint) -> Floats[Array, "3"]:
    return np.zeros(3) if joint.offset is None else joint.offset


def _places(joints: list[BvhJoint]) -> list[bool]:
    """For each joint whether its OFFSET is where the body stood rather than a bone: so for the root, and for joints
    that may move and hang alone on such a joint."""
    children = [0] * len(joints)
    for joint in joints[1:]:
        children[joint.parent] += 1
    places = [True]
    for joint in joints[1:]:
        places.append(places[joint.parent] and children[joint.parent] == 1 and bool(joint.positions))
    return places


def _motion(joints: list[BvhJoint], values: Floats[Array, "frames columns"], rate: float, name: str) -> Motion:
    """The motion in the file's own unit and axes."""
    places = zip(joints, _places(joints), strict=True)
    offsets = np.stack([np.zeros(3) if place else _offset(joint) for joint, place in places])
    tips = {joint.name: joint.tip for joint in joints if joint.tip is not None and joint.tip.any()}
    skeleton = make_skeleton([j.name for j in joints], [j.parent for j in joints], offsets, tips)
    columns, axes = hierarchy.rotation_columns(joints)
    q = np.empty((len(values), skeleton.size))
    angles = np.deg2rad(values)[:, np.maximum(columns, 0)]
    q[:, 3:] = rotvec_series_from_euler(angles, axes).reshape(len(values), -1)
    moves = np.zeros((len(values), len(joints), 3))
    first = 0
    for index, joint in enumerate(joints):
        moves[:, index] = _offset(joint) - offsets[index]
        for place in joint.positions:
            axis = joint.channels[place]
            moves[:, index, axis] = values[:, first + place] - offsets[index, axis]
        first += len(joint.channels)
    q[:, :3] = moves[:, 0]
    moves[:, 0] = 0.0
    return make_motion(skeleton, q, rate, name, moves if moves.any() else None)
