"""How large a source's body is and which way it stands: what its file does not say, told from limbs and poses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import RetargetError
from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix, unwrap_rotvec
from poseloom.skeleton._family import Family, plain_name
from poseloom.skeleton._rest_from_motion import sampled, unit
from poseloom.skeleton._rest_pose import choose_rest, is_bodily, rest_positions
from poseloom.skeleton.families import recognise
from poseloom.skeleton.kinematics import BoneFrames, motion_frames
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.skeleton import Skeleton

SHORTEST, TALLEST = 0.5, 2.5
"""Statures of humans in metres, with room for infants and for giants."""

AXES = ("x", "y", "z", "-x", "-y", "-z")
"""The axes of a file that may point up."""

_ADULT = 1.7
_STATURE_OF_LEG, _STATURE_OF_ARM, _STATURE_OF_REACH = 2.05, 3.56, 1.62
"""Stature as a multiple of thigh plus shank, of upper arm plus forearm, and of the longest way along the bones from the
pelvis: 1.7 m for the average body."""


@dataclass(frozen=True)
class _Unit:
    """A unit of length, and the statures for which it is taken: infants and toys are likelier in metric units."""

    name: str
    metres: float
    shortest: float
    tallest: float


_UNITS = (
    _Unit("metres", 1.0, SHORTEST, TALLEST),
    _Unit("centimetres", 0.01, SHORTEST, TALLEST),
    _Unit("millimetres", 0.001, SHORTEST, TALLEST),
    _Unit("feet", 0.3048, 1.2, 2.15),
    _Unit("inches", 0.0254, 1.2, 2.15),
    _Unit("CMU's 0.45 scaled inches", 0.0254 / 0.45, 1.2, 2.15),
)
_FRAMES = 300
_UPRIGHT = np.cos(np.radians(45.0))
_MOSTLY = 0.8
"""Share of the frames in which a body must stand along an axis for that to be its up, against the zero pose."""


def stature(skeleton: Skeleton) -> float | None:
    """About how tall a body is, from its limbs' lengths, in the skeleton's unit; None where it has no length.

    Neither the root's offset nor the rest pose matters. Where joint names are of no known family, the longest way along
    the bones from the first fork is taken.
    """
    known = _known(skeleton)
    found = _stature_of_reach(skeleton) if known is None else _stature_of_limbs(skeleton, *known)
    return found if found > 0 else None


def guess_metres_per_unit(skeleton: Skeleton) -> float | None:
    """The unit of length in which a body comes nearest to an adult, of those in use; None if it is human in none."""
    tall = stature(skeleton)
    if tall is None:
        return None
    fitting = [unit for unit in _UNITS if unit.shortest <= tall * unit.metres <= unit.tallest]
    best = min(fitting, key=lambda unit: abs(np.log(tall * unit.metres / _ADULT)), default=None)
    return None if best is None else best.metres


def unit_name(metres: float) -> str:
    """What a person calls a unit of length."""
    return next((unit.name for unit in _UNITS if np.isclose(unit.metres, metres, rtol=1e-9)), f"units of {metres:g} m")


def scaled(motion: Motion, factor: float) -> Motion:
    """A motion with all lengths multiplied."""
    if factor == 1.0:
        return motion
    q = motion.q.copy()
    q[:, :3] *= factor
    moved = motion.displacements
    skeleton = motion.skeleton.with_offsets(motion.skeleton.offsets * factor, motion.skeleton.tips * factor)
    return replace(
        motion,
        skeleton=skeleton,
        q=frozen_float(q),
        displacements=None if moved is None else frozen_float(moved * factor),
    )


def guess_up(motion: Motion) -> tuple[str, bool]:
    """The axis that points up, and whether the zero pose stands along it too.

    Most frames of most motions are upright. Where they are not (crawling, lying), the zero pose decides. A motion that
    stands along another axis than its zero pose is taken at its word only if it does so nearly all the time, with its
    feet at that axis' zero: else somebody may be lying there.
    """
    known = _known(motion.skeleton)
    if known is None:
        return "y", True
    frames = sampled(motion_frames(motion), _FRAMES)
    standing = {axis: _share(frames, *known, _direction(axis)) for axis in AXES}
    most = max(AXES, key=lambda axis: (standing[axis], axis == "y"))
    rest = _rest_up(motion.skeleton, *known)
    if standing["y"] >= 0.5 or standing[most] < 0.5:
        up = "y" if standing["y"] >= 0.5 or rest is None else rest
    elif rest == most or (standing[most] > _MOSTLY and _on_the_ground(frames, *known, _direction(most))):
        up = most
    else:
        up = "y" if rest is None else rest
    return up, rest is None or rest == up


def turned_upright(motion: Motion, up: str, whole: bool) -> Motion:
    """A motion with one of its axes turned to +Y.

    Args:
        motion: The motion.
        up: The axis.
        whole: Turn the zero pose too; else only the movement.
    """
    if up == "y":
        return motion
    turn = _to_y(up)
    q = motion.q.copy()
    q[:, :3] = q[:, :3] @ turn.T
    moved, skeleton = motion.displacements, motion.skeleton
    if whole:
        rotvecs = q[:, 3:].reshape(len(q), -1, 3) @ turn.T
        q[:, 3:] = rotvecs.reshape(len(q), -1)
        skeleton = skeleton.with_offsets(skeleton.offsets @ turn.T, skeleton.tips @ turn.T)
        moved = None if moved is None else frozen_float(moved @ turn.T)
    else:
        q[:, 3:6] = unwrap_rotvec(rotvec_from_matrix(turn @ matrix_from_rotvec(q[:, 3:6])))
    return replace(motion, skeleton=skeleton, q=frozen_float(q), displacements=moved)


def _known(skeleton: Skeleton) -> tuple[Family, Mapping[str, int]] | None:
    try:
        family = recognise(skeleton)
    except RetargetError:
        return None
    return family, {plain_name(name): joint for joint, name in reversed(list(enumerate(skeleton.names)))}


def _stature_of_limbs(skeleton: Skeleton, family: Family, index: Mapping[str, int]) -> float:
    found: list[float] = []
    for share, bones in ((_STATURE_OF_LEG, ("UpperLeg", "Foot")), (_STATURE_OF_ARM, ("UpperArm", "Hand"))):
        for side in ("left", "right"):
            first, last = (index.get(family.start(f"{side}{bone}")) for bone in bones)
            if first is not None and last is not None:
                found.append(share * _length(skeleton, first, last))
    return float(np.exp(np.mean(np.log(np.maximum(found, 1e-12))))) if found and max(found) > 0 else 0.0


def _length(skeleton: Skeleton, first: int, last: int) -> float:
    """The way along the bones from a joint to one below it."""
    total = 0.0
    while last != first and last > 0:
        total += float(np.linalg.norm(skeleton.offsets[last]))
        last = int(skeleton.parents[last])
    return total


def _stature_of_reach(skeleton: Skeleton) -> float:
    reach = np.zeros(len(skeleton))
    forked = np.zeros(len(skeleton), dtype=np.bool_)
    for joint in range(1, len(skeleton)):
        parent = int(skeleton.parents[joint])
        forked[joint] = forked[parent] or len(skeleton.children(parent)) > 1
        reach[joint] = reach[parent] + (np.linalg.norm(skeleton.offsets[joint]) if forked[joint] else 0.0)
    if not forked.any():
        reach = np.cumsum(np.linalg.norm(skeleton.offsets, axis=1))
    return _STATURE_OF_REACH * float(reach.max())


def _rest_up(skeleton: Skeleton, family: Family, index: Mapping[str, int]) -> str | None:
    """The axis along which the zero pose stands; None if no body could take it."""
    pose = choose_rest(skeleton, family, index, None).rotations
    if not is_bodily(skeleton, family, index, pose):
        return None
    places = rest_positions(skeleton, pose)
    way = unit(_mean(places, family, index, "UpperArm") - _mean(places, family, index, "UpperLeg"))
    best = max(AXES, key=lambda axis: float(way @ _direction(axis)))
    return best if way @ _direction(best) > _UPRIGHT else None


def _mean(
    places: Floats[Array, "*batch joints 3"], family: Family, index: Mapping[str, int], bone: str
) -> Floats[Array, "*batch 3"]:
    both: Sequence[int] = [index[family.start(f"{side}{bone}")] for side in ("left", "right")]
    return places[..., both, :].mean(axis=-2)


def _share(frames: BoneFrames, family: Family, index: Mapping[str, int], up: Floats[Array, "3"]) -> float:
    """Share of the frames in which trunk and legs stand along an axis."""
    ways = _mean(frames.positions, family, index, "UpperArm") - _mean(frames.positions, family, index, "Foot")
    return float((unit(ways) @ up > _UPRIGHT).mean())


def _on_the_ground(frames: BoneFrames, family: Family, index: Mapping[str, int], up: Floats[Array, "3"]) -> bool:
    """Whether feet are near an axis' zero, as those of somebody are who stands along it."""
    heights = _mean(frames.positions, family, index, "Foot") @ up
    tall = float(np.linalg.norm(
        _mean(frames.positions, family, index, "UpperArm") - _mean(frames.positions, family, index, "Foot"), axis=1
    ).max())  # fmt: skip
    return bool(np.median(np.abs(heights)) < 0.3 * tall)


def _direction(axis: str) -> Floats[Array, "3"]:
    return (-1.0 if axis[0] == "-" else 1.0) * np.eye(3)["xyz".index(axis[-1])]


def _to_y(axis: str) -> Floats[Array, "3 3"]:
    """The turn that lays an axis on +Y: by a quarter about a horizontal axis, or by half of one for -y."""
    sign = -1.0 if axis[0] == "-" else 1.0
    about = {"z": (-sign, 0.0, 0.0), "x": (0.0, 0.0, sign), "y": (1.0 - sign, 0.0, 0.0)}[axis[-1]]
    return np.round(matrix_from_rotvec(np.array(about) * np.pi / 2))
