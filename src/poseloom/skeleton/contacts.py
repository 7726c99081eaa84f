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
"""The underside of an average heel in the foot's frame, metres from the ankle. Measured on standing feet of CMU's walks:
the ankle is 7.5 cm above the floor, the toes' joint 3 cm and their tip 1.7 cm."""

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
    tip = np.where(np.isfinite(skeleton.tips[at]), skeleton.tips[at], scale * average.tips[average.index(toes)])
    return SolePoints(scale * _HEEL, 0.5 * tip - scale * np.array([0.0, _TOE_DROP, 0.0]))


def sole_positions(motion: Motion) -> Floats[Array, "frames 4 3"]:
    """World places of left heel, left toe, right heel and right toe.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    if motion.skeleton.names != BODY_BONES:
        raise SkeletonError(
            f"only the body has soles, not a skeleton of {len(motion.skeleton)} joints",
            remedy="Retarget the motion to the body first",
        )
    frames = motion_frames(motion)
    places: list[Floats[Array, "frames 3"]] = []
    for side in ("left", "right"):
        points = sole_points(motion.skeleton, side)
        places.append(bone_points(frames, motion.skeleton.index(f"{side}Foot"), points.heel))
        places.append(bone_points(frames, motion.skeleton.index(f"{side}Toes"), points.toe))
    return np.stack(places, axis=1)


def contacts(motion: Motion, thresholds: ContactThresholds | None = None) -> Contacts:
    """Which heels and toes stand on the floor, frame by frame.

    A point's height counts from its own standing level in the clip (heels and toes each, both sides together), for
    people's feet differ from the average by centimetres. Contact begins when the point is low and slow, and ends when it
    is high or fast by the larger thresholds.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    limits = thresholds or ContactThresholds()
    places = sole_positions(motion)
    speeds = _speeds(places, motion.rate)
    heights = places[..., 1] - _floor_plane(places, speeds, motion.rate)
    for part in (slice(0, 4, 2), slice(1, 4, 2)):
        heights[:, part] -= _level(heights[:, part], speeds[:, part])
    on = (heights < limits.height_on) & (speeds < limits.speed_on)
    off = (heights > limits.height_off) | (speeds > limits.speed_off)
    return Contacts(*(_hysteresis(on[:, i], off[:, i]) for i in range(4)))


def floor_height(motion: Motion) -> float:
    """Height of the floor that the motion's feet stand on, metres above the world's zero.

    The median height of the lowest slow point of the soles, over the frames in which it is within 4 cm of the clip's
    lowest stances: steps, boxes and ladders that are climbed do not count, nor do flights. Where even the lowest stance
    is 25 cm or more above the file's own zero, it is on a thing and zero stays the floor.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    places = sole_positions(motion)
    floor = _floor(places[..., 1], _speeds(places, motion.rate))
    return 0.0 if floor > _ELEVATED else floor


def _speeds(places: Floats[Array, "frames points 3"], rate: float) -> Floats[Array, "frames points"]:
    if len(places) < 2:
        return np.zeros(places.shape[:2])
    return np.linalg.norm(np.gradient(places, axis=0), axis=-1) * rate


def _floor(heights: Floats[Array, "frames points"], speeds: Floats[Array, "frames points"]) -> float:
    standing = np.where(speeds < _SLOW, heights, np.inf).min(axis=1)
    standing = standing[np.isfinite(standing)]
    if standing.size == 0:
        return float(np.percentile(heights.min(axis=1), _LEVEL_PERCENTILE))
    low = np.percentile(standing, _LEVEL_PERCENTILE)
    return float(np.median(standing[standing < low + _LEVEL_BAND]))


def _floor_plane(
    places: Floats[Array, "frames points 3"], speeds: Floats[Array, "frames points"], rate: float
) -> Floats[Array, "frames points"]:
    """Heights of the floor below the points, from a plane that may tilt a little.

    Takes that rise by 6 cm over 4 m are common: the capture's floor was not level. A robust fit of the lowest slow
    points (Cauchy weights) with slopes held near zero by their prior, for a flight of stairs is no floor.
    """
    lowest = np.where(speeds < _SLOW, places[..., 1], np.inf).argmin(axis=1)
    frames = np.flatnonzero(np.take_along_axis(speeds, lowest[:, None], axis=1)[:, 0] < _SLOW)
    floor = _floor(places[..., 1], speeds)
    if frames.size == 0:
        return np.full(places.shape[:2], floor)
    standing = places[frames, lowest[frames]]
    middle = np.median(standing, axis=0)
    design = np.stack([np.ones(len(standing)), *(standing[:, [0, 2]] - middle[[0, 2]]).T], axis=1)
    prior = np.diag([0.0, 1.0, 1.0]) / _SLOPE**2
    plane = np.array([floor, 0.0, 0.0])
    for _ in range(10):
        residual = (standing[:, 1] - design @ plane) / _UNEVEN
        weights = 1 / ((1 + residual**2) * _UNEVEN**2 * max(rate * _STANCE, 1.0))
        plane = np.linalg.solve(design.T * weights @ design + prior, design.T @ (weights * standing[:, 1]))
    return plane[0] + (places[..., [0, 2]] - middle[[0, 2]]) @ plane[1:]


def _level(heights: Floats[Array, "frames points"], speeds: Floats[Array, "frames points"]) -> float:
    """The height above the floor at which points of one kind stand; zero if they never come near it."""
    near = heights[(speeds < _SLOW) & (np.abs(heights) < 2 * _LEVEL_BAND)]
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
