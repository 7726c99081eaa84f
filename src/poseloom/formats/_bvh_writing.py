"""The writer of BVH; its reader stands in `bvh`."""

import math
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import write_bytes
from poseloom.rotations import euler_from_matrix, matrix_from_rotvec
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.skeleton import Skeleton


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
    order_of_joints = _depth_first(motion.skeleton)
    lines = ["HIERARCHY", *_hierarchy_lines(motion.skeleton, order_of_joints, moved, metres_per_unit, order)]
    lines += ["MOTION", f"Frames: {len(motion)}", f"Frame Time: {1 / motion.rate!r}"]
    # Adding zero turns -0 into 0 after the rounding that could make one.
    figures = max(6, math.ceil(8 + math.log10(metres_per_unit)))
    columns = np.round(_columns(motion, order_of_joints, moved, metres_per_unit, order), figures) + 0.0
    pattern = " ".join([f"%.{figures}f"] * columns.shape[1])
    lines += [pattern % tuple(row) for row in columns.tolist()]
    write_bytes(path, ("\n".join(lines) + "\n").encode())


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
