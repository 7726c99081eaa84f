"""Batches as the network receives them: `channels.fill_inputs` on tensors."""

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from poseloom.methods.prior.channels import CHANNEL_SCALES, CalibrationPose, Channel, InputSpec


def assemble(
    values: dict[Channel, Tensor],
    there: Tensor,
    up: Tensor,
    reference: Tensor,
    sizes: Tensor,
    pose: Tensor,
    spec: InputSpec,
) -> Tensor:
    """Inputs (batch, frames, inputs).

    Args:
        values: By channel, (batch, frames, bones, numbers), SI units, the reference's axes; bones of `spec`.
        there: (batch, frames, bones, channels): what is measured.
        up: (batch, frames, 3): world up in the reference's axes.
        reference: (batch,): position of the reference in the list of bones, -1 for none.
        sizes: (batch, sizes).
        pose: (batch,): the `CalibrationPose` whose residuals are given.
        spec: Which numbers.
    """
    batch, frames, bones = there.shape[:3]
    parts: list[Tensor] = []
    for channel in spec.channels:
        measured = there[..., channel, None]
        parts += [torch.where(measured, values[channel], 0.0) / CHANNEL_SCALES[channel], measured.float()]
    mine = one_hot(reference + 1, bones + 1)[:, 1:].float()
    parts.append(mine[:, None, :, None].expand(batch, frames, bones, 1))
    rest = torch.cat([sizes, one_hot(pose, len(CalibrationPose)).float()], -1)[:, None].expand(batch, frames, -1)
    return torch.cat([torch.cat(parts, -1).reshape(batch, frames, -1), up, rest], -1)
