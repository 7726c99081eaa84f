"""From a trained network to a file that runs without torch: one sample in, angles and the next memory out."""

import io
import math
import warnings
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from poseloom.arrays import Array, Floats
from poseloom.methods.flex.model_file import FlexModel, write_flex_model
from poseloom.methods.flex.step_network import INPUTS, MemoryPart, StepNetwork
from poseloom.training.fitting import Fitted
from poseloom.training.networks import CHANNELS
from poseloom.training.scales import LEAST_LIVELINESS, MIXED, PAIRS, Scales, keep

_OPSET = 17


class WindowStep(nn.Module):
    """A network of windows that keeps its window, and the median of its last three outputs, itself."""

    def __init__(self, network: nn.Module, window: int, spread: Floats[Array, "angles"], medians: bool) -> None:
        super().__init__()
        self.network, self.medians, self.window = network, medians, window
        self.register_buffer("constant_spread", torch.tensor(spread, dtype=torch.float32)[None])

    def parts(self) -> tuple[MemoryPart, ...]:
        """What is remembered."""
        angles = self.get_buffer("constant_spread").shape[1]
        return (MemoryPart("window", (1, self.window, INPUTS)), MemoryPart("told", (1, 2, angles)))

    def forward(self, sample: Tensor, fresh: Tensor, window: Tensor, told: Tensor) -> tuple[Tensor, ...]:
        again = fresh.reshape(1, 1, 1)
        newest = sample.reshape(1, 1, INPUTS)
        # Before the first sample that sample is repeated, and the same for the outputs.
        kept = again * newest + (1 - again) * window[:, 1:]
        heard = torch.cat([kept, newest], dim=1)
        angles = self.network(heard).reshape(1, 1, -1)
        past = again * angles + (1 - again) * told
        if self.medians:
            # The median of three without sorting: what is not the least and not the greatest.
            first, second = past[:, 0], past[:, 1]
            third = angles[:, 0]
            low, high = torch.minimum(first, second), torch.maximum(first, second)
            said = torch.maximum(low, torch.minimum(high, third))
        else:
            said = angles[:, 0]
        spread = self.get_buffer("constant_spread") + 0 * said
        return said, spread, heard, torch.cat([past[:, 1:], angles], dim=1)


