"""Real inertial sensors through methods: one walk with optical truth, and others whose cadence the signal tells.

The walk with truth is subject S02's of `neura_walk`: raw packets of Xsens sensors, resampled, aligned to their bones by
standing and walking, and given to a method sample by sample. Nothing optical enters but the lengths of the legs, which
a wearer knows. Compared are the legs: knees and ankles seen from the middle of the hip joints, without the hips'
heading, which no inertial sensor without a magnetometer knows, and the hips' way. (The cameras' toes are markers, not
joints.)
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.one_imu.measures import turned_path_errors_m, way_m
from poseloom.benchmark.one_imu.optical import FIRST_ROW, RATE, OpticalWalk, read_optical_walk
from poseloom.calibration.imu_alignment import align_imus, turn_to_bones
from poseloom.evaluation.rows import Row
from poseloom.formats.imus import assemble_imus, read_imu_tracks
from poseloom.methods.contract import Reconstructor
from poseloom.methods.reconstruction import Reconstruction, reconstruct
from poseloom.rotations import heading_matrix, rotvec_from_matrix
from poseloom.sensors.recording import Recording
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

NEURA_SENSORS: Mapping[str, str] = MappingProxyType(
    {
        "hips": "00B40B91",
        "left-thigh": "00B40C45",
        "right-thigh": "00B40C3C",
        "left-shank": "00B40C44",
        "right-shank": "00B40C47",
        "left-foot": "00B40C55",
        "right-foot": "00B40C48",
    }
)
"""Which sensor S02 wears where: the cut tables beside the raw files repeat their numbers under the bones' names."""

_LEG = ("LowerLeg", "Foot")
_SIDES = ("left", "right")
_HANGING = 1.3
"""Radians by which arms hang from the T-pose."""


@dataclass(frozen=True, eq=False)
class LegPlaces:
    """Joints of both legs from the middle of the hip joints, y up, z where the hips face.

    Attributes:
        joints: Left knee and ankle, then the right ones, metres.
        hips: Left and right hip joint.
    """

    joints: Floats[Array, "frames 4 3"]
    hips: Floats[Array, "frames 2 3"]


def neura_recording(
    data: Path, words: Sequence[str] = ("right-foot",), skeleton: Skeleton | None = None, rate: float = 60.0
) -> Recording:
    """S02's walk as some of its sensors tell it, aligned to the bones, all 25 s of it.

    Args:
        data: The folder of real recordings.
        words: Where the sensors are worn.
        skeleton: The wearer's; one with S02's legs if left out.
        rate: Samples a second.
    """
    folder = data / "imu" / "neura_walk"
    tracks = read_imu_tracks(folder / "imu")
    body = wearer_of(read_optical_walk(folder)) if skeleton is None else skeleton
    recording = assemble_imus(
        {word: tracks[NEURA_SENSORS[word]] for word in words}, rate=rate, skeleton=body, name="neura_walk S02"
    )
    return turn_to_bones(recording, align_imus(recording))


def wearer_of(optical: OpticalWalk) -> Skeleton:
    """The average body with a person's thighs, shanks and hip width."""
    body = average_body()
    offsets = np.array(body.offsets)
    for side in _SIDES:
        for lower in ("LowerLeg", "Foot"):
            upper = "UpperLeg" if lower == "LowerLeg" else "LowerLeg"
            joint = body.index(f"{side}{lower}")
            length = np.mean([optical.length(f"{each}{upper}", f"{each}{lower}") for each in _SIDES])
            offsets[joint] *= length / np.linalg.norm(offsets[joint])
        hip = body.index(f"{side}UpperLeg")
        offsets[hip, 0] *= optical.length("leftUpperLeg", "rightUpperLeg") / (2 * abs(offsets[hip, 0]))
    tips = {name: body.tips[i] for i, name in enumerate(body.names) if np.isfinite(body.tips[i]).all()}
    return make_skeleton(body.names, body.parents, offsets, tips)


