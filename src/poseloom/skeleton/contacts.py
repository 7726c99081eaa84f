"""When heels and toes stand on the floor, and where the floor is."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import SkeletonError
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.kinematics import bone_points, motion_frames
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.skeleton import Skeleton

_HEEL = np.array([0.0, -0.072, -0.045])
"""The underside of an average heel in the foot's frame, metres from the ankle. Measured on standing feet of CMU's
walks: the ankle is 7.5 cm above the floor, the toes' joint 3 cm and their tip 1.7 cm."""

_TOE_DROP = 0.023
"""Metres from the middle of an average body's toes down to their underside, measured in the same way."""

_LEVEL_PERCENTILE = 5.0
_LEVEL_BAND = 0.04
"""Metres above the lowest stances within which stances count as standing on the floor itself."""

_ELEVATED = 0.25
"""Metres above a file's own zero from which on the lowest stance is taken for a thing that stands on the floor."""

_SLOPE = 0.01
"""Standard deviation of a capture floor's slope."""

_UNEVEN = 0.015
"""Metres by which the soles of standing feet vary."""

_STANCE = 0.25
"""Seconds over which the height of a standing foot is one and the same observation."""

_MOMENT = 0.025
"""Seconds before and after a frame over which a speed is measured."""

_UPRIGHT = 0.6
"""Vertical share of a foot's up axis from which on its sole faces the floor: within 53 degrees."""

_SLOW = 0.3
"""Metres a second below which a sole's point can be standing."""


class SolePoints(NamedTuple):
    """The points of a foot that meet the floor.

    Attributes:
        heel: Underside of the heel in the foot's frame, metres.
        toe: Underside of the middle of the toes in the toes' frame, metres.
    """

    heel: Floats[Array, "3"]
    toe: Floats[Array, "3"]


@dataclass(frozen=True)
class ContactThresholds:
    """When a sole's point begins and ceases to stand: two values each, so that noise does not make it flicker.

    Attributes:
        height_on: Metres above the point's own standing level below which contact may begin.
        height_off: Metres above it from which on contact ends.
        speed_on: Metres a second below which contact may begin.
        speed_off: Metres a second from which on contact ends.
    """

    height_on: float = 0.025
    height_off: float = 0.04
    speed_on: float = 0.4
    speed_off: float = 0.7


@dataclass(frozen=True, eq=False)
class Contacts:
    """For each frame, whether a heel's or toes' underside stands on the floor."""

    left_heel: Bools[Array, "frames"]
    left_toe: Bools[Array, "frames"]
    right_heel: Bools[Array, "frames"]
    right_toe: Bools[Array, "frames"]

    @property
    def left(self) -> Bools[Array, "frames"]:
        """Whether any part of the left foot stands."""
        return self.left_heel | self.left_toe

    @property
    def right(self) -> Bools[Array, "frames"]:
        """Whether any part of the right foot stands."""
        return self.right_heel | self.right_toe


def sole_points(skeleton: Skeleton, side: str) -> SolePoints:
    """Heel and toe points of one foot ("left" or "right"), scaled with its length from ankle to toes.

    Raises:
        SkeletonError: if the skeleton lacks the body's foot and toes.
    """
    foot, toes = f"{side}Foot", f"{side}Toes"
    skeleton.index(foot)
    average = average_body()
    at = skeleton.index(toes)
    scale = np.linalg.norm(skeleton.offsets[at]) / np.linalg.norm(average.offsets[average.index(toes)])
    tip = skeleton.tips[at]
    if not np.isfinite(tip).all():
        tip = scale * average.tips[average.index(toes)]
    return SolePoints(scale * _HEEL, 0.5 * tip - scale * np.array([0.0, _TOE_DROP, 0.0]))


def sole_positions(motion: Motion) -> Floats[Array, "frames 4 3"]:
    """World places of left heel, left toe, right heel and right toe, metres.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    return _soles(motion).places


def contacts(motion: Motion, thresholds: ContactThresholds | None = None) -> Contacts:
    """Which heels and toes stand on the floor, frame by frame.

    A point's height counts from its own standing level in the clip (heels and toes each, both sides together), for
    people's feet differ from the average by centimetres, and from a floor that may tilt a little. Contact begins when
    the point is low and slow and the sole faces down, and ends when it is high or fast by the larger thresholds.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    limits = thresholds or ContactThresholds()
    soles = _soles(motion)
    heights = soles.places[..., 1] - _floor_plane(soles, motion.rate)
    for part in (slice(0, 4, 2), slice(1, 4, 2)):
        heights[:, part] -= _level(heights[:, part], soles.standing[:, part])
    on = (heights < limits.height_on) & (soles.speeds < limits.speed_on) & soles.upright
    off = (heights > limits.height_off) | (soles.speeds > limits.speed_off)
    return Contacts(*(_hysteresis(on[:, i], off[:, i]) for i in range(4)))


