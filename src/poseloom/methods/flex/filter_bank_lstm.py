"""Filters over many time scales, an LSTM and a smoothed output, one sample at a time, in NumPy."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Floats32
from poseloom.errors import FormatError
from poseloom.methods.flex.filter_bank import BankMemory, BankSettings, bank_step, keep

_WEIGHTS = ("centre", "scale", "input", "recurrent", "bias", "angles", "angles_bias", "error", "error_bias")


@dataclass(frozen=True, eq=False)
class FilterBankMemory:
    """What the network remembers between samples; never changed in place.

    Attributes:
        bank: Of the filter bank; None before the first sample.
        hidden: The LSTM's output.
        cell: The LSTM's cell.
        angles: The smoothed output; None before the first sample.
    """

    bank: BankMemory | None
    hidden: Floats32[Array, "units"]
    cell: Floats32[Array, "units"]
    angles: Floats32[Array, "angles"] | None


class FilterBankLstm:
    """The network of `flex-scales`: features of the filter bank in, an LSTM, angles and their errors out.

    Args:
        bank: The filter bank.
        smoothing: Time scale of the output's exponential mean, in samples.
        weights: `centre` and `scale` (features), `input` (4 units, features), `recurrent` (4 units, units) and `bias`
            (4 units) in the order input, forget, cell, output; `angles` and `error` (angles, units) with `angles_bias`
            and `error_bias` (angles): the error is the logarithm of the mean absolute error.

    Raises:
        FormatError: if a weight is missing, not finite, or of another shape.
    """

    def __init__(self, bank: BankSettings, smoothing: float, weights: Mapping[str, NDArray[Any]]) -> None:
        missing = [name for name in _WEIGHTS if name not in weights]
        if missing:
            raise FormatError(f"the network has no {', '.join(missing)}", remedy="Fit the model again")
        self.bank, self.smoothing = bank, smoothing
        self.weights = {name: np.ascontiguousarray(weights[name], dtype=np.float32) for name in _WEIGHTS}
        self._check()

    def _check(self) -> None:
        units, angles = self.weights["recurrent"].shape[-1], len(np.atleast_1d(self.weights["angles_bias"]))
        shapes = {
            "centre": (self.bank.features,),
            "scale": (self.bank.features,),
            "input": (4 * units, self.bank.features),
            "recurrent": (4 * units, units),
            "bias": (4 * units,),
            "angles": (angles, units),
            "angles_bias": (angles,),
            "error": (angles, units),
            "error_bias": (angles,),
        }
        for name, shape in shapes.items():
            if self.weights[name].shape != shape or not np.isfinite(self.weights[name]).all():
                raise FormatError(
                    f"the network's {name} is not {shape} finite numbers",
                    cause=f"its shape is {self.weights[name].shape}",
                    remedy="Fit the model again",
                )
        if not (self.weights["scale"] > 0).all() or not self.smoothing > 0:
            raise FormatError("the network's scales are not above 0", remedy="Fit the model again")

    def start(self) -> FilterBankMemory:
        """The memory before the first sample."""
        units = self.weights["recurrent"].shape[1]
        nothing = np.zeros(units, dtype=np.float32)
        return FilterBankMemory(None, nothing, nothing, None)

    def step(
        self,
        memory: FilterBankMemory,
        values: Floats[Array, "channels"],
        measured: Floats[Array, "channels"],
        fresh: bool,
    ) -> tuple[FilterBankMemory, Floats[Array, "angles"], Floats[Array, "angles"]]:
        """One sample; see `StepNetwork.step`."""
        weights = self.weights
        bank, features = bank_step(
            memory.bank, values.astype(np.float32), measured.astype(np.float32), self.bank
        )  # fmt: skip
        inputs = (features - weights["centre"]) / weights["scale"]
        gates = weights["input"] @ inputs + weights["recurrent"] @ memory.hidden + weights["bias"]
        entering, forgetting, candidate, leaving = np.split(gates, 4)
        cell = _sigmoid(forgetting) * memory.cell + _sigmoid(entering) * np.tanh(candidate)
        hidden = _sigmoid(leaving) * np.tanh(cell)
        newest = weights["angles"] @ hidden + weights["angles_bias"]
        stays = np.float32(keep(self.smoothing))
        angles = newest if memory.angles is None else stays * memory.angles + (np.float32(1) - stays) * newest
        # Laplace: the standard deviation is the mean absolute error times the root of two.
        spread = np.exp(weights["error"] @ hidden + weights["error_bias"]) * np.float32(math.sqrt(2))
        after = FilterBankMemory(bank, hidden, cell, angles)
        return after, angles.astype(np.float64), spread.astype(np.float64)


def _sigmoid(values: Floats32[Array, "units"]) -> Floats32[Array, "units"]:
    # By tanh: it never overflows.
    return np.float32(0.5) * (np.float32(1) + np.tanh(np.float32(0.5) * values))
