"""From rotations of bones with a sigma each to a Gaussian over the pose vector."""

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.rotations import nearest_branch, right_jacobian_inverse, rotvec_from_matrix
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import GaussianPrior


def pose_vector(
    skeleton: Skeleton,
    rotations: Floats[Array, "joints 3 3"],
    root: Floats[Array, "3"],
    near: Floats[Array, "dofs"] | None = None,
) -> Floats[Array, "dofs"]:
    """The pose vector of world rotations of all bones.

    Args:
        skeleton: The bones.
        rotations: `R_world_bone`.
        root: The root's place.
        near: The pose on whose branches rotation vectors are kept.
    """
    rotvecs = rotvec_from_matrix(_local(skeleton, rotations))
    if near is not None:
        rotvecs = nearest_branch(rotvecs, near[3:].reshape(-1, 3))
    return np.concatenate([root, rotvecs.ravel()])


def pose_gaussian(
    skeleton: Skeleton,
    q: Floats[Array, "dofs"],
    rotations: Floats[Array, "joints 3 3"],
    sigma: Floats[Array, "joints"],
    root_sigma: Floats[Array, "3"],
) -> GaussianPrior:
    """The pose vector's Gaussian where errors of bones' world rotations are independent.

    A joint's rotation is R = R_parent^T R_bone; turned by e_parent and e_bone in their own axes its rotation vector
    changes by J_r^-1 (e_bone - R^T e_parent).

    Args:
        skeleton: The bones.
        q: The mean.
        rotations: The mean's `R_world_bone`.
        sigma: Standard deviation of each bone's rotation, radians an axis.
        root_sigma: That of the root's place, metres.
    """
    count = len(skeleton)
    local = _local(skeleton, rotations)
    by_own = right_jacobian_inverse(q[3:].reshape(-1, 3))
    by_parent = -by_own @ local.swapaxes(-1, -2)
    change = np.zeros((count, 3, count, 3))
    joints = np.arange(count)
    change[joints, :, joints] = by_own
    moved = joints[skeleton.parents >= 0]
    change[moved, :, skeleton.parents[moved]] = by_parent[moved]
    jacobian = change.reshape(3 * count, 3 * count) * np.repeat(sigma, 3)
    covariance = np.zeros((len(q), len(q)))
    covariance[3:, 3:] = jacobian @ jacobian.T
    covariance[[0, 1, 2], [0, 1, 2]] = root_sigma**2
    return GaussianPrior(q, covariance)


def _local(skeleton: Skeleton, rotations: Floats[Array, "joints 3 3"]) -> Floats[Array, "joints 3 3"]:
    parents = rotations[skeleton.parents]
    parents[skeleton.parents < 0] = np.eye(3)
    return parents.swapaxes(-1, -2) @ rotations
