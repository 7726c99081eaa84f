"""What an estimate costs: rotations, positions, speeds, contacts, doubts and restlessness."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from poseloom.methods.prior.channels import RATE
from poseloom.skeleton.body import BODY_BONES
from poseloom.training.prior.kinematics import joint_offsets
from poseloom.training.prior.network import Estimate
from poseloom.training.prior.virtual_sensors import Batch

_SMOOTH = 1e-4
"""Under the roots of norms: keeps gradients finite at zero."""

_HEAVY = ("UpperLeg", "UpperArm", "hips", "LowerLeg", "LowerArm", "upperChest", "Shoulder")
BONE_WEIGHTS = torch.tensor(
    [1.5 if any(part in name for part in _HEAVY) else 0.3 if "Toes" in name else 1.0 for name in BODY_BONES]
)
"""How much each bone's rotation counts."""


@dataclass(frozen=True)
class LossWeights:
    """Weights of the parts of the loss.

    Attributes:
        rotation: Frobenius distance of rotation matrices.
        position: Distance of joints from the root's place, metres.
        speed: Distance of the joints' velocities, m/s.
        contacts: Cross entropy.
        likelihood: Negative log-likelihood of sigma; errors are detached, so that it teaches the doubt only.
        restlessness: Size of second differences of joint positions beyond the truth's, metres a frame squared.
        velocity: Distance of the root's velocity, m/s.
    """

    rotation: float = 1.0
    position: float = 4.0
    speed: float = 0.1
    contacts: float = 0.1
    likelihood: float = 0.05
    restlessness: float = 10.0
    velocity: float = 0.3


def loss_parts(estimate: Estimate, batch: Batch) -> Mapping[str, Tensor]:
    """Each part of the loss by its name in `LossWeights`."""
    weights = batch.weights
    places = joint_offsets(estimate.rotations, batch.offsets[:, None])
    truth = joint_offsets(batch.rotations, batch.offsets[:, None])
    apart = ((estimate.rotations - batch.rotations) ** 2).sum((-1, -2))
    bones = BONE_WEIGHTS / BONE_WEIGHTS.mean()
    # |A - B|^2 = 8 sin^2(angle / 2) = about twice the squared angle.
    squared_angle = 0.5 * apart.detach()
    likelihood = 0.5 * squared_angle * torch.exp(-2 * estimate.log_sigma) + 3 * estimate.log_sigma
    pace = (places.diff(dim=1) - truth.diff(dim=1)) * RATE
    restless = places.diff(dim=1, n=2) - truth.diff(dim=1, n=2)
    contacts = binary_cross_entropy_with_logits(estimate.contacts, batch.contacts, reduction="none")
    return {
        "rotation": _mean((torch.sqrt(apart + _SMOOTH) * bones).mean(-1), weights),
        "position": _mean(_norm(places - truth).mean(-1), weights),
        "speed": _mean(_norm(pace).mean(-1), weights[:, 1:]),
        "contacts": _mean(contacts.mean(-1), weights),
        "likelihood": _mean(likelihood.mean(-1), weights),
        "restlessness": _mean(_norm(restless).mean(-1), weights[:, 2:]),
        "velocity": _mean(_norm(estimate.velocity - batch.velocity), weights),
    }


def total_loss(parts: Mapping[str, Tensor], weights: LossWeights) -> Tensor:
    """The weighted sum of a loss' parts."""
    return torch.stack([getattr(weights, name) * part for name, part in parts.items()]).sum()


def _norm(vectors: Tensor) -> Tensor:
    return torch.sqrt((vectors * vectors).sum(-1) + _SMOOTH**2)


def _mean(values: Tensor, weights: Tensor) -> Tensor:
    return (values * weights).sum() / weights.sum().clamp(min=1.0)