def floor_height(motion: Motion) -> float:
    """Height of the floor that the motion's feet stand on, metres above the world's zero.

    The median height of the lowest point of a sole that is slow and faces down, over the frames in which it is within
    4 cm of the clip's lowest stances: steps, boxes and ladders that are climbed do not count, nor do flights. Zero
    stays the floor where no foot ever stands and none goes far below zero, and where even the lowest stance is 25 cm or
    more above it: that is on a thing.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    soles = _soles(motion)
    floor = _floor(soles)
    return 0.0 if floor > _ELEVATED else floor


class _Soles(NamedTuple):
    """Left heel, left toe, right heel and right toe over time."""

    places: Floats[Array, "frames 4 3"]
    speeds: Floats[Array, "frames 4"]
    upright: Bools[Array, "frames 4"]

    @property
    def standing(self) -> Bools[Array, "frames 4"]:
        """Points that may be standing on something."""
        return self.upright & (self.speeds < _SLOW)

    def lowest_standing(self) -> Floats[Array, "stances 3"]:
        """In each frame that has a standing point, the place of the lowest."""
        heights = np.where(self.standing, self.places[..., 1], np.inf)
        frames = np.flatnonzero(self.standing.any(axis=1))
        return self.places[frames, heights[frames].argmin(axis=1)]


def _soles(motion: Motion) -> _Soles:
    if motion.skeleton.names != BODY_BONES:
        raise SkeletonError(
            f"only the body has soles, not a skeleton of {len(motion.skeleton)} joints",
            remedy="Retarget the motion to the body first",
        )
    frames = motion_frames(motion)
    places, upright = np.empty((len(motion), 4, 3)), np.empty((len(motion), 4), dtype=np.bool_)
    for column, (side, part) in enumerate((side, part) for side in ("left", "right") for part in ("Foot", "Toes")):
        bone, points = motion.skeleton.index(side + part), sole_points(motion.skeleton, side)
        places[:, column] = bone_points(frames, bone, points.heel if part == "Foot" else points.toe)
        upright[:, column] = frames.rotations[:, bone, 1, 1] > _UPRIGHT
    return _Soles(places, _speeds(places, motion.rate), upright)


def _speeds(places: Floats[Array, "frames 4 3"], rate: float) -> Floats[Array, "frames 4"]:
    """Speeds over about 50 ms around each frame: noise of a millimetre at 120 Hz would look like 0.1 m/s otherwise."""
    frames = np.arange(len(places))
    reach = max(1, round(_MOMENT * rate))
    before, after = np.maximum(frames - reach, 0), np.minimum(frames + reach, len(places) - 1)
    seconds = np.maximum(after - before, 1)[:, None] / rate
    return np.linalg.norm(places[after] - places[before], axis=-1) / seconds


def _floor(soles: _Soles) -> float:
    heights = soles.lowest_standing()[:, 1]
    if heights.size == 0:
        low = float(np.percentile(soles.places[..., 1].min(axis=1), _LEVEL_PERCENTILE))
        return low if low < -_ELEVATED else 0.0
    low = np.percentile(heights, _LEVEL_PERCENTILE)
    return float(np.median(heights[heights < low + _LEVEL_BAND]))


def _floor_plane(soles: _Soles, rate: float) -> Floats[Array, "frames 4"]:
    """Heights of the floor below the points, from a plane that may tilt a little.

    Takes that rise by 6 cm over 4 m are common: the capture's floor was not level. A robust fit of the lowest standing
    points (Cauchy weights) with slopes held near zero by their prior, for a flight of stairs is no floor.
    """
    standing = soles.lowest_standing()
    floor = _floor(soles)
    if len(standing) == 0:
        return np.full(soles.places.shape[:2], floor)
    middle = np.median(standing[:, [0, 2]], axis=0)
    design = np.concatenate([np.ones((len(standing), 1)), standing[:, [0, 2]] - middle], axis=1)
    prior = np.diag([0.0, 1.0, 1.0]) / _SLOPE**2
    plane = np.array([floor, 0.0, 0.0])
    for _ in range(10):
        residual = (standing[:, 1] - design @ plane) / _UNEVEN
        weights = 1 / ((1 + residual**2) * _UNEVEN**2 * max(rate * _STANCE, 1.0))
        plane = np.linalg.solve(design.T * weights @ design + prior, design.T @ (weights * standing[:, 1]))
    return plane[0] + (soles.places[..., [0, 2]] - middle) @ plane[1:]


def _level(heights: Floats[Array, "frames points"], standing: Bools[Array, "frames points"]) -> float:
    """The height above the floor at which points of one kind stand; zero if they never come near it."""
    near = heights[standing & (np.abs(heights) < 2 * _LEVEL_BAND)]
    if near.size == 0:
        return 0.0
    low = np.percentile(near, _LEVEL_PERCENTILE)
    return float(np.median(near[near < low + 0.5 * _LEVEL_BAND]))


def _hysteresis(on: Bools[Array, "frames"], off: Bools[Array, "frames"]) -> Bools[Array, "frames"]:
    """True from a frame where `on` holds to the next where `off` does."""
    frames = np.arange(len(on))
    last_on = np.maximum.accumulate(np.where(on & ~off, frames, -1))
    last_off = np.maximum.accumulate(np.where(off, frames, -1))
    return last_on > last_off
