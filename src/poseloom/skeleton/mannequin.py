"""The visible body of the figures: smooth limbs of elliptic cross-section, each fixed to one bone.

Drawn by the HTML report's own renderer, by the still pictures and by the viewer, so that a body looks the same in all.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.skeleton.body import BODY_BONES, MIRROR, average_body
from poseloom.skeleton.figure_mesh import Mesh, capsule, joined
from poseloom.skeleton.skeleton import Skeleton

_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Limb:
    """A tube with round ends and an elliptic cross-section that may change along it, in its bone's frame, in metres.

    Attributes:
        bone: Index of the body's bone that carries it.
        start: Centre of the first end.
        end: Centre of the other end.
        side: Unit vector across the tube, along which the half width is measured; the half depth lies across both.
        radii: Half width and half depth at the start, then at the end.
    """

    bone: int
    start: Floats[Array, "3"]
    end: Floats[Array, "3"]
    side: Floats[Array, "3"]
    radii: Floats[Array, "4"]


def limbs(skeleton: Skeleton) -> tuple[Limb, ...]:
    """The limbs of a body with this skeleton's bone lengths; thickness goes with the length of the legs."""
    places = dict(zip(skeleton.names, skeleton.offsets, strict=True))
    tips = dict(zip(skeleton.names, skeleton.tips, strict=True))
    thickness = _leg(skeleton) / _leg(average_body())
    parts = _middle(places, thickness)
    for side, mirror in (("left", np.ones(3)), ("right", MIRROR)):
        parts += _arm(side, mirror, places, tips, thickness) + _limbs_of_leg(side, mirror, places, tips, thickness)
    return tuple(parts)


@cache
def limb_bones() -> tuple[int, ...]:
    """For each limb of any body the index of its bone."""
    return tuple(limb.bone for limb in limbs(average_body()))


def mannequin_mesh(skeleton: Skeleton) -> Mesh:
    """The limbs' surface as triangles around the body in its rest pose."""
    rest = skeleton.rest_positions()
    parts: list[tuple[int, Floats[Array, "vertices 3"], Ints[Array, "triangles 3"]]] = []
    for limb in limbs(skeleton):
        wide, deep, end_wide, end_deep = (float(radius) for radius in limb.radii)
        vertices, triangles = capsule(limb.start, limb.end, (wide, deep, end_wide, end_deep), limb.side, fineness=2)
        parts.append((limb.bone, vertices + rest[limb.bone], triangles))
    return joined(parts)


def _leg(skeleton: Skeleton) -> float:
    return float(sum(np.linalg.norm(skeleton.offsets[skeleton.index(f"left{bone}")]) for bone in ("LowerLeg", "Foot")))


def _limb(
    bone: str,
    start: Floats[Array, "3"],
    end: Floats[Array, "3"],
    radii: tuple[float, float, float, float],
    side: tuple[float, float, float] = _X,
) -> Limb:
    axis = (end - start) / np.linalg.norm(end - start)
    across = np.array(side) - axis * float(axis @ np.array(side))
    return Limb(BODY_BONES.index(bone), start, end, across / np.linalg.norm(across), np.array(radii))


def _middle(places: dict[str, Floats[Array, "3"]], k: float) -> list[Limb]:
    hip = 0.5 * (places["leftUpperLeg"] + places["rightUpperLeg"])
    wide = float(abs(places["leftUpperLeg"][0])) + 0.045 * k
    chest, upper, neck = places["chest"], places["upperChest"], places["neck"]
    belly = np.array([0.0, 0.0, 0.014 * k])
    head = np.array([0.0, k, k])
    return [
        _limb("hips", 0.7 * hip, 0.2 * hip + 0.3 * chest, (wide, 0.098 * k, 0.122 * k, 0.090 * k)),
        _limb("spine", 0.1 * chest + belly, chest + belly, (0.120 * k, 0.086 * k, 0.119 * k, 0.086 * k)),
        _limb("chest", belly, 0.6 * upper + belly, (0.119 * k, 0.086 * k, 0.124 * k, 0.090 * k)),
        _limb("upperChest", 0.4 * belly - 0.5 * upper, 0.80 * neck, (0.130 * k, 0.101 * k, 0.146 * k, 0.084 * k)),
        _limb("neck", -0.1 * places["head"], places["head"], (0.054 * k, 0.058 * k, 0.047 * k, 0.051 * k)),
        _limb(
            "head", head * (0.0, 0.062, 0.024), head * (0.0, 0.115, 0.006), (0.054 * k, 0.072 * k, 0.075 * k, 0.092 * k)
        ),
        _limb(
            "head", head * (0.0, 0.070, 0.094), head * (0.0, 0.096, 0.090), (0.012 * k, 0.014 * k, 0.007 * k, 0.008 * k)
        ),
    ]


