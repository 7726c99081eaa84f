"""MVNX, the XML export of Xsens MVN: what its motion trackers say.

Orientations are quaternions, scalar first, from the sensor to a world whose z points up; `sensorFreeAcceleration` is in
that world, without gravity, so the specific force is `R^T (a - g)`. There is no gyroscope channel: the angular rate is
the derivative of the orientation. Only frames of the type `normal` are motion. Times are rounded to milliseconds; the
frame's index divided by the frame rate is exact.
"""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import read_bytes
from poseloom.formats.imus.tracks import STANDARD_GRAVITY, ImuTrack, make_track
from poseloom.rotations import matrix_from_quat

_FRAME = "frame"
_ORIENTATION, _FREE = "sensorOrientation", "sensorFreeAcceleration"
_SLOWEST, _FASTEST = 1.0, 10_000.0


def read_mvnx(path: Path) -> tuple[ImuTrack, ...]:
    """Reads all trackers, by their labels (Pelvis, T8, RightHand ...).

    Raises:
        FormatError: with the line, for damaged XML; for a file without trackers, without one of the two fields
            (the message says which), or with a frame rate that no recording has; for a frame with another number of
            values.
    """
    content = read_bytes(path)
    if b"<!ENTITY" in content:
        raise FormatError("the file defines entities of its own", remedy="Export it again from MVN", file=path)
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        line = error.position[0]
        raise FormatError(
            "this is no whole XML file",
            cause=str(error),
            remedy="Export it again from MVN; its copy may have been cut off",
            file=path,
            line=line,
        ) from None
    space = found.group(0) if (found := re.match(r"\{.*\}", root.tag)) else ""
    names = [sensor.get("label", "") for sensor in root.iter(f"{space}sensor")]
    subject = next(root.iter(f"{space}subject"), None)
    frames = [frame for frame in root.iter(f"{space}{_FRAME}") if frame.get("type") == "normal"]
    if subject is None or not names or not frames:
        raise FormatError(
            "this file holds no motion trackers",
            cause="it has no list of sensors, or no normal frame",
            remedy="Export it from MVN with sensor data",
            file=path,
        )
    rate = _number(subject.get("frameRate"), "frameRate", path)
    if not _SLOWEST <= rate <= _FASTEST:
        raise FormatError(
            f"the frameRate is {subject.get('frameRate')!r}",
            cause=f"no recording has it: {_SLOWEST:g} to {_FASTEST:g} frames a second are read",
            remedy="Export the file again from MVN",
            file=path,
        )
    _check_fields(frames, space, path)
    places = np.array([_number(frame.get("index"), "index of a frame", path) for frame in frames])
    quats = _values(frames, f"{space}{_ORIENTATION}", 4 * len(names), path).reshape(len(frames), -1, 4)
    free = _values(frames, f"{space}{_FREE}", 3 * len(names), path).reshape(len(frames), -1, 3)
    felt = np.einsum("fsji,fsj->fsi", matrix_from_quat(quats), free + np.array([0.0, 0.0, STANDARD_GRAVITY]))
    return tuple(
        make_track(name, places / rate, path, specific_forces=felt[:, i], quats_wxyz=quats[:, i])
        for i, name in enumerate(names)
    )


def _check_fields(frames: list[ElementTree.Element], space: str, path: Path) -> None:
    """Raises where no frame has one of the fields that are needed, and says which are there."""
    absent = [
        field for field in (_ORIENTATION, _FREE) if all(frame.find(f"{space}{field}") is None for frame in frames)
    ]
    if absent:
        there = sorted({part.tag.removeprefix(space) for part in frames[0]})
        raise FormatError(
            f"no frame has the field {' or '.join(absent)}",
            cause=f"it was left out at the export; the fields are {', '.join(there)[:200] or 'none'}",
            remedy=f"Export the file again from MVN with {' and '.join(absent)} (sensor data) chosen",
            file=path,
        )


def _number(text: str | None, what: str, path: Path) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or value < 0:
        raise FormatError(f"the {what} is {text!r}", remedy="Export the file again from MVN", file=path)
    return value


def _values(frames: list[ElementTree.Element], tag: str, count: int, path: Path) -> Floats[Array, "frames values"]:
    out = np.empty((len(frames), count))
    for i, frame in enumerate(frames):
        cells = (frame.findtext(tag) or "").split()
        try:
            numbers = [float(cell) for cell in cells]
        except ValueError:
            numbers = []
        if len(numbers) != count:
            raise FormatError(
                f"frame {frame.get('index')} has {len(cells)} values of {tag.rpartition('}')[2]}, not {count} numbers",
                remedy="Export it from MVN with sensor data",
                file=path,
            )
        out[i] = numbers
    return out
