"""Features of the model: x of the motion and y of the signal (section 4.4 of the single-IMU paper)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats, Floats32, frozen_float
from poseloom.methods.imus.pairs import SignalPair
from poseloom.rotations import (
    heading_angle,
    heading_matrix,
    matrix_from_rotvec,
    quat_from_matrix,
    quat_from_rotvec,
)
from poseloom.skeleton.contacts import contacts
from poseloom.skeleton.retarget import leg_length

_MOST_ROWS = 6000
"""Windows from which principal components are learnt."""


@dataclass(frozen=True, eq=False)
class MotionFeatures:
    """What the model keeps of each frame of a motion, free of ground place and heading.

    Attributes:
        quats_wxyz: Local rotations of all joints; the root's with its heading taken off.
        height: Of the root, in leg lengths.
        way: Root displacement to the next frame in its heading frame (aside, ahead), in leg lengths. The paper's delta
            tau, with the sign that moves forward.
        turn: Change of heading to the next frame, radians.
        standing: Whether left heel, left toes, right heel and right toes stand.
    """

    quats_wxyz: Floats[Array, "frames joints 4"]
    height: Floats[Array, "frames"]
    way: Floats[Array, "frames 2"]
    turn: Floats[Array, "frames"]
    standing: Bools[Array, "frames 4"]


def motion_features(pair: SignalPair) -> MotionFeatures:
    """The features of a pair's motion.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    motion = pair.motion
    heading = np.unwrap(heading_angle(quat_from_rotvec(motion.q[:, 3:6])))
    quats = quat_from_rotvec(motion.rotvecs)
    quats[:, 0] = quat_from_matrix(heading_matrix(-heading) @ matrix_from_rotvec(motion.q[:, 3:6]))
    legs = leg_length(motion.skeleton)
    step = np.diff(motion.q[:, [0, 2]], axis=0, append=motion.q[-1:, [0, 2]])
    step[-1] = step[-2]
    turn = np.diff(heading, append=heading[-1])
    turn[-1] = turn[-2]
    aside = step[:, 0] * np.cos(heading) - step[:, 1] * np.sin(heading)
    ahead = step[:, 0] * np.sin(heading) + step[:, 1] * np.cos(heading)
    stands = contacts(motion)
    return MotionFeatures(
        quats,
        motion.q[:, 1] / legs,
        np.stack([aside, ahead], axis=1) / legs,
        turn,
        np.stack([stands.left_heel, stands.left_toe, stands.right_heel, stands.right_toe], axis=1),
    )


def registered_columns(features: MotionFeatures) -> Floats[Array, "frames columns"]:
    """What segments are warped by: large joints' rotations as the vector parts of their quaternions, and the height."""
    vectors = np.where(features.quats_wxyz[..., :1] < 0, -1.0, 1.0) * features.quats_wxyz[..., 1:]
    return np.concatenate([vectors.reshape(len(vectors), -1), features.height[:, None]], axis=1)


@dataclass(frozen=True, eq=False)
class SignalFeatures:
    """How windows of the signal become the columns that emissions compare. Make one with `fit_signal_features`.

    Attributes:
        scale: By which each channel is divided: see `fit_model`.
        mean: Mean of the scaled windows.
        basis: Directions; the identity where the channels themselves are compared.
    """

    scale: Floats[Array, "channels"]
    mean: Floats[Array, "samples_channels"]
    basis: Floats[Array, "samples_channels columns"]

    @property
    def window(self) -> int:
        """Samples of a window."""
        return len(self.mean) // len(self.scale)

    def of_window(self, samples: Floats[Array, "window channels"]) -> Floats32[Array, "columns"]:
        """Columns of one window, the newest sample last."""
        return (((samples / self.scale).reshape(-1) - self.mean) @ self.basis).astype(np.float32)

    def of_signal(self, signal: Floats[Array, "frames channels"]) -> Floats32[Array, "frames columns"]:
        """Columns of every frame of a signal; before its first sample it is taken to have stood."""
        return ((windows(signal / self.scale, self.window) - self.mean) @ self.basis).astype(np.float32)


def windows(signal: Floats[Array, "frames channels"], length: int) -> Floats[Array, "frames samples_channels"]:
    """The last `length` samples up to each frame, the newest last; the first sample repeats before the start."""
    padded = np.concatenate([np.repeat(signal[:1], length - 1, axis=0), signal])
    return np.concatenate([padded[k : k + len(signal)] for k in range(length)], axis=1)


def fit_signal_features(
    signals: list[NDArray[np.float64]], scale: Floats[Array, "channels"], window: int, columns: int, seed: int
) -> SignalFeatures:
    """Learns principal components from all signals.

    Args:
        signals: One a clip.
        scale: By which each channel is divided.
        window: Samples of a window.
        columns: Principal components; 0 keeps the scaled channels.
        seed: Of the draw of windows.
    """
    width = window * len(scale)
    if columns == 0:
        return SignalFeatures(frozen_float(scale), frozen_float(np.zeros(width)), frozen_float(np.eye(width)))
    rows = np.concatenate([windows(signal / scale, window) for signal in signals])
    if len(rows) > _MOST_ROWS:
        rows = rows[np.sort(np.random.default_rng(seed).choice(len(rows), _MOST_ROWS, replace=False))]
    mean = rows.mean(axis=0)
    _, _, directions = np.linalg.svd(rows - mean, full_matrices=False)
    return SignalFeatures(frozen_float(scale), frozen_float(mean), frozen_float(directions[:columns].T))