def optical_legs(optical: OpticalWalk, rows: Floats[Array, "moments"]) -> LegPlaces:
    """The legs at moments counted in the cameras' frames."""

    def at(name: str) -> Floats[Array, "moments 3"]:
        frames = np.arange(len(optical), dtype=np.float64)
        return np.stack([np.interp(rows, frames, optical.joints[name][:, axis]) for axis in range(3)], axis=1)

    hips = np.stack([at(f"{side}UpperLeg") for side in _SIDES], axis=1)
    # The hips face where their joints say, which needs no convention of axes: to the left of the line, turned.
    across = hips[:, 0] - hips[:, 1]
    return _from_hips(
        np.stack([at(f"{side}{bone}") for side in _SIDES for bone in _LEG], axis=1),
        hips,
        np.arctan2(-across[:, 2], across[:, 0]),
    )


def estimated_legs(motion: Motion) -> LegPlaces:
    """The legs of an estimate, with the heading of the line through its hip joints."""
    names = [motion.skeleton.index(f"{side}{bone}") for side in _SIDES for bone in _LEG]
    places = motion_frames(motion).positions
    hips = places[:, [motion.skeleton.index(f"{side}UpperLeg") for side in _SIDES]]
    across = hips[:, 0] - hips[:, 1]
    return _from_hips(places[:, names], hips, np.arctan2(-across[:, 2], across[:, 0]))


def _from_hips(
    joints: Floats[Array, "frames 4 3"], hips: Floats[Array, "frames 2 3"], heading: Floats[Array, "frames"]
) -> LegPlaces:
    middle = hips.mean(axis=1, keepdims=True)
    back = heading_matrix(-heading)
    return LegPlaces(np.einsum("fij,fbj->fbi", back, joints - middle), np.einsum("fij,fbj->fbi", back, hips - middle))


def optical_motion(optical: OpticalWalk, rows: Floats[Array, "moments"], rate: float = 60.0) -> Motion:
    """The cameras' hips and legs as a motion of the wearer's body, arms hanging, for pictures.

    Args:
        optical: What the cameras saw.
        rows: Moments, counted in the cameras' frames; the nearest frame is shown.
        rate: Of the motion.
    """
    body = wearer_of(optical)
    frames = np.clip(np.rint(rows).astype(np.int64), 0, len(optical) - 1)
    q = np.zeros((len(frames), body.size))
    q[:, :3] = optical.joints["hips"][frames]
    for bone, turns in optical.bones.items():
        joint = body.index(bone)
        parent = body.names[int(body.parents[joint])] if joint else ""
        local = np.swapaxes(optical.bones[parent][frames], 1, 2) @ turns[frames] if parent else turns[frames]
        q[:, 3 + 3 * joint : 6 + 3 * joint] = rotvec_from_matrix(local)
    for side, way in (("left", -1.0), ("right", 1.0)):
        q[:, 3 + 3 * body.index(f"{side}UpperArm") + 2] = way * _HANGING
    # The cameras' middle of the pelvis is another than the body's: the hip joints are laid on the cameras'.
    placed = motion_frames(make_motion(body, q, rate)).positions
    hips = [body.index(f"{side}UpperLeg") for side in _SIDES]
    seen = np.mean([optical.joints[f"{side}UpperLeg"][frames] for side in _SIDES], axis=0)
    q[:, :3] += seen - placed[:, hips].mean(axis=1)
    return make_motion(body, q, rate, "cameras")


def leg_angles_deg(legs: LegPlaces) -> Mapping[str, Floats[Array, "frames 2"]]:
    """Flexion of hips and knees, left and right, degrees, from places of joints alone.

    Hip: how far the thigh swings forwards of the vertical, in the sagittal plane. Knee: between thigh and shank.
    """
    knees, ankles = legs.joints[:, [0, 2]], legs.joints[:, [1, 3]]
    thigh, shank = knees - legs.hips, ankles - knees
    hip = np.arctan2(thigh[..., 2], -thigh[..., 1])
    lengths = np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shank, axis=-1)
    knee = np.arccos(np.clip(np.sum(thigh * shank, axis=-1) / lengths, -1.0, 1.0))
    return MappingProxyType({"hip": np.degrees(hip), "knee": np.degrees(knee)})


