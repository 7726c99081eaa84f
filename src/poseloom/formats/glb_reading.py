"""GLB back to a motion: the files that `poseloom.formats.glb` writes, not glTF at large."""

import json
import struct
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import read_bytes, reading
from poseloom.rotations import rotvec_from_quat, unwrap_rotvec
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

_HEAD, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_FLOAT = 5126
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_RATE_OF_ONE_FRAME = 30.0


def read_glb(path: Path) -> Motion:
    """The motion of a GLB file that poseloom wrote; ends of the bones, which it does not hold, are left open.

    Raises:
        FormatError: for a file that is damaged, or another program's: those may move anything in any way.
        SkeletonError: for an impossible hierarchy.
    """
    with reading(path, "a motion"):
        return _read(path)


def _read(path: Path) -> Motion:
    content, blob = _chunks(read_bytes(path), path)
    if str(content.get("asset", {}).get("generator", "")) != "poseloom":
        raise FormatError(
            "this GLB file is another program's",
            cause="poseloom reads back only the GLB files that it wrote",
            remedy="Convert it to BVH in Blender, or name the file that it was made from",
            file=path,
        )
    try:
        return _motion(content, blob, path.stem)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise _damaged(path, f"its parts do not fit together ({type(error).__name__})") from None


def _chunks(data: bytes, path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the numbers."""
    try:
        magic, version, size = _HEAD.unpack_from(data)
        if magic != b"glTF" or version != 2:
            raise FormatError("this is no GLB file", remedy="Name a .glb file made by poseloom", file=path)
        length, kind = _CHUNK.unpack_from(data, _HEAD.size)
        at = _HEAD.size + _CHUNK.size
        content: Any = json.loads(data[at : at + length])
        second, binary = _CHUNK.unpack_from(data, at + length)
        blob = data[at + length + _CHUNK.size :][:second]
    except (struct.error, ValueError, RecursionError):
        raise _damaged(path, "it ends too early or is garbled") from None
    if kind != b"JSON" or binary != b"BIN\x00" or size != len(data) or len(blob) != second:
        raise _damaged(path, "its length is not what it says")
    if not isinstance(content, dict):
        raise _damaged(path, "it holds no description")
    return cast(dict[str, Any], content), blob


def _motion(content: dict[str, Any], blob: bytes, name: str) -> Motion:
    joints: list[dict[str, Any]] = [node for node in content["nodes"] if "mesh" not in node]
    skeleton = _skeleton(joints)
    animation = content["animations"][0]
    times: NDArray[np.float64] | None = None
    quats = [_still(node) for node in joints]
    places: dict[int, NDArray[np.float64]] = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        times = _values(content, blob, sampler["input"])[:, 0]
        moved, joint = _values(content, blob, sampler["output"]), int(channel["target"]["node"])
        if channel["target"]["path"] == "rotation":
            quats[joint] = np.roll(moved, 1, axis=-1)
        else:
            places[joint] = moved
    if times is None:
        raise ValueError("nothing moves")
    count = len(times)
    turns = np.stack([np.broadcast_to(quat, (count, 4)) for quat in quats], axis=1)
    turns = turns / np.linalg.norm(turns, axis=-1, keepdims=True)
    rotvecs = unwrap_rotvec(rotvec_from_quat(turns))
    q = np.concatenate([places[0], rotvecs.reshape(count, -1)], axis=1)
    displacements = None
    if len(places) > 1:
        displacements = np.zeros((count, len(joints), 3))
        for joint, moved in places.items():
            if joint > 0:
                displacements[:, joint] = moved - skeleton.offsets[joint]
    rate = (count - 1) / float(times[-1] - times[0]) if count > 1 else _RATE_OF_ONE_FRAME
    # Times are kept as 32-bit numbers: a rate that is off by that little is the round one.
    return make_motion(skeleton, q, round(rate, 3), name, displacements)


def _skeleton(joints: list[dict[str, Any]]) -> Skeleton:
    parents = [-1] * len(joints)
    for index, node in enumerate(joints):
        for child in node.get("children", ()):
            parents[child] = index
    offsets = np.array([node["translation"] for node in joints], dtype=np.float64)
    return make_skeleton([str(node["name"]) for node in joints], parents, offsets)


def _still(node: dict[str, Any]) -> Floats[Array, "4"]:
    x, y, z, w = (float(value) for value in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    return np.array([w, x, y, z])


def _values(content: dict[str, Any], blob: bytes, index: int) -> NDArray[np.float64]:
    accessor = content["accessors"][index]
    view = content["bufferViews"][accessor["bufferView"]]
    if accessor["componentType"] != _FLOAT:
        raise ValueError("numbers of another kind")
    count, width = int(accessor["count"]), _WIDTHS[accessor["type"]]
    values = np.frombuffer(blob, "<f4", count * width, int(view["byteOffset"]))
    return values.reshape(count, width).astype(np.float64)


def _damaged(path: Path, cause: str) -> FormatError:
    return FormatError("the GLB file is damaged", cause=cause, remedy="Get or write the file again", file=path)
