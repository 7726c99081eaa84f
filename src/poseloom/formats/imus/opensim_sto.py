"""OpenSim storage files of quaternions (`.sto`): a header, then one line a moment, one orientation a sensor.

Each cell is a quaternion, scalar first, its parts separated by commas, from the sensor to a world whose z points up. It
tells no specific force; the angular rate can be derived from the orientations.
"""

from pathlib import Path

import numpy as np

from poseloom.errors import FormatError
from poseloom.formats._files import decode, read_bytes
from poseloom.formats.imus.tracks import ImuTrack, make_track

_END = "endheader"


def read_sto(path: Path) -> tuple[ImuTrack, ...]:
    """Reads all sensors by their column names.

    Raises:
        FormatError: with the line, for a file of other values than quaternions, or a damaged one.
    """
    lines = decode(read_bytes(path)).splitlines()
    end = next((i for i, line in enumerate(lines) if line.strip() == _END), None)
    if end is None or len(lines) < end + 3:
        raise FormatError("this storage file has no header, or no line after it", remedy="Export it again", file=path)
    if not any(line.replace(" ", "") == "DataType=Quaternion" for line in lines[:end]):
        raise FormatError(
            "this storage file holds no quaternions",
            cause="its header lacks DataType=Quaternion",
            remedy="Export orientations of sensors",
            file=path,
        )
    names = lines[end + 1].split("\t")[1:]
    times = np.empty(len(lines) - end - 2)
    quats = np.empty((len(times), len(names), 4))
    for i, line in enumerate(lines[end + 2 :]):
        cells = line.split("\t")
        try:
            if len(cells) != len(names) + 1:
                raise ValueError
            times[i] = float(cells[0])
            quats[i] = [[float(part) for part in cell.split(",")] for cell in cells[1:]]
        except ValueError:
            raise FormatError(
                f"this line does not hold a time and {len(names)} quaternions",
                cause="the file is damaged, or was cut off",
                remedy="Mend or cut out that line",
                file=path,
                line=end + 3 + i,
            ) from None
    return tuple(make_track(name, times, path, quats_wxyz=quats[:, i]) for i, name in enumerate(names))