def leg_rows(truth: LegPlaces, estimate: LegPlaces, method: str, setting: str) -> tuple[Row, ...]:
    """Distances of joints in cm, and differences of angles in degrees with their correlation over the walk."""
    away = 100 * np.linalg.norm(truth.joints - estimate.joints, axis=-1)
    frames = len(away)

    def row(metric: str, value: float) -> Row:
        return Row("real-walk", method, setting, "by-subject", metric, float(value), sequences=1, frames=frames)

    rows = [row("leg_position_cm", away.mean())]
    rows += [row(f"{bone}_position_cm", away[:, [i, i + 2]].mean()) for i, bone in enumerate(("knee", "ankle"))]
    true, found = leg_angles_deg(truth), leg_angles_deg(estimate)
    for joint in ("hip", "knee"):
        for side, name in enumerate(_SIDES):
            first, second = true[joint][:, side], found[joint][:, side]
            rows.append(row(f"{name}_{joint}_deg", np.abs(first - second).mean()))
            rows.append(
                row(f"{name}_{joint}_deg_without_offset", np.abs(first - second - (first - second).mean()).mean())
            )
            together = np.corrcoef(first, second)[0, 1] if second.std() > 1e-9 else 0.0
            rows.append(row(f"{name}_{joint}_correlation", together))
    return tuple(rows)


def way_rows(truth: Motion, estimate: Motion, method: str, setting: str) -> tuple[Row, ...]:
    """The hips' way over the ground against the cameras', in percent of its length."""
    length = way_m(truth)
    values = (
        ("turned_path_error_percent", float(turned_path_errors_m(truth, estimate)[-1])),
        ("way_length_error_percent", abs(way_m(estimate) - length)),
    )
    return tuple(
        Row("real-walk", method, setting, "by-subject", metric, 100 * value / length, sequences=1, frames=len(truth))
        for metric, value in values
    )


def neura_moments(recording: Recording, reconstruction: Reconstruction) -> tuple[np.ndarray, Floats[Array, "moments"]]:
    """Which frames of a reconstruction the cameras saw, and when in the cameras' frames."""
    rows = recording.times[reconstruction.samples] * RATE - FIRST_ROW
    seen = np.flatnonzero((rows >= 0) & (rows <= 954))
    return seen, rows[seen]


def real_walk(
    data: Path,
    methods: Mapping[str, Callable[[Skeleton], Reconstructor[Any]]],
    words: Sequence[str] = ("right-foot",),
) -> tuple[tuple[Row, ...], Mapping[str, Reconstruction]]:
    """S02's walk through methods, legs compared with the cameras, beside two estimates that hear no sensor.

    Args:
        data: The folder of real recordings.
        methods: What makes each method, by name, from the wearer's skeleton; fitted to the layout of these words.
        words: Where the sensors are worn.

    Returns:
        Rows of the table "real-walk", and what each method made of all 25 s.
    """
    optical = read_optical_walk(data / "imu" / "neura_walk")
    recording = neura_recording(data, words)
    rows: list[Row] = []
    made: dict[str, Reconstruction] = {}
    for name, make in methods.items():
        made[name] = reconstruct(make(recording.skeleton), recording)
        seen, moments = neura_moments(recording, made[name])
        estimate = made[name].motion
        legs = estimated_legs(estimate)
        part = LegPlaces(legs.joints[seen], legs.hips[seen])
        rows += leg_rows(optical_legs(optical, moments), part, name, recording.layout.name)
        seen_by_cameras = optical_motion(optical, moments, estimate.rate)
        rows += way_rows(seen_by_cameras, estimate.cut(int(seen[0]), int(seen[-1]) + 1), name, recording.layout.name)
    moments = np.arange(len(optical), dtype=np.float64)
    truth = optical_legs(optical, moments)
    for name, legs in (("standing still", _standing(optical)), ("mean of the truth itself", _mean(truth))):
        rows += leg_rows(truth, legs, name, "no sensor")
    return tuple(rows), MappingProxyType(made)


def _standing(optical: OpticalWalk) -> LegPlaces:
    """A person with the wearer's legs who stands throughout: what any method must beat."""
    body = wearer_of(optical)
    q = np.zeros((1, body.size))
    legs = estimated_legs(make_motion(body, q, 60.0))
    return LegPlaces(np.repeat(legs.joints, len(optical), axis=0), np.repeat(legs.hips, len(optical), axis=0))


def _mean(truth: LegPlaces) -> LegPlaces:
    """The best still pose there is: it knows the truth."""
    frames = len(truth.joints)
    return LegPlaces(
        np.repeat(truth.joints.mean(axis=0, keepdims=True), frames, axis=0),
        np.repeat(truth.hips.mean(axis=0, keepdims=True), frames, axis=0),
    )
