"""How fast somebody walks, from how the hips bob: what legs told by four bends cannot say.

Knees tell when steps are taken, not how long these are: a network's thighs swing in turn, but too little, towards what
is usual. An IMU on the hips tells the length. On stiff legs of length l the hips rise and fall by h in a step of
`2 sqrt(2 l h)` (an inverted pendulum; Zijlstra and Hof, *Gait and Posture* 18, 2003, who found real steps 1.25 times
as long; without that factor it suits walking, sneaking and jogging alike, for who jogs bobs more). Let the hips bob as
a sine: rise and cadence both follow from the spread of their vertical acceleration, the cadence cancels out, and the
speed is `gain sqrt(l spread)`, without integrating anything.
"""

import math
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats


@dataclass(frozen=True)
class StrideSettings:
    """When bobbing hips are taken for walking, and how fast that is.

    Attributes:
        gain: `sqrt(4 sqrt(2)) / pi`, see above.
        posture_s: Time constants, seconds, of what is posture and no step: of vertical acceleration, of the thighs.
        average_s: Time constant of the spreads, seconds.
        in_turn: Thighs surely swing in turn when their difference has this share more of the movement than their sum:
            1 in plain walking, -1 in a squat.
        least_swing_rad: Spread of the difference of the thighs' turns below which nobody steps ...
        full_swing_rad: ... and from which on somebody may.
    """

    gain: float = math.sqrt(4 * math.sqrt(2)) / math.pi
    posture_s: tuple[float, float] = (0.3, 2.0)
    average_s: float = 0.8
    in_turn: float = 0.4
    least_swing_rad: float = 0.08
    full_swing_rad: float = 0.2


@dataclass(frozen=True, eq=False)
class Stride:
    """What the last second was like.

    Attributes:
        means: Running means of vertical acceleration (m/s^2), of the thighs' difference and of their sum (radians).
        squares: Mean squares of what moves about them.
        weight: Of the mean squares: 0 at first, 1 later.
    """

    means: Floats[Array, "3"]
    squares: Floats[Array, "3"]
    weight: float


NO_STRIDE = Stride(np.zeros(3), np.zeros(3), 0.0)
"""Before the first sample."""


def follow_stride(
    stride: Stride, seconds: float, vertical: float, thighs: Floats[Array, "2"], settings: StrideSettings
) -> Stride:
    """Takes in one frame.

    Args:
        stride: What was before.
        seconds: Time since the last frame.
        vertical: The hips' vertical acceleration without gravity, m/s^2.
        thighs: How far left and right thigh are turned forwards, radians.
        settings: Time constants.
    """
    now = np.array([vertical, thighs[0] - thighs[1], thighs[0] + thighs[1]])
    if stride.weight == 0.0:
        return Stride(now, np.zeros(3), -math.expm1(-seconds / settings.average_s))
    slow = np.array([settings.posture_s[0], settings.posture_s[1], settings.posture_s[1]])
    means = stride.means + (now - stride.means) * -np.expm1(-seconds / slow)
    taken = -math.expm1(-seconds / settings.average_s)
    squares = stride.squares + ((now - means) ** 2 - stride.squares) * taken
    return Stride(means, squares, stride.weight + (1 - stride.weight) * taken)


def stepping(stride: Stride, settings: StrideSettings) -> float:
    """How surely somebody steps, 0 to 1: the thighs swing in turn, not together, and far enough."""
    if stride.weight == 0.0:
        return 0.0
    apart, together = stride.squares[1:] / stride.weight
    if apart <= 0:
        return 0.0
    in_turn = (apart - together) / (apart + together)
    enough = (math.sqrt(apart) - settings.least_swing_rad) / (settings.full_swing_rad - settings.least_swing_rad)
    return min(max(float(in_turn) / settings.in_turn, 0.0), 1.0) * min(max(enough, 0.0), 1.0)


def walking_speed(stride: Stride, leg_m: float, settings: StrideSettings) -> float:
    """How fast somebody walks whose hips bob like this, metres a second."""
    if stride.weight == 0.0:
        return 0.0
    return settings.gain * math.sqrt(leg_m * math.sqrt(float(stride.squares[0]) / stride.weight))
