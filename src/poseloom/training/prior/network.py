"""The prior's network: an encoder, two recurrent layers, a head."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from poseloom.methods.prior.channels import OUTPUT_ROTATIONS, OUTPUT_SIGMAS, OUTPUT_SIZE, InputSpec
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
