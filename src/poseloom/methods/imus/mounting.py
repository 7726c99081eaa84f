"""How a sensor is really turned on its bone, learnt while it is worn.

Strapped by hand, a sensor sits some degrees off its stated orientation, and emissions compare its axes with those of
sensors that sat right. The difference is a small rotation d that stays: measured = exp(-d) expected, to first order
measured - expected = [expected]x d. Each sample is a linear observation of d, with what the model expects to be felt in
the place of what would have been; recursive least squares with the prior of a mounting error find d. This is not in the
paper, whose sensor was never taken off between training and use.
"""

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats
from poseloom.methods.imus.pairs import CHANNELS
from poseloom.rotations import matrix_from_rotvec


class Mounting(NamedTuple):
    """What is known of the sensors' mounting errors.

    Attributes:
        information: Inverse covariance of each sensor's rotation vector.
        evidence: Information times mean.
        turns: `R` that turns what each sensor says into what a well-mounted one would say.
    """

    information: Floats[Array, "sensors 3 3"]
    evidence: Floats[Array, "sensors 3"]
    turns: Floats[Array, "sensors 3 3"]


def unknown_mounting(sensors: int, sigma: float) -> Mounting:
    """The prior: mounted as stated, up to `sigma` radians an axis; a sigma of 0 is certain of it."""
    information = np.tile(np.eye(3) / max(sigma, 1e-6) ** 2, (sensors, 1, 1))
    return Mounting(information, np.zeros((sensors, 3)), np.tile(np.eye(3), (sensors, 1, 1)))


def aligned(mounting: Mounting, signal: Floats[Array, "*batch channels"]) -> Floats[Array, "*batch channels"]:
    """The signal as well-mounted sensors would say it."""
    vectors = signal.reshape(*signal.shape[:-1], -1, 2, 3)
    return np.einsum("sij,...skj->...ski", mounting.turns, vectors).reshape(signal.shape)


def misaligned(mounting: Mounting, signal: Floats[Array, "channels"]) -> Floats[Array, "channels"]:
    """What the sensors would say of what well-mounted ones feel: the reverse of `aligned`."""
    vectors = signal.reshape(-1, 2, 3)
    return np.einsum("sji,skj->ski", mounting.turns, vectors).reshape(-1)


def observe_mounting(
    mounting: Mounting,
    said: Floats[Array, "channels"],
    expected: Floats[Array, "channels"],
    heard: Bools[Array, "sensors"],
    sigmas: Floats[Array, "sensors 2"],
    gain: float,
) -> Mounting:
    """Takes one sample into account.

    Args:
        mounting: What was known.
        said: What the sensors said, as they are mounted.
        expected: What well-mounted ones were expected to say.
        heard: Which sensors spoke.
        sigmas: Standard deviations of what is expected of each sensor's specific force (m/s^2) and angular rate
            (rad/s): people differ, and hands more than feet.
        gain: How much of an independent observation a sample is.
    """
    information, evidence, turns = mounting.information.copy(), mounting.evidence.copy(), mounting.turns.copy()
    for sensor in np.flatnonzero(heard):
        part = slice(CHANNELS * sensor, CHANNELS * (sensor + 1))
        for measured, hoped, sigma in zip(
            said[part].reshape(2, 3), expected[part].reshape(2, 3), sigmas[sensor], strict=True
        ):
            x, y, z = hoped
            jacobian = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            weight = gain / sigma**2
            information[sensor] += weight * jacobian.T @ jacobian
            evidence[sensor] += weight * jacobian.T @ (measured - hoped)
        turn = cast(NDArray[np.float64], np.linalg.solve(information[sensor], evidence[sensor]))
        turns[sensor] = matrix_from_rotvec(turn)
    return Mounting(information, evidence, turns)
