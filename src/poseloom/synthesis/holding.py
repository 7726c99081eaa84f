"""A person who holds poses one after another, as in calibration: never exactly, never quite still."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Floats
from poseloom.errors import SensorError
from poseloom.formats.recording_header import placements_to_json
from poseloom.rotations import matrix_from_quat, matrix_from_rotvec, rotvec_from_matrix, unwrap_rotvec
from poseloom.sensors.layout import SensorLayout
from poseloom.sensors.placement import Placement, default_placements, make_placement
from poseloom.sensors.recording import Recording
from poseloom.skeleton.body import average_body, moving_dofs
from poseloom.skeleton.contacts import sole_positions
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors
from poseloom.skeleton.skeleton import Skeleton
from poseloom.synthesis.faults import Fault
from poseloom.synthesis.noise import Streams, TrackerNoise
from poseloom.synthesis.trackers import simulate_trackers
from poseloom.synthesis.wearing import TRUE_PLACEMENTS


@dataclass(frozen=True)
class HoldingStyle:
    """How a person holds poses.

    Attributes:
        pose_rad: Standard deviation of each moving joint angle about the pose asked for; drawn anew for each hold. The
            root tilts by as much.
        heading_rad: Of the way the person faces.
        place_m: Of where the person stands.
        sway_rad: Of what each moving joint angle does during a hold, slowly.
        hold_s: Seconds of a hold.
        move_s: Seconds of the way from one pose to the next.
    """

    pose_rad: float = math.radians(7.0)
    heading_rad: float = math.radians(10.0)
    place_m: float = 0.05
    sway_rad: float = math.radians(0.3)
    hold_s: float = 2.5
    move_s: float = 1.5


_SWAY_SECONDS = 1.0
"""Time over which sway is smoothed."""


def hold_poses(
    skeleton: Skeleton,
    poses: Floats[Array, "holds dofs"],
    style: HoldingStyle = HoldingStyle(),
    rate: float = 40.0,
    seed: int | Generator = 0,
    name: str = "held poses",
) -> Motion:
    """Moves a body through poses, holding each for a while; its lowest sole is always at y = 0.

    Args:
        skeleton: The person's body.
        poses: Pose vectors, in order.
        style: How exactly and how long.
        rate: Frames a second.
        seed: Number or generator for all that is drawn.
        name: What to call the motion.

    Raises:
        SensorError: for a style that makes no sense.
    """
    for each in fields(style):
        value = getattr(style, each.name)
        if not (math.isfinite(value) and value >= 0) or (value == 0 and each.name.endswith("_s")):
            raise SensorError(f"the holding style's {each.name} is {value}", remedy="Give a finite, positive number")
    streams = Streams(seed)
    held = _draw_holds(poses, style, streams)
    hold, move = max(1, round(style.hold_s * rate)), max(1, round(style.move_s * rate))
    frames: list[Floats[Array, "frames dofs"]] = []
    for i, q in enumerate(held):
        frames.append(np.tile(q, (hold, 1)))
        if i + 1 < len(held):
            way = (np.arange(move) + 1.0) / (move + 1.0)
            eased = way**2 * (3 - 2 * way)
            ends = (np.tile(q, (move, 1)), np.tile(held[i + 1], (move, 1)))
            frames.append(interpolate_pose_vectors(*ends, eased))
    q = np.concatenate(frames)
    sway = _sway((len(q), q.shape[1] - 3), style.sway_rad, rate, streams)
    q[:, 3:] += np.where(moving_dofs()[3:], sway, 0.0)
    q[:, 3:] = unwrap_rotvec(q[:, 3:].reshape(len(q), -1, 3)).reshape(len(q), -1)
    q[:, 1] -= sole_positions(make_motion(skeleton, q, rate, name))[..., 1].min(axis=1)
    return make_motion(skeleton, q, rate, name)


def hold_times(holds: int, style: HoldingStyle) -> Floats[Array, "holds 2"]:
    """Seconds at which each hold of `hold_poses` begins and ends."""
    begins = np.arange(holds) * (style.hold_s + style.move_s)
    return np.stack([begins, begins + style.hold_s], axis=1)


def _draw_holds(
    poses: Floats[Array, "holds dofs"], style: HoldingStyle, streams: Streams
) -> Floats[Array, "holds dofs"]:
    count = len(poses)
    errors = style.pose_rad * streams.stream("pose").normal(size=(count, poses.shape[1] - 3))
    errors[:, ~moving_dofs()[3:]] = 0.0
    errors[:, 1] = 0.0
    turned = matrix_from_rotvec(poses[:, 3:].reshape(count, -1, 3)) @ matrix_from_rotvec(errors.reshape(count, -1, 3))
    headings = style.heading_rad * streams.stream("heading").normal(size=count)
    turned[:, 0] = matrix_from_rotvec(headings[:, None] * np.array([0.0, 1.0, 0.0])) @ turned[:, 0]
    held = poses.copy()
    held[:, 3:] = rotvec_from_matrix(turned).reshape(count, -1)
    held[:, [0, 2]] = style.place_m * streams.stream("place").normal(size=(count, 2))
    return held


def _sway(shape: tuple[int, int], size: float, rate: float, streams: Streams) -> Floats[Array, "frames angles"]:
    """Smooth noise of a standard deviation: white noise under a Gaussian window."""
    reach = max(1, round(_SWAY_SECONDS * rate))
    window = np.exp(-0.5 * (np.arange(-2 * reach, 2 * reach + 1) / (0.5 * reach)) ** 2)
    window /= np.linalg.norm(window)
    white = streams.stream("sway").normal(size=(shape[0] + len(window) - 1, shape[1]))
    spectrum = np.fft.rfft(white, axis=0) * np.fft.rfft(window, len(white))[:, None]
    return size * np.fft.irfft(spectrum, len(white), axis=0)[len(window) - 1 :]


def simulate_session(
    skeleton: Skeleton,
    poses: Floats[Array, "holds dofs"],
    layout: SensorLayout,
    noise: TrackerNoise = TrackerNoise(),  # noqa: B008 - frozen
    faults: Sequence[Fault] = (),
    style: HoldingStyle = HoldingStyle(),
    placement_m: float = 0.02,
    seed: int | Generator = 0,
    name: str = "calibration",
    settings: Mapping[str, str] | None = None,
) -> Recording:
    """A calibration session: a person of unknown size, with trackers strapped on anyhow, holds poses.

    Args:
        skeleton: The person's body.
        poses: Pose vectors that are asked for, in order.
        layout: Trackers only.
        noise: Their errors.
        faults: What goes wrong in addition.
        style: How the poses are held.
        placement_m: Standard deviation, on each axis, of a tracker's place about the default one. It is turned anyhow.
        seed: Number or generator for all that is drawn.
        name: What to call the recording.
        settings: To be added to the recording's.

    Returns:
        The recording, as if uncalibrated: its skeleton is the average body and its placements are the default ones. The
        truth moves the person's own body; `true_placements` tells where the trackers really sat.

    Raises:
        SensorError: if a parameter makes no sense.
    """
    streams = Streams(seed)
    motion = hold_poses(skeleton, poses, style, layout.rate, int(streams.stream("holds").integers(2**31)), name)
    worn: list[Placement] = []
    for sensor, usual in zip(layout.names, default_placements(layout, skeleton), strict=True):
        stream = streams.stream(sensor, "strap")
        quat = stream.normal(size=4)
        turn = matrix_from_quat(quat / np.linalg.norm(quat))
        worn.append(make_placement(usual.bone, usual.p_bone_sensor + placement_m * stream.normal(size=3), turn))
    recording = simulate_trackers(motion, layout, noise, faults, streams.seed, worn)
    told = {"made by": "simulate_session", TRUE_PLACEMENTS: json.dumps(placements_to_json(worn))}
    body = average_body()
    return replace(
        recording,
        skeleton=body,
        placements=default_placements(layout, body),
        settings=MappingProxyType({**recording.settings, **told, **(settings or {})}),
    )
