"""Rotations and forward kinematics of the 22-bone body on batches of tensors."""

from functools import cache

import numpy as np
import torch
from torch import Tensor

from poseloom.skeleton.body import BODY_BONES, average_body, mirror_bones
from poseloom.training.tensors import tensor

_TINY = 1e-8


@cache
def parents() -> tuple[int, ...]:
    """Index of each bone's parent; the root's is -1."""
    return tuple(int(parent) for parent in average_body().parents)


@cache
def _ancestors() -> Tensor:
    """1 where a row's joint is moved by a column's offset: itself and all before it."""
    count = len(BODY_BONES)
    matrix = np.zeros((count, count), dtype=np.float32)
    for joint in range(count):
        at = joint
        while at >= 0:
            matrix[joint, at] = 1.0
            at = parents()[at]
    return tensor(matrix)


def matrix_from_rotvec(rotvec: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    angle = torch.sqrt((rotvec * rotvec).sum(-1, keepdim=True) + _TINY**2)
    axis = rotvec / angle
    sine, versine = torch.sin(angle)[..., None], (1 - torch.cos(angle))[..., None]
    outer = axis[..., :, None] * axis[..., None, :]
    eye = torch.eye(3, dtype=rotvec.dtype)
    return (1 - versine) * eye + versine * outer + sine * skew(axis)


def skew(vector: Tensor) -> Tensor:
    """The matrices that take the cross product with vectors (..., 3)."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [torch.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return torch.stack(rows, -2)


def matrix_from_columns(columns: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of two columns (..., 6), made orthonormal by Gram and Schmidt (Zhou 2019)."""
    first, second = columns[..., :3], columns[..., 3:]
    x = first / torch.sqrt((first * first).sum(-1, keepdim=True) + _TINY)
    second = second - (x * second).sum(-1, keepdim=True) * x
    y = second / torch.sqrt((second * second).sum(-1, keepdim=True) + _TINY)
    return torch.stack([x, y, (skew(x) * y[..., None, :]).sum(-1)], -1)


def columns_from_matrix(matrix: Tensor) -> Tensor:
    """The first two columns (..., 6) of rotation matrices (..., 3, 3)."""
    return torch.cat([matrix[..., :, 0], matrix[..., :, 1]], -1)


def rotvec_from_matrix(matrix: Tensor) -> Tensor:
    """Rotation vectors of matrices that turn by clearly less than half a turn."""
    cosine = ((matrix.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2).clamp(-0.999, 1.0)
    odd = torch.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        -1,
    )  # twice the sine times the axis
    sine = 0.5 * torch.sqrt((odd * odd).sum(-1) + _TINY**2)
    angle = torch.atan2(sine, cosine)
    return 0.5 * odd * (angle / sine)[..., None]


def lengths(vectors: Tensor, keepdim: bool = False) -> Tensor:
    """Lengths (...) of vectors (..., 3); not to be differentiated at zero."""
    return torch.sqrt((vectors * vectors).sum(-1, keepdim=keepdim))


def global_rotations(local: Tensor) -> Tensor:
    """World rotations (..., joints, 3, 3) of rotations relative to the parents; the root's is the world's."""
    made: list[Tensor] = []
    for joint, parent in enumerate(parents()):
        own = local[..., joint, :, :]
        made.append(own if parent < 0 else made[parent] @ own)
    return torch.stack(made, -3)


def joint_offsets(rotations: Tensor, offsets: Tensor) -> Tensor:
    """Joints (..., joints, 3) relative to the root, from world rotations.

    Args:
        rotations: (..., joints, 3, 3).
        offsets: Rest offsets, broadcastable to (..., joints, 3); the root's is zero.
    """
    of_parent = rotations[..., [max(parent, 0) for parent in parents()], :, :]
    steps = (of_parent * offsets[..., None, :]).sum(-1)
    return _ancestors().to(steps.dtype) @ steps


def mirror(rotvecs: Tensor, root: Tensor) -> tuple[Tensor, Tensor]:
    """Rotation vectors (..., joints, 3) and root positions (..., 3) in a mirror that stands in the plane x = 0."""
    swapped = rotvecs[..., list(mirror_bones()), :]
    flip = torch.tensor([1.0, -1.0, -1.0])
    return swapped * flip, root * -flip
