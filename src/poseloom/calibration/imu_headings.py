"""Which way a sensor's bone faces, from how its wearer walks.

Thighs, shanks and feet turn mostly about the axis that points left; which of its two ends does is told by a shank and a
thigh from the swing, whose turn is shorter and faster than the stance's, and by a foot from where it goes between two
stances. Hips and head sway: what they accelerate forwards they lose in height, as an upside-down pendulum does
(Cavagna, Heglund and Taylor 1977), so the horizontal acceleration that goes with falling points forwards, while the
sway to the sides, with one period a stride and not a step, averages out. In running it is the other way round.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from vqf import offlineVQF  # pyright: ignore

from poseloom.arrays import Array, Floats
from poseloom.errors import SensorError
from poseloom.rotations import matrix_from_quat, quat_conjugate, quat_rotate
from poseloom.sensors.paths import SmoothPath

_GRAVITY = 9.80665
_STEP_BAND_HZ = (0.7, 5.0)
"""Where the steps' own frequency and its first harmonics lie."""
_STANCE_RAD_S = 0.8
_SWING_SECONDS = (0.2, 1.5)


@dataclass(frozen=True, eq=False)
class LevelWalk:
    """What one sensor felt in walking, in axes whose y was up in standing; their heading is anyhow.

    Attributes:
        rate: Samples a second.
        forces: Specific forces, m/s^2.
        turns: Angular rates without bias, rad/s.
    """

    rate: float
    forces: Floats[Array, "samples 3"]
    turns: Floats[Array, "samples 3"]


@dataclass(frozen=True)
class Heading:
    """Which way a bone faces.

    Attributes:
        angle: Of the direction to the left: cos angle along x, minus sin angle along z, radians.
        forward_trust: How clear forwards was, 0 to 1.
        axis_trust: How clear the axis was, 0 to 1.
    """

    angle: float
    forward_trust: float
    axis_trust: float


def _main_axis(walk: LevelWalk) -> tuple[float, float]:
    """Angle, in the plane of x and z, of the level axis about which most of the turning is, and its share."""
    flat = walk.turns[:, [0, 2]]
    shares, axes = np.linalg.eigh(flat.T @ flat)
    axis = axes[:, 1]
    # Left is at angle t where left = cos t x - sin t z: turning about up goes from z to x.
    return math.atan2(-float(axis[1]), float(axis[0])), float(shares[1] / max(float(shares.sum()), 1e-12))


def _towards(angle: float) -> tuple[Floats[Array, "3"], Floats[Array, "3"]]:
    """Left and forwards in level axes for a heading."""
    return np.array([math.cos(angle), 0.0, -math.sin(angle)]), np.array([math.sin(angle), 0.0, math.cos(angle)])


def _heading_of_swing(walk: LevelWalk) -> Heading:
    """Of a shank or thigh: about the axis that points left, the swing turns backwards, shortly and fast."""
    angle, share = _main_axis(walk)
    left, _ = _towards(angle)
    about = np.asarray(walk.turns @ left, dtype=np.float64)
    about -= about.mean()
    skew = float((about**3).mean()) / max(float((about**2).mean()), 1e-12) ** 1.5
    return Heading(angle if skew < 0 else angle + math.pi, min(1.0, abs(skew)), share)


def _heading_of_foot(walk: LevelWalk) -> Heading:
    """Of a foot: forwards is where it goes between stances."""
    angle, share = _main_axis(walk)
    _, forwards = _towards(angle)
    ways = _swing_ways(walk)
    length = float(np.linalg.norm(ways, axis=1).sum())
    if length == 0:
        raise SensorError(
            "a foot's sensor does not come to rest between steps",
            cause="the walk is not one, or its moments are chosen wrongly",
            remedy="Say when its wearer walks (--walking FROM:TO)",
        )
    along = float((ways @ forwards).sum())
    return Heading(angle if along > 0 else angle + math.pi, abs(along) / length, share)


