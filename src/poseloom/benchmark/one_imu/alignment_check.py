"""How well sensors are aligned to bones: on virtual sensors whose mounting is known, and on a real walk with cameras.

A virtual wearer stands in the rest pose, then walks as a recorded walk does; the sensor is turned in any way. On the
real walk the cameras' bones and the sensor's own orientations give the mounting: the one rotation, with one turn
between the two worlds, that explains both best (hand-eye calibration by alternating least squares).
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.one_imu.optical import FIRST_ROW, RATE, read_optical_walk
from poseloom.benchmark.one_imu.real_walk import NEURA_SENSORS
from poseloom.calibration.imu_alignment import align_imus
from poseloom.errors import SensorError
from poseloom.evaluation.rows import Row
from poseloom.formats.imus import assemble_imus, read_imu_tracks
from poseloom.rotations import (
    geodesic_angle,
    heading_angle,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_matrix,
    quat_from_rotvec,
)
from poseloom.sensors.layout import imu_layout
from poseloom.sensors.paths import SmoothPath
from poseloom.sensors.placement import default_placements, make_placement
from poseloom.skeleton.differences import angular_velocity
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import interpolate_pose_vectors
from poseloom.synthesis.imus import ImuNoise, simulate_imus

PLACES = ("hips", "right-thigh", "left-thigh", "right-shank", "left-shank", "right-foot", "left-foot")
_STAND_SECONDS, _BLEND_SECONDS = 2.0, 0.5
_SHORTEST_WALK = 4.0
_SLOWEST_M_S, _MOST_TURNING_DEG_S = 0.7, 30.0
_BACKWARDS_DEG = 90.0
_TURNING_HZ = 6.0


class AlignmentError(NamedTuple):
    """How far an alignment is off.

    Attributes:
        tilt_deg: Between the bone's up and what was taken for it.
        heading_deg: About the bone's up, signed.
    """

    tilt_deg: float
    heading_deg: float


def alignment_error(found: Floats[Array, "3 3"], true: Floats[Array, "3 3"]) -> AlignmentError:
    """Tilt and heading of `R_bone_sensor` against the true one."""
    turn = found @ true.T
    heading = math.atan2(turn[0, 2] - turn[2, 0], turn[0, 0] + turn[2, 2])
    return AlignmentError(math.degrees(math.acos(min(1.0, max(-1.0, turn[1, 1])))), math.degrees(heading))


def stand_before(motion: Motion) -> Motion:
    """The motion after two seconds of standing in the rest pose, where and as its first frame stands and faces."""
    still = np.zeros_like(motion.q[0])
    still[:3] = motion.q[0, :3]
    still[4] = float(heading_angle(quat_from_rotvec(motion.q[0, 3:6])))
    count = round(_BLEND_SECONDS * motion.rate)
    share = np.arange(1, count + 1) / (count + 1)
    ends = (np.tile(still, (count, 1)), np.tile(motion.q[0], (count, 1)))
    bridge = interpolate_pose_vectors(*ends, share**2 * (3 - 2 * share))
    stand = np.tile(still, (round(_STAND_SECONDS * motion.rate), 1))
    return make_motion(motion.skeleton, np.concatenate([stand, bridge, motion.q]), motion.rate, motion.name)


def walks_on(motion: Motion) -> bool:
    """Whether someone walks forwards for four seconds or more, at 0.7 m/s or more, turning 30 degrees/s at most."""
    if motion.duration < _SHORTEST_WALK:
        return False
    heading = np.unwrap(heading_angle(quat_from_rotvec(motion.q[:, 3:6])))
    speed = np.diff(motion.q[:, :3], axis=0) * motion.rate
    ahead = speed[:, 0] * np.sin(heading[1:]) + speed[:, 2] * np.cos(heading[1:])
    turning = math.degrees(float(np.ptp(heading))) / motion.duration
    return float(ahead.mean()) >= _SLOWEST_M_S and turning <= _MOST_TURNING_DEG_S


def simulated_alignment(walks: Sequence[Motion], seed: int = 0) -> tuple[Row, ...]:
    """Rows of the table "alignment-simulated": errors by place, over walks as the alignment asks for (`walks_on`).

    The virtual sensors have `ImuNoise`'s errors and sit up to centimetres off; each is turned anyhow.
    """
    asked = [walk for walk in walks if walks_on(walk)]
    rows: list[Row] = []
    for place in PLACES:
        errors: list[AlignmentError] = []
        refused = 0
        for index, walk in enumerate(asked):
            motion = stand_before(walk)
            rng = np.random.default_rng([seed, index])
            quat = rng.normal(size=4)
            turn = matrix_from_quat(quat / np.linalg.norm(quat))
            layout = imu_layout(place)
            (usual,) = default_placements(layout, motion.skeleton)
            shifted = usual.p_bone_sensor + 0.01 * rng.normal(size=3)
            worn = make_placement(usual.bone, shifted, turn)
            noise = ImuNoise(placement_m=0.0, placement_rad=0.0)
            recording = simulate_imus(motion, layout, noise, seed=index, placements=[worn])
            walking = (_STAND_SECONDS + _BLEND_SECONDS, recording.duration)
            try:
                (found,) = align_imus(recording, walking=walking)
            except SensorError:
                refused += 1
                continue
            errors.append(alignment_error(found.R_bone_sensor, turn))
        rows += _rows("alignment-simulated", "standing and walking", place, errors, refused, seed)
    return tuple(rows)


def real_alignment(data: Path) -> tuple[Row, ...]:
    """Rows of the table "alignment-real": S02's sensors against the cameras."""
    folder = data / "imu" / "neura_walk"
    optical = read_optical_walk(folder)
    tracks = read_imu_tracks(folder / "imu")
    rows: list[Row] = []
    for place in PLACES:
        track = tracks[NEURA_SENSORS[place]]
        recording = assemble_imus({place: track})
        (found,) = align_imus(recording)
        quats = track.quats_wxyz[FIRST_ROW : FIRST_ROW + len(optical)]
        bone = recording.layout.sensors[0].bone
        true, left = hand_eye(optical.bones[bone], matrix_from_quat(quats))
        error = alignment_error(found.R_bone_sensor, true)
        rows += _rows("alignment-real", "standing and walking", place, [error], 0, None)
        rows.append(Row("alignment-real", "cameras and sensor", place, "none", "residual_deg", left, sequences=1))
        if place != "hips":
            own = turning_axis_deg(optical.bones[bone])
            rows.append(Row("alignment-real", "cameras", place, "none", "turning_axis_deg", own, sequences=1))
    return tuple(rows)


