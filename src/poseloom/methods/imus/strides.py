"""What is missing of the root's way and heading, by the sensor of a foot.

The examples' legs give the root its way (`ground`), and they swing as far as the examples' did. A sensor on a foot
hears how far that foot really went from one stance to the next, and how far it turned (`odometer`). Where the two
differ the body is moved along its own direction, and turned about world up.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.methods.imus.odometer import FootTrack, flown, start_track, stood
from poseloom.methods.imus.pairs import CHANNELS
from poseloom.sensors import Placement
from poseloom.skeleton.contacts import sole_points
from poseloom.skeleton.skeleton import Skeleton
from poseloom.synthesis.imus import GRAVITY

_FEET = ("leftFoot", "rightFoot")

_STANDS = 0.5
"""Probability of contact from which on a sole may stand."""

_STILL_RATE = 1.5
"""Radians a second below which a foot may stand."""

_STILL_FORCE = 2.0
"""The same of the difference of the specific force from gravity, m/s^2."""

_SLIP = (0.02, 0.05)
"""Velocity of a standing contact: m/s, and metres a radian of turning, for it is no point."""

_MEMORY_SECONDS = 4.0
"""Time constant with which what was gone is forgotten: as far back the two ways are compared."""

_LEAST = 0.2
"""Metres gone from which on a direction means something."""

_MOST_RATIO = 2.0


@dataclass(frozen=True, eq=False)
class FootSensor:
    """A sensor that sits on a foot.

    Attributes:
        sensor: Its place in the layout.
        side: 0 for the left foot, 1 for the right.
        arms: From the undersides of heel and toes to the sensor, in the sensor's axes, metres; toes not bent.
        ahead: Where the foot points, in the sensor's axes.
    """

    sensor: int
    side: int
    arms: Floats[Array, "2 3"]
    ahead: Floats[Array, "3"]


class Stride(NamedTuple):
    """What one foot's sensor says of the way.

    Attributes:
        track: Of the sensor; None before it was heard, and after a silence.
        sensed: Metres (x, z) gone by the track, older ones forgotten; in the track's own heading.
        shown: The same of the figure's sole.
        missing: Metres (x, z) by which the figure is still to be moved.
        facing: Radians from the track's heading to the figure's, as the first stance showed it; None before.
        missing_turn: Radians by which the figure is still to be turned about world up.
        stands: Whether the foot was heard to stand at the last sample.
    """

    track: FootTrack | None
    sensed: Floats[Array, "2"]
    shown: Floats[Array, "2"]
    missing: Floats[Array, "2"]
    facing: float | None
    missing_turn: float
    stands: bool


def foot_sensors(skeleton: Skeleton, placements: Sequence[Placement]) -> tuple[FootSensor, ...]:
    """Those of the sensors that sit on feet."""
    found: list[FootSensor] = []
    for index, placement in enumerate(placements):
        if placement.bone not in _FEET:
            continue
        side = _FEET.index(placement.bone)
        points = sole_points(skeleton, ("left", "right")[side])
        toes = skeleton.offsets[skeleton.index(("leftToes", "rightToes")[side])]
        arms = (placement.p_bone_sensor - np.stack([points.heel, toes + points.toe])) @ placement.R_bone_sensor
        found.append(FootSensor(index, side, arms, placement.R_bone_sensor[2]))
    return tuple(found)


def missing_way(strides: Sequence[Stride]) -> Floats[Array, "2"]:
    """Metres (x, z) by which the figure is to be moved, as the feet say on average."""
    return np.mean([stride.missing for stride in strides], axis=0) if strides else np.zeros(2)


def missing_turn(strides: Sequence[Stride]) -> float:
    """Radians by which the figure is to be turned, as the feet say on average."""
    return sum(stride.missing_turn for stride in strides) / len(strides) if strides else 0.0


def no_stride() -> Stride:
    """Nothing is known."""
    zero = np.zeros(2)
    return Stride(None, zero, zero, zero, None, 0.0, False)


def sensed(
    stride: Stride,
    foot: FootSensor,
    said: Floats[Array, "channels"],
    heard: Bools[Array, "sensors"],
    standing: Floats[Array, "4"],
    ups: Floats[Array, "sensors 3"],
    seconds: float,
) -> Stride:
    """Takes a sample of the foot's sensor into account.

    Args:
        stride: Before.
        foot: Whose.
        said: Of all sensors, as they are mounted.
        heard: Which sensors spoke.
        standing: Probability of contact of left heel, left toes, right heel, right toes.
        ups: Roughly world up in the frame of each sensor.
        seconds: Since the last sample.
    """
    if not heard[foot.sensor]:
        return no_stride()
    force, rate = said[CHANNELS * foot.sensor : CHANNELS * (foot.sensor + 1)].reshape(2, 3)
    if stride.track is None:
        return no_stride()._replace(track=start_track(ups[foot.sensor], force, rate))
    track = flown(stride.track, force, rate, seconds)
    soles = standing[2 * foot.side : 2 * foot.side + 2]
    turning = float(np.linalg.norm(rate))
    pushed = abs(float(np.linalg.norm(force)) - GRAVITY)
    stands = bool(soles.max() > _STANDS and turning < _STILL_RATE and pushed < _STILL_FORCE)
    if stands:
        track = stood(track, soles @ foot.arms / soles.sum(), _SLIP[0] + _SLIP[1] * turning)
    gone = (track.place - stride.track.place)[[0, 2]] if stride.track.stood else np.zeros(2)
    kept = np.exp(-seconds / _MEMORY_SECONDS)
    return stride._replace(track=track, sensed=kept * stride.sensed + gone, stands=stands)


def shown(
    stride: Stride, foot: FootSensor, moved: Floats[Array, "2"], heading: float, paid: float, seconds: float
) -> Stride:
    """Takes the figure's own movement into account.

    Args:
        stride: Before.
        foot: Whose.
        moved: Metres (x, z) that the sole of the figure's foot went in this frame.
        heading: Of the figure's foot.
        paid: Share of what was missing that has been made up for in it.
        seconds: Of a frame.
    """
    if stride.track is None or not stride.track.stood:
        return stride
    way = np.exp(-seconds / _MEMORY_SECONDS) * stride.shown + moved
    missing = (1 - paid) * stride.missing
    length = float(np.linalg.norm(way))
    if stride.stands and length > _LEAST:
        ratio = float(np.linalg.norm(stride.sensed)) / length
        missing = (np.clip(ratio, 1 / _MOST_RATIO, _MOST_RATIO) - 1) * way
    facing, missing_turn = stride.facing, (1 - paid) * stride.missing_turn
    if stride.stands:
        ahead = stride.track.turn @ foot.ahead
        apart = heading - math.atan2(ahead[0], ahead[2])
        facing = apart if facing is None else facing
        missing_turn = math.remainder(facing - apart, math.tau)
    return stride._replace(shown=way, missing=missing, facing=facing, missing_turn=missing_turn)
