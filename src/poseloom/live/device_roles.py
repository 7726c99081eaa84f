"""Which of the devices that a headset's program tells of is worn where."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, cast

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.live.vmc import Device, DeviceKind
from poseloom.rotations import heading_angle, heading_matrix
from poseloom.sensors import SensorLayout

_HEIGHTS: Mapping[str, float] = {
    "head": 1.0,
    "upperChest": 0.75,
    "hips": 0.57,
    "LowerLeg": 0.08,
    "Foot": 0.04,
    "Hand": 0.5,
    "LowerArm": 0.6,
    "UpperLeg": 0.4,
}
"""Height of a sensor on a standing person's bone, sides left out, as a share of the headset's."""


_TOO_FAR = 0.35
"""Share of the headset's height by which a tracker may be off."""
_SIDE_COST = 0.05


def guess_roles(
    devices: Sequence[Device], layout: SensorLayout, known: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Sensor names by serial number, for a person who stands upright and looks ahead.

    A headset is the head; of the controllers the one that is farther left, seen along the headset's heading, is the
    left hand, and a single one is held on the headset's side on which it is; trackers go to the layout's other bones by
    their height, and left from right by their place. What cannot be told is left out.

    Args:
        devices: One of each serial number.
        layout: The sensors.
        known: Sensor names by serial number that are settled: these devices say where the wearer stands, and their
            sensors are not given again.

    Returns:
        What is new.
    """
    known = known or {}
    roles: dict[str, str] = {}
    headset = next((device for device in devices if device.kind is DeviceKind.HEADSET), None)
    free = [sensor for sensor in layout.sensors if sensor.name not in known.values()]
    fresh = [device for device in devices if device.serial not in known]
    if headset is not None and headset in fresh:
        head = next((sensor for sensor in free if sensor.bone == "head"), None)
        if head is not None:
            roles[headset.serial] = head.name
            free.remove(head)
    lefts = _leftness(devices, headset)
    for device, side in _sides_of_controllers(fresh, lefts, headset, [sensor.bone for sensor in free]):
        hand = next((sensor for sensor in free if sensor.bone == f"{side}Hand"), None)
        if hand is not None:
            roles[device.serial] = hand.name
            free.remove(hand)
    trackers = [device for device in fresh if device.kind is DeviceKind.TRACKER]
    return {**roles, **_trackers(trackers, [(s.name, s.bone) for s in free], lefts, _top(devices, headset))}


def _sides_of_controllers(
    fresh: Sequence[Device], lefts: Mapping[str, float], headset: Device | None, free: Sequence[str]
) -> list[tuple[Device, str]]:
    """Which controller is held in which hand."""
    hands = sorted((d for d in fresh if d.kind is DeviceKind.CONTROLLER), key=lambda d: -lefts[d.serial])
    if len(hands) > 1:
        return [(hands[0], "left"), (hands[-1], "right")]
    if not hands:
        return []
    sides = [side for side in ("left", "right") if f"{side}Hand" in free]
    if len(sides) == 1:
        return [(hands[0], sides[0])]
    if headset is None:
        return []
    return [(hands[0], "left" if lefts[hands[0].serial] > lefts[headset.serial] else "right")]


def _trackers(
    trackers: list[Device], free: list[tuple[str, str]], lefts: Mapping[str, float], top: float
) -> dict[str, str]:
    """The assignment with the least difference in height and side; what is far from everything is left out."""
    if not trackers or not free:
        return {}
    costs = np.array(
        [
            [abs(device.position[1] / max(top, 1e-6) - _height(bone)) + _on_wrong_side(lefts[device.serial], bone)
             for _, bone in free]
            for device in trackers
        ]
    )  # fmt: skip
    optimize = cast(Any, import_module("scipy.optimize"))  # takes a while to load, and few need it
    rows, columns = optimize.linear_sum_assignment(costs)
    return {
        trackers[int(row)].serial: free[int(column)][0]
        for row, column in zip(rows, columns, strict=True)
        if costs[row, column] < _TOO_FAR
    }


def _on_wrong_side(left: float, bone: str) -> float:
    """Small beside a difference in height, but enough to tell one ankle from the other."""
    side = 1.0 if bone.startswith("left") else -1.0 if bone.startswith("right") else 0.0
    return _SIDE_COST * float(np.clip(0.5 - side * left / 0.2, 0.0, 1.0)) if side else 0.0


def _height(bone: str) -> float:
    side = next((side for side in ("left", "right") if bone.startswith(side)), "")
    return _HEIGHTS.get(bone.removeprefix(side), 0.5)


def _top(devices: Sequence[Device], headset: Device | None) -> float:
    return max(device.position[1] for device in devices) if headset is None else headset.position[1]


def _leftness(devices: Sequence[Device], headset: Device | None) -> dict[str, float]:
    """How far to the wearer's left each device is, metres."""
    places: Floats[Array, "devices 3"] = np.array([device.position for device in devices], dtype=np.float64)
    facing = np.eye(3)
    if headset is not None:
        facing = heading_matrix(np.asarray(heading_angle(np.array(headset.quat_wxyz))))
    lefts = (places - places.mean(axis=0)) @ facing[:, 0]
    return {device.serial: float(left) for device, left in zip(devices, lefts, strict=True)}
