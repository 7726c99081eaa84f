"""How far a foot has gone, from its own sensor: inertial navigation that is put right whenever the foot stands.

Between two stances the sensor's specific force, turned into a level frame and freed of gravity, is integrated twice;
while the sole stands the sensor's velocity is that of a rigid body rolling about its contact. An error-state Kalman
filter over turn, velocity, place and gyroscope bias carries what a stance tells back to the flight before it (Foxlin,
Pedestrian tracking with shoe-mounted inertial sensors, 2005). Its heading begins anywhere.
"""

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.rotations import aligning_matrix, matrix_from_rotvec
from poseloom.synthesis.imus import GRAVITY

_TURN_NOISE = 0.02
"""Radians that the attitude's error grows by in a second: scale errors and noise of the gyroscope."""

_SPEED_NOISE = 0.3
"""Metres a second that the velocity's error grows by in a second: bias, scale and the sampling of impacts."""

_BIAS_NOISE = 1e-4

_QUIET = (0.02, 3.0)
"""Standard deviation of a standing foot's mean turning, rad/s, and for each rad/s by which it turns: who stands quietly
tells the gyroscope's bias at once, who walks over minutes."""

_START = np.repeat([0.3, 2.0, 1e-3, 0.02], 3)
"""Standard deviations at the start: radians of turn, m/s of velocity, metres, rad/s of the gyroscope's bias."""


class FootTrack(NamedTuple):
    """What is known of a foot's sensor.

    Attributes:
        turn: Turns the sensor's axes into the track's own level ones (y up).
        velocity: In these, m/s.
        place: In these, from where the track began, metres.
        bias: Of the gyroscope, rad/s, in the sensor's axes.
        covariance: Of the errors of turn (in the level axes), velocity, place and bias.
        force: The last specific force heard, m/s^2.
        rate: The last angular rate heard, rad/s.
        stood: Whether the foot has stood since the track began; before, its velocity means nothing.
    """

    turn: Floats[Array, "3 3"]
    velocity: Floats[Array, "3"]
    place: Floats[Array, "3"]
    bias: Floats[Array, "3"]
    covariance: Floats[Array, "12 12"]
    force: Floats[Array, "3"]
    rate: Floats[Array, "3"]
    stood: bool


def start_track(up: Floats[Array, "3"], force: Floats[Array, "3"], rate: Floats[Array, "3"]) -> FootTrack:
    """A track that begins here.

    Args:
        up: Roughly the direction of world up in the sensor's frame.
        force: What is heard now, m/s^2.
        rate: The same, rad/s.
    """
    turn = aligning_matrix(up / np.linalg.norm(up), np.array([0.0, 1.0, 0.0]))
    zero = np.zeros(3)
    return FootTrack(turn, zero, zero, zero, np.diag(_START**2), force, rate, False)


def flown(track: FootTrack, force: Floats[Array, "3"], rate: Floats[Array, "3"], seconds: float) -> FootTrack:
    """The track a sample later, by integration.

    Args:
        track: Before.
        force: Heard now, m/s^2.
        rate: Heard now, rad/s.
        seconds: Since the last sample.
    """
    spin = 0.5 * (rate + track.rate) - track.bias
    middle = track.turn @ matrix_from_rotvec(0.5 * seconds * spin)
    felt = middle @ (0.5 * (force + track.force))
    acceleration = felt - np.array([0.0, GRAVITY, 0.0])
    moved = np.eye(12)
    moved[3:6, 0:3] = -seconds * _cross(felt)
    moved[6:9, 3:6] = seconds * np.eye(3)
    moved[0:3, 9:12] = -seconds * middle
    covariance = moved @ track.covariance @ moved.T
    covariance[np.diag_indices(12)] += seconds * np.repeat([_TURN_NOISE, _SPEED_NOISE, 0.0, _BIAS_NOISE], 3) ** 2
    return track._replace(
        turn=track.turn @ matrix_from_rotvec(seconds * spin),
        velocity=track.velocity + seconds * acceleration,
        place=track.place + seconds * track.velocity + 0.5 * seconds**2 * acceleration,
        covariance=covariance,
        force=force,
        rate=rate,
    )


def stood(track: FootTrack, arm: Floats[Array, "3"], sigma: float) -> FootTrack:
    """The track when the sole is known to stand.

    Args:
        track: Before.
        arm: From the contact to the sensor, in the sensor's axes, metres.
        sigma: Standard deviation of the contact's own velocity, m/s.
    """
    rolling = track.turn @ np.cross(track.rate - track.bias, arm)
    seen = np.zeros((3, 12))
    seen[:, 0:3] = _cross(rolling)
    seen[:, 3:6] = np.eye(3)
    track = _corrected(track, rolling - track.velocity, seen, sigma)
    # On average a standing foot does not turn: this tells the bias, about the vertical too.
    quiet = _QUIET[0] + _QUIET[1] * float(np.linalg.norm(track.rate))
    still = np.zeros((3, 12))
    still[:, 9:12] = np.eye(3)
    return _corrected(track, track.rate - track.bias, still, quiet)._replace(stood=True)


def _corrected(track: FootTrack, error: Floats[Array, "3"], seen: Floats[Array, "3 12"], sigma: float) -> FootTrack:
    """The Kalman update by three numbers, each with the same standard deviation."""
    spread = seen @ track.covariance
    gain = cast(NDArray[np.float64], np.linalg.solve(spread @ seen.T + sigma**2 * np.eye(3), spread)).T
    step = gain @ error
    kept = np.eye(12) - gain @ seen
    # Joseph's form: it stays symmetric and positive, whatever is rounded.
    return track._replace(
        turn=matrix_from_rotvec(step[0:3]) @ track.turn,
        velocity=track.velocity + step[3:6],
        place=track.place + step[6:9],
        bias=track.bias + step[9:12],
        covariance=kept @ track.covariance @ kept.T + sigma**2 * gain @ gain.T,
    )


def _cross(vector: Floats[Array, "3"]) -> Floats[Array, "3 3"]:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