class ScalesStep(nn.Module):
    """Our network, one sample at a time: the filter bank, the LSTM's step and the smoothing."""

    def __init__(self, network: Scales) -> None:
        super().__init__()
        self.network = network
        self.hidden = network.memory.hidden_size
        bank = network.bank
        self.register_buffer("stays", torch.tensor([keep(scale) for scale in bank.means]).reshape(1, -1, 1))
        self.register_buffer("lively_stays", torch.tensor([keep(scale) for scale in bank.liveliness]).reshape(1, -1, 1))

    def parts(self) -> tuple[MemoryPart, ...]:
        """What is remembered."""
        bank = self.network.bank
        return (
            MemoryPart("means", (1, len(bank.means), CHANNELS)),
            MemoryPart("lively", (1, len(bank.liveliness), CHANNELS)),
            MemoryPart("pairs", (1, len(PAIRS))),
            MemoryPart("mixed", (1, len(MIXED))),
            MemoryPart("hidden", (1, 1, self.hidden)),
            MemoryPart("cell", (1, 1, self.hidden)),
            MemoryPart("told", (1, self.network.told.out_features)),
        )

    def forward(
        self, sample: Tensor, fresh: Tensor, means: Tensor, lively: Tensor, pairs: Tensor, mixed: Tensor,
        hidden: Tensor, cell: Tensor, told: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        bank, again = self.network.bank, fresh.reshape(1, 1, 1)
        values = sample[:, :CHANNELS]
        means = self._follow(means, values[:, None], self.get_buffer("stays"), again)
        moved, posture = values - means[:, bank.swift], values - means[:, bank.slow]
        lively = self._follow(lively, (moved * moved)[:, None], self.get_buffer("lively_stays"), again)
        together = torch.tensor(keep(bank.together))
        pairs_now = torch.cat([posture[:, i : i + 1] * posture[:, j : j + 1] for i, j in PAIRS], dim=1)
        mixed_now = torch.cat([moved[:, i : i + 1] * posture[:, j : j + 1] for i, j in MIXED], dim=1)
        pairs = self._follow(pairs, pairs_now, together, fresh)
        mixed = self._follow(mixed, mixed_now, together, fresh)
        steps = (means[:, :-1] - means[:, 1:]).reshape(1, -1)
        liveliness = torch.sqrt(lively + LEAST_LIVELINESS).reshape(1, -1)
        features = torch.cat(
            [sample, values - means[:, 0], steps, means[:, -1], liveliness, pairs, mixed], dim=1
        )  # fmt: skip
        heard = (features - self.network.get_buffer("centre")) / self.network.get_buffer("scale")
        remembered, (hidden, cell) = self.network.memory(heard[:, None], (hidden, cell))
        angles = self.network.told(remembered[:, 0])
        # Laplace: the standard deviation is the mean absolute error times the root of two.
        spread = torch.exp(self.network.doubt(remembered[:, 0])) * math.sqrt(2)
        said = self._follow(told, angles, torch.tensor(keep(self.network.smoothing)), fresh)
        return said, spread, means, lively, pairs, mixed, hidden, cell, said

    @staticmethod
    def _follow(mean: Tensor, value: Tensor, stays: Tensor, again: Tensor) -> Tensor:
        before = again * value + (1 - again) * mean
        return stays * before + (1 - stays) * value


def step_module(fitted: Fitted, medians: bool = True) -> WindowStep | ScalesStep:
    """A fitted network as one that hears a sample at a time."""
    if isinstance(fitted.network, Scales):
        return ScalesStep(fitted.network).eval()
    return WindowStep(fitted.network, fitted.settings.network.window, fitted.spread, medians).eval()


def to_step_network(module: WindowStep | ScalesStep) -> StepNetwork:
    """The ONNX graph of a step."""
    parts = module.parts()
    memory = [torch.zeros(part.shape) for part in parts]
    file = io.BytesIO()
    with _exportable(), torch.no_grad():
        torch.onnx.export(  # pyright: ignore[reportUnknownMemberType]
            module,
            (torch.zeros(1, INPUTS), torch.zeros(1), *memory),
            cast(Any, file),  # the older exporter writes to streams, too
            input_names=["sample", "fresh", *(part.name for part in parts)],
            output_names=["angles", "spread", *(f"next_{part.name}" for part in parts)],
            opset_version=_OPSET,
            dynamo=False,
        )
    return StepNetwork(file.getvalue(), parts)


@contextmanager
def _exportable() -> Generator[None, None, None]:
    """While torch exports: the fused attention layer, which has no counterpart in ONNX, is off, and warnings are still.

    torch's newer exporter needs a further package; the older one warns that it is the older one.
    """
    fused = torch.backends.mha.get_fastpath_enabled()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.backends.mha.set_fastpath_enabled(False)
        try:
            yield
        finally:
            torch.backends.mha.set_fastpath_enabled(fused)


def export(
    fitted: Fitted,
    path: Path,
    method: str,
    rest: Floats[Array, "dofs"],
    rest_spread: Floats[Array, "dofs"],
    card: Mapping[str, str],
    data_digest: str = "",
    medians: bool = True,
) -> None:
    """Writes a fitted network as a model file that `load_flex_model` reads.

    Args:
        fitted: The network.
        path: The file.
        method: Name of the method that it is for.
        rest: Pose vector of what the network does not tell: mean angles of the other joints.
        rest_spread: Standard deviation of each entry of the pose vector.
        card: What one should know of the model, by heading.
        data_digest: Of what it was fitted to.
        medians: Whether a window network's outputs pass the median of three.
    """
    network = to_step_network(step_module(fitted, medians))
    model = FlexModel(method, network, np.asarray(rest), np.asarray(rest_spread), dict(card))
    write_flex_model(model, path, seed=fitted.seed, data_digest=data_digest)
