"""From the recording of a guided session to a calibration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints, frozen_float
from poseloom.calibration.body_size import BodySizeModel, body_size_model
from poseloom.calibration.calibration import Calibration, Level, Verdict
from poseloom.calibration.fit import CalibrationFit, fit_calibration, without_lever_bias
from poseloom.calibration.holds import StillReadings, match_in_order, pose_costs, still_readings
from poseloom.calibration.poses import GuidedPose, guided_poses
from poseloom.calibration.screening import (
    axis_verdict,
    expected_positions,
    order_verdict,
    silence_verdicts,
    unit_verdict,
)
from poseloom.calibration.unknowns import CalibrationSettings, HeldPoses
from poseloom.errors import SensorError
from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix
from poseloom.sensors import Recording, SensorKind, make_placement
from poseloom.sensors.layout import SensorLayout
from poseloom.skeleton.body import BODY_BONES, moving_dofs

ROUNDS_SETTING = "guided rounds"
"""Key in a recording's settings of how often the eight poses were held."""

DEFAULT_ROUNDS = 5
"""How often the guide leads through the eight poses: each hold is off by itself, and only repeating them helps."""

_LEAST_HOLDS = 5
_LEAST_SENSORS = 3
_BAD_COST, _BAD_RATIO = 50.0, 3.0
"""A hold whose part of the energy exceeds both this and this many times the median was not the guided pose."""

_SUSPECT_COST = 16.0
"""Mean energy of a hold above which other bones are tried for each sensor; a clean session has about 13."""

_WRONG_BONE_GAIN = 4.0
"""Energy a hold by which another bone must explain a sensor better."""

_NEIGHBOURS = {
    "head": ("upperChest",),
    "upperChest": ("hips", "head"),
    "Hand": ("LowerArm", "UpperArm"),
    "LowerLeg": ("UpperLeg", "Foot"),
}
"""Bones on which a sensor may have been put by mistake, sides left out."""


class _Holds(NamedTuple):
    """Holds matched to poses.

    Attributes:
        held: Readings.
        poses: Index of the guided pose of each.
        rounds: The round of each, from 0.
        windows: Index of the still moment of each.
    """

    held: HeldPoses
    poses: Ints[Array, "holds"]
    rounds: Ints[Array, "holds"]
    windows: Ints[Array, "holds"]

    def keep(self, holds: Bools[Array, "holds"]) -> "_Holds":
        return _Holds(self.held.keep(holds), self.poses[holds], self.rounds[holds], self.windows[holds])


@dataclass(frozen=True, eq=False)
class _Session:
    """A screened session."""

    layout: SensorLayout
    still: StillReadings
    expected: Floats[Array, "poses sensors 3"]
    rounds: int
    guide: tuple[GuidedPose, ...]


