"""What a calibration finds, how it is kept in a file, and how it is put to use."""

import enum
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, SensorError
from poseloom.formats._files import reading
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.formats.artefact_arrays import ArtefactArrays
from poseloom.formats.recording_header import placements_from_json, placements_to_json
from poseloom.formats.skeleton_json import skeleton_from_json, skeleton_to_json
from poseloom.sensors import Placement, Recording
from poseloom.skeleton.skeleton import Skeleton

KIND, VERSION = "calibration", 1


class Level(enum.StrEnum):
    """How bad a finding is."""

    GOOD = "good"
    WARNING = "warning"
    UNUSABLE = "unusable"


@dataclass(frozen=True)
class Verdict:
    """A finding about a calibration session, in words.

    Attributes:
        level: How bad it is.
        topic: One word for programs, such as "swapped", "missed" or "silent".
        fact: What was found, without a full stop.
        cause: Why, as far as known.
        remedy: What to do.
    """

    level: Level
    topic: str
    fact: str
    cause: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        return " ".join(text.rstrip(".") + "." for text in (self.fact, self.cause, self.remedy) if text)

    def error(self) -> SensorError:
        """The verdict as an error."""
        return SensorError(self.fact, cause=self.cause, remedy=self.remedy)


@dataclass(frozen=True, eq=False)
class Calibration:
    """The wearer's body and where the sensors sit on it.

    Attributes:
        skeleton: The body.
        sensors: Names of the sensors, in the layout's order.
        placements: Where each sits.
        coefficients: Of the body-size model.
        lengths: Length of each bone's offset, in the body's order, metres.
        length_sigmas: Their posterior standard deviations, metres.
        offset_sigmas: Of the sensors' places, metres, in their bones' axes.
        turn_sigmas: Of the sensors' orientations, radians, about their own axes.
        poses: Name of the guided pose of each hold that was used.
        residuals: Measured from predicted, metres and radians, for each hold and sensor; NaN where silent.
        deviations: Root mean square of how far the joints were from each guided pose, radians.
        verdicts: Findings; a good one if there is nothing else to say.
    """

    skeleton: Skeleton
    sensors: tuple[str, ...]
    placements: tuple[Placement, ...]
    coefficients: Floats[Array, "components"]
    lengths: Floats[Array, "joints"]
    length_sigmas: Floats[Array, "joints"]
    offset_sigmas: Floats[Array, "sensors 3"]
    turn_sigmas: Floats[Array, "sensors 3"]
    poses: tuple[str, ...]
    residuals: Floats[Array, "holds sensors 2"]
    deviations: Floats[Array, "holds"]
    verdicts: tuple[Verdict, ...]


_ARRAYS = ("coefficients", "lengths", "length_sigmas", "offset_sigmas", "turn_sigmas", "residuals", "deviations")


def write_calibration(calibration: Calibration, path: str | Path, data_digest: str = "") -> None:
    """Writes a calibration, whole or not at all.

    Raises:
        OSError: where the file cannot be written.
    """
    header: dict[str, Any] = {
        "skeleton": skeleton_to_json(calibration.skeleton),
        "sensors": list(calibration.sensors),
        "placements": placements_to_json(calibration.placements),
        "poses": list(calibration.poses),
        "verdicts": [
            {"level": v.level.value, "topic": v.topic, "fact": v.fact, "cause": v.cause, "remedy": v.remedy}
            for v in calibration.verdicts
        ],
    }
    arrays = {name: getattr(calibration, name) for name in _ARRAYS}
    write_artefact(path, KIND, VERSION, header, arrays, data_digest=data_digest)


def read_calibration(path: str | Path) -> Calibration:
    """Reads a calibration.

    Raises:
        FormatError: where there is no such file, or it is no calibration.
    """
    artefact = read_artefact(path, KIND, VERSION)
    header: Mapping[str, Any] = artefact.header
    with reading(path, "a calibration"):
        skeleton, sensors = skeleton_from_json(header["skeleton"]), tuple(str(name) for name in header["sensors"])
        placements, poses = placements_from_json(header["placements"]), tuple(str(name) for name in header["poses"])
        for placement in placements:
            skeleton.index(placement.bone)
        if len(placements) != len(sensors) or len(set(sensors)) != len(sensors):
            raise FormatError(f"it places {len(placements)} sensors of {len(set(sensors))}")
        verdicts = tuple(
            Verdict(Level(v["level"]), *(str(v[part]) for part in ("topic", "fact", "cause", "remedy")))
            for v in header["verdicts"]
        )
        arrays = ArtefactArrays(artefact.arrays, sensors=len(sensors), joints=len(skeleton), holds=len(poses))
        return Calibration(
            skeleton=skeleton,
            sensors=sensors,
            placements=placements,
            coefficients=arrays.floats("coefficients", _components(artefact.arrays.get("coefficients"))),
            lengths=arrays.floats("lengths", "joints", low=0.0, high=100.0),
            length_sigmas=arrays.floats("length_sigmas", "joints", low=0.0, missing=True),
            offset_sigmas=arrays.floats("offset_sigmas", "sensors 3", low=0.0, missing=True),
            turn_sigmas=arrays.floats("turn_sigmas", "sensors 3", low=0.0, missing=True),
            poses=poses,
            residuals=arrays.floats("residuals", "holds sensors 2", missing=True),
            deviations=arrays.floats("deviations", "holds", low=0.0),
            verdicts=verdicts,
        )


def _components(coefficients: NDArray[Any] | None) -> str:
    """The axis of a calibration's coefficients: there are none where one pose alone was held."""
    return "0" if coefficients is not None and coefficients.shape == (0,) else "components"


def apply_calibration(recording: Recording, calibration: Calibration) -> Recording:
    """The recording with the wearer's body and the sensors' places as calibrated; sensors are matched by name.

    Raises:
        SensorError: if the calibration lacks one of the recording's sensors, or has it on another bone.
    """
    known = dict(zip(calibration.sensors, calibration.placements, strict=True))
    missing = [name for name in recording.layout.names if name not in known]
    if missing:
        raise SensorError(
            f"the calibration has no sensor {', '.join(map(repr, missing))}",
            cause=f"it was made with {', '.join(calibration.sensors)}",
            remedy="Calibrate with the sensors that the recording has",
        )
    for sensor in recording.layout.sensors:
        calibrated = known[sensor.name].bone
        if calibrated != sensor.bone:
            raise SensorError(
                f"sensor {sensor.name!r} is worn on {sensor.bone} in the recording, on {calibrated} in the calibration",
                remedy="Calibrate as the sensors are worn",
            )
    placements = tuple(known[name] for name in recording.layout.names)
    return replace(recording, skeleton=calibration.skeleton, placements=placements)
