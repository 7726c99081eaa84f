"""BVH (Biovision hierarchy): a skeleton and its motion in one text file.

The format states neither its unit of length nor what a joint's position channels mean. Here: the unit is told from the
size of the skeleton (`guess_metres_per_unit`); a position channel replaces the joint's OFFSET on its axis, as it does
in Blender and in every file we know, among them some whose root has both. Rotations are the product of the turns in
the order of the channels, left to right, in degrees. Y is up.
"""

import math
import re
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats import _bvh_hierarchy as hierarchy
from poseloom.formats._bvh_hierarchy import BvhJoint
from poseloom.formats._bvh_writing import write_bvh
from poseloom.formats._files import decode, read_bytes
from poseloom.formats._numbers import Tokens, scan
from poseloom.rotations import rotvec_series_from_euler
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import make_skeleton

__all__ = ["guess_metres_per_unit", "read_bvh", "write_bvh"]

_MOTION = re.compile(rb"^[ \t]*MOTION[ \t\r]*$", re.IGNORECASE | re.MULTILINE)
_FRAMES = re.compile(rb"^Frames\s*:?\s*(\S+)$", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"^Frame\s+Time\s*:?\s*(\S+)$", re.IGNORECASE)

_REACH = 1.05
"""Metres from an adult's root along the bones to the farthest joint: down a leg, or up the trunk and out an arm."""
_UNITS = {1.0: 2.8, 0.01: 2.8, 0.001: 2.8, 0.0254 / 0.45: 1.6, 0.0254: 1.6}
"""Units in use (metres, centimetres, millimetres, CMU's 0.45 scaled inches, inches), and by which factor a skeleton may
be larger or smaller than an adult to be taken for one in that unit: a toddler or a toy is likelier in a metric one."""


def read_bvh(path: Path, metres_per_unit: float | None = None) -> Motion:
    """A BVH file as a motion in metres.

    Args:
        path: The file.
        metres_per_unit: The file's unit of length; guessed from the skeleton's size where it is None.

    Raises:
        FormatError: with the line, for a file that is not BVH, is cut off, or holds values that are no numbers.
        SkeletonError: for joints that share a name.
    """
    if metres_per_unit is not None and not (math.isfinite(metres_per_unit) and metres_per_unit > 0):
        raise FormatError(f"the unit of length is {metres_per_unit:g} m", remedy="Give a positive number", file=path)
    content = read_bytes(path)
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
    frames, rate, body, line = _motion_header(content, mark.end() + 1, line, path)
    values = _values(scan(body, line), frames, columns, line, path)
    scale = guess_metres_per_unit(joints) if metres_per_unit is None else metres_per_unit
    try:
        return _motion(joints, values, rate, scale, path.stem)
    except PoseloomError as error:
        raise error.at(path) from None


def guess_metres_per_unit(joints: list[BvhJoint]) -> float:
    """The unit of length in which a hierarchy is as large as a person; centimetres where it is so in none.

    The measure is the longest way along the bones, which no rest pose changes. Of the units in use the one that brings
    it nearest to an adult's is taken; people of 1.2 m and more are told right in any.
    """
    reach = np.zeros(len(joints))
    for index, (joint, place) in enumerate(zip(joints, _places(joints), strict=True)):
        if not place:
            reach[index] = reach[joint.parent] + np.linalg.norm(_offset(joint))
    longest = float(reach.max())
    if longest <= 0:
        return 0.01
    misfits = {unit: abs(math.log(longest * unit / _REACH)) for unit in _UNITS}
    fitting = [unit for unit, misfit in misfits.items() if misfit < math.log(_UNITS[unit])]
    return min(fitting, key=lambda unit: misfits[unit], default=0.01)


def _motion_header(content: bytes, start: int, line: int, path: Path) -> tuple[int, float, bytes, int]:
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
    return int(frames_text), _rate(time_text, path, line - 1), content[start:], line


def _rate(text: str, path: Path, line: int) -> float:
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
    return float(whole) if abs(1 / whole - time) <= 0.5 * 10.0**-figures + 1e-16 else rate


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


def _motion(
    joints: list[BvhJoint], values: Floats[Array, "frames columns"], rate: float, scale: float, name: str
) -> Motion:
    places = zip(joints, _places(joints), strict=True)
    offsets = np.stack([np.zeros(3) if place else _offset(joint) for joint, place in places])
    tips = {joint.name: joint.tip * scale for joint in joints if joint.tip is not None and joint.tip.any()}
    skeleton = make_skeleton([j.name for j in joints], [j.parent for j in joints], offsets * scale, tips)
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
    moves *= scale
    q[:, :3] = moves[:, 0]
    moves[:, 0] = 0.0
    return make_motion(skeleton, q, rate, name, moves if moves.any() else None)