def turning_axis_deg(bones: Floats[Array, "frames 3 3"]) -> float:
    """Heading, in a bone's own axes, of the level axis about which it turns most, against its axis to the left.

    Alignment can find no other axis than this one: a foot that is turned out by 20 degrees swings straight on.
    """
    turns = np.einsum("nji,nj->ni", bones, angular_velocity(bones, RATE))
    moved = SmoothPath(turns, RATE, _TURNING_HZ).at(np.arange(len(turns), dtype=np.float64))[:, [0, 2]]
    axis = np.linalg.eigh(moved.T @ moved)[1][:, 1]
    axis = axis * np.sign(axis[0])
    return math.degrees(math.atan2(-axis[1], axis[0]))


def hand_eye(
    bones: Floats[Array, "frames 3 3"], sensors: Floats[Array, "frames 3 3"]
) -> tuple[Floats[Array, "3 3"], float]:
    """`R_bone_sensor` from orientations of both, each in a world of its own, and the mean angle left over, degrees.

    Args:
        bones: `R_world_bone`.
        sensors: `R_other_sensor`.
    """
    # Of several starts the best counts: alternating finds the nearest minimum only.
    best = (np.eye(3), math.inf)
    for start in range(4):
        turn = matrix_from_rotvec(np.array([0.0, start * math.pi / 2, 0.0]))
        mounting = _mean_rotation(np.swapaxes(bones, 1, 2) @ turn @ sensors)
        for _ in range(100):
            turn = _mean_rotation(bones @ mounting @ np.swapaxes(sensors, 1, 2))
            mounting = _mean_rotation(np.swapaxes(bones, 1, 2) @ turn @ sensors)
        left = geodesic_angle(quat_from_matrix(bones @ mounting), quat_from_matrix(turn @ sensors))
        residual = math.degrees(float(np.mean(left)))
        if residual < best[1]:
            best = (mounting, residual)
    return best


def _mean_rotation(rotations: Floats[Array, "frames 3 3"]) -> Floats[Array, "3 3"]:
    """The rotation nearest to all (Frobenius)."""
    first, _, second = np.linalg.svd(rotations.mean(axis=0))
    return np.asarray(first @ np.diag([1.0, 1.0, np.linalg.det(first @ second)]) @ second)


def _rows(
    table: str, method: str, place: str, errors: Sequence[AlignmentError], refused: int, seed: int | None
) -> list[Row]:
    if not errors:
        return []
    tilts = np.array([error.tilt_deg for error in errors])
    headings = np.abs([error.heading_deg for error in errors])
    right = headings[headings < _BACKWARDS_DEG]
    count = len(errors)

    def row(metric: str, value: float, spread: float | None = None) -> Row:
        return Row(table, method, place, "none", metric, float(value), spread, sequences=count, seed=seed)

    rows = [row("tilt_deg", tilts.mean(), float(tilts.std()) if count > 1 else None)]
    if right.size:
        rows.append(row("heading_deg", right.mean(), float(right.std()) if count > 1 else None))
        rows.append(row("heading_most_deg", right.max()))
    rows.append(row("backwards", float((headings >= _BACKWARDS_DEG).sum())))
    rows.append(row("refused", float(refused)))
    return rows
