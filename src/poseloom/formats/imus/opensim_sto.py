"""OpenSim storage files of quaternions (`.sto`): a header, then one line a moment, one orientation a sensor.

Each cell is a quaternion, scalar first, its parts separated by commas, from the sensor to a world whose z points up. It
tells no specific force; the angular rate can be derived from the orientations.
"""

from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import decode, read_bytes, split_lines
from poseloom.formats.imus.tracks import ImuTrack, make_track
from poseloom.formats.table_times import usual_step

_END = "endheader"


def read_sto(path: Path) -> tuple[ImuTrack, ...]:
    """Reads all sensors by their column names.

    Raises:
        FormatError: with the line, for a file of other values than quaternions, or a damaged one.
    """
    lines = [line.rstrip() for line in split_lines(decode(read_bytes(path)))]
    while lines and not lines[-1]:
        lines.pop()
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
    rows = [(end + 3 + i, line) for i, line in enumerate(lines[end + 2 :]) if line]
    times = np.empty(len(rows))
    quats = np.empty((len(rows), len(names), 4))
    for i, (number, line) in enumerate(rows):
        cells = line.split("\t")
        try:
            if len(cells) != len(names) + 1:
                raise ValueError
            times[i] = float(cells[0])
            quats[i] = [[float(part) for part in cell.split(",")] for cell in cells[1:]]
        except ValueError:
            commas = len(cells) == len(names) + 1 and all(cell.count(",") > 3 for cell in cells[1:])
            raise FormatError(
                f"this line does not hold a time and {len(names)} quaternions",
                cause="commas stand between the parts and within the numbers, which cannot be told apart"
                if commas
                else "the file is damaged, or was cut off",
                remedy="Export it with decimal points" if commas else "Mend or cut out that line",
                file=path,
                line=number,
            ) from None
    times, notes = _in_seconds(times)
    return tuple(make_track(name, times, path, quats_wxyz=quats[:, i], notes=notes) for i, name in enumerate(names))


def _in_seconds(times: Floats[Array, "rows"]) -> tuple[Floats[Array, "rows"], list[str]]:
    """Seconds, which the format asks for; milliseconds, and a note, where seconds would make less than one a second."""
    step = usual_step(times)
    if 1.0 <= step <= 250.0:
        return times * 1e-3, [f"time in ms, for it goes up by {step:g} a row: {1000 / step:.4g} samples a second"]
    return times, []
