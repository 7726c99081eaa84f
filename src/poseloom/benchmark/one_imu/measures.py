"""The single-IMU paper's measure of a pose, and the measures of its paths and transitions."""

import math

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.evaluation.profiles import check_pair
from poseloom.rotations import heading_angle, heading_matrix, matrix_from_rotvec, quat_from_rotvec, rotvec_from_matrix
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.contacts import contacts, sole_positions
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion

_ROOT_BONES = ("hips", "spine")
"""They begin at the root's place, which is removed: their zeros would flatter every method."""


def headings(motion: Motion) -> Floats[Array, "frames"]:
    """Where the hips face, radians about world up."""
    return heading_angle(quat_from_rotvec(motion.q[:, 3:6]))


def placed_joints(motion: Motion, facing: Floats[Array, "frames"] | None = None) -> Floats[Array, "frames joints 3"]:
    """Places of the joints from the hips, metres, seen along the heading of the hips (or along the given one).

    An IMU without a magnetometer knows nothing of the heading, so the paper's measure is taken without it.
    """
    frames = motion_frames(motion)
    away = frames.positions - frames.positions[:, :1]
    back = heading_matrix(-(headings(motion) if facing is None else facing))
    kept = [index for index, bone in enumerate(BODY_BONES) if bone not in _ROOT_BONES]
    return np.einsum("fij,fbj->fbi", back, away[:, kept])


def pose_errors_cm(truth: Motion, estimate: Motion) -> Floats[Array, "frames"]:
    """Mean distance of joints in each frame, place and heading of the hips removed, cm.

    What the paper calls mean square error of joint positions "after excluding the global root position". Its hips and
    ours are removed each with its own heading.

    Raises:
        PoseloomError: where the two cannot be compared.
    """
    check_pair(truth, estimate)
    away = placed_joints(truth) - placed_joints(estimate)
    return 100 * np.asarray(np.linalg.norm(away, axis=-1).mean(axis=1))


def jitter_km_s3(motion: Motion) -> float:
    """Mean third derivative of the joints' places from the hips, km/s^3; NaN for fewer than four frames."""
    if len(motion) < 4:
        return float("nan")
    third = np.diff(placed_joints(motion), n=3, axis=0) * motion.rate**3
    return float(np.linalg.norm(third, axis=-1).mean()) / 1000


def foot_skate_cm_s(motion: Motion, standing: Bools[Array, "frames 4"]) -> float:
    """Mean horizontal speed of heels and toes while the truth has them on the floor in both frames, or NaN.

    Args:
        motion: Truth or estimate.
        standing: When the truth's left heel, left toe, right heel and right toe stand.
    """
    both = standing[1:] & standing[:-1]
    if not both.any():
        return float("nan")
    speed = np.linalg.norm(np.diff(sole_positions(motion)[..., [0, 2]], axis=0), axis=-1) * motion.rate
    return 100 * float(speed[both].mean())


def standing_soles(truth: Motion) -> Bools[Array, "frames 4"]:
    """When heels and toes stand: left heel, left toe, right heel, right toe."""
    stands = contacts(truth)
    return np.stack([stands.left_heel, stands.left_toe, stands.right_heel, stands.right_toe], axis=1)


def path_errors_m(truth: Motion, estimate: Motion) -> Floats[Array, "frames"]:
    """Distance over the ground between the roots, both ways begun at one place and with one heading, metres."""
    return np.asarray(np.linalg.norm(_way(truth) - _way(estimate), axis=1))


def turned_path_errors_m(truth: Motion, estimate: Motion) -> Floats[Array, "frames"]:
    """The same, once the estimated way is turned about its beginning so that it fits the truth best, metres.

    Heading about world up is not observed by an IMU without a magnetometer, and that of the first pose is one moment of
    a pelvis that turns with every step: odometry is compared after such an alignment.
    """
    true_way, way = _way(truth), _way(estimate)
    cosine = float((true_way * way).sum())
    sine = float((way[:, 0] * true_way[:, 1] - way[:, 1] * true_way[:, 0]).sum())
    size = math.hypot(cosine, sine)
    if size == 0.0:
        return path_errors_m(truth, estimate)
    turn = np.array([[cosine, sine], [-sine, cosine]]) / size
    return np.asarray(np.linalg.norm(true_way - way @ turn, axis=1))


def way_m(motion: Motion) -> float:
    """Length of the root's way over the ground, metres, its sway between steps smoothed away (over half a second)."""
    span = max(1, round(0.5 * motion.rate))
    ground = motion.q[:, [0, 2]]
    if len(ground) <= span:
        return float(np.linalg.norm(ground[-1] - ground[0]))
    kernel = np.full(span, 1 / span)
    smooth = np.stack([np.convolve(ground[:, axis], kernel, mode="valid") for axis in (0, 1)], axis=1)
    return float(np.linalg.norm(np.diff(smooth, axis=0), axis=1).sum() * len(ground) / len(smooth))


def largest_jump_cm(truth: Motion, estimate: Motion, start: int, stop: int) -> float:
    """Largest movement of a joint from frame to frame, seen from the hips, that the truth does not make, cm."""
    moved = np.diff(placed_joints(estimate)[start:stop], axis=0) - np.diff(placed_joints(truth)[start:stop], axis=0)
    return 100 * float(np.linalg.norm(moved, axis=-1).max())


def largest_velocity_jump_m_s(motion: Motion, start: int, stop: int) -> float:
    """Largest change of a joint's velocity in the world from one frame to the next, m/s, in a stretch of a motion."""
    places = motion_frames(motion).positions[max(start, 0) : stop]
    change = np.diff(places, n=2, axis=0) * motion.rate
    return float(np.linalg.norm(change, axis=-1).max())


def facing_start(motion: Motion) -> Motion:
    """The motion begun above the world's origin, facing +z."""
    turn = heading_matrix(-headings(motion)[:1])[0]
    q = np.array(motion.q)
    q[:, [0, 2]] -= q[0, [0, 2]]
    q[:, :3] = q[:, :3] @ turn.T
    q[:, 3:6] = rotvec_from_matrix(turn @ matrix_from_rotvec(q[:, 3:6]))
    return make_motion(motion.skeleton, q, motion.rate, motion.name)


def _way(motion: Motion) -> Floats[Array, "frames 2"]:
    return facing_start(motion).q[:, [0, 2]]
