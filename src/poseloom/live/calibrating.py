"""Calibration within a session: who leads through the poses, and what is made of what the sensors said."""

from collections.abc import Sequence

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.calibration.calibration import Calibration, Level, Verdict
from poseloom.calibration.poses import GuidedPose, guided_poses
from poseloom.calibration.session import calibrate
from poseloom.errors import SensorError
from poseloom.live.contract import Calibrate, CalibrationKind, CalibrationProgress
from poseloom.rotations import heading_matrix, matrix_from_quat, mean_quat
from poseloom.sensors import (
    Recording,
    Sample,
    SensorKind,
    SensorLayout,
    default_placements,
    make_placement,
    make_recording,
    place_sensors,
)
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.skeleton.skeleton import Skeleton

_FIRST_READY, _READY, _HOLD = 5.0, 3.0, 3.0
"""Seconds to get ready for the first pose and the others, and to hold each."""
_SMALLEST, _LARGEST = 0.6, 1.35
"""Sizes of people beside the average body's."""
_LEAST_SAMPLES = 10


class CalibrationRun:
    """Leads through the poses by the samples' times, and gathers the samples.

    Args:
        command: Which calibration.
        layout: The sensors.
        began: Session time, seconds.

    Raises:
        SensorError: if the layout's sensors cannot be calibrated by poses.
    """

    def __init__(self, command: Calibrate, layout: SensorLayout, began: float) -> None:
        others = [sensor.name for sensor in layout.sensors if sensor.kind is not SensorKind.TRACKER]
        if others:
            raise SensorError(
                f"sensors that are no trackers cannot be calibrated by poses: {', '.join(others)}",
                remedy="Use a layout of trackers, such as six-trackers",
            )
        self.command, self.layout = command, layout
        guide = guided_poses()
        guided = command.kind is CalibrationKind.GUIDED
        self._poses: tuple[GuidedPose, ...] = guide * max(command.rounds, 1) if guided else guide[:1]
        self._began = began
        self._samples: list[Sample] = []
        self.computing = False

    def hear(self, sample: Sample) -> None:
        """Takes in a sample, as it came."""
        held = self.command.kind is CalibrationKind.GUIDED or self.progress(sample.time).phase == "hold"
        if held:
            self._samples.append(sample)

    def is_over(self, time: float) -> bool:
        """Whether all poses have been held."""
        return self.progress(time).phase == "computing"

    def progress(self, time: float) -> CalibrationProgress:
        """Where it stands at a session time."""
        left, count = time - self._began, len(self._poses)
        for step, pose in enumerate(self._poses, start=1):
            for phase, length in (("get ready", _READY if step > 1 else _FIRST_READY), ("hold", _HOLD)):
                if left < length:
                    return CalibrationProgress(
                        pose.title, pose.instruction, pose.name, phase, length - left, step, count
                    )
                left -= length
        return CalibrationProgress("Computing", "You can move again.", "", "computing", 0.0, count, count)

    def result(self) -> Calibration:
        """The calibration; takes a moment, and may run in any thread.

        Raises:
            SensorError: if what was said does not do, in words for the person.
        """
        if self.command.kind is CalibrationKind.ARMS_OUT:
            return arms_out_calibration(self._samples, self.layout)
        if len(self._samples) < _LEAST_SAMPLES:
            raise SensorError("hardly anything was heard", remedy="Check that the sensors are on, and begin anew")
        return calibrate(_recording(self._samples, self.layout), rounds=self.command.rounds)