def _heading_of_trunk(walk: LevelWalk) -> Heading:
    """Of hips or head: forwards is where it accelerates while it falls."""
    accelerations = _level_accelerations(walk)
    band = _band_passed(accelerations, walk.rate)
    rising = _band_passed(np.cumsum(band[:, [1]], axis=0) / walk.rate, walk.rate)[:, 0]
    with_falling = -(band[:, [0, 2]] * rising[:, None]).mean(axis=0)
    size = float(np.sqrt((band[:, [0, 2]] ** 2).sum(axis=1).mean()) * rising.std())
    trust = float(np.linalg.norm(with_falling)) / max(size, 1e-12)
    return Heading(math.atan2(float(with_falling[0]), float(with_falling[1])), trust, trust)


def _orientations(walk: LevelWalk) -> Floats[Array, "samples 4"]:
    """Orientations in a world whose z points up, with a heading of their own that may wander (VQF)."""
    signals = (np.ascontiguousarray(walk.turns), np.ascontiguousarray(walk.forces))
    found = cast(dict[str, Floats[Array, "samples 4"]], offlineVQF(*signals, None, 1 / walk.rate))
    return found["quat6D"]


def _level_accelerations(walk: LevelWalk) -> Floats[Array, "samples 3"]:
    """Accelerations without gravity, y up, in axes that turn with the sensor's heading but do not tilt."""
    quats = _orientations(walk)
    world = quat_rotate(quats, walk.forces) - np.array([0.0, 0.0, _GRAVITY])
    ahead = matrix_from_quat(quats)[:, :, 2]  # of the level frame's z axis
    length = np.hypot(ahead[:, 0], ahead[:, 1])
    cos, sin = ahead[:, 0] / length, ahead[:, 1] / length
    forward = cos * world[:, 0] + sin * world[:, 1]
    left = -sin * world[:, 0] + cos * world[:, 1]
    return np.stack([left, world[:, 2], forward], axis=1)


def _band_passed(values: Floats[Array, "samples _"], rate: float) -> Floats[Array, "samples _"]:
    """What lies in the band of steps."""
    places = np.arange(len(values), dtype=np.float64)
    slow = SmoothPath(values, rate, _STEP_BAND_HZ[0]).at(places)
    return SmoothPath(values - slow, rate, _STEP_BAND_HZ[1]).at(places)


def _swing_ways(walk: LevelWalk) -> Floats[Array, "swings 3"]:
    """How far a foot goes between stances, in its own level axes at the stance before; velocities nought at both."""
    quats = _orientations(walk)
    world = quat_rotate(quats, walk.forces) - np.array([0.0, 0.0, _GRAVITY])
    resting = np.linalg.norm(walk.turns, axis=1) < _STANCE_RAD_S
    edges = np.diff(resting.astype(np.int64))
    leaves, lands = np.flatnonzero(edges < 0), np.flatnonzero(edges > 0) + 1
    ways: list[np.ndarray] = []
    for leave in leaves:
        after = lands[lands > leave]
        if not after.size or not _SWING_SECONDS[0] <= (after[0] - leave) / walk.rate <= _SWING_SECONDS[1]:
            continue
        speeds = np.cumsum(world[leave : after[0] + 1], axis=0) / walk.rate
        speeds -= np.linspace(0.0, 1.0, len(speeds))[:, None] * speeds[-1]
        ways.append(quat_rotate(quat_conjugate(quats[leave]), speeds.sum(axis=0) / walk.rate))
    return np.array(ways).reshape(-1, 3)


HEADINGS: Mapping[str, Callable[[LevelWalk], Heading]] = {
    "Foot": _heading_of_foot,
    "LowerLeg": _heading_of_swing,
    "UpperLeg": _heading_of_swing,
    "hips": _heading_of_trunk,
    "head": _heading_of_trunk,
}
"""How each bone that can be aligned tells its heading, the side left out."""
