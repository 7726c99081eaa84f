"""Where a skeleton's bones are in the world, and how that changes with the pose vector."""

from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.skeleton import _kernels
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.skeleton import Skeleton


class BoneFrames(NamedTuple):
    """World frames of joints.

    Attributes:
        positions: (..., joints, 3) in metres.
        rotations: (..., joints, 3, 3): `R_world_bone`.
    """

    positions: Floats[Array, "*batch joints 3"]
    rotations: Floats[Array, "*batch joints 3 3"]


class PointJacobians(NamedTuple):
    """World places of points fixed to bones, the bones' rotations there, and their derivatives by the pose vector.

    Attributes:
        points: (points, 3) in metres.
        rotations: (points, 3, 3): `R_world_bone` of each point's bone.
        linear: (points, 3, dofs): d point / d q.
        angular: (points, 3, dofs): world angular change of the bone / d q.
    """

    points: Floats[Array, "points 3"]
    rotations: Floats[Array, "points 3 3"]
    linear: Floats[Array, "points 3 dofs"]
    angular: Floats[Array, "points 3 dofs"]


def forward_kinematics(skeleton: Skeleton, q: Floats[Array, "dofs"]) -> BoneFrames:
    """World frames of all joints in one pose."""
    count = len(skeleton)
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    _kernels.forward(skeleton.parents, skeleton.offsets, q, positions, rotations)
    return BoneFrames(positions, rotations)


def motion_frames(motion: Motion) -> BoneFrames:
    """World frames of all joints in every frame of a motion."""
    frames, count = len(motion), len(motion.skeleton)
    offsets = motion.skeleton.offsets[None]
    if motion.displacements is not None:
        offsets = offsets + motion.displacements
    positions, rotations = np.empty((frames, count, 3)), np.empty((frames, count, 3, 3))
    _kernels.forward_batch(motion.skeleton.parents, offsets, motion.q, positions, rotations)
    return BoneFrames(positions, rotations)


def point_jacobians(
    skeleton: Skeleton, q: Floats[Array, "dofs"], bones: Ints[Array, "points"], locals_: Floats[Array, "points 3"]
) -> PointJacobians:
    """World places and analytic Jacobians of points fixed to bones.

    Args:
        skeleton: The bones.
        q: Pose vector.
        bones: Index of the bone that carries each point.
        locals_: Each point in its bone's frame, metres.
    """
    count, points, size = len(skeleton), len(bones), skeleton.size
    positions, rotations, axes = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3, 3))
    places = np.empty((points, 3))
    linear, angular = np.zeros((points, 3, size)), np.zeros((points, 3, size))
    _kernels.frames_and_jacobians(
        skeleton.parents, skeleton.offsets, q, bones, locals_, positions, rotations, axes, places, linear, angular
    )
    return PointJacobians(places, rotations[bones], linear, angular)


def bone_points(frames: BoneFrames, bone: int, local: Floats[Array, "3"]) -> Floats[Array, "*batch 3"]:
    """World places of a point fixed to one bone."""
    return frames.positions[..., bone, :] + frames.rotations[..., bone, :, :] @ local