def arms_out_calibration(samples: Sequence[Sample], layout: SensorLayout) -> Calibration:
    """How each tracker is turned on its bone, and the wearer's height, from standing with the arms out.

    Each bone then is as at rest, turned about the vertical by the wearer's heading: from that and the trackers'
    orientations follow the placements' turns. The heading is told by where the hands are, or else by the head. Sizes
    are the average body's, times the head's height beside its. Places on the bones stay those of `default_placements`:
    the guided poses find them, one pose does not.

    Raises:
        SensorError: if a tracker was not heard, did not keep still, or the pose was clearly another.
    """
    if len(samples) < _LEAST_SAMPLES:
        raise SensorError("hardly anything was heard", remedy="Check that the sensors are on, and begin anew")
    places = np.stack([sample.positions for sample in samples])
    quats = np.stack([sample.quats_wxyz for sample in samples])
    _check_heard(places, quats, layout)
    mean = np.nanmedian(places, axis=0)
    turns = np.stack([_mean_turn(quats[:, sensor]) for sensor in range(len(layout))])
    heading = _heading(mean, turns, layout)
    skeleton, scale = _scaled(mean, layout)
    R_body_world = heading_matrix(np.asarray(heading)).T
    placements = tuple(
        make_placement(placement.bone, placement.p_bone_sensor, R_body_world @ turn)
        for placement, turn in zip(default_placements(layout, skeleton), turns, strict=True)
    )
    count = len(layout)
    verdict = Verdict(
        Level.GOOD, "arms-out", f"the trackers' turns were found, and a height of {scale:.0%} of the average"
    )
    return Calibration(
        skeleton=skeleton,
        sensors=layout.names,
        placements=placements,
        coefficients=np.zeros(0),
        lengths=np.linalg.norm(skeleton.offsets, axis=-1),
        length_sigmas=np.full(len(skeleton), np.nan),
        offset_sigmas=np.full((count, 3), np.nan),
        turn_sigmas=np.full((count, 3), np.nan),
        poses=(guided_poses()[0].name,),
        residuals=np.full((1, count, 2), np.nan),
        deviations=np.zeros(1),
        verdicts=(verdict,),
    )


def _check_heard(
    places: Floats[Array, "samples sensors 3"], quats: Floats[Array, "samples sensors 4"], layout: SensorLayout
) -> None:
    heard = np.isfinite(places[..., 0]) & np.isfinite(quats[..., 0])
    silent = [name for name, share in zip(layout.names, heard.mean(axis=0), strict=True) if share < 0.5]
    if silent:
        raise SensorError(
            f"not heard while the pose was held: {', '.join(silent)}",
            remedy="Check their batteries and what they can see, and begin anew",
        )
    moved = np.nanstd(places, axis=0).max(axis=-1)
    restless = [name for name, by in zip(layout.names, moved, strict=True) if by > 0.05]
    if restless:
        raise SensorError(f"these moved: {', '.join(restless)}", remedy="Hold the pose still, and begin anew")


def _mean_turn(quats: Floats[Array, "samples 4"]) -> Floats[Array, "3 3"]:
    said = quats[np.isfinite(quats[:, 0])]
    return matrix_from_quat(mean_quat(said, np.ones(len(said))))


def _heading(mean: Floats[Array, "sensors 3"], turns: Floats[Array, "sensors 3 3"], layout: SensorLayout) -> float:
    """Which way the wearer faces, radians about the vertical."""
    bones = {sensor.bone: index for index, sensor in enumerate(layout.sensors)}
    if "leftHand" in bones and "rightHand" in bones:
        across = mean[bones["leftHand"]] - mean[bones["rightHand"]]
        if np.hypot(across[0], across[2]) < 0.6:
            raise SensorError("the hands were not out to the sides", remedy="Stretch both arms out, and begin anew")
        return float(np.arctan2(-across[2], across[0]))
    reference = next((bones[bone] for bone in ("head", "upperChest", "hips") if bone in bones), 0)
    forward = turns[reference] @ np.array([0.0, 0.0, 1.0])
    return float(np.arctan2(forward[0], forward[2]))


def _scaled(mean: Floats[Array, "sensors 3"], layout: SensorLayout) -> tuple[Skeleton, float]:
    """The average body at the wearer's height, and how many times the average's that is."""
    body = average_body()
    bones = {sensor.bone: index for index, sensor in enumerate(layout.sensors)}
    if "head" not in bones:
        return body, 1.0
    head = bones["head"]
    standing = forward_kinematics(body, guided_poses()[0].q)
    expected = float(place_sensors(standing, body, default_placements(layout, body)).positions[head, 1])
    scale = float(mean[head, 1]) / expected
    if not _SMALLEST < scale < _LARGEST:
        raise SensorError(
            f"the head was {mean[head, 1]:.2f} m above the floor",
            cause="the floor of the sensors' world is not at height 0, or positions are not in metres",
            remedy="Set up the room's floor in the program that sends the positions",
        )
    return body.with_offsets(body.offsets * scale, body.tips * scale), scale


def _recording(samples: Sequence[Sample], layout: SensorLayout) -> Recording:
    body = average_body()
    return make_recording(
        layout,
        default_placements(layout, body),
        body,
        np.array([sample.time for sample in samples]),
        positions=np.stack([sample.positions for sample in samples]),
        quats_wxyz=np.stack([sample.quats_wxyz for sample in samples]),
    )
