"""Exponential-map CSV: one line a frame, the root's place and one rotation vector a joint, without header.

The skeleton stands in a `skeleton.json` in the same folder or in one of the three above: "joints", each with "name",
"parent" (null for the root) and "offset", "metres_per_unit", "frame_rate_hz" and "up_axis". Columns 0 to 2 are the
root's place, columns 3 + 3i to 5 + 3i the vector v of joint i, whose rotation relative to its parent and to the rest
pose is exp(-v). Joints whose names end in `_end` are the tips of leaf bones; their vectors are not used.
"""

import json
from pathlib import Path
from typing import Any, cast

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats._files import decode, read_bytes
from poseloom.formats._numbers import scan
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, settle
from poseloom.rotations import unwrap_rotvec
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

_SKELETON = "skeleton.json"
_LEVELS = 4


def read_expmap(path: Path, skeleton: Path | None = None, choices: MotionChoices = NOTHING_SAID) -> Motion:
    """An exponential-map CSV file as a motion in metres.

    Args:
        path: The file.
        skeleton: Its skeleton's JSON file; looked for beside and above the file where it is None.
        choices: What else the user says of the file.

    Raises:
        FormatError: with the line, for a file that is no table of finite numbers with a column for each joint's axes.
        SkeletonError: for an impossible hierarchy.
    """
    content = _plain(read_bytes(path))
    if b"," not in content:
        raise FormatError(
            "this is no table of exponential maps",
            cause="there are no commas in it",
            remedy="Give a file with one line a frame, values separated by commas",
            file=path,
        )
    tokens = scan(content, file=path)
    wrong = np.flatnonzero(~np.isfinite(tokens.values))
    if wrong.size:
        token = int(wrong[0])
        raise FormatError(
            f"{tokens.word(token)[:40]!r} is not a finite number",
            cause="this is no table of exponential maps, or it is damaged",
            remedy="Mend or cut out that line",
            file=path,
            line=int(tokens.lines[token]),
        )
    lines, counts = np.unique(tokens.lines, return_counts=True)
    source = _find_skeleton(path) if skeleton is None else skeleton
    try:
        names, bones, scale, rate = _skeleton(source)
        columns = 3 + 3 * len(names)
        uneven = np.flatnonzero(counts != columns)
        if uneven.size:
            raise FormatError(
                f"this line has {counts[uneven[0]]} values, but {len(names)} joints need {columns} ({source.name})",
                cause="the file is cut off, or the skeleton belongs to other files",
                remedy="Get the file again, or name its skeleton (--skeleton FILE.json)",
                file=path,
                line=int(lines[uneven[0]]),
            )
        motion = _motion(tokens.values.reshape(-1, columns), names, bones, scale, rate, path.stem)
        return settle(motion, path, choices, scale, "y")
    except PoseloomError as error:
        raise error if error.file else error.at(path) from None


def _plain(content: bytes) -> bytes:
    """The table with commas between the cells and decimal points, whatever its dialect, line by line as it was."""
    text = decode(content)
    mark = next((mark for mark in ";\t" if mark in text), "")
    if mark:
        text = (text.replace(",", ".") if "." not in text else text).replace(mark, ",")
    return text.encode()


def _motion(
    values: Floats[Array, "frames columns"], names: list[str], bones: Skeleton, scale: float, rate: float, name: str
) -> Motion:
    turning = np.array([names.index(bone) for bone in bones.names])
    vectors = values[:, 3:].reshape(len(values), len(names), 3)[:, turning]
    rotvecs = unwrap_rotvec(0.0 - vectors).reshape(len(values), -1)
    return make_motion(bones, np.concatenate([values[:, :3] * scale, rotvecs], axis=1), rate, name)


def _find_skeleton(path: Path) -> Path:
    for folder in list(path.absolute().parents)[:_LEVELS]:
        if (file := folder / _SKELETON).is_file():
            return file
    raise FormatError(
        "the skeleton of this table is missing",
        cause=f"there is no {_SKELETON} in its folder or the {_LEVELS - 1} above",
        remedy=f"Put its {_SKELETON} there, or name it (--skeleton FILE.json)",
        file=path,
    )


def _skeleton(path: Path) -> tuple[list[str], Skeleton, float, float]:
    """All joint names in the columns' order, the skeleton of those that turn, metres per unit, and frames a second."""
    try:
        content = cast(dict[str, Any], json.loads(decode(read_bytes(path))))
        joints = cast(list[dict[str, Any]], content["joints"])
        names = [str(joint["name"]) for joint in joints]
        parents = [None if joint["parent"] is None else str(joint["parent"]) for joint in joints]
        offsets = np.array([[float(value) for value in joint["offset"]] for joint in joints])
        scale, rate = float(content["metres_per_unit"]), float(content["frame_rate_hz"])
        up = str(content.get("up_axis", "y")).lower()
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FormatError(
            "this is not the skeleton of exponential-map tables",
            cause=f"JSON cannot be read or lacks something: {error}",
            remedy="Give a file with joints (name, parent, offset), metres_per_unit and frame_rate_hz",
            file=path,
        ) from None
    if up != "y" or offsets.shape != (len(names), 3) or not (np.isfinite(scale) and scale > 0):
        raise FormatError(
            f"up axis {up!r}, {scale:g} metres per unit and offsets of shape {offsets.shape} cannot be used",
            remedy="Give y up, a positive unit and three numbers an offset",
            file=path,
        )
    turning = [name for name in names if not name.endswith("_end")] or names
    ends = {p: offsets[i] * scale for i, p in enumerate(parents) if p is not None and names[i] not in turning}
    try:
        bones = make_skeleton(
            turning,
            [turning.index(p) if (p := parents[names.index(name)]) in turning else -1 for name in turning],
            np.stack([offsets[names.index(name)] for name in turning]) * scale,
            ends,
        )
    except PoseloomError as error:
        raise error.at(path) from None
    return names, bones, scale, rate
