"""Text tables of accelerometers, gyroscopes and orientations, in any dialect, wording and unit.

Columns are known by their names (`acc_x`, `Gyroscope Y (deg/s)`, `left foot ax`, `qw` ...), with the sensors' names in
them or in a row above, or by a column map. Units are told from names, checked against values, and found from values
where names say nothing: the specific force by gravity at rest, the angular rate by its peaks, the orientations and
gravity's direction, the time by the rate. Every track says in its notes what was found. gaitmap's tables and those of
one sensor with its rate in a comment (`fs=100`) are such tables.
"""

import re
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import decode, split_lines
from poseloom.formats.column_names import FORCE, FORCE_UNITS, QUAT, RATE, RATE_UNITS, read_column_name
from poseloom.formats.imus.choices import ImuChoices
from poseloom.formats.imus.quaternions import NO_QUATS, settle_quats, turning_of
from poseloom.formats.imus.sensor_columns import SensorColumns, mapped_sensors, sensors_of, table_columns
from poseloom.formats.imus.tracks import ImuTrack, make_track
from poseloom.formats.imus.units import find_rest, force_unit, rate_unit, stirred
from poseloom.formats.table_times import TimeChoice, parse_unit, table_times, usual_step
from poseloom.formats.text_tables import Table, read_table, split_cells

_NONE = ImuChoices()
_RATE = re.compile(r"\b(?:fs|rate|frequency)\s*(?:\(hz\))?\s*[=:,;\t]\s*([0-9]+(?:\.[0-9]+)?)", re.IGNORECASE)


def is_imu_csv(head: bytes) -> bool:
    """Whether a file's beginning names an acceleration's, an angular rate's or an orientation's axes in one line."""
    for line in split_lines(decode(head))[:60]:
        for delimiter in "\t;,| ":
            found = [read_column_name(cell).quantity for cell in split_cells(line[:4096], delimiter)]
            if found.count(FORCE) >= 3 or found.count(RATE) >= 3 or found.count(QUAT) >= 4:
                return True
    return False


def read_imu_csv(path: Path, choices: ImuChoices = _NONE) -> tuple[ImuTrack, ...]:
    """Reads all sensors of a table.

    Args:
        path: The file.
        choices: What the user says of it.

    Raises:
        FormatError: with the line, for a damaged file or missing columns; for a unit, an order or a rate that is not
            known or cannot be, and for accelerations without gravity.
    """
    table = read_table(path)
    columns = table_columns(table)
    mapped = choices.columns
    sensors = mapped_sensors(table, columns, mapped) if mapped and mapped.sensors else sensors_of(table, columns)
    stated = next((float(found.group(1)) for line in table.comments if (found := _RATE.search(line))), None)
    rate = choices.rate or (mapped.rate if mapped else None)
    try:
        times, said = table_times(
            table,
            columns,
            TimeChoice(
                rate,
                choices.setting("time_unit", choices.time_unit),
                choices.setting("time", ""),
                stated,
            ),
        )
        notes = [f"text with {table.dialect}"] if table.dialect else []
        return _tracks(table, sensors, times, choices, [*notes, said], stated is not None)
    except FormatError as error:
        raise error if error.file else error.at(path) from None


def _tracks(
    table: Table,
    sensors: list[SensorColumns],
    times: Floats[Array, "rows"],
    choices: ImuChoices,
    notes: list[str],
    numbered: bool,
) -> tuple[ImuTrack, ...]:
    step = usual_step(times)
    forces = {i: table.columns(sensor.force) for i, sensor in enumerate(sensors) if sensor.force}
    if forces:
        size, said = _force_size(list(forces.values()), sensors, step, choices)
        forces = {i: size * force for i, force in forces.items()}
        notes.append(said)
    rates = {i: table.columns(sensor.rate) for i, sensor in enumerate(sensors) if sensor.rate}
    quats: dict[int, Floats[Array, "rows 4"]] = {}
    order = choices.setting("quaternion_order", choices.quat_order)
    for i, sensor in enumerate(sensors):
        if sensor.quat and order != NO_QUATS:
            cells = table.columns(sensor.quat)
            named = sensor.quat_order == "wxyz" and choices.columns is None
            chosen = "" if named and order == "wxyz" else order
            quats[i], said = settle_quats(cells, sensor.quat_order, forces.get(i), rates.get(i), step, chosen)
            notes.append(said if len(sensors) == 1 else f"{sensor.name}: {said}")
    if rates:
        moving = any(stirred(force) for force in forces.values()) or not forces
        unit, said = _rate_unit(rates, forces, quats, sensors, step, moving, choices)
        notes.append(said)
        rates = {i: _in_radians(rate, unit) for i, rate in rates.items()}
    single = table.file.stem.rpartition("-")[2] if numbered else table.file.stem
    return tuple(
        make_track(
            sensor.name or single,
            times,
            table.file,
            specific_forces=forces.get(i),
            angular_rates=rates.get(i),
            quats_wxyz=quats.get(i),
            notes=notes,
        )
        for i, sensor in enumerate(sensors)
    )


def _force_size(
    forces: list[Floats[Array, "rows 3"]], sensors: list[SensorColumns], step: float, choices: ImuChoices
) -> tuple[float, str]:
    """m/s^2 in one unit, and how that is known."""
    chosen = choices.setting("accel_unit", choices.accel_unit)
    linear = any(sensor.linear for sensor in sensors)
    named = next((unit for sensor in sensors if (unit := sensor.units.get(FORCE))), "")
    if not chosen:
        unit, said = force_unit(forces, step, named, linear)
        return FORCE_UNITS[unit], said
    size = parse_unit(chosen, FORCE_UNITS, "acceleration")
    rests = [rest.length for force in forces if (rest := find_rest(force, step)) is not None]
    if not rests:
        force_unit(forces, step, named, linear)  # says that gravity is missing
    return size, f"specific force in {chosen}, as given: {size * float(np.median(rests)):.4g} m/s2 at rest"


def _rate_unit(
    rates: dict[int, Floats[Array, "rows 3"]],
    forces: dict[int, Floats[Array, "rows 3"]],
    quats: dict[int, Floats[Array, "rows 4"]],
    sensors: list[SensorColumns],
    step: float,
    moving: bool,
    choices: ImuChoices,
) -> tuple[str, str]:
    chosen = choices.setting("gyro_unit", choices.gyro_unit)
    if chosen:
        parse_unit(chosen, RATE_UNITS, "angular rate")
        return chosen, f"angular rate in {chosen}, as given"
    named = next((unit for sensor in sensors if (unit := sensor.units.get(RATE))), "")
    turning = {i: found for i in rates if i in quats and (found := turning_of(quats[i], step)) is not None}
    felt = [(rates[i], forces[i]) for i in rates if i in forces]
    return rate_unit(
        [rates[i] for i in (turning or rates)],
        moving,
        [turning[i] for i in turning],
        [rate for rate, _ in felt],
        [force for _, force in felt],
        step,
        named,
    )


def _in_radians(rate: Floats[Array, "rows 3"], unit: str) -> Floats[Array, "rows 3"]:
    return np.radians(rate) if unit == "deg/s" else parse_unit(unit, RATE_UNITS, "angular rate") * rate
