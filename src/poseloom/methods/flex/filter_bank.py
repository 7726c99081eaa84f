"""A bank of exponential filters over many time scales: what four bends were like in the last eight seconds.

The bank is fixed, so training computes it once for a whole series; live it is a memory of some dozen numbers a channel.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats32

CHANNELS = 4
PAIRS = tuple((i, j) for i in range(CHANNELS) for j in range(i, CHANNELS))
"""Channels whose postures are multiplied."""
MIXED = tuple((i, j) for i in range(CHANNELS) for j in range(CHANNELS) if i != j)
"""Channels of which the one's movement and the other's posture are multiplied."""
LEAST_LIVELINESS = 1e-6
"""What is added to a mean square before its root is taken."""

_FIRST, _SECOND = (list(each) for each in zip(*PAIRS, strict=True))
_MOVED, _HELD = (list(each) for each in zip(*MIXED, strict=True))


@dataclass(frozen=True)
class BankSettings:
    """Time scales of the filter bank, in samples at 50 Hz.

    Attributes:
        means: Of the exponential means of the values.
        swift: Which of them movement is measured against.
        slow: Which of them posture is measured against.
        liveliness: Of the means of squared movement.
        together: Of the means of products between channels.
    """

    means: tuple[float, ...] = (2.0, 5.0, 12.0, 30.0, 100.0, 400.0)
    swift: int = 1
    slow: int = 4
    liveliness: tuple[float, ...] = (25.0, 100.0)
    together: float = 50.0

    @property
    def features(self) -> int:
        """Numbers that come out a sample."""
        return CHANNELS * (3 + len(self.means) + len(self.liveliness)) + len(PAIRS) + len(MIXED)


@dataclass(frozen=True, eq=False)
class BankMemory:
    """What the bank remembers between samples; never changed in place.

    Attributes:
        means: Exponential means of the values, `(scales, channels)`.
        liveliness: Means of squared movement, `(scales, channels)`.
        pairs: Means of the products of two postures.
        mixed: Means of the products of a movement and a posture.
    """

    means: Floats32[Array, "scales channels"]
    liveliness: Floats32[Array, "squares channels"]
    pairs: Floats32[Array, "pairs"]
    mixed: Floats32[Array, "mixed"]


def keep(scale: float) -> float:
    """Share of an exponential mean that stays from one sample to the next."""
    return math.exp(-1.0 / scale)


def bank_step(
    memory: BankMemory | None, values: Floats32[Array, "channels"], measured: Floats32[Array, "channels"],
    settings: BankSettings,
) -> tuple[BankMemory, Floats32[Array, "features"]]:  # fmt: skip
    """One sample.

    Args:
        memory: What is remembered; None before the first sample, with which every mean then begins.
        values: Of each channel, as a share of its range.
        measured: 1 where the value was measured, 0 where it is the last one carried on.
        settings: The bank.

    Returns:
        What to remember, and the features.
    """
    means = _follow(None if memory is None else memory.means, values[None], _stays(settings.means))
    moved, posture = values - means[settings.swift], values - means[settings.slow]
    liveliness = _follow(
        None if memory is None else memory.liveliness, (moved * moved)[None], _stays(settings.liveliness)
    )
    together = np.float32(keep(settings.together))
    pairs = _follow(None if memory is None else memory.pairs, posture[_FIRST] * posture[_SECOND], together)
    mixed = _follow(None if memory is None else memory.mixed, moved[_MOVED] * posture[_HELD], together)
    features = np.concatenate(
        [
            *(values, measured, values - means[0], (means[:-1] - means[1:]).ravel(), means[-1]),
            *(np.sqrt(liveliness + np.float32(LEAST_LIVELINESS)).ravel(), pairs, mixed),
        ]
    )
    return BankMemory(means, liveliness, pairs, mixed), features


def _stays(scales: tuple[float, ...]) -> Floats32[Array, "scales 1"]:
    return np.array([[keep(scale)] for scale in scales], dtype=np.float32)


def _follow(
    mean: NDArray[np.float32] | None, value: NDArray[np.float32], stays: NDArray[np.float32] | np.float32
) -> NDArray[np.float32]:
    before = value if mean is None else mean
    return np.asarray(stays * before + (np.float32(1) - stays) * value, dtype=np.float32)
