"""A figure in the scene: one mesh a bone, hung on its parent's, so that a pose is one small message a joint."""

from dataclasses import dataclass

import numpy as np
import viser

from poseloom.arrays import Array, Floats
from poseloom.rotations import quat_from_rotvec
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.figure_mesh import Mesh, figure_mesh
from poseloom.skeleton.mannequin import mannequin_mesh
from poseloom.skeleton.skeleton import Skeleton
from poseloom.viewer.colours import LEVELS, Colour, doubt_levels, doubtful

_Node = viser.MeshHandle | viser.FrameHandle


@dataclass(frozen=True)
class FigureLook:
    """How a figure is drawn.

    Attributes:
        colour: Of its skin.
        opacity: From 0 to 1.
    """

    colour: Colour
    opacity: float = 1.0


class Figure:
    """A body that takes poses. All calls from one thread.

    Args:
        scene: Where it stands.
        path: The scene node under which it is hung, such as "/world/estimate".
        skeleton: Its bones: the body's get limbs, those of any other skeleton capsules.
        look: Colour and opacity.
    """

    def __init__(self, scene: viser.SceneApi, path: str, skeleton: Skeleton, look: FigureLook) -> None:
        self.skeleton = skeleton
        self._look = look
        self._place = scene.add_frame(path, show_axes=False)
        self._nodes = _add_bones(scene, path, skeleton, look)
        self._levels = [0] * len(skeleton)

    def pose(self, q: Floats[Array, "dofs"], offsets: Floats[Array, "joints 3"] | None = None) -> None:
        """Shows a pose vector; `offsets` are the joints' places in their parents where they are not the skeleton's."""
        quats_wxyz = quat_from_rotvec(q[3:].reshape(-1, 3))
        self._nodes[0].position = q[:3]
        for node, quat in zip(self._nodes, quats_wxyz, strict=True):
            node.wxyz = quat
        if offsets is not None:
            for node, offset in zip(self._nodes[1:], offsets[1:], strict=True):
                node.position = offset

    def doubt(self, spread: Floats[Array, "dofs"] | None) -> None:
        """Colours each bone by its own spread (standard deviations of the pose vector; None for none)."""
        levels = [0] * len(self.skeleton)
        if spread is not None:
            levels = doubt_levels(np.degrees(np.sqrt((spread[3:].reshape(-1, 3) ** 2).mean(axis=1))))
        for joint, (level, shown) in enumerate(zip(levels, self._levels, strict=True)):
            # Colours change in steps, and not back and forth at the border of two.
            if abs(level - shown) > 1 or (level != shown and level in (0, LEVELS)):
                self._paint(joint, level)

    def place(self, offset: Floats[Array, "3"]) -> None:
        """Shifts the whole figure, to stand beside another."""
        self._place.position = offset

    def show(self, visible: bool) -> None:
        """Shows or hides it."""
        self._place.visible = visible

    def remove(self) -> None:
        """Takes it out of the scene for good."""
        self._place.remove()

    def _paint(self, joint: int, level: int) -> None:
        node = self._nodes[joint]
        self._levels[joint] = level
        if isinstance(node, viser.MeshHandle):
            node.color = doubtful(self._look.colour, level)


def _add_bones(scene: viser.SceneApi, path: str, skeleton: Skeleton, look: FigureLook) -> list[_Node]:
    is_body = skeleton.names == BODY_BONES
    mesh = mannequin_mesh(skeleton) if is_body else figure_mesh(skeleton)
    rest = skeleton.rest_positions()
    paths: list[str] = []
    nodes: list[_Node] = []
    for joint, parent in enumerate(skeleton.parents):
        # Short names: every message of every frame carries its node's whole path.
        paths.append(f"{path if parent < 0 else paths[parent]}/{joint}")
        nodes.append(_add_bone(scene, paths[joint], mesh, joint, rest[joint], skeleton.offsets[joint], look))
    return nodes


def _add_bone(
    scene: viser.SceneApi,
    path: str,
    mesh: Mesh,
    joint: int,
    rest: Floats[Array, "3"],
    offset: Floats[Array, "3"],
    look: FigureLook,
) -> _Node:
    own = mesh.joints == joint
    if not own.any():
        return scene.add_frame(path, show_axes=False, position=offset)
    renumbered = np.cumsum(own) - 1
    triangles = mesh.triangles[own[mesh.triangles[:, 0]]]
    return scene.add_mesh_simple(
        path,
        mesh.vertices[own] - rest,
        renumbered[triangles],
        color=look.colour,
        opacity=None if look.opacity >= 1.0 else look.opacity,
        cast_shadow=look.opacity >= 1.0,
        receive_shadow=look.opacity >= 1.0,
        position=offset,
    )
