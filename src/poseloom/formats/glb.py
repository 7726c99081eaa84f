"""GLB (binary glTF 2.0): an animated skeleton with a simple visible body, for viewers, Blender and game engines.

One node a joint, one skin whose bind pose is the skeleton's rest pose, one mesh, and one animation of the root's place,
the joints' rotations and, where joints move, their places. Metres, seconds, Y up, as glTF has it.
"""

from pathlib import Path

import numpy as np
import pygltflib as gltf  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.formats._files import write_bytes
from poseloom.rotations import quat_from_rotvec
from poseloom.skeleton.figure_mesh import Mesh, figure_mesh
from poseloom.skeleton.motion import Motion

_COLOUR = [0.32, 0.55, 0.75, 1.0]


def write_glb(motion: Motion, path: Path) -> None:
    """Writes a motion as GLB, whole or not at all.

    Raises:
        FormatError: where the file cannot be written.
    """
    buffer = _Buffer()
    skeleton = motion.skeleton
    nodes = [
        gltf.Node(
            name=skeleton.names[joint],
            translation=skeleton.offsets[joint].tolist(),
            children=list(skeleton.children(joint)),
        )
        for joint in range(len(skeleton))
    ]
    document = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator="poseloom"),
        scene=0,
        scenes=[gltf.Scene(name=motion.name or "motion", nodes=[0])],
        nodes=nodes,
    )
    document.animations = [_animation(motion, document.nodes, buffer)]
    mesh = figure_mesh(skeleton)
    if len(mesh.triangles):
        _add_body(document, mesh, skeleton.rest_positions(), buffer)
    document.bufferViews, document.accessors = buffer.views, buffer.accessors
    document.buffers = [gltf.Buffer(byteLength=len(buffer.content))]
    document.set_binary_blob(bytes(buffer.content))  # pyright: ignore[reportUnknownMemberType]
    write_bytes(path, b"".join(document.save_to_bytes()))  # pyright: ignore[reportUnknownMemberType, reportUnknownArgumentType]


class _Buffer:
    """Arrays one behind the other, with the accessors that find them."""

    def __init__(self) -> None:
        self.content = bytearray()
        self.views: list[gltf.BufferView] = []
        self.accessors: list[gltf.Accessor] = []

    def add(self, values: NDArray[np.generic], kind: str, target: int | None = None, bounds: bool = False) -> int:
        """Index of the new accessor to values of float32, uint16 or uint32, one row an element."""
        code = {"float32": gltf.FLOAT, "uint16": gltf.UNSIGNED_SHORT, "uint32": gltf.UNSIGNED_INT}[values.dtype.name]
        data = np.ascontiguousarray(values).tobytes()
        self.views.append(gltf.BufferView(buffer=0, byteOffset=len(self.content), byteLength=len(data), target=target))
        self.content += data + bytes(-len(data) % 4)
        accessor = gltf.Accessor(bufferView=len(self.views) - 1, componentType=code, count=len(values), type=kind)
        if bounds:
            rows = values.reshape(len(values), -1)
            accessor.min, accessor.max = rows.min(axis=0).tolist(), rows.max(axis=0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _animation(motion: Motion, nodes: list[gltf.Node], buffer: _Buffer) -> gltf.Animation:
    """Moves the nodes; one that never turns gets its rotation once and for all."""
    times = (np.arange(len(motion)) / motion.rate).astype(np.float32)
    clock = buffer.add(times, gltf.SCALAR, bounds=True)
    animation = gltf.Animation(name=motion.name or "motion")

    def add(joint: int, path: str, values: Floats[Array, "frames width"], kind: str) -> None:
        output = buffer.add(values.astype(np.float32), kind)
        animation.samplers.append(gltf.AnimationSampler(input=clock, output=output, interpolation=gltf.ANIM_LINEAR))
        target = gltf.AnimationChannelTarget(node=joint, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    add(0, "translation", motion.root_positions, gltf.VEC3)
    if motion.displacements is not None:
        for joint in np.flatnonzero(motion.displacements.any(axis=(0, 2))).tolist():
            add(joint, "translation", motion.skeleton.offsets[joint] + motion.displacements[:, joint], gltf.VEC3)
    quats_xyzw = np.roll(_continuous(quat_from_rotvec(motion.rotvecs)), -1, axis=-1)
    for joint in range(len(motion.skeleton)):
        turns = quats_xyzw[:, joint]
        if joint > 0 and (turns == turns[0]).all():
            nodes[joint].rotation = turns[0].tolist()
        else:
            add(joint, "rotation", turns, gltf.VEC4)
    return animation


def _continuous(quats: Floats[Array, "frames joints 4"]) -> Floats[Array, "frames joints 4"]:
    """The same rotations with the signs that lie nearest to the frame before: viewers interpolate the numbers."""
    flips = np.where(np.sum(quats[1:] * quats[:-1], axis=-1) < 0, -1.0, 1.0)
    signs = np.concatenate([np.ones_like(quats[:1, :, 0]), np.cumprod(flips, axis=0)])
    return quats * signs[..., None]


def _add_body(document: gltf.GLTF2, mesh: Mesh, rest: Floats[Array, "joints 3"], buffer: _Buffer) -> None:
    """Hangs the mesh into the scene, each vertex carried by one joint."""
    count = len(mesh.vertices)
    joints, weights = np.zeros((count, 4), dtype=np.uint16), np.zeros((count, 4), dtype=np.float32)
    joints[:, 0], weights[:, 0] = mesh.joints, 1.0
    attributes = gltf.Attributes(
        POSITION=buffer.add(mesh.vertices.astype(np.float32), gltf.VEC3, gltf.ARRAY_BUFFER, bounds=True),
        NORMAL=buffer.add(mesh.normals.astype(np.float32), gltf.VEC3, gltf.ARRAY_BUFFER),
        JOINTS_0=buffer.add(joints, gltf.VEC4, gltf.ARRAY_BUFFER),
        WEIGHTS_0=buffer.add(weights, gltf.VEC4, gltf.ARRAY_BUFFER),
    )
    triangles = mesh.triangles.reshape(-1).astype(np.uint32)
    indices = buffer.add(triangles, gltf.SCALAR, gltf.ELEMENT_ARRAY_BUFFER)
    # Matrices stand column by column: the last four numbers are the translation.
    binds = np.tile(np.eye(4, dtype=np.float32), (len(rest), 1, 1))
    binds[:, 3, :3] = -rest
    matrices = buffer.add(binds.reshape(-1, 16), gltf.MAT4)
    surface = gltf.PbrMetallicRoughness(baseColorFactor=_COLOUR, metallicFactor=0.0, roughnessFactor=0.75)
    document.materials = [gltf.Material(name="body", pbrMetallicRoughness=surface)]
    document.meshes = [
        gltf.Mesh(name="body", primitives=[gltf.Primitive(attributes=attributes, indices=indices, material=0)])
    ]
    document.skins = [
        gltf.Skin(name="skeleton", joints=list(range(len(rest))), inverseBindMatrices=matrices, skeleton=0)
    ]
    document.nodes.append(gltf.Node(name="body", mesh=0, skin=0))
    document.scenes[0].nodes = [0, len(document.nodes) - 1]
