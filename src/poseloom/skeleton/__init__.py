"""Skeletons, the body, poses and motions: kinematics, retargeting, contacts, mirroring, rates and differences."""

from poseloom.skeleton.body import BODY_BONES, average_body, mirror_bones, moving_dofs
from poseloom.skeleton.contacts import (
    Contacts,
    ContactThresholds,
    SolePoints,
    contacts,
    floor_height,
    sole_points,
    sole_positions,
)
from poseloom.skeleton.differences import (
    angular_acceleration,
    angular_velocity,
    derivative,
    linear_acceleration,
    linear_velocity,
)
from poseloom.skeleton.families import FAMILIES, Family, recognise
from poseloom.skeleton.kinematics import (
    BoneFrames,
    PointJacobians,
    bone_points,
    forward_kinematics,
    motion_frames,
    point_jacobians,
)
from poseloom.skeleton.mirror import mirror_motion, mirror_pose_vectors, mirror_skeleton
from poseloom.skeleton.motion import Motion, Pose, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors, resample
from poseloom.skeleton.retarget import retarget
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

__all__ = [
    "BODY_BONES",
    "FAMILIES",
    "BoneFrames",
    "ContactThresholds",
    "Contacts",
    "Family",
    "Motion",
    "PointJacobians",
    "Pose",
    "Skeleton",
    "SolePoints",
    "angular_acceleration",
    "angular_velocity",
    "average_body",
    "bone_points",
    "contacts",
    "derivative",
    "floor_height",
    "forward_kinematics",
    "interpolate_pose_vectors",
    "linear_acceleration",
    "linear_velocity",
    "make_motion",
    "make_skeleton",
    "mirror_bones",
    "mirror_motion",
    "mirror_pose_vectors",
    "mirror_skeleton",
    "motion_frames",
    "moving_dofs",
    "point_jacobians",
    "recognise",
    "resample",
    "retarget",
    "sole_points",
    "sole_positions",
]
