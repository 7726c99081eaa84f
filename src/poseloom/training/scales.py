"""Our network for four bends: a bank of filters over many time scales, a small LSTM, and a smoothed output.

Five samples, a tenth of a second, do not tell a walk from a climb. The bank keeps what the last eight seconds were
like: differences of exponential means from 0.04 to 8 s, how lively each channel was, and how the channels went together
(means of products of their movements, which hold the phase between knees and elbows). The bank is fixed, so training
computes it once; live it is a memory of some dozen numbers a channel.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from scipy.signal import lfilter  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]
from torch import Tensor, nn

from poseloom.arrays import Array, Floats, Floats32
from poseloom.methods.flex.filter_bank import CHANNELS, LEAST_LIVELINESS, MIXED, PAIRS, BankSettings, keep
from poseloom.training.tensors import tensor


def bank_series(inputs: Floats32[Array, "frames inputs"], settings: BankSettings) -> Floats32[Array, "frames features"]:
    """What the bank makes of a series, from an empty memory."""
    values = inputs[:, :CHANNELS].astype(np.float64)
    means = [exponential_mean(values, scale) for scale in settings.means]
    moved, posture = values - means[settings.swift], values - means[settings.slow]
    lively = [np.sqrt(exponential_mean(moved**2, scale) + LEAST_LIVELINESS) for scale in settings.liveliness]
    pairs = np.stack([posture[:, i] * posture[:, j] for i, j in PAIRS], axis=1)
    mixed = np.stack([moved[:, i] * posture[:, j] for i, j in MIXED], axis=1)
    parts = [
        *(values, inputs[:, CHANNELS:], values - means[0]),
        *(swift - slow for swift, slow in pairwise(means)),
        *(means[-1], *lively, exponential_mean(pairs, settings.together), exponential_mean(mixed, settings.together)),
    ]
    return np.concatenate(parts, axis=1).astype(np.float32)


def exponential_mean(series: Floats[Array, "frames columns"], scale: float) -> Floats[Array, "frames columns"]:
    """The exponential mean over time of `scale` samples, beginning with the first."""
    stays = keep(scale)
    filtered: Any = lfilter([1 - stays], [1, -stays], series, axis=0, zi=stays * series[:1])
    return np.asarray(filtered[0])


class Scales(nn.Module):
    """Features of the bank in, angles out: an LSTM, a linear layer, and an exponential mean of the output.

    Args:
        bank: The filter bank.
        hidden: Units of the LSTM.
        angles: Numbers to tell.
        drop: Share of the LSTM's outputs dropped in training.
    """

    def __init__(self, bank: BankSettings, hidden: int, angles: int, drop: float = 0.4) -> None:
        super().__init__()
        self.bank = bank
        self.register_buffer("centre", torch.zeros(bank.features))
        self.register_buffer("scale", torch.ones(bank.features))
        self.memory = nn.LSTM(bank.features, hidden, batch_first=True)
        self.drop = nn.Dropout(drop)
        self.told = nn.Linear(hidden, angles)
        self.doubt = nn.Linear(hidden, angles)
        self.smoothing = 1.0
        nn.init.zeros_(self.told.weight)
        nn.init.zeros_(self.doubt.weight)
        nn.init.constant_(self.doubt.bias, math.log(0.15))

    def begin_at(self, features: Floats32[Array, "frames features"], angles: Floats32[Array, "frames angles"]) -> None:
        """Sets what features are measured in, and the mean pose, from which learning begins."""
        with torch.no_grad():
            self.get_buffer("centre").copy_(tensor(features.mean(axis=0)))
            self.get_buffer("scale").copy_(tensor(features.std(axis=0) + np.float32(1e-3)))
            self.told.bias.copy_(tensor(angles.mean(axis=0)))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Angles before smoothing, and the logarithm of their mean absolute error; both `(batch, frames, angles)`."""
        heard = (features - self.get_buffer("centre")) / self.get_buffer("scale")
        remembered = self.drop(self.memory(heard)[0])
        return self.told(remembered), self.doubt(remembered.detach())