def _arm(
    side: str,
    mirror: Floats[Array, "3"],
    places: dict[str, Floats[Array, "3"]],
    tips: dict[str, Floats[Array, "3"]],
    k: float,
) -> list[Limb]:
    elbow, wrist = places[f"{side}LowerArm"], places[f"{side}Hand"]
    fingers = tips[f"{side}Hand"]
    if not np.isfinite(fingers).all():
        fingers = 0.85 * wrist
    shoulder = places[f"{side}UpperArm"]
    thumb = [np.array([0.025, -0.004, 0.022]), np.array([0.085, -0.012, 0.050])]
    return [
        _limb(f"{side}Shoulder", 0.15 * shoulder, shoulder, (0.058 * k, 0.050 * k, 0.056 * k, 0.054 * k), _Z),
        _limb(f"{side}UpperArm", np.zeros(3), elbow, (0.054 * k, 0.052 * k, 0.041 * k, 0.040 * k), _Z),
        _limb(f"{side}LowerArm", np.zeros(3), wrist, (0.043 * k, 0.041 * k, 0.029 * k, 0.025 * k), _Z),
        _limb(f"{side}Hand", 0.1 * fingers, 0.55 * fingers, (0.032 * k, 0.019 * k, 0.042 * k, 0.015 * k), _Z),
        _limb(f"{side}Hand", 0.55 * fingers, 0.95 * fingers, (0.040 * k, 0.014 * k, 0.028 * k, 0.009 * k), _Z),
        _limb(
            f"{side}Hand",
            k * mirror * thumb[0],
            k * mirror * thumb[1],
            (0.014 * k, 0.014 * k, 0.010 * k, 0.010 * k),
            _Z,
        ),
    ]


def _limbs_of_leg(
    side: str,
    mirror: Floats[Array, "3"],
    places: dict[str, Floats[Array, "3"]],
    tips: dict[str, Floats[Array, "3"]],
    k: float,
) -> list[Limb]:
    knee, ankle, ball = places[f"{side}LowerLeg"], places[f"{side}Foot"], places[f"{side}Toes"]
    tip = tips[f"{side}Toes"]
    if not np.isfinite(tip).all():
        tip = np.array([0.0, 0.0, 0.06 * k])
    calf = 0.28 * ankle + np.array([0.0, 0.0, -0.010 * k])
    heel = np.array([0.0, -0.044 * k, -0.040 * k])
    return [
        _limb(f"{side}UpperLeg", np.zeros(3), knee, (0.080 * k, 0.086 * k, 0.053 * k, 0.056 * k)),
        _limb(f"{side}LowerLeg", np.zeros(3), calf, (0.052 * k, 0.055 * k, 0.054 * k, 0.058 * k)),
        _limb(f"{side}LowerLeg", calf, ankle, (0.054 * k, 0.058 * k, 0.033 * k, 0.037 * k)),
        _limb(f"{side}Foot", heel, ball, (0.033 * k, 0.028 * k, 0.046 * k, 0.024 * k)),
        _limb(f"{side}Foot", np.zeros(3), 0.85 * ball, (0.034 * k, 0.034 * k, 0.036 * k, 0.022 * k)),
        _limb(f"{side}Toes", np.zeros(3), tip, (0.046 * k, 0.023 * k, 0.036 * k, 0.017 * k)),
    ]
