"""The inner loop of sharing an arm's twist: one upper arm and forearm over time."""

import math

from poseloom.arrays import Array, Floats, compiled

_TURN = 2.0 * math.pi


@compiled
def share_twist(
    upper: Floats[Array, "frames 4"],
    lower: Floats[Array, "frames 4"],
    neutral: float,
    freedom: float,
    straight: float,
    bent: float,
) -> None:
    """Moves twist about the common X axis from a forearm to its upper arm, in place, quaternions `wxyz`.

    `lower` is a swing by the bend times a roll about X. The roll may leave `neutral` by `freedom` times the bend up to
    the bend `straight`, and by ever more up to half a turn at the bend `bent` (radians); what is beyond goes to the
    upper arm. Where a roll is about half a turn off, the way round is that of the frame before.
    """
    off = 0.0
    for frame in range(upper.shape[0]):
        w, x, y, z = lower[frame]
        bend = 2.0 * math.atan2(math.hypot(y, z), math.hypot(w, x))
        roll = 2.0 * math.atan2(x, w) - neutral
        roll -= _TURN * math.floor(roll / _TURN + 0.5)
        most = freedom * min(bend, straight)
        if bend > straight:
            most += (math.pi - most) * min((bend - straight) / (bent - straight), 1.0)
        if abs(off) > math.pi / 2.0 and abs(roll - off) > math.pi:
            other = roll + math.copysign(_TURN, off)
            if abs(other) < min(1.5 * math.pi, _TURN - most):
                roll = other
        off = roll
        excess = roll - min(max(roll, -most), most)
        if excess != 0.0:
            _turn_after(upper[frame], excess)
            _turn_before(lower[frame], -excess)


@compiled
def _turn_after(quat: Floats[Array, "4"], angle: float) -> None:
    """quat times the turn about X by `angle`."""
    c, s = math.cos(angle / 2.0), math.sin(angle / 2.0)
    w, x, y, z = quat
    quat[0], quat[1], quat[2], quat[3] = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s


@compiled
def _turn_before(quat: Floats[Array, "4"], angle: float) -> None:
    """The turn about X by `angle` times quat."""
    c, s = math.cos(angle / 2.0), math.sin(angle / 2.0)
    w, x, y, z = quat
    quat[0], quat[1], quat[2], quat[3] = c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y
