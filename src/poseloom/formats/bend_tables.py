"""Bench recordings of flex sensors: counts of several sensors over one joint beside the joint's true angle, as CSV."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import decode, read_bytes

_ANGLE = "angle"
_LEAST_ROWS = 500
"""Rows below which nothing can be said of a sensor."""


@dataclass(frozen=True, eq=False)
class BendTable:
    """Counts beside the truth.

    Attributes:
        name: The file's stem.
        person: The stem up to its last underscore: tables of one person share it.
        rate: Rows a second.
        channels: Names of the sensors.
        bends: How far the joint is bent, radians; 0 is straight.
        counts: As converted; tables that were aligned in time hold numbers between two counts too.
    """

    name: str
    person: str
    rate: float
    channels: tuple[str, ...]
    bends: Floats[Array, "rows"]
    counts: Floats[Array, "rows channels"]


def read_bend_tables(folder: Path, rate: float = 50.0) -> list[BendTable]:
    """All tables of a folder, sorted by name; files without an `angle` column and at least one `r...` are passed over.

    Args:
        folder: Holds files `PERSON_NUMBER.csv` with columns `r1`, `r2` ... and `angle`, the inner angle of the joint in
            degrees (180 is straight).
        rate: Rows a second: the files do not say.

    Raises:
        FormatError: if there is no such folder, no such table, or one holds something else than numbers.
    """
    if not folder.is_dir():
        raise FormatError("there is no such folder", remedy="Name the folder with the tables", file=folder)
    tables = [table for path in sorted(folder.glob("*.csv")) if (table := _read(path, rate)) is not None]
    if not tables:
        raise FormatError(
            "no table of flex sensors is here",
            cause="that needs columns r1, r2 ... and angle, and a number after the person: PERSON_1.csv",
            remedy="Name the folder with such CSV files",
            file=folder,
        )
    return tables


def _read(path: Path, rate: float) -> BendTable | None:
    lines = decode(read_bytes(path)).splitlines()
    header = [name.strip() for name in lines[0].split(",")]
    channels = [name for name in header if name[:1] == "r" and name[1:].isdigit()]
    person, _, number = path.stem.rpartition("_")
    if _ANGLE not in header or not channels or not person or not number.isdigit():
        return None
    wanted = [header.index(name) for name in (*channels, _ANGLE)]
    rows: list[list[float]] = []
    for at, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        fields = line.split(",")
        try:
            row = [float(fields[column]) for column in wanted]
        except (ValueError, IndexError):
            row = [math.nan]
        if len(fields) != len(header) or not all(math.isfinite(value) for value in row):
            raise FormatError(
                f"this line does not hold {len(header)} numbers", remedy="Mend or remove it", file=path, line=at
            )
        rows.append(row)
    if len(rows) < _LEAST_ROWS:
        raise FormatError(
            f"the table has {len(rows)} rows", remedy=f"Give at least {_LEAST_ROWS}, or remove the file", file=path
        )
    values = np.array(rows)
    bends = np.radians(np.clip(180.0 - values[:, -1], 0.0, 180.0))
    return BendTable(path.stem, person, rate, tuple(channels), bends, np.ascontiguousarray(values[:, :-1]))
