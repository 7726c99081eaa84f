"""Text exports of Xsens MT Manager: one file a sensor, comments, column names, then one line a packet.

Separated by commas or tabs. Accelerations in m/s^2 with gravity, angular rates in rad/s, orientation as a quaternion
(scalar first) or as a rotation matrix written column by column (`Mat[2][1]` is row 2, column 1), from the sensor to a
world whose z points up. `PacketCounter` goes from 0 to 65535 and starts again; packets that were lost are missing from
it. Columns may be left out, and `SampleTimeFine` is often empty.
"""

import re
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import decode
from poseloom.formats.imus.tracks import ImuTrack, make_track, quats_from_columns
from poseloom.formats.text_tables import Table, read_table

_WRAP = 65536
_RATE = re.compile(r"Update Rate:\s*([0-9.]+)\s*Hz")
_MATRIX = [f"Mat[{row}][{column}]" for column in (1, 2, 3) for row in (1, 2, 3)]


def is_xsens_text(head: bytes) -> bool:
    """Whether a file begins as such an export does."""
    text = decode(head)
    return text.lstrip().startswith("//") and "PacketCounter" in text


def read_xsens_text(path: Path, rate: float | None = None) -> ImuTrack:
    """Reads one sensor; it is called what stands behind the last underscore of the file's name: its number.

    Args:
        path: The file.
        rate: Packets a second, where the header does not say.

    Raises:
        FormatError: with the line, for a damaged file, one without a rate, or one without a channel of use.
    """
    table = read_table(path)
    stated = next((found.group(1) for line in table.comments if (found := _RATE.search(line))), None)
    pace = rate if rate is not None else float(stated) if stated else None
    if pace is None or pace <= 0:
        raise FormatError(
            "the file does not say how many packets come a second",
            remedy="Name the rate (--source-rate HZ)",
            file=path,
        )
    counter = _unwrapped(table.columns(table.find("PacketCounter"))[:, 0], table)
    known = set(table.names)
    quats = None
    if {"Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"} <= known:
        quats = table.columns(table.find("Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"))
    elif set(_MATRIX) <= known:
        quats = quats_from_columns(table.columns(table.find(*_MATRIX)))
    return make_track(
        path.stem.rpartition("_")[2],
        counter / pace,
        path,
        specific_forces=table.columns(table.find("Acc_X", "Acc_Y", "Acc_Z")) if "Acc_X" in known else None,
        angular_rates=table.columns(table.find("Gyr_X", "Gyr_Y", "Gyr_Z")) if "Gyr_X" in known else None,
        quats_wxyz=quats,
    )


def _unwrapped(counter: Floats[Array, "packets"], table: Table) -> Floats[Array, "packets"]:
    lost = np.flatnonzero(np.isnan(counter))
    if lost.size:
        raise FormatError(
            "this line has no packet counter",
            remedy="Mend or cut out that line",
            file=table.file,
            line=table.lines[int(lost[0])],
        )
    steps = np.diff(counter)
    return counter + _WRAP * np.concatenate([[0.0], np.cumsum(steps < -_WRAP / 2)])
