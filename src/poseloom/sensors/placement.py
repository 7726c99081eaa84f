"""Where on its bone a sensor sits, and how it is turned there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import SensorError
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.skeleton.body import MIRROR, average_body
from poseloom.skeleton.kinematics import BoneFrames
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Placement:
    """A sensor on a bone. Make one with `make_placement`, which checks.

    Attributes:
        bone: Name of the bone.
        R_bone_sensor: Turns the sensor's axes into the bone's: `R_world_bone @ R_bone_sensor = R_world_sensor`.
        p_bone_sensor: Place of the sensor's origin in the bone's frame, metres.
    """

    bone: str
    R_bone_sensor: Floats[Array, "3 3"]
    p_bone_sensor: Floats[Array, "3"]


def make_placement(
    bone: str, p_bone_sensor: ArrayLike | None = None, R_bone_sensor: ArrayLike | None = None
) -> Placement:
    """Checks and freezes a placement; left out, the sensor sits at the bone's joint and its axes are the bone's.

    Raises:
        SensorError: for a place that is not three finite numbers, or a matrix that is not a rotation.
    """
    place = frozen_float(np.zeros(3) if p_bone_sensor is None else p_bone_sensor)
    turn = frozen_float(np.eye(3) if R_bone_sensor is None else R_bone_sensor)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise SensorError(
            f"the place of a sensor on bone {bone!r} is not three finite numbers", remedy="Give x, y and z in metres"
        )
    proper = turn.shape == (3, 3) and bool(np.isfinite(turn).all())
    if not proper or np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0:
        raise SensorError(
            f"the orientation of a sensor on bone {bone!r} is not a rotation",
            remedy="Give an orthonormal, right-handed 3 x 3 matrix",
        )
    return Placement(bone, turn, place)


class _Spot(NamedTuple):
    """A place on a left or middle bone: a share of the way to its end, and a shift in units of its length."""

    end: str  # joint that ends the bone; empty: its tip, or else its first child
    along: float
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


# Keyed by bone, the side left out. Shares of a length, so that the sensor stays on the skin of any body.
_SPOTS: Mapping[str, _Spot] = {
    "head": _Spot("", 0.6, (0.0, 0.0, 0.55)),  # above the eyes, as a head-mounted display
    "upperChest": _Spot("neck", 0.5, (0.0, 0.0, 0.9)),  # on the breastbone
    "hips": _Spot("chest", 0.0, (0.0, 0.0, -1.0)),  # on the sacrum
    "LowerLeg": _Spot("Foot", 0.9, (0.1, 0.0, 0.0)),  # ankle strap, outside
    "Foot": _Spot("Toes", 0.5, (0.0, 0.4, 0.0)),  # on the instep
}
_MIDDLE = _Spot("", 0.5)
_AT_JOINT = _Spot("", 0.0)


def default_placements(layout: SensorLayout, skeleton: Skeleton) -> tuple[Placement, ...]:
    """Sane places of a layout's sensors on a body, scaled with its bones, the sensors' axes along the bones'.

    Head: on the forehead. Chest: on the breastbone. Hands: in the middle of the hand. Shanks: outside, 90 % of the way
    to the ankle. Feet: on the instep. Hips: on the sacrum. Flex sensors: at the joint. Other bones: half way along.

    Raises:
        SensorError: if the skeleton has not a bone of the layout.
    """
    return tuple(make_placement(sensor.bone, _place(skeleton, sensor.bone, sensor.kind)) for sensor in layout.sensors)


def _place(skeleton: Skeleton, bone: str, kind: SensorKind) -> Floats[Array, "3"]:
    if bone not in skeleton.names:
        raise SensorError(
            f"the skeleton has no bone {bone!r} to wear a sensor",
            remedy=f"Choose a layout on its bones: {', '.join(skeleton.names)}",
        )
    side = next((side for side in ("left", "right") if bone.startswith(side)), "")
    spot = _AT_JOINT if kind is SensorKind.FLEX else _SPOTS.get(bone.removeprefix(side), _MIDDLE)
    bone_vector = _bone_vector(skeleton, bone, side + spot.end if spot.end else "")
    shift = np.array(spot.shift) * (MIRROR if side == "right" else 1.0)
    return np.asarray(spot.along * bone_vector + np.linalg.norm(bone_vector) * shift)


def _bone_vector(skeleton: Skeleton, bone: str, end: str) -> Floats[Array, "3"]:
    """From the bone's joint to its end at rest; the average body's where the skeleton does not say."""
    joint = skeleton.index(bone)
    if end and end in skeleton.names:
        places = skeleton.rest_positions()
        return np.asarray(places[skeleton.index(end)] - places[joint])
    if np.isfinite(skeleton.tips[joint]).all():
        return skeleton.tips[joint]
    children = skeleton.children(joint)
    if children:
        return skeleton.offsets[children[0]]
    body = average_body()
    return _bone_vector(body, bone, end) if skeleton is not body and bone in body.names else np.zeros(3)


def place_sensors(frames: BoneFrames, skeleton: Skeleton, placements: Sequence[Placement]) -> BoneFrames:
    """World frames of sensors on moving bones.

    Args:
        frames: World frames of the skeleton's joints, any batch shape.
        skeleton: The bones.
        placements: One a sensor.

    Returns:
        positions (..., sensors, 3) in metres and rotations (..., sensors, 3, 3), `R_world_sensor`.

    Raises:
        SkeletonError: if a placement names an unknown bone.
    """
    bones = [skeleton.index(placement.bone) for placement in placements]
    local = np.stack([placement.p_bone_sensor for placement in placements])
    turn = np.stack([placement.R_bone_sensor for placement in placements])
    rotations = frames.rotations[..., bones, :, :]
    positions = frames.positions[..., bones, :] + np.einsum("...sij,sj->...si", rotations, local)
    return BoneFrames(positions, rotations @ turn)
