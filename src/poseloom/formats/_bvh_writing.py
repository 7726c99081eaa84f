"""The writer of BVH; its reader stands in `bvh`."""

import math
from io import BufferedIOBase
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import write_bytes
from poseloom.rotations import euler_from_matrix, matrix_from_rotvec
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton

_DIGITS = 10
"""Room for the count of frames, the same however a file is written: a session sets it at its end."""


def write_bvh(motion: Motion, path: Path, metres_per_unit: float = 0.01, order: str = "ZXY") -> None:
    """Writes a motion as BVH, whole or not at all.

    Args:
        motion: Angles become Euler angles in degrees, continuous in time; a joint with displacements gets position
            channels too. Places are exact to 5e-9 m, angles to 5e-7 degrees.
        path: Where to.
        metres_per_unit: The file's unit of length; centimetres is what most programs expect.
        order: In which order the turns are multiplied and listed.

    Raises:
        FormatError: where the file cannot be written, a joint's name cannot stand in it, the unit is not positive, or
            the order is not three different axes.
    """
    _check_names(motion.skeleton, path)
    if not (math.isfinite(metres_per_unit) and metres_per_unit > 0):
        raise FormatError(f"the unit of length is {metres_per_unit:g} m", remedy="Give a positive number")
    if sorted(order) != ["X", "Y", "Z"]:
        raise FormatError(f"the order of rotations {order!r} is not three different axes", remedy="Use for example ZXY")
    moved = _moving_joints(motion)
    joints = _depth_first(motion.skeleton)
    header = _header(motion.skeleton, joints, moved, metres_per_unit, order, f"{len(motion):{_DIGITS}d}", motion.rate)
    rows = _rows(_columns(motion, joints, moved, metres_per_unit, order), metres_per_unit)
    write_bytes(path, (header + rows).encode())


class BvhStream:
    """A BVH file that is written frame by frame, as `write_bvh` would; its count of frames is set by `finish`.

    Args:
        file: Where to, opened for writing; it must be able to seek.
        skeleton: The bones.
        rate: Frames a second.
        path: Its name, for messages.

    Raises:
        FormatError: where a joint's name cannot stand in the file.
        OSError: also from the methods, where the file cannot be written.
    """

    _unit, _order = 0.01, "ZXY"

    def __init__(self, file: BufferedIOBase, skeleton: Skeleton, rate: float, path: Path) -> None:
        _check_names(skeleton, path)
        self._file, self._skeleton, self._rate = file, skeleton, rate
        self._joints, self._moved = _depth_first(skeleton), [False] * len(skeleton)
        self._count = 0
        self._last: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        header = _header(skeleton, self._joints, self._moved, self._unit, self._order, f"{0:{_DIGITS}d}", rate).encode()
        self._place = header.rindex(b"Frames: ") + len(b"Frames: ")
        file.write(header)

    def add(self, q: Floats[Array, "frames dofs"]) -> None:
        """Appends frames by their pose vectors."""
        before = () if self._last is None else (self._last[0][None],)
        motion = make_motion(self._skeleton, np.concatenate([*before, q]), self._rate)
        columns: NDArray[np.float64] = _columns(motion, self._joints, self._moved, self._unit, self._order)
        if self._last is not None:
            # Angles go on from where they are, over any number of turns.
            columns = np.asarray(columns[1:] + 360.0 * np.round((self._last[1] - columns[0]) / 360.0), dtype=np.float64)
        self._file.write(_rows(columns, self._unit).encode())
        self._last = (q[-1], columns[-1])
        self._count += len(q)

    def finish(self) -> None:
        """Sets the count of frames."""
        self.set_count(self._file, self._count)

    def set_count(self, file: BufferedIOBase, count: int) -> None:
        """Sets the count of frames in a file, where what was added last could not be written whole."""
        file.seek(self._place)
        file.write(f"{count:{_DIGITS}d}".encode())


