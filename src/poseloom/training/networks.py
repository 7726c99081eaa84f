"""The flex paper's network and its comparators, in torch: a window of sensor values in, 39 angles out.

All take `(batch, window, 8)`: four values normalised by the range known at that time, and four flags, 1 where the
value was measured and 0 where it is the last known one carried on. The paper's networks look at the values alone.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import cast

import torch
from torch import Tensor, nn

CHANNELS = 4
INPUTS = 2 * CHANNELS
"""Values and flags."""
HEARD = 5
"""Samples that reach the paper's networks behind the calibrator."""


class Kind(StrEnum):
    """Which network."""

    BILSTM = "bilstm"
    BILSTM_C = "bilstm-c"
    TRANSFORMER = "transformer"
    FCN = "fcn"
    TCN = "tcn"
    SCALES = "scales"


@dataclass(frozen=True)
class NetworkSettings:
    """What a network is like.

    Attributes:
        kind: Which one.
        window: Samples that it hears at once; for networks without a calibrator only the last five count.
        hidden: Hidden units: of the LSTM, in the paper's in each direction.
        min_pool: Kernel of the calibrator's min-pooling.
        average_pool: Kernel of its average-pooling.
    """

    kind: Kind = Kind.BILSTM_C
    window: int = 100
    hidden: int = 512
    min_pool: int = 15
    average_pool: int = 10


class Calibrator(nn.Module):
    """`Y_out = Y_in - LN(ave(min(Y_in)))`, equation 2, for each channel alike, then two linear layers.

    Pools step by their kernels, as torch's do unless told otherwise; only so does the linear layer "recover the number
    of features". The text's padding of 8 is illegal for a kernel of 10, so the minima are repeated at both ends.
    """

    def __init__(self, window: int, min_pool: int, average_pool: int, padding: int = 8, between: int = 100) -> None:
        super().__init__()
        minima = (window - min_pool) // min_pool + 1
        baselines = (minima + 2 * padding - average_pool) // average_pool + 1
        self.min_pool, self.average_pool, self.padding = min_pool, average_pool, padding
        self.spread_out = nn.Linear(baselines, window)
        self.layers = nn.Sequential(nn.Linear(CHANNELS, between), nn.Linear(between, CHANNELS))

    def baseline(self, values: Tensor) -> Tensor:
        """The baselines `LN(ave(min(...)))` of `(batch, window, channels)`, of the same shape."""
        series = values.transpose(1, 2)
        minima = -nn.functional.max_pool1d(-series, self.min_pool)
        ends = (minima[..., :1], minima[..., -1:])
        padded = torch.cat([ends[0].repeat(1, 1, self.padding), minima, ends[1].repeat(1, 1, self.padding)], dim=-1)
        return self.spread_out(nn.functional.avg_pool1d(padded, self.average_pool)).transpose(1, 2)

    def forward(self, values: Tensor) -> Tensor:
        return self.layers(values - self.baseline(values))


class BiLstm(nn.Module):
    """The paper's network: calibrator (or none), the last five samples, one Bi-LSTM layer, dense layers.

    Only the output at the last sample is used, live and in the loss. There the backward direction has heard that one
    sample and nothing else: its recurrent weights never count, and it is computed for one step instead of five. The
    result is what a five-step `nn.LSTM(bidirectional=True)` gives there; a test compares the two.
    """

    def __init__(self, settings: NetworkSettings, angles: int) -> None:
        super().__init__()
        calibrates = settings.kind is Kind.BILSTM_C
        self.calibrator = (
            Calibrator(settings.window, settings.min_pool, settings.average_pool) if calibrates else nn.Identity()
        )
        self.dense_in = nn.Linear(CHANNELS, 100)
        self.forwards = nn.LSTM(100, settings.hidden, batch_first=True)
        self.backwards = nn.LSTM(100, settings.hidden, batch_first=True)
        self.head = nn.Sequential(
            *(nn.Linear(2 * settings.hidden, 512), nn.ReLU(), nn.Linear(512, 1024), nn.ReLU()),
            *(nn.Linear(1024, 150), nn.ReLU(), nn.Linear(150, angles)),
        )

    def forward(self, inputs: Tensor) -> Tensor:
        heard = self.dense_in(self.calibrator(inputs[..., :CHANNELS])[:, -HEARD:])
        ahead = self.forwards(heard)[0][:, -1]
        return self.head(torch.cat([ahead, self._back(heard[:, -1])], dim=-1))

    def _back(self, last: Tensor) -> Tensor:
        """The backward direction's first step, from nothing: what it would recall and forget is nil."""
        names = ("weight_ih_l0", "bias_ih_l0", "bias_hh_l0")
        weight, bias, more = (cast(Tensor, getattr(self.backwards, name)) for name in names)
        gates = nn.functional.linear(last, weight, bias + more)
        let_in, _, new, let_out = gates.chunk(4, dim=-1)
        return torch.sigmoid(let_out) * torch.tanh(torch.sigmoid(let_in) * torch.tanh(new))


class Transformer(nn.Module):
    """One encoder layer with four heads over the last five samples, and one linear layer."""

    def __init__(self, angles: int, width: int = 64, heads: int = 4) -> None:
        super().__init__()
        self.enter = nn.Linear(CHANNELS, width)
        self.places = nn.Parameter(torch.zeros(HEARD, width))
        self.encoder = nn.TransformerEncoderLayer(width, heads, 4 * width, dropout=0.0, batch_first=True)
        self.leave = nn.Linear(width, angles)

    def forward(self, inputs: Tensor) -> Tensor:
        return self.leave(self.encoder(self.enter(inputs[:, -HEARD:, :CHANNELS]) + self.places)[:, -1])


class Fcn(nn.Module):
    """Two hidden layers, 200 and 100 units, on the last five samples."""

    def __init__(self, angles: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *(nn.Linear(HEARD * CHANNELS, 200), nn.ReLU(), nn.Linear(200, 100), nn.ReLU(), nn.Linear(100, angles)),
        )

    def forward(self, inputs: Tensor) -> Tensor:
        return self.layers(inputs[:, -HEARD:, :CHANNELS].flatten(1))


class Tcn(nn.Module):
    """A linear layer to 64, two causal convolutions of kernel 7 with dilations 1 and 2, 64 units, residual."""

    def __init__(self, angles: int, width: int = 64, kernel: int = 7) -> None:
        super().__init__()
        self.kernel = kernel
        self.enter = nn.Linear(CHANNELS, width)
        self.blocks = nn.ModuleList(nn.Conv1d(width, width, kernel, dilation=dilation) for dilation in (1, 2))
        self.leave = nn.Linear(width, angles)

    def forward(self, inputs: Tensor) -> Tensor:
        series = self.enter(inputs[:, -HEARD:, :CHANNELS]).transpose(1, 2)
        for block, dilation in zip(self.blocks, (1, 2), strict=True):
            past = nn.functional.pad(series, ((self.kernel - 1) * dilation, 0))
            series = series + torch.relu(block(past))
        return self.leave(series[..., -1])


def median_of_three(outputs: Tensor) -> Tensor:
    """The causal median over time of `(frames, angles)`: of each output and the two before it, never across angles.

    The first two outputs have fewer before them; the first one stands in for those.
    """
    past = torch.cat([outputs[:1], outputs[:1], outputs])
    return torch.stack([past[:-2], past[1:-1], past[2:]]).median(dim=0).values
