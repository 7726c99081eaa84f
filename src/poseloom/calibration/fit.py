"""Solving for sizes, placements and held poses."""

from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.calibration.body_size import BodySizeModel
from poseloom.calibration.problem import CalibrationProblem
from poseloom.calibration.soles import sole_model
from poseloom.calibration.unknowns import CalibrationSettings, CalibrationState, HeldPoses
from poseloom.rotations import (
    heading_matrix,
    matrix_from_quat,
    matrix_from_rotvec,
    mean_quat,
    quat_from_matrix,
    rotvec_from_matrix,
)
from poseloom.sensors.layout import SensorLayout
from poseloom.sensors.placement import default_placements
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import BoneFrames, forward_kinematics
from poseloom.solve.least_squares import LeastSquaresSettings, Minimum, marginal_mode, minimise


class CalibrationFit(NamedTuple):
    """A solved problem.

    Attributes:
        problem: What was solved.
        minimum: Its answer.
    """

    problem: CalibrationProblem
    minimum: Minimum[CalibrationState]

    @property
    def pose_costs(self) -> Floats[Array, "holds"]:
        """Each hold's part of the energy, readings and deviation from the guided pose together."""
        return np.asarray(self.minimum.block_costs.sum(axis=1))


def fit_calibration(
    model: BodySizeModel, layout: SensorLayout, held: HeldPoses, settings: CalibrationSettings | None = None
) -> CalibrationFit:
    """The most probable sizes, placements and poses.

    Args:
        model: How bodies differ; cut to the settings' number of components.
        layout: The sensors; each on its bone.
        held: Readings in held poses.
        settings: Beliefs and effort.
    """
    how = settings or CalibrationSettings()
    cut = model.cut(min(how.components, model.size))
    body = average_body()
    usual = np.stack([placement.p_bone_sensor for placement in default_placements(layout, body)])
    bones = np.array([body.index(sensor.bone) for sensor in layout.sensors], dtype=np.int64)
    problem = CalibrationProblem(cut, sole_model(cut), held, bones, usual, how)
    minimum = minimise(problem, _start(problem), LeastSquaresSettings(how.iterations))
    return CalibrationFit(problem, minimum)


def without_lever_bias(fit: CalibrationFit) -> CalibrationFit:
    """The fit with the poses integrated out, so that lengths are not drawn towards those that explain most."""
    size, sensors = fit.problem.model.size, len(fit.problem.bones)
    lengths = np.concatenate([np.arange(size), size + 3 * sensors + np.arange(3 * sensors)])
    return CalibrationFit(fit.problem, marginal_mode(fit.problem, fit.minimum, lengths))


def _start(problem: CalibrationProblem) -> CalibrationState:
    """Mean body, usual offsets, guided poses laid under the measured positions, and the sensors' turns that follow."""
    body = problem.model.body_of(np.zeros(problem.model.size))
    q = problem.held.guided.copy()
    R_bone_sensor: list[Floats[Array, "sensors 3 3"]] = []
    for hold, pose in enumerate(q):
        frames = forward_kinematics(body, pose)
        _lay_under(pose, frames, problem, hold)
        R_world_bone = forward_kinematics(body, pose).rotations[problem.bones]
        R_bone_sensor.append(R_world_bone.swapaxes(1, 2) @ problem.held.rotations[hold])
    return CalibrationState(
        np.zeros(problem.model.size),
        np.stack([_mean_rotation(turns) for turns in np.stack(R_bone_sensor, axis=1)]),
        problem.usual_offsets.copy(),
        q,
    )


def _lay_under(q: Floats[Array, "dofs"], frames: BoneFrames, problem: CalibrationProblem, hold: int) -> None:
    """Turns a pose about the vertical and shifts it so that its sensors come nearest to the measured positions."""
    turns = frames.rotations[problem.bones]
    places = frames.positions[problem.bones] + np.einsum("sij,sj->si", turns, problem.usual_offsets)
    measured = problem.held.positions[hold]
    came = np.isfinite(measured[:, 0])
    if not came.any():
        return
    to, of = measured[came].mean(axis=0), places[came].mean(axis=0)
    a, b = places[came] - of, measured[came] - to
    heading = np.arctan2((a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]).sum(), (a[:, 0] * b[:, 0] + a[:, 2] * b[:, 2]).sum())
    R = heading_matrix(np.asarray(heading))
    q[:3] = to + R @ (q[:3] - of)
    q[3:6] = rotvec_from_matrix(R @ matrix_from_rotvec(q[3:6]))


def _mean_rotation(turns: Floats[Array, "holds 3 3"]) -> Floats[Array, "3 3"]:
    came = np.isfinite(turns).all(axis=(1, 2))
    if not came.any():
        return np.eye(3)
    quats = quat_from_matrix(turns[came])
    # Twice, the second time without what is far off: one pose held wrongly must not turn the sensor.
    near = np.abs(quats @ mean_quat(quats, np.ones(len(quats))))
    return matrix_from_quat(mean_quat(quats, (near >= np.median(near)).astype(np.float64)))
