"""Bodies of different sizes that move: world frames of all bones from drawn motions, feet kept where they stand."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor

from poseloom.calibration.body_size import body_size_model
from poseloom.methods.prior.calibration import known_rotations
from poseloom.methods.prior.channels import CalibrationPose, size_matrix
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.training.prior.kinematics import global_rotations, joint_offsets, lengths, matrix_from_rotvec
from poseloom.training.prior.motions import Motions, MotionSettings
from poseloom.training.tensors import tensor

_STANDING = tuple(BODY_BONES.index(name) for name in ("leftFoot", "leftToes", "rightFoot", "rightToes"))
_TOES = tuple(BODY_BONES.index(name) for name in ("leftToes", "rightToes"))
_LEG = tuple(BODY_BONES.index(name) for name in ("leftLowerLeg", "leftFoot"))


@dataclass(frozen=True, eq=False)
class Scene:
    """What the bodies do. Motions' extra frames are still there: see `motions.LEAD`.

    Attributes:
        rotations: (batch, frames, joints, 3, 3), world.
        positions: (batch, frames, joints, 3), world, metres.
        offsets: (batch, joints, 3): the bodies' rest offsets.
        contacts: (batch, frames, 4).
        weights: (batch, frames).
    """

    rotations: Tensor
    positions: Tensor
    offsets: Tensor
    contacts: Tensor
    weights: Tensor


def make_scene(motions: Motions, settings: MotionSettings, generator: Generator, size_scale: float = 1.0) -> Scene:
    """Gives drawn motions bodies, and turns joints by constants.

    Args:
        motions: What they do.
        settings: By how much joints are turned.
        generator: Of all that is drawn.
        size_scale: Standard deviation of the bodies' size coefficients; 0 for average bodies.
    """
    batch = len(motions.root)
    offsets = draw_offsets(batch, generator, size_scale)
    average = tensor(average_body().offsets.astype(np.float32))
    local = matrix_from_rotvec(motions.rotvecs)
    before = joint_offsets(global_rotations(local), average)
    turn = generator.normal(size=(batch, 1, len(BODY_BONES), 3)) * settings.joint_rad
    turn *= (generator.random((batch, 1, 1, 1)) < settings.turned) * generator.uniform(0, 1.5, (batch, 1, 1, 1))
    turn[:, :, [0, *_TOES]] = 0.0
    rotations = global_rotations(local @ matrix_from_rotvec(tensor(turn.astype(np.float32))))
    after = joint_offsets(rotations, offsets[:, None])
    leg = offsets[:, _LEG, 1].sum(1) / average[_LEG, 1].sum()
    root = _keep_feet(motions, before, after, motions.root * leg[:, None, None])
    return Scene(rotations, after + root[:, :, None], offsets, motions.contacts, motions.weights)


def draw_offsets(batch: int, generator: Generator, scale: float = 1.0) -> Tensor:
    """Rest offsets of bodies drawn from the body-size model."""
    model = body_size_model()
    coefficients = scale * generator.normal(size=(batch, model.size))
    offsets = model.mean[0] + np.tensordot(coefficients, model.components[:, 0], 1)
    return tensor(offsets.astype(np.float32))


def sizes_of(offsets: Tensor) -> Tensor:
    """See `channels.body_sizes`, for a batch of bodies."""
    matrix = tensor(size_matrix().astype(np.float32))
    average = lengths(tensor(average_body().offsets.astype(np.float32))) @ matrix
    return 10 * ((lengths(offsets) @ matrix) / average - 1)


def known_pose(pose: Tensor) -> Tensor:
    """World rotations (batch, joints, 3, 3) of bodies that stand in a calibration pose and face +Z.

    Args:
        pose: `CalibrationPose` of each.
    """
    known = np.stack([known_rotations(each) for each in CalibrationPose])
    return tensor(known.astype(np.float32))[pose]


def _keep_feet(motions: Motions, before: Tensor, after: Tensor, root: Tensor) -> Tensor:
    """The root's path on which a standing foot moves as it did before bodies and joints were changed."""
    feet = list(_STANDING)
    then = (motions.root[:, :, None] + before[:, :, feet]).diff(dim=1)
    now = (root[:, :, None] + after[:, :, feet]).diff(dim=1)
    both = (motions.contacts[:, 1:] * motions.contacts[:, :-1])[..., None]
    slip = ((now - then) * both).sum(2) / both.sum(2).clamp(min=1.0)
    return root - torch.cat([torch.zeros_like(slip[:, :1]), slip.cumsum(1)], 1)
