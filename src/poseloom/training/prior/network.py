"""The prior's network: an encoder, two recurrent layers, a head."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from poseloom.methods.prior.channels import (
    CHANNEL_SIZES,
    OUTPUT_ROTATIONS,
    OUTPUT_SIGMAS,
    OUTPUT_SIZE,
    SIZE_COUNT,
    CalibrationPose,
    Channel,
    InputSpec,
    likeness,
)
from poseloom.methods.prior.network import LOG_SIGMA_BOUNDS, LOG_SIGMA_OFFSET
from poseloom.skeleton.body import BODY_BONES
from poseloom.training.prior.kinematics import matrix_from_columns


@dataclass(frozen=True)
class NetworkShape:
    """Sizes of a network.

    Attributes:
        hidden: Units of the encoder and of each recurrent layer.
        layers: Recurrent layers.
    """

    hidden: int = 256
    layers: int = 2


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a network gives.

    Attributes:
        rotations: (batch, frames, joints, 3, 3), in the reference's axes.
        log_sigma: (batch, frames, joints): logarithm of each bone's standard deviation an axis, radians.
        contacts: (batch, frames, 4): logits.
        velocity: (batch, frames, 3): of the root, m/s.
    """

    rotations: Tensor
    log_sigma: Tensor
    contacts: Tensor
    velocity: Tensor


class PriorGru(nn.Module):
    """A causal recurrent network over inputs (batch, frames, inputs)."""

    def __init__(self, spec: InputSpec, shape: NetworkShape) -> None:
        super().__init__()
        self.spec, self.shape = spec, shape
        self.encode = nn.Linear(spec.size, shape.hidden)
        self.memory = nn.GRU(shape.hidden, shape.hidden, shape.layers, batch_first=True)
        self.head = nn.Linear(shape.hidden, OUTPUT_SIZE)
        with torch.no_grad():
            # The base itself to begin with: a network far from any pose loses its first hundreds of steps.
            self.head.weight.mul_(0.1)
            self.head.bias[:OUTPUT_ROTATIONS] = torch.tensor([1.0, 0, 0, 0, 1.0, 0]).repeat(len(BODY_BONES))

    def forward(self, inputs: Tensor) -> Tensor:
        """Raw outputs (batch, frames, outputs): see `channels.OUTPUT_SIZE`."""
        heard, _ = self.memory(torch.relu(self.encode(inputs)))
        return self.head(heard)


def split(raw: Tensor, base: Tensor) -> Estimate:
    """Raw outputs by meaning.

    Args:
        raw: (batch, frames, outputs).
        base: (batch, frames, joints, 3, 3): rotations that those of the outputs follow; see `channels`.
    """
    columns = raw[..., :OUTPUT_ROTATIONS].reshape(*raw.shape[:-1], len(BODY_BONES), 6)
    doubts = raw[..., OUTPUT_ROTATIONS : OUTPUT_ROTATIONS + OUTPUT_SIGMAS]
    log_sigma = (doubts + LOG_SIGMA_OFFSET).clamp(*LOG_SIGMA_BOUNDS)
    return Estimate(base @ matrix_from_columns(columns), log_sigma, raw[..., -7:-3], raw[..., -3:])


def widened(weights: Mapping[str, Tensor], of: InputSpec, to: InputSpec, seed: int) -> dict[str, Tensor]:
    """First weights for a network that receives more, from one of the same shape that receives less.

    Where the first receives something the weights are its own. The new bones' are those of the likest old bone at half
    their size, so that a hand begins by meaning what a forearm means; the rest is small and random.

    Args:
        weights: Of the trained network.
        of: What it receives.
        to: What the other receives.
        seed: Of what is random.
    """
    generator = torch.Generator().manual_seed(seed)
    old = weights["encode.weight"]
    new = 0.5 * float(old.std()) * torch.randn((len(old), to.size), generator=generator)
    unlike = likeness()
    for bone, there in _columns(to).items():
        likest = min(of.bones, key=lambda other: unlike[BODY_BONES.index(bone), BODY_BONES.index(other)])
        share = 1.0 if bone in of.bones else 0.5
        for channel, columns in _columns(of)[likest].items():
            if channel in there:
                new[:, there[channel]] = share * old[:, columns]
    rest = 3 + SIZE_COUNT + len(CalibrationPose)
    new[:, -rest:] = old[:, -rest:]
    return {**weights, "encode.weight": new}


def _columns(spec: InputSpec) -> dict[str, dict[Channel | None, slice]]:
    """Where in the inputs each bone's channels stand, masks with them; None for the mark of the reference."""
    found: dict[str, dict[Channel | None, slice]] = {}
    at = 0
    for bone in spec.bones:
        found[bone] = {}
        for channel in spec.channels:
            found[bone][channel] = slice(at, at + CHANNEL_SIZES[channel] + 1)
            at += CHANNEL_SIZES[channel] + 1
        found[bone][None] = slice(at, at + 1)
        at += 1
    return found