def calibrate(
    recording: Recording,
    settings: CalibrationSettings | None = None,
    model: BodySizeModel | None = None,
    rounds: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Calibration:
    """The wearer's sizes and the sensors' placements from the recording of a guided session.

    Args:
        recording: Trackers while the person held the guided poses, in their order; what it says of placements, sizes
            and truth is not looked at.
        settings: Beliefs and effort.
        model: How bodies differ; the one that comes with poseloom unless given.
        rounds: How often the eight poses were held; from the recording's settings, or else from the number of still
            moments.
        progress: Called with what is being done, and how many of how many steps are.

    Returns:
        The calibration, with warnings among its verdicts.

    Raises:
        SensorError: if the session is unusable: other sensors than trackers, positions in another unit or with another
            vertical, exchanged trackers, one on the wrong bone, too few still moments.
    """
    tell = progress or _untold
    how, sizes = settings or CalibrationSettings(), model or body_size_model()
    tell("Calibrating", 0, 4)
    session, verdicts = _screen(recording, rounds)
    holds, missed = _match(session)
    verdicts += missed
    tell("Calibrating", 1, 4)
    fit, holds, wrong = _fit(session, holds, sizes, how)
    verdicts += wrong
    tell("Calibrating", 2, 4)
    bone = _bone_verdict(session.layout, holds, sizes, how, fit)
    if bone is not None:
        raise bone.error()
    tell("Calibrating", 3, 4)
    result = _calibration(session, holds, without_lever_bias(fit), verdicts)
    tell("Calibrating", 4, 4)
    return result


def _untold(what: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


def _screen(recording: Recording, rounds: int | None) -> tuple[_Session, list[Verdict]]:
    layout = recording.layout
    others = [sensor.name for sensor in layout.sensors if sensor.kind is not SensorKind.TRACKER]
    if others:
        raise SensorError(
            f"sensors that are no trackers cannot be calibrated by poses: {', '.join(others)}",
            remedy="Record a layout of trackers, such as six-trackers",
        )
    guide = guided_poses()
    expected = expected_positions(layout, guide)
    unit = unit_verdict(recording, expected)
    if unit is not None:
        raise unit.error()
    still = still_readings(recording)
    if len(still.windows) < _LEAST_HOLDS:
        raise SensorError(
            f"only {len(still.windows)} still moments were found, and {len(guide)} poses were to be held",
            cause="the poses were held too briefly or not still, or this is no recording of a guided session",
            remedy="Hold each pose for two to three seconds, as the page of `poseloom calibrate --guide` leads",
        )
    heard = np.isfinite(still.positions[..., 0]).mean(axis=0) > 0.5
    if heard.sum() < _LEAST_SENSORS:
        names = [name for name, here in zip(layout.names, heard, strict=True) if not here]
        raise SensorError(
            f"too few trackers say anything: silent or stuck are {', '.join(names)}",
            remedy="Check their batteries and pairing, and record the session again",
        )
    axis = axis_verdict(still.positions, expected)
    if axis is not None:
        raise axis.error()
    stated = recording.settings.get(ROUNDS_SETTING, "")
    times = rounds or (int(stated) if stated.isdigit() else 0) or max(1, round(len(still.windows) / len(guide)))
    swapped = order_verdict(layout, still.positions, expected, times)
    if swapped is not None:
        raise swapped.error()
    return _Session(layout, still, expected, times, guide), silence_verdicts(layout, still.positions, still.stuck)


def _match(session: _Session) -> tuple[_Holds, list[Verdict]]:
    """Which still moment is which pose; verdicts for poses without one."""
    still, guide = session.still, session.guide
    costs = pose_costs(still.positions, session.expected)[0]
    found, _ = match_in_order(np.tile(costs, (1, session.rounds)))
    verdicts = [
        _missed(session, int(place), np.flatnonzero(~np.isin(np.arange(len(costs)), found)), costs)
        for place in np.flatnonzero(found < 0)
    ]
    places = np.flatnonzero(found >= 0)
    if len(places) < _LEAST_HOLDS:
        raise SensorError(
            f"only {len(places)} of {len(found)} guided poses were recognised",
            cause="the poses were others or in another order than the guide's, or a tracker is on the wrong bone",
            remedy="Hold the poses in the guide's order, and check which tracker is where",
        )
    poses = places % len(guide)
    guided = np.stack([guide[pose].q for pose in poses])
    windows = found[places]
    held = HeldPoses(guided, still.positions[windows], still.rotations[windows])
    return _Holds(held, poses, places // len(guide), windows), verdicts


def _missed(
    session: _Session, place: int, spare: Ints[Array, "spare"], costs: Floats[Array, "windows poses"]
) -> Verdict:
    guide = session.guide
    pose, turn = guide[place % len(guide)], place // len(guide) + 1
    cause = "it was left out, or not held still"
    if len(spare):
        looks = sorted({guide[int(costs[window].argmin())].title for window in spare})
        cause = f"left over are {len(spare)} still moments that look like: {', '.join(looks)}"
    return Verdict(
        Level.WARNING,
        "missed",
        f"the pose {pose.title!r} was not found{f' in round {turn}' if session.rounds > 1 else ''}",
        cause,
        "The calibration does without it; hold all poses in the guide's order for a better one",
    )


def _fit(
    session: _Session, holds: _Holds, model: BodySizeModel, settings: CalibrationSettings
) -> tuple[CalibrationFit, _Holds, list[Verdict]]:
    """The fit to all holds that fit, and verdicts for those that do not."""
    verdicts: list[Verdict] = []
    fit = fit_calibration(model, session.layout, holds.held, settings)
    while True:
        costs = fit.pose_costs
        bad = costs > max(_BAD_COST, _BAD_RATIO * float(np.median(costs)))
        if not bad.any() or len(holds.poses) - bad.sum() < _LEAST_HOLDS:
            return fit, holds, verdicts
        worst = costs >= 0.7 * costs.max()
        verdicts += [_unlike(session, holds, int(hold)) for hold in np.flatnonzero(bad & worst)]
        holds = holds.keep(~(bad & worst))
        fit = fit_calibration(model, session.layout, holds.held, settings)


def _unlike(session: _Session, holds: _Holds, hold: int) -> Verdict:
    pose = session.guide[int(holds.poses[hold])]
    costs = pose_costs(holds.held.positions[hold : hold + 1], session.expected)[0, 0]
    looks = session.guide[int(costs.argmin())]
    where = f" in round {holds.rounds[hold] + 1}" if session.rounds > 1 else ""
    return Verdict(
        Level.WARNING,
        "missed",
        f"the pose {pose.title!r}{where} does not fit the others",
        f"what was held looks like {looks.title!r}" if looks is not pose else "it was held otherwise than shown",
        "The calibration does without it; hold all poses as shown for a better one",
    )


def _bone_verdict(
    layout: SensorLayout, holds: _Holds, model: BodySizeModel, settings: CalibrationSettings, fit: CalibrationFit
) -> Verdict | None:
    """Whether another bone explains a sensor much better, tried on one round of the poses."""
    if float(fit.pose_costs.mean()) < _SUSPECT_COST:
        return None
    first = np.array([int(np.flatnonzero(holds.poses == pose)[0]) for pose in np.unique(holds.poses)])
    held, quick = holds.held.keep(first), replace(settings, iterations=25)
    usual = float(fit_calibration(model, layout, held, quick).pose_costs.sum())
    gains: dict[tuple[str, str], float] = {}
    for index, sensor in enumerate(layout.sensors):
        side = next((side for side in ("left", "right") if sensor.bone.startswith(side)), "")
        for other in _NEIGHBOURS.get(sensor.bone.removeprefix(side), ()):
            bone = side + other if side else other
            sensors = list(layout.sensors)
            sensors[index] = replace(sensor, bone=bone)
            tried = fit_calibration(model, replace(layout, sensors=tuple(sensors)), held, quick)
            gains[sensor.name, bone] = (usual - float(tried.pose_costs.sum())) / len(held)
    if not gains or max(gains.values()) < _WRONG_BONE_GAIN:
        return None
    name, bone = max(gains, key=lambda each: gains[each])
    worn = layout.sensors[layout.index(name)].bone
    return Verdict(
        Level.UNUSABLE,
        "wrong bone",
        f"tracker {name!r} moves as if it sat on {bone}, not on {worn}",
        "it was strapped to another part of the body than the guide shows",
        f"Strap it to {worn} and hold the poses again",
    )


def _calibration(session: _Session, holds: _Holds, fit: CalibrationFit, verdicts: Sequence[Verdict]) -> Calibration:
    state, sensors = fit.minimum.state, len(session.layout)
    size = fit.problem.model.size
    body = fit.problem.model.body_of(state.coefficients)
    lengths = np.linalg.norm(body.offsets, axis=1)
    directions = body.offsets / np.maximum(lengths, 1e-12)[:, None]
    along = np.einsum("hja,ja->hj", fit.problem.model.components[:, 0], directions)
    covariance = fit.minimum.covariance
    sigmas = np.sqrt(np.einsum("hj,hk,kj->j", along, covariance[:size, :size], along))
    others = np.sqrt(np.diag(covariance)[size:]).reshape(2, sensors, 3)
    linear = fit.problem.linearise(state).residuals.blocks
    how = fit.problem.settings
    apart = np.linalg.norm(linear[:, : 2 * sensors], axis=2).reshape(-1, 2, sensors)
    came = fit.problem.present[:, : 2 * sensors].reshape(-1, 2, sensors)
    scaled = np.where(came, apart * np.array([how.position_m, how.orientation_rad])[:, None], np.nan)
    good = Verdict(Level.GOOD, "good", f"all {len(holds.poses)} held poses agree with one body and one placement")
    return Calibration(
        skeleton=body,
        sensors=session.layout.names,
        placements=tuple(
            make_placement(sensor.bone, place, _orthonormal(turn))
            for sensor, place, turn in zip(
                session.layout.sensors, state.p_bone_sensor, state.R_bone_sensor, strict=True
            )
        ),
        coefficients=frozen_float(state.coefficients),
        lengths=frozen_float(lengths),
        length_sigmas=frozen_float(sigmas),
        offset_sigmas=frozen_float(others[1]),
        turn_sigmas=frozen_float(others[0]),
        poses=tuple(session.guide[int(pose)].name for pose in holds.poses),
        residuals=frozen_float(scaled.swapaxes(1, 2)),
        deviations=frozen_float(_deviations(holds.held.guided, state.q)),
        verdicts=tuple(verdicts) or (good,),
    )


def _orthonormal(turn: Floats[Array, "3 3"]) -> Floats[Array, "3 3"]:
    """The same rotation without what rounding adds over many steps."""
    return matrix_from_rotvec(rotvec_from_matrix(turn))


def _deviations(guided: Floats[Array, "holds dofs"], q: Floats[Array, "holds dofs"]) -> Floats[Array, "holds"]:
    """Root mean square over the body's moving angles, the root left out."""
    count = len(BODY_BONES)
    R_guided, R = (matrix_from_rotvec(each[:, 3:].reshape(len(q), count, 3)) for each in (guided, q))
    apart = rotvec_from_matrix(R_guided.swapaxes(2, 3) @ R)[:, 1:].reshape(len(q), -1)
    return np.asarray(np.sqrt((apart[:, moving_dofs()[6:]] ** 2).mean(axis=1)))
