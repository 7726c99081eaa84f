"""Which columns of a table belong to which inertial sensor: out of header rows, or as a column map says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from poseloom.errors import FormatError
from poseloom.formats.column_map import ColumnMap
from poseloom.formats.column_names import FORCE, OTHER, POSITION, QUAT, RATE, Column, read_column_name, unit_of
from poseloom.formats.text_tables import Table

LABELS: Mapping[str, str] = {FORCE: "acc", RATE: "gyr", QUAT: "quat"}
_OWNED = (*LABELS, POSITION)
"""Quantities that belong to one sensor."""
_AXES = (("x", "y", "z"), ("1", "2", "3"), ("0", "1", "2"))
_QUAT_AXES = (("w", "x", "y", "z"), ("0", "1", "2", "3"), ("1", "2", "3", "4"))
_MAPPED = {"acceleration": FORCE, "angular_rate": RATE, "quaternion": QUAT}


@dataclass
class SensorColumns:
    """Places of one sensor's columns.

    Attributes:
        name: The sensor's name; empty where the table does not say one.
        force: Three places, or none.
        rate: Three places, or none.
        quat: Four places, or none, in the order of the names w, x, y, z or of their numbers.
        quat_order: "wxyz" where the names say it; empty where they are numbered.
        linear: Whether the names say that gravity was taken off.
        units: By quantity, the units that names say.
    """

    name: str
    force: list[int] = field(default_factory=list[int])
    rate: list[int] = field(default_factory=list[int])
    quat: list[int] = field(default_factory=list[int])
    quat_order: str = ""
    linear: bool = False
    units: dict[str, str] = field(default_factory=dict[str, str])


def table_columns(table: Table) -> list[Column]:
    """What each column holds, from up to three header rows: sensors, names, units, in any order."""
    rows = [[read_column_name(cell) for cell in head] for head in table.heads]
    useful = [sum(column.quantity in _OWNED for column in row) for row in rows]
    named = len(rows) - 1 - useful[::-1].index(max(useful))
    columns = rows[named]
    for at, head in enumerate(table.heads):
        if at == named:
            continue
        spelled = [
            unit_of(cell, columns[i].quantity) if columns[i].quantity in _OWNED else "" for i, cell in enumerate(head)
        ]
        if any(spelled):
            columns = [c._replace(unit=u or c.unit) for c, u in zip(columns, spelled, strict=True)]
        elif at < named:
            columns = [
                c._replace(sensor=s or c.sensor) if c.quantity in _OWNED else c
                for c, s in zip(columns, _filled(head), strict=True)
            ]
    return columns


def sensors_of(table: Table, columns: Sequence[Column]) -> list[SensorColumns]:
    """The sensors of a table, in the order of their first columns.

    Raises:
        FormatError: where an axis of a sensor is missing or doubled, or there is no inertial column.
    """
    groups: dict[str, list[int]] = {}
    for place, column in enumerate(columns):
        if column.quantity in LABELS:
            groups.setdefault(column.sensor, []).append(place)
    kinds = [{columns[place].quantity for place in places} for places in groups.values()]
    if len(groups) > 1 and sum(len(kind) for kind in kinds) == len(set[str]().union(*kinds)):
        # `Accel_LN_X` beside `Gyro_X`: each quantity once, so this is one sensor
        groups = {"": [place for places in groups.values() for place in places]}
    sensors = [_sensor(table, columns, name, places) for name, places in groups.items()]
    sensors = [sensor for sensor in sensors if sensor.force or sensor.rate or sensor.quat]
    if not sensors:
        raise FormatError(
            "this table has no columns of an inertial sensor",
            cause=f"the columns are {', '.join(table.names)[:200]}",
            remedy="Name them acc_x ... gyr_z, or say which they are (--columns MAP.toml)",
            file=table.file,
            line=table.lines[0] - 1,
        )
    return sensors


def mapped_sensors(table: Table, columns: Sequence[Column], mapped: ColumnMap) -> list[SensorColumns]:
    """The sensors that a column map names.

    Raises:
        FormatError: for a column that is not in the table, or a sensor with a position.
    """
    sensors: list[SensorColumns] = []
    for name, parts in mapped.sensors.items():
        sensor = SensorColumns(name, quat_order=mapped.get("quaternion_order"))
        for part, titles in parts.items():
            if part not in _MAPPED:
                raise FormatError(
                    f"sensor {name!r} has a {part}: this is no table of IMUs",
                    remedy="Import trackers with import-trackers",
                    file=mapped.file,
                )
            places = table.find(*titles)
            _set(sensor, _MAPPED[part], places)
            _note_units(sensor, _MAPPED[part], [columns[place] for place in places], table)
        sensors.append(sensor)
    return sensors


def _filled(head: Sequence[str]) -> list[str]:
    """Names of merged cells, which stand in the first of them only."""
    out: list[str] = []
    for i, cell in enumerate(head):
        out.append(cell or (out[-1] if i > 1 else ""))
    return out


def _sensor(table: Table, columns: Sequence[Column], name: str, places: Sequence[int]) -> SensorColumns:
    sensor = SensorColumns(name)
    for quantity in (FORCE, RATE, QUAT):
        found = [place for place in places if columns[place].quantity == quantity]
        if quantity == FORCE and {columns[place].linear for place in found} == {True, False}:
            found = [place for place in found if not columns[place].linear]
        if not found:
            continue
        axes = [columns[place].axis for place in found]
        if quantity == QUAT and set(axes) <= set("xyz"):
            continue  # angles or a rotation vector: of no use here
        wanted = _wanted(axes, _QUAT_AXES if quantity == QUAT else _AXES)
        for axis in wanted:
            if axes.count(axis) != 1:
                raise FormatError(
                    f"sensor {name or table.file.stem!r} has {axes.count(axis)} columns '{LABELS[quantity]}_{axis}'",
                    cause=f"the columns are {', '.join(table.names)[:200]}",
                    remedy=f"Give one of each: {', '.join(f'{LABELS[quantity]}_{a}' for a in wanted)}",
                    file=table.file,
                    line=table.lines[0] - 1,
                )
        ordered = [found[axes.index(axis)] for axis in wanted]
        _set(sensor, quantity, ordered)
        _note_units(sensor, quantity, [columns[place] for place in ordered], table)
        if quantity == QUAT:
            sensor.quat_order = "wxyz" if "w" in wanted else ""
    return sensor


def _wanted(axes: Sequence[str], choices: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    return max(choices, key=lambda choice: len(set(choice) & set(axes)))


def _set(sensor: SensorColumns, quantity: str, places: list[int]) -> None:
    if quantity == FORCE:
        sensor.force = places
    elif quantity == RATE:
        sensor.rate = places
    else:
        sensor.quat = places


def _note_units(sensor: SensorColumns, quantity: str, columns: Sequence[Column], table: Table) -> None:
    units = {column.unit for column in columns if column.unit and column.quantity != OTHER}
    if len(units) > 1:
        raise FormatError(
            f"columns of one {LABELS[quantity]} are in {' and '.join(sorted(units))}",
            remedy="Export them in one unit",
            file=table.file,
            line=table.lines[0] - 1,
        )
    sensor.units[quantity] = next(iter(units), "")
    sensor.linear = sensor.linear or (quantity == FORCE and all(column.linear for column in columns))
