"""Source skeletons of every naming family, built from the body, for tests of retargeting."""

from collections.abc import Mapping

import numpy as np

from poseloom.skeleton import BODY_BONES, Skeleton, average_body, forward_kinematics, make_skeleton
from poseloom.skeleton._family import Family

_AXES = {"X": np.array([1.0, 0, 0]), "Y": np.array([0, 1.0, 0]), "Z": np.array([0, 0, 1.0])}
BRIDGED = {"Chest4": ("Chest3", "Chest2")}
"""Joints between two that are mapped: of the first, the one before it and that one's parent."""


def axes_matrix(axes: str) -> np.ndarray:
    """The rotation whose x, y and z axes point as in "+Y -X +Z"."""
    return np.stack([(1 if axis[0] == "+" else -1) * _AXES[axis[1]] for axis in axes.split()], axis=1)


def source_skeleton(
    family: Family, pose: Mapping[str, tuple[float, float, float]] | None = None, prefix: str = ""
) -> Skeleton:
    """A skeleton with the family's joint names that rests as the average body does in a pose.

    Args:
        family: Names, and the axes of its joints in the T-pose.
        pose: Rotation vectors of body bones in which the source rests; the T-pose if none.
        prefix: Put before every name.
    """
    body = average_body()
    q = np.zeros(body.size)
    for bone, turn in (pose or {}).items():
        at = 3 + 3 * body.index(bone)
        q[at : at + 3] = turn
    frames = forward_kinematics(body, q)
    starts = {family.start(bone) for bone in family.bones}
    places: dict[str, np.ndarray] = {}
    parents: dict[str, str] = {}
    tips: dict[str, np.ndarray] = {}
    for i, bone in enumerate(BODY_BONES):
        if bone not in family.bones:
            continue
        start, turn = family.start(bone), family.turn(bone)
        above = BODY_BONES[body.parents[i]] if i else ""
        while above and above not in family.bones:
            above = BODY_BONES[body.parents[body.index(above)]]
        parent = "" if not above else family.start(above) if family.turn(above) == start else family.turn(above)
        if start in BRIDGED:
            between, parent = BRIDGED[start]
            places[between], parents[between] = 0.5 * (places[parent] + frames.positions[i]), parent
            parent = between
        places[start], parents[start] = frames.positions[i], parent
        end = frames.positions[i] + frames.rotations[i] @ np.nan_to_num(body.tips[i])
        if turn not in starts:
            places[turn], parents[turn] = 0.5 * (places[start] + end), start
        if np.isfinite(body.tips[i]).all():
            tips[turn] = end
    names = list(places)
    rotations = {name: axes_matrix(family.frames.get(name, "+X +Y +Z")) for name in names}
    offsets = [
        rotations[parents[name]].T @ (places[name] - places[parents[name]]) if parents[name] else np.zeros(3)
        for name in names
    ]
    return make_skeleton(
        [prefix + name for name in names],
        [names.index(parents[name]) if parents[name] else -1 for name in names],
        np.array(offsets),
        {prefix + name: rotations[name].T @ (tip - places[name]) for name, tip in tips.items()},
    )


def facing(angle: float) -> dict[str, tuple[float, float, float]]:
    """A pose that differs from the T-pose by a turn about the vertical."""
    return {"hips": (0.0, angle, 0.0)}


def hanging_arms() -> dict[str, tuple[float, float, float]]:
    """A pose with arms straight down."""
    return {"leftUpperArm": (0.0, 0.0, -np.pi / 2), "rightUpperArm": (0.0, 0.0, np.pi / 2)}
