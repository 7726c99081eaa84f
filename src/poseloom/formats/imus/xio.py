"""Folders that the x-IMU3 software writes: one folder a sensor, in it one CSV file a kind of message.

The folder is called after the sensor's name, its number and how it was connected, such as `Left Foot 64F0EBCE (UDP)`,
blanks included. `Inertial.csv` has microseconds, degrees a second and g; `Quaternion.csv`, if present, the orientation
(scalar first, world z up). Messages of the two kinds come in pairs with the same times, but either may be lost, and the
clocks of the sensors were set together but tick apart.
"""

import re
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.formats.imus.tracks import STANDARD_GRAVITY, ImuTrack, make_track
from poseloom.formats.text_tables import read_table

_INERTIAL, _QUATERNION = "Inertial.csv", "Quaternion.csv"
_FOLDER = re.compile(r"^(?P<name>.+) (?P<serial>[0-9A-F]{8}) \((?P<connection>[^)]+)\)$")
_TIME = "Timestamp (us)"


def is_xio_folder(folder: Path) -> bool:
    """Whether a folder is one sensor's."""
    return (folder / _INERTIAL).is_file()


def read_xio(folder: Path) -> ImuTrack:
    """Reads one sensor, called as in the folder's name without number and connection.

    Raises:
        FormatError: with the line, for damaged files.
    """
    found = _FOLDER.match(folder.name)
    inertial = read_table(folder / _INERTIAL)
    times = inertial.columns(inertial.find(_TIME))[:, 0]
    degrees = inertial.columns(inertial.find(*(f"Gyroscope {axis} (deg/s)" for axis in "XYZ")))
    gs = inertial.columns(inertial.find(*(f"Accelerometer {axis} (g)" for axis in "XYZ")))
    return make_track(
        found["name"] if found else folder.name,
        times * 1e-6,
        folder / _INERTIAL,
        specific_forces=gs * STANDARD_GRAVITY,
        angular_rates=np.radians(degrees),
        quats_wxyz=_quats_at(folder / _QUATERNION, times),
    )


def _quats_at(path: Path, times: Floats[Array, "samples"]) -> Floats[Array, "samples 4"]:
    """Orientations at the moments of inertial messages; NaN where that message was lost."""
    out = np.full((len(times), 4), np.nan)
    if path.is_file():
        table = read_table(path)
        moments = table.columns(table.find(_TIME))[:, 0]
        _, ours, theirs = np.intersect1d(times, moments, return_indices=True)
        out[ours] = table.columns(table.find("W", "X", "Y", "Z"))[theirs]
    return out
