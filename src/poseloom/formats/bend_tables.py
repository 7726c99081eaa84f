"""Bench recordings of flex sensors: counts of several sensors over one joint beside the joint's true angle, as CSV."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import reading
from poseloom.formats.text_tables import Table, read_table

_ANGLE = "angle"
_DISPLACED = "displacement.csv"
_PLACE = ("circular", "lateral")
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
    tables: list[BendTable] = []
    for path in sorted(folder.glob("*.csv")):
        with reading(path, "a table of flex sensors"):
            table = _read(path, rate)
        tables += [] if table is None else [table]
    if not tables:
        raise FormatError(
            "no table of flex sensors is here",
            cause="that needs columns r1, r2 ... and angle, and a number after the person: PERSON_1.csv",
            remedy="Name the folder with such CSV files",
            file=folder,
        )
    return tables


def read_displaced_tables(folder: Path, rate: float = 50.0) -> dict[tuple[float, float], BendTable]:
    """Recordings with the sensors shifted on the joint, by how far: round the limb (degrees) and along it (steps).

    Args:
        folder: May hold `displacement.csv`, with the columns of other tables and `circular` and `lateral`.
        rate: Rows a second.

    Returns:
        Nothing if there is no such file.

    Raises:
        FormatError: if it is not such a table.
    """
    path = folder / _DISPLACED
    if not path.is_file():
        return {}
    with reading(path, "a table of shifted flex sensors"):
        return _read_displaced(path, rate)


def _read_displaced(path: Path, rate: float) -> dict[tuple[float, float], BendTable]:
    table = read_table(path, heads=1)
    header = list(table.names)
    channels = [name for name in header if name[:1] == "r" and name[1:].isdigit()]
    lacking = [name for name in (*_PLACE, _ANGLE) if name not in header]
    if lacking or not channels:
        raise FormatError(
            f"no column {', '.join(lacking) or 'r1'}", remedy="Give r1, r2 ..., angle, circular and lateral", file=path
        )
    values = _numbers(table, [*channels, _ANGLE, *_PLACE])
    bends = np.radians(np.clip(180.0 - values[:, -3], 0.0, 180.0))
    tables: dict[tuple[float, float], BendTable] = {}
    for place in np.unique(values[:, -2:], axis=0):
        rows = (values[:, -2:] == place).all(axis=1)
        key = (float(place[0]), float(place[1]))
        counts = np.ascontiguousarray(values[rows, : len(channels)])
        tables[key] = BendTable(path.stem, path.stem, rate, tuple(channels), bends[rows], counts)
    return tables


def _read(path: Path, rate: float) -> BendTable | None:
    table = read_table(path, heads=1)
    header = list(table.names)
    channels = [name for name in header if name[:1] == "r" and name[1:].isdigit()]
    person, _, number = path.stem.rpartition("_")
    if _ANGLE not in header or not channels or not person or not number.isdigit():
        return None
    values = _numbers(table, [*channels, _ANGLE])
    if len(values) < _LEAST_ROWS:
        raise FormatError(
            f"the table has {len(values)} rows", remedy=f"Give at least {_LEAST_ROWS}, or remove the file", file=path
        )
    bends = np.radians(np.clip(180.0 - values[:, -1], 0.0, 180.0))
    return BendTable(path.stem, person, rate, tuple(channels), bends, np.ascontiguousarray(values[:, :-1]))


def _numbers(table: Table, names: list[str]) -> Floats[Array, "rows columns"]:
    """The columns of these names, as finite numbers."""
    values = table.columns(table.find(*names))
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise FormatError(
            f"this line does not hold {len(table.names)} numbers",
            remedy="Mend or remove it",
            file=table.file,
            line=table.lines[int(bad[0])],
        )
    return values
