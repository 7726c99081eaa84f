"""CSV tables of accelerometers and gyroscopes: gaitmap's, and those of one sensor with its rate in a comment.

gaitmap's have columns `acc_x` ... `gyr_z` in m/s^2 and degrees a second, with the sensors' names in a row above or
without one, sensors and axes in any order, and before them a column that counts samples or tells seconds. The others
begin with a comment `fs=100`, and have `acc_1` ... `gyr_3` in m/s^2 and rad/s and the orientation `ori_1` ... `ori_4`
as a quaternion, scalar first, from the sensor to a world whose z points up.
"""

import re
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats.imus.tables import Table, read_table
from poseloom.formats.imus.tracks import ImuTrack, make_track

_AXES = ("acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z")
_NUMBERED = tuple(f"{kind}_{axis}" for kind in ("acc", "gyr") for axis in (1, 2, 3))
_TURNED = tuple(f"ori_{axis}" for axis in (1, 2, 3, 4))
_RATE = re.compile(r"\bfs=([0-9.]+)")


def is_imu_csv(head: bytes) -> bool:
    """Whether a file begins as one of these tables does."""
    return b"acc_x" in head or (head.startswith(b"//") and b"acc_1" in head)


def read_imu_csv(path: Path, rate: float | None = None) -> tuple[ImuTrack, ...]:
    """Reads all sensors of a table.

    Args:
        path: The file.
        rate: Samples a second, for tables that count samples and do not say it.

    Raises:
        FormatError: with the line, for a damaged file, missing columns, or a rate that is not known.
    """
    with path.open("rb") as stream:
        lines = stream.read(8192).split(b"\n")
    if lines[0].startswith(b"//"):
        return (_read_numbered(path, rate),)
    table = read_table(path, heads=1 if b"acc_x" in lines[0] else 2)
    owners = table.heads[0] if len(table.heads) == 2 else tuple(path.stem for _ in table.names)
    sensors = list(dict.fromkeys(owner for owner, axis in zip(owners, table.names, strict=True) if axis in _AXES))
    times = _times(table, rate)
    return tuple(_sensor(table, owners, sensor, times) for sensor in sensors)


def _sensor(table: Table, owners: tuple[str, ...], sensor: str, times: Floats[Array, "samples"]) -> ImuTrack:
    places: list[int] = []
    for axis in _AXES:
        found = [
            i
            for i, (owner, name) in enumerate(zip(owners, table.names, strict=True))
            if (owner, name) == (sensor, axis)
        ]
        if len(found) != 1:
            raise FormatError(
                f"sensor {sensor!r} has {len(found)} columns {axis!r}",
                remedy=f"Give one of each: {', '.join(_AXES)}",
                file=table.file,
                line=table.first_line - 1,
            )
        places += found
    values = table.columns(places)
    return make_track(sensor, times, table.file, specific_forces=values[:, :3], angular_rates=np.radians(values[:, 3:]))


def _times(table: Table, rate: float | None) -> Floats[Array, "samples"]:
    """Seconds: told by the first column if its steps are no whole numbers, else counted."""
    first = table.columns([0])[:, 0]
    steps = np.diff(first)
    told = np.isfinite(first).all() and table.names[0] not in _AXES and bool((steps > 0).all())
    if told and bool((steps % 1 != 0).any()):
        return first
    if rate is None:
        raise FormatError(
            "the table counts samples, and does not say how many come a second",
            remedy="Name the rate (--source-rate HZ)",
            file=table.file,
        )
    counted = first if told else np.arange(len(first), dtype=np.float64)
    return np.asarray((counted - counted[0]) / rate)


def _read_numbered(path: Path, rate: float | None) -> ImuTrack:
    table = read_table(path)
    stated = next((found.group(1) for line in table.comments if (found := _RATE.search(line))), None)
    pace = rate if rate is not None else float(stated) if stated else None
    if pace is None:
        raise FormatError(
            "the file does not say how many samples come a second", remedy="Name the rate (--source-rate HZ)", file=path
        )
    values = table.columns(table.find(*_NUMBERED))
    return make_track(
        path.stem.rpartition("-")[2],
        np.arange(len(values)) / pace,
        path,
        specific_forces=values[:, :3],
        angular_rates=values[:, 3:],
        quats_wxyz=table.columns(table.find(*_TURNED)) if set(_TURNED) <= set(table.names) else None,
    )