def _header(
    skeleton: Skeleton, joints: list[int], moved: list[bool], scale: float, order: str, frames: str, rate: float
) -> str:
    lines = ["HIERARCHY", *_hierarchy_lines(skeleton, joints, moved, scale, order)]
    return "\n".join([*lines, "MOTION", f"Frames: {frames}", f"Frame Time: {1 / rate!r}"]) + "\n"


def _rows(columns: Floats[Array, "frames columns"], scale: float) -> str:
    # Adding zero turns -0 into 0 after the rounding that could make one.
    figures = max(6, math.ceil(8 + math.log10(scale)))
    pattern = " ".join([f"%.{figures}f"] * columns.shape[1]) + "\n"
    return "".join(pattern % tuple(row) for row in (np.round(columns, figures) + 0.0).tolist())


def _check_names(skeleton: Skeleton, path: Path) -> None:
    for name in skeleton.names:
        if not name or name != " ".join(name.split()) or "{" in name or "}" in name:
            raise FormatError(
                f"the joint name {name!r} cannot stand in a BVH file",
                cause="it is empty, or holds braces, line ends or outer blanks",
                remedy="Rename the joint",
                file=path,
            )


def _moving_joints(motion: Motion) -> list[bool]:
    if motion.displacements is None:
        return [False] * len(motion.skeleton)
    return [joint > 0 and bool(motion.displacements[:, joint].any()) for joint in range(len(motion.skeleton))]


def _depth_first(skeleton: Skeleton) -> list[int]:
    """Joints in the order in which nested blocks list them."""
    order: list[int] = []
    waiting = [0]
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += reversed(skeleton.children(joint))
    return order


def _hierarchy_lines(skeleton: Skeleton, joints: list[int], moved: list[bool], scale: float, order: str) -> list[str]:
    turns = " ".join(f"{axis}rotation" for axis in order)
    lines: list[str] = []
    open_joints: list[int] = []
    for joint in joints:
        parent = int(skeleton.parents[joint])
        while open_joints and open_joints[-1] != parent:
            open_joints.pop()
            lines.append("\t" * len(open_joints) + "}")
        indent = "\t" * len(open_joints)
        place = np.zeros(3) if parent < 0 else skeleton.offsets[joint] / scale
        channels = f"6 Xposition Yposition Zposition {turns}" if parent < 0 or moved[joint] else f"3 {turns}"
        lines += [f"{indent}{'ROOT' if parent < 0 else 'JOINT'} {skeleton.names[joint]}", indent + "{"]
        lines += [f"{indent}\tOFFSET {_vector(place)}", f"{indent}\tCHANNELS {channels}"]
        tip = skeleton.tips[joint]
        stated = bool(np.isfinite(tip).all())
        if stated or not skeleton.children(joint):
            end = tip / scale if stated else np.zeros(3)
            lines += [f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET {_vector(end)}", f"{indent}\t}}"]
        open_joints.append(joint)
    while open_joints:
        open_joints.pop()
        lines.append("\t" * len(open_joints) + "}")
    return lines


def _vector(values: Floats[Array, "3"]) -> str:
    return " ".join(f"{value:.8f}" for value in (np.round(values, 8) + 0.0).tolist())


def _columns(
    motion: Motion, joints: list[int], moved: list[bool], scale: float, order: str
) -> Floats[Array, "frames columns"]:
    rotvecs = motion.rotvecs[:, np.array(joints)]
    angles = np.rad2deg(np.unwrap(euler_from_matrix(matrix_from_rotvec(rotvecs), order), axis=0))
    columns: list[Floats[Array, "frames 3"]] = []
    for place, joint in enumerate(joints):
        if joint == 0:
            columns.append(motion.root_positions / scale)
        elif moved[joint] and motion.displacements is not None:
            columns.append((motion.skeleton.offsets[joint] + motion.displacements[:, joint]) / scale)
        columns.append(angles[:, place])
    return np.concatenate(columns, axis=1)
