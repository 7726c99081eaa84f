"""Errors of an estimated motion by frame and by joint: what the metrics are means of, and what the report draws.

Truth and estimate are motions of the 22-bone body, frame for frame at one rate; their bones may differ in size.
"""

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import PoseloomError
from poseloom.rotations import geodesic_angle, nearest_branch, quat_from_matrix, quat_from_rotvec
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion


def check_pair(truth: Motion, estimate: Motion) -> None:
    """Refuses what cannot be compared.

    Raises:
        PoseloomError: where one of the two is not on the body, or they differ in length or in rate.
    """
    for what, motion in (("truth", truth), ("estimate", estimate)):
        if motion.skeleton.names != BODY_BONES:
            raise PoseloomError(
                f"the {what} {motion.name!r} is not on the body of {len(BODY_BONES)} bones",
                remedy="Retarget it to the body first",
            )
    if len(truth) != len(estimate):
        raise PoseloomError(
            f"truth has {len(truth)} frames, estimate {len(estimate)}",
            remedy="Cut both to the frames that they share",
        )
    if abs(truth.rate - estimate.rate) > 1e-6 * truth.rate:
        raise PoseloomError(
            f"truth has {truth.rate:g} frames a second, estimate {estimate.rate:g}",
            remedy="Resample one to the rate of the other",
        )


def angle_errors(truth: Motion, estimate: Motion) -> Floats[Array, "frames joints 3"]:
    """Absolute differences of the pose-vector angles in degrees.

    A rotation has many rotation vectors, a whole turn apart: the estimate's are first brought to the branch nearest to
    the truth's, so that equal rotations always have error zero.
    """
    near = nearest_branch(estimate.rotvecs, truth.rotvecs)
    return np.degrees(np.abs(near - truth.rotvecs))


def rotation_errors(truth: Motion, estimate: Motion) -> Floats[Array, "frames joints"]:
    """Geodesic angles in degrees between the local joint rotations (the root's: relative to the world)."""
    return np.degrees(geodesic_angle(quat_from_rotvec(truth.rotvecs), quat_from_rotvec(estimate.rotvecs)))


def global_rotation_errors(truth: Motion, estimate: Motion) -> Floats[Array, "frames joints"]:
    """Geodesic angles in degrees between the world rotations of the bones."""
    first, second = motion_frames(truth).rotations, motion_frames(estimate).rotations
    return np.degrees(geodesic_angle(quat_from_matrix(first), quat_from_matrix(second)))


def position_errors(truth: Motion, estimate: Motion) -> Floats[Array, "frames joints"]:
    """Distances in cm between joints, each motion's root position removed (its orientation stays)."""
    first, second = motion_frames(truth).positions, motion_frames(estimate).positions
    apart = (first - first[:, :1]) - (second - second[:, :1])
    return 100 * np.linalg.norm(apart, axis=-1)


def root_position_errors(truth: Motion, estimate: Motion) -> Floats[Array, "frames"]:
    """Distances in cm between the roots."""
    return 100 * np.asarray(np.linalg.norm(truth.root_positions - estimate.root_positions, axis=-1))
