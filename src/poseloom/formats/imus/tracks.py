"""What one inertial sensor wrote down, in poseloom's units, on its own clock."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import FormatError
from poseloom.formats.table_times import usual_step
from poseloom.rotations import quat_from_matrix, quat_multiply

STANDARD_GRAVITY = 9.80665
"""m/s^2 in one g."""

_LARGEST = 1e12
"""Values beyond it are none, in any unit; squares of those below it are finite."""
_Q_YUP_ZUP = np.array([0.5, -0.5, -0.5, -0.5])
"""Turns the world of files, whose z points up, into ours: its (x, y, z) becomes our (y, z, x)."""


@dataclass(frozen=True, eq=False)
class ImuTrack:
    """One sensor's samples as a file has them. Make one with `make_track`, which checks.

    Attributes:
        name: What the file calls the sensor.
        times: Seconds on the sensor's own clock, increasing; samples that were lost leave a gap.
        specific_forces: m/s^2, sensor frame; NaN = missing or not measured.
        angular_rates: rad/s, sensor frame; NaN = missing or not measured.
        quats_wxyz: `R_world_sensor` in a world whose y points up; its heading is the file's own. NaN = not told.
        file: Where it was read.
        notes: What was found out of units, clocks and orders, in words.
    """

    name: str
    times: Floats[Array, "samples"]
    specific_forces: Floats[Array, "samples 3"]
    angular_rates: Floats[Array, "samples 3"]
    quats_wxyz: Floats[Array, "samples 4"]
    file: Path
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.times)

    @property
    def step(self) -> float:
        """Seconds between samples: the median, or a mean where the times are rounded coarsely."""
        return usual_step(self.times)


def make_track(
    name: str,
    times: ArrayLike,
    file: Path,
    *,
    specific_forces: ArrayLike | None = None,
    angular_rates: ArrayLike | None = None,
    quats_wxyz: ArrayLike | None = None,
    notes: Iterable[str] = (),
) -> ImuTrack:
    """Checks and freezes a track. Half-missing vectors count as missing; samples whose time repeats are dropped.

    Args:
        name: The sensor's name.
        times: Seconds.
        file: Where it was read.
        specific_forces: m/s^2, sensor frame.
        angular_rates: rad/s, sensor frame.
        quats_wxyz: Of any length but nought, in a world whose z points up.
        notes: How units, clocks and orders were found.

    Raises:
        FormatError: for fewer than two samples, times that go back, or infinite or impossible numbers.
    """
    moments = np.asarray(times, dtype=np.float64)
    fresh = np.concatenate([[True], np.diff(moments) != 0])
    moments = moments[fresh]
    if len(moments) < 2:
        raise FormatError(
            f"sensor {name!r} has {len(moments)} samples", remedy="Give a recording of two samples or more", file=file
        )
    if not np.isfinite(moments).all() or (np.diff(moments) < 0).any():
        raise FormatError(
            f"the times of sensor {name!r} are missing or go back",
            cause="lines are out of order, or two recordings were joined",
            remedy="Sort the lines, or take the recordings apart",
            file=file,
        )
    columns: list[Floats[Array, "samples _"]] = []
    for values, width in ((specific_forces, 3), (angular_rates, 3), (quats_wxyz, 4)):
        given = np.full((len(fresh), width), np.nan) if values is None else np.array(values, dtype=np.float64)
        column = given[fresh]
        if (np.abs(column) > _LARGEST).any():
            raise FormatError(
                f"sensor {name!r} has an infinite or impossible value", remedy="Mend or cut out that sample", file=file
            )
        column[np.isnan(column).any(axis=1)] = np.nan
        columns.append(column)
    length = np.linalg.norm(columns[2], axis=1, keepdims=True)
    columns[2] = quat_multiply(_Q_YUP_ZUP, columns[2] / np.where(length > 0.1, length, np.nan))
    forces, rates, turned = (frozen_float(column) for column in columns)
    return ImuTrack(name, frozen_float(moments), forces, rates, turned, file, tuple(notes))


def quats_from_columns(cells: Floats[Array, "samples 9"]) -> Floats[Array, "samples 4"]:
    """Quaternions of rotation matrices that are written column by column; NaN where any element is missing."""
    matrices = cells.reshape(-1, 3, 3).swapaxes(1, 2)
    out = np.full((len(cells), 4), np.nan)
    whole = np.isfinite(cells).all(axis=1)
    out[whole] = quat_from_matrix(matrices[whole])
    return out
