"""The prior network without torch: one sample in, one estimate and the next memory out."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Floats32, frozen
from poseloom.errors import FormatError
from poseloom.methods.prior.channels import (
    CONTACTS,
    OUTPUT_ROTATIONS,
    OUTPUT_SIGMAS,
    OUTPUT_SIZE,
    Channel,
    InputSpec,
)
from poseloom.skeleton.body import BODY_BONES

LOG_SIGMA_OFFSET = -2.0
"""Added to the raw outputs of log sigma, so that an untrained network is in doubt by eight degrees."""
LOG_SIGMA_BOUNDS = (-4.0, 0.7)
"""Bounds of log sigma, radians: one degree and two radians."""

Memory = Floats32[Array, "layers hidden"]
"""What a network remembers between samples; never changed in place."""


@dataclass(frozen=True, eq=False)
class PriorEstimate:
    """What a network estimates of one moment.

    Attributes:
        rotations: `R_reference_bone` of all bones, in the axes of the reference as measured, or as said otherwise.
        sigma: Standard deviation of each bone's rotation, radians an axis.
        contacts: Probability that left heel, left toe, right heel and right toe stand.
        velocity: Of the root, m/s, the same axes.
    """

    rotations: Floats[Array, "joints 3 3"]
    sigma: Floats[Array, "joints"]
    contacts: Floats[Array, "contacts"]
    velocity: Floats[Array, "3"]


@dataclass(frozen=True, eq=False)
class GruLayer:
    """A gated recurrent layer; rows of reset, update and new gate one after the other, as torch has them."""

    weight_input: Floats32[Array, "gates inputs"]
    weight_hidden: Floats32[Array, "gates hidden"]
    bias_input: Floats32[Array, "gates"]
    bias_hidden: Floats32[Array, "gates"]

    def step(self, heard: Floats32[Array, "inputs"], hidden: Floats32[Array, "hidden"]) -> Floats32[Array, "hidden"]:
        """The next hidden state."""
        size = len(hidden)
        given = self.weight_input @ heard + self.bias_input
        kept = self.weight_hidden @ hidden + self.bias_hidden
        gates = _sigmoid(given[: 2 * size] + kept[: 2 * size])
        new = np.tanh(given[2 * size :] + gates[:size] * kept[2 * size :])
        return new + gates[size:] * (hidden - new)


class PriorNetwork:
    """A trained prior; holds weights only.

    Args:
        spec: Which numbers it receives.
        weights: Arrays by the names that `training.prior.network.PriorGru` gives them, of any type of floats.
        sigma_factors: By how much each bone's sigma is multiplied, from people who were not trained on.
        card: What one should know of it, by heading.

    Raises:
        FormatError: where arrays are missing, not finite or of shapes that do not fit.
    """

    def __init__(
        self,
        spec: InputSpec,
        weights: Mapping[str, NDArray[Any]],
        sigma_factors: Floats[Array, "joints"] | None = None,
        card: Mapping[str, Any] | None = None,
    ) -> None:
        self.spec = spec
        self.card: Mapping[str, Any] = dict(card or {})
        factors = np.ones(len(BODY_BONES)) if sigma_factors is None else np.asarray(sigma_factors, dtype=np.float64)
        if factors.shape != (len(BODY_BONES),) or not (np.isfinite(factors) & (factors > 0)).all():
            raise _unfit("its sigma factors are not one positive number for each bone")
        self.sigma_factors = frozen(factors)
        self.weights = {name: frozen(np.ascontiguousarray(array, np.float32)) for name, array in weights.items()}
        self._check()
        layers = sum(name.startswith("memory.weight_ih_l") for name in self.weights)
        self._layers = tuple(
            GruLayer(
                *(self.weights[f"memory.{name}_l{k}"] for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"))
            )
            for k in range(layers)
        )

    @property
    def hidden(self) -> int:
        """Units of each layer."""
        return len(self.weights["encode.bias"])

    def start(self) -> Memory:
        """The memory before the first sample."""
        return np.zeros((len(self._layers), self.hidden), dtype=np.float32)

    def raw_step(self, memory: Memory, inputs: Floats[Array, "inputs"]) -> tuple[Memory, Floats32[Array, "outputs"]]:
        """One sample, and the numbers that come out; see `channels.OUTPUT_SIZE`."""
        heard = self.weights["encode.weight"] @ inputs.astype(np.float32) + self.weights["encode.bias"]
        heard = np.maximum(heard, np.float32(0))
        following = np.empty_like(memory)
        for index, layer in enumerate(self._layers):
            heard = following[index] = layer.step(heard, memory[index])
        return following, self.weights["head.weight"] @ heard + self.weights["head.bias"]

    def step(
        self, memory: Memory, inputs: Floats[Array, "inputs"], base: Floats[Array, "joints 3 3"]
    ) -> tuple[Memory, PriorEstimate]:
        """One sample; changes neither argument.

        Args:
            memory: What was remembered.
            inputs: See `channels.fill_inputs`; finite.
            base: Rotations that those of the outputs follow, in the reference's axes; see `channels`.
        """
        following, raw = self.raw_step(memory, inputs)
        numbers = raw.astype(np.float64)
        columns = numbers[:OUTPUT_ROTATIONS].reshape(len(BODY_BONES), 2, 3)
        doubts = numbers[OUTPUT_ROTATIONS : OUTPUT_ROTATIONS + OUTPUT_SIGMAS] + LOG_SIGMA_OFFSET
        sigma = np.exp(np.clip(doubts, *LOG_SIGMA_BOUNDS)) * self.sigma_factors
        contacts = _sigmoid(numbers[-3 - len(CONTACTS) : -3])
        return following, PriorEstimate(base @ rotations_from_columns(columns), sigma, contacts, numbers[-3:])

    def _check(self) -> None:
        hidden = self.weights.get("encode.bias", np.empty(0)).size
        layers = max(1, sum(name.startswith("memory.weight_ih_l") for name in self.weights))
        shapes: dict[str, tuple[int, ...]] = {
            "encode.weight": (hidden, self.spec.size),
            "encode.bias": (hidden,),
            "head.weight": (OUTPUT_SIZE, hidden),
            "head.bias": (OUTPUT_SIZE,),
        }
        for k in range(layers):
            shapes |= {f"memory.weight_{each}_l{k}": (3 * hidden, hidden) for each in ("ih", "hh")}
            shapes |= {f"memory.bias_{each}_l{k}": (3 * hidden,) for each in ("ih", "hh")}
        found = {name: array.shape for name, array in self.weights.items()}
        if hidden == 0 or found != shapes:
            wrong = sorted(name for name in {*found, *shapes} if found.get(name) != shapes.get(name))
            raise _unfit(f"{', '.join(wrong) or 'encode.bias'} are missing, unknown or of another shape")
        infinite = [name for name, array in self.weights.items() if not np.isfinite(array).all()]
        if infinite:
            raise _unfit(f"{', '.join(infinite)} are not finite")


def rotations_from_columns(columns: Floats[Array, "joints 2 3"]) -> Floats[Array, "joints 3 3"]:
    """Rotation matrices of their first two columns, made orthonormal by Gram and Schmidt."""
    x = columns[:, 0] / np.maximum(np.linalg.norm(columns[:, 0], axis=1, keepdims=True), 1e-9)
    y = columns[:, 1] - (x * columns[:, 1]).sum(axis=1, keepdims=True) * x
    y = y / np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-9)
    z = np.stack(
        [
            x[:, 1] * y[:, 2] - x[:, 2] * y[:, 1],
            x[:, 2] * y[:, 0] - x[:, 0] * y[:, 2],
            x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0],
        ],
        axis=1,
    )
    return np.stack([x, y, z], axis=-1)


def spec_to_json(spec: InputSpec) -> dict[str, list[str]]:
    """A spec for a file's header."""
    return {"bones": list(spec.bones), "channels": [channel.name for channel in spec.channels]}


def spec_from_json(content: Mapping[str, Any]) -> InputSpec:
    """The inverse of `spec_to_json`.

    Raises:
        FormatError: for unknown channels or what is no spec.
    """
    try:
        return InputSpec(tuple(content["bones"]), tuple(Channel[name] for name in content["channels"]))
    except (KeyError, TypeError) as error:
        raise _unfit(f"it does not say what it receives ({error})") from None


def _sigmoid(values: Any) -> Any:
    return 0.5 * (1 + np.tanh(0.5 * values))


def _unfit(cause: str) -> FormatError:
    return FormatError("this is no prior network", cause=cause, remedy="Train it again, or name the right file")
