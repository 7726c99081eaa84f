"""DeepMimic's motions: JSON with 44 numbers a frame, on the humanoid that its source describes.

A frame holds its duration (1, seconds), the root's position (3, metres) and rotation (4), and then, in the order of
`_JOINTS`, one quaternion `wxyz` for a ball joint or one angle for a hinge. DeepMimic's humanoid faces +X with its right
hand towards +Z, and hinges turn about +Z; here all is turned by a quarter about the vertical, so that it faces +Z.
Source: Peng et al., DeepMimic, 2018, and its `humanoid3d` character and motion files.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from poseloom.arrays import Array, Floats, exceeds_room
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats._files import decode, read_bytes
from poseloom.rotations import rotvec_from_quat, unwrap_rotvec
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

_BALL, _HINGE, _FIXED = 4, 1, 0
_VALUES = 44


class _Joint(NamedTuple):
    """A joint of the humanoid, in DeepMimic's axes: its place in the parent's frame, and how many numbers turn it."""

    name: str
    parent: str
    offset: tuple[float, float, float]
    values: int


_JOINTS = (
    _Joint("chest", "root", (0.0, 0.236151, 0.0), _BALL),
    _Joint("neck", "chest", (0.0, 0.223894, 0.0), _BALL),
    _Joint("right_hip", "root", (0.0, 0.0, 0.084887), _BALL),
    _Joint("right_knee", "right_hip", (0.0, -0.421546, 0.0), _HINGE),
    _Joint("right_ankle", "right_knee", (0.0, -0.409870, 0.0), _BALL),
    _Joint("right_shoulder", "chest", (-0.02405, 0.24350, 0.18311), _BALL),
    _Joint("right_elbow", "right_shoulder", (0.0, -0.274788, 0.0), _HINGE),
    _Joint("right_wrist", "right_elbow", (0.0, -0.258947, 0.0), _FIXED),
    _Joint("left_hip", "root", (0.0, 0.0, -0.084887), _BALL),
    _Joint("left_knee", "left_hip", (0.0, -0.421546, 0.0), _HINGE),
    _Joint("left_ankle", "left_knee", (0.0, -0.409870, 0.0), _BALL),
    _Joint("left_shoulder", "chest", (-0.02405, 0.24350, -0.18311), _BALL),
    _Joint("left_elbow", "left_shoulder", (0.0, -0.274788, 0.0), _HINGE),
    _Joint("left_wrist", "left_elbow", (0.0, -0.258947, 0.0), _FIXED),
)
# The far sides of the shapes that the character draws there: a ball for the head, boxes for the feet, balls for hands.
_TIPS = {
    "neck": (0.0, 0.2775, 0.0),
    "right_ankle": (0.1335, -0.0225, 0.0),
    "left_ankle": (0.1335, -0.0225, 0.0),
    "right_wrist": (0.0, -0.04, 0.0),
    "left_wrist": (0.0, -0.04, 0.0),
}


class DeepMimicMotion(NamedTuple):
    """A motion file of DeepMimic's.

    Attributes:
        motion: At a constant rate.
        cyclic: Whether the file says that it repeats: its last pose is then its first again, root place apart.
    """

    motion: Motion
    cyclic: bool


def deepmimic_skeleton() -> Skeleton:
    """The humanoid: arms hang at rest, it faces +Z, metres."""
    names = ["root", *(joint.name for joint in _JOINTS)]
    still, hinge = np.array([True, True, True]), np.array([False, True, True])
    return make_skeleton(
        names,
        [-1, *(names.index(joint.parent) for joint in _JOINTS)],
        _turned(np.array([(0.0, 0.0, 0.0), *(joint.offset for joint in _JOINTS)])),
        {name: _turned(np.array(tip)) for name, tip in _TIPS.items()},
        {joint.name: still if joint.values == _FIXED else hinge for joint in _JOINTS if joint.values != _BALL},
    )


def read_deepmimic(path: Path) -> DeepMimicMotion:
    """Reads a DeepMimic motion file.

    Frames of different durations are resampled to a constant rate: that of the most frequent duration, a whole number
    where one is within the rounding of the files. The last frame's duration has no meaning and is not read.

    Raises:
        FormatError: for a file that is not JSON, is cut off, or whose frames are not 44 finite numbers.
    """
    content = _json(path)
    values = _frames(content, path)
    durations = values[:-1, 0]
    if len(values) > 1 and durations.min() <= 0:
        frame = int(np.argmin(durations))
        raise _wrong(f"frame {frame} lasts {durations[frame]:g} s", path, "Give each frame a positive duration")
    rate = _rate(durations) if len(values) > 1 else _rate(values[:, 0])
    if exceeds_room(float(durations.sum()) * rate, len(values), _VALUES):
        frame = int(np.argmax(durations))
        raise _wrong(f"frame {frame} lasts {durations[frame]:g} s", path, "Mend its duration, or cut the clip there")
    q = _pose_vectors(values, path)
    even = np.abs(durations * rate - 1) < 1e-3
    try:
        motion = make_motion(deepmimic_skeleton(), q if even.all() else _evened(q, durations, rate), rate, path.stem)
    except PoseloomError as error:
        raise error.at(path) from None
    return DeepMimicMotion(motion, content.get("Loop") == "wrap")


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(decode(read_bytes(path)))
    except json.JSONDecodeError as error:
        raise FormatError(
            f"this is not whole JSON: {error.msg}",
            cause="the file is cut off or damaged, or it is another kind of file",
            remedy="Get the file again",
            file=path,
            line=error.lineno,
        ) from None
    except RecursionError:
        raise _wrong("this JSON is nested without end", path, "Give a DeepMimic motion file") from None
    if not isinstance(content, dict) or "Frames" not in content:
        raise _wrong('there is no "Frames" in this JSON file', path, "Give a DeepMimic motion file")
    return cast(dict[str, Any], content)


def _frames(content: dict[str, Any], path: Path) -> Floats[Array, "frames values"]:
    frames = content["Frames"]
    if not isinstance(frames, list) or not frames:
        raise _wrong('"Frames" is no list with at least one frame', path, "Give a DeepMimic motion file")
    rows = cast(list[Any], frames)
    for number, row in enumerate(rows):
        numbers = cast(list[Any], row) if isinstance(row, list) else []
        count = len(numbers)
        if count != _VALUES:
            raise _wrong(f"frame {number} has {count} values instead of {_VALUES}", path, "Get the file again")
        if not all(type(value) in (int, float) for value in numbers):
            raise _wrong(f"frame {number} holds something that is no number", path, "Get the file again")
    try:
        values = np.array(rows, dtype=np.float64)
    except OverflowError:
        values = np.full((1, _VALUES), np.inf)
    if not np.isfinite(values).all():
        frame = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise _wrong(f"frame {frame} holds a number that is not finite", path, "Mend or cut out that frame")
    return values


def _rate(durations: Floats[Array, "frames"]) -> float:
    """Frames a second; durations in the files are rounded, as 0.0166660007 for a 60th."""
    rounded, counts = np.unique(np.round(durations, 6), return_counts=True)
    duration = float(rounded[np.argmax(counts)])
    rate = 1 / duration if duration > 0 else 30.0
    whole = max(round(rate), 1)
    return float(whole) if abs(rate - whole) < 2e-4 * whole else rate


def _pose_vectors(values: Floats[Array, "frames values"], path: Path) -> Floats[Array, "frames dofs"]:
    turns = np.zeros((len(values), 1 + len(_JOINTS), 3))
    turns[:, 0] = _rotvecs(values[:, 4:8], "root", path)
    column = 8
    for place, joint in enumerate(_JOINTS, start=1):
        if joint.values == _BALL:
            turns[:, place] = _rotvecs(values[:, column : column + 4], joint.name, path)
        elif joint.values == _HINGE:
            turns[:, place, 2] = values[:, column]
        column += joint.values
    places = _turned(values[:, None, 1:4])
    return np.concatenate([places, unwrap_rotvec(_turned(turns))], axis=1).reshape(len(values), -1)


def _rotvecs(quats: Floats[Array, "frames 4"], joint: str, path: Path) -> Floats[Array, "frames 3"]:
    sizes = np.linalg.norm(quats, axis=1, keepdims=True)
    if sizes.min() < 0.5:
        frame = int(np.argmin(sizes))
        raise _wrong(f"in frame {frame} the quaternion of {joint} is nearly zero", path, "Mend or cut out that frame")
    return rotvec_from_quat(quats / sizes)


def _turned(vectors: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3"]:
    """From DeepMimic's axes (front +X, right +Z) to ours (front +Z, left +X)."""
    return np.stack([-vectors[..., 2], vectors[..., 1], vectors[..., 0]], axis=-1)


def _evened(
    q: Floats[Array, "frames dofs"], durations: Floats[Array, "intervals"], rate: float
) -> Floats[Array, "even dofs"]:
    """The same motion at a constant rate, from frames at uneven times."""
    times = np.concatenate([[0.0], np.cumsum(durations)])
    instants = np.arange(int(times[-1] * rate + 1e-6) + 1) / rate
    before = np.clip(np.searchsorted(times, instants, side="right") - 1, 0, len(q) - 2)
    fraction = np.clip((instants - times[before]) / durations[before], 0.0, 1.0)
    return interpolate_pose_vectors(q[before], q[before + 1], fraction)


def _wrong(fact: str, path: Path, remedy: str) -> FormatError:
    return FormatError(fact, cause="this is no motion file of DeepMimic's, or damaged", remedy=remedy, file=path)
