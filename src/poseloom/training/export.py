"""From a trained network to a file that runs without torch: one sample in, angles and the next memory out."""

import io
import warnings
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from poseloom.arrays import Array, Floats
from poseloom.methods.flex.filter_bank_lstm import FilterBankLstm
from poseloom.methods.flex.model_file import FlexModel, write_flex_model
from poseloom.methods.flex.onnx_network import MemoryPart, OnnxNetwork
from poseloom.methods.flex.step_network import INPUTS
from poseloom.training.fitting import Fitted
from poseloom.training.scales import Scales

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


def to_step_network(fitted: Fitted, medians: bool = True) -> FilterBankLstm | OnnxNetwork:
    """A fitted network as one that takes a sample at a time and runs without torch.

    Args:
        fitted: The network.
        medians: Whether a window network's outputs pass the median of three.
    """
    if isinstance(fitted.network, Scales):
        return _filter_bank_lstm(fitted.network)
    return _onnx(WindowStep(fitted.network, fitted.settings.network.window, fitted.spread, medians).eval())


def _filter_bank_lstm(network: Scales) -> FilterBankLstm:
    lstm = cast("dict[str, Tensor]", network.memory.state_dict())
    weights: dict[str, Tensor] = {
        "centre": network.get_buffer("centre"),
        "scale": network.get_buffer("scale"),
        "input": lstm["weight_ih_l0"],
        "recurrent": lstm["weight_hh_l0"],
        "bias": lstm["bias_ih_l0"] + lstm["bias_hh_l0"],
        "angles": network.told.weight,
        "angles_bias": network.told.bias,
        "error": network.doubt.weight,
        "error_bias": network.doubt.bias,
    }
    arrays = {name: weight.detach().numpy() for name, weight in weights.items()}
    return FilterBankLstm(network.bank, network.smoothing, arrays)


def _onnx(module: WindowStep) -> OnnxNetwork:
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
    return OnnxNetwork(file.getvalue(), parts)


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
    network = to_step_network(fitted, medians)
    model = FlexModel(method, network, np.asarray(rest), np.asarray(rest_spread), dict(card))
    write_flex_model(model, path, seed=fitted.seed, data_digest=data_digest)
