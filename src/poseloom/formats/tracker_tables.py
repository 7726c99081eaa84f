"""Tables of foreign trackers: positions and quaternions of a head, hands, a chest, ankles, as text in any dialect.

Which columns are whose is told from names (`head_pos_x`, `LeftHand.qw` ...) or by a column map. What up and the unit
are is told from the head's place above the ankles or hands; the order of quaternions must be in the names or be given,
for no accelerometer shows where gravity points; left and right are checked against the way that the wearer walks.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import reading
from poseloom.formats.column_map import ColumnMap
from poseloom.formats.column_names import LENGTH_UNITS, OTHER, POSITION, QUAT, Column, words_of
from poseloom.formats.imus.quaternions import ORDERS, level
from poseloom.formats.imus.sensor_columns import table_columns
from poseloom.formats.table_times import TimeChoice, parse_unit, table_times, usual_step
from poseloom.formats.text_tables import Table, read_table
from poseloom.rotations import quat_conjugate, quat_from_matrix, quat_multiply
from poseloom.sensors.layout import SensorLayout, layout, make_layout
from poseloom.sensors.placement import default_placements
from poseloom.sensors.recording import Recording, make_recording
from poseloom.skeleton.body import average_body
from poseloom.skeleton.skeleton import Skeleton

_LAYOUTS = ("six-trackers", "three-trackers")
_PARTS = {"head": "head", "hmd": "head", "headset": "head", "chest": "upperChest", "upperchest": "upperChest",
          "hand": "Hand", "controller": "Hand", "wrist": "Hand", "ankle": "Ankle", "foot": "Ankle"}  # fmt: skip
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_SIZES = {"six-trackers": (0.8, 2.0), "three-trackers": (0.15, 1.2)}
"""Metres from the ankles (else the hands) to the head."""
_CLEARLY = 0.9
"""Least mean sign of left and right in walking that says which is which."""
_Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""From z up to our y up: (x, y, z) becomes (y, z, x)."""


@dataclass(frozen=True)
class TrackerChoices:
    """What the user says of a table; empty where names and values shall tell. They go before a column map's settings.

    Attributes:
        layout: six-trackers or three-trackers.
        rate: Samples a second, for tables without times.
        time_unit: s, ms, us, ns, `index`, or seconds of one tick.
        length_unit: m, cm, mm, in, ft, or metres in one unit.
        up: x, y, z, -x, -y or -z.
        handedness: left or right.
        quat_order: wxyz or xyzw.
        columns: Which columns hold what.
    """

    layout: str = ""
    rate: float | None = None
    time_unit: str = ""
    length_unit: str = ""
    up: str = ""
    handedness: str = ""
    quat_order: str = ""
    columns: ColumnMap | None = None

    def setting(self, name: str, option: str) -> str:
        """An option, or else what the column map says."""
        return option or (self.columns.get(name) if self.columns is not None else "")


@dataclass
class _Places:
    """Columns of one tracker."""

    position: list[int]
    quat: list[int]
    order: str
    unit: str


_NONE = TrackerChoices()


def read_tracker_table(
    path: str | Path, choices: TrackerChoices = _NONE, skeleton: Skeleton | None = None
) -> tuple[Recording, tuple[str, ...]]:
    """A recording of trackers from a table, in metres, y up, right-handed, and sentences that say how it was read.

    How each tracker is turned on its bone stands in no table: the recording has the default placements, and is to be
    calibrated (`poseloom calibrate`).

    Args:
        path: The file.
        choices: What the user says of it.
        skeleton: The wearer's body; the average one if left out.

    Raises:
        FormatError: with the line, for a damaged file; for missing trackers or columns, an order of quaternions that
            nothing says, and a unit, up axis or handedness that cannot be.
    """
    file = Path(path)
    with reading(file, "a table of trackers"):
        return _recording(read_table(file), choices, skeleton or average_body())


def _recording(table: Table, choices: TrackerChoices, body: Skeleton) -> tuple[Recording, tuple[str, ...]]:
    columns = table_columns(table)
    mapped = choices.columns
    found = _mapped(table, mapped) if mapped and mapped.sensors else _named(table, columns)
    worn = _layout(found, choices.setting("layout", choices.layout), table)
    rate = choices.rate or (mapped.rate if mapped else None)
    time = TimeChoice(rate, choices.setting("time_unit", choices.time_unit), choices.setting("time", ""))
    times, said = table_times(table, columns, time)
    keep = np.concatenate([[True], np.diff(times) != 0])
    if (np.diff(times) < 0).any():
        raise FormatError(
            "the times go back", remedy="Sort the lines", line=table.lines[int(np.argmax(np.diff(times) < 0)) + 1]
        )
    notes = [f"text with {table.dialect}", said] if table.dialect else [said]
    places = [found[name] for name in worn.names]
    positions = np.stack([table.columns(place.position) for place in places], axis=1)[keep]
    quats, said = _quats(table, places, choices.setting("quaternion_order", choices.quat_order))
    notes.append(said)
    moments = times[keep] - times[0]
    step = usual_step(moments)
    world, said = _world(positions, worn, choices, step)
    notes.append(said)
    size, said = _length(positions, worn, places, choices)
    notes.append(said)
    q_world = quat_from_matrix(world if np.linalg.det(world) > 0 else world @ np.diag([-1.0, 1.0, 1.0]))
    if np.linalg.det(world) < 0:
        quats = quats * np.array([1.0, 1.0, -1.0, -1.0])
    turned = quat_multiply(quat_multiply(q_world, quats[keep]), quat_conjugate(q_world))
    turned = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    placed = size * positions @ world.T
    for values in (placed, turned):
        values[np.isnan(values).any(axis=-1)] = np.nan
    at = make_layout(worn.name, worn.sensors, float(f"{1 / step:.4g}"))
    notes.append("how the trackers are turned on their bones is not known: calibrate the recording")
    settings = {"made by": "read_tracker_table", "source": table.file.name, "read as": "; ".join(notes)}
    name = choices.setting("name", "") or table.file.stem
    recording = make_recording(
        at,
        default_placements(at, body),
        body,
        moments,
        positions=placed,
        quats_wxyz=turned,
        name=name,
        settings=settings,
    )
    return recording, tuple(notes)


def _tracker(text: str) -> str:
    """The tracker that a name means, such as leftHand; empty for none."""
    words = [word.lower() for word in words_of(text)]
    joined = "".join(words)
    side = next((_SIDES[word] for word in words if word in _SIDES), "")
    for spelling in ("left", "right"):
        side = spelling if spelling in joined else side
    part = next((_PARTS[word] for word in _PARTS if word in joined), "")
    return part if part[:1].islower() else f"{side}{part}" if side and part else ""


def _named(table: Table, columns: Sequence[Column]) -> dict[str, _Places]:
    found: dict[str, _Places] = {}
    for name in dict.fromkeys(tracker for column in columns if (tracker := _tracker(column.sensor))):
        own = [i for i, column in enumerate(columns) if _tracker(column.sensor) == name]
        at = {c.axis: i for i in own if (c := columns[i]).quantity == POSITION and c.axis}
        at = at or {c.axis: i for i in own if (c := columns[i]).quantity == OTHER and c.axis}
        turned = {c.axis: i for i in own if (c := columns[i]).quantity == QUAT}
        if set(at) != set("xyz") or len(turned) != 4:
            angles = bool(turned) and set(turned) <= set("xyz")
            raise FormatError(
                f"tracker {name!r} has positions {''.join(sorted(at)) or 'none'} "
                f"and rotations {''.join(sorted(turned)) or 'none'}",
                cause="its rotations are angles, whose order and sense no table says" if angles else "",
                remedy="Give x, y, z and a quaternion, or say which columns they are (--columns MAP.toml)",
                line=table.lines[0] - 1,
            )
        order = "wxyz" if "w" in turned else ""
        quat = [turned[axis] for axis in ("wxyz" if order else sorted(turned))]
        units = {columns[i].unit for i in at.values() if columns[i].unit}
        found[name] = _Places([at[axis] for axis in "xyz"], quat, order, units.pop() if len(units) == 1 else "")
    return found


def _mapped(table: Table, mapped: ColumnMap) -> dict[str, _Places]:
    found: dict[str, _Places] = {}
    for text, parts in mapped.sensors.items():
        name = _tracker(text)
        if not name or set(parts) != {"position", "quaternion"}:
            raise FormatError(
                f"sensor {text!r} of the column map is no tracker with a position and a quaternion",
                remedy="Call it head, leftHand, rightHand, upperChest, leftAnkle or rightAnkle, and give both",
                file=mapped.file,
            )
        quat = table.find(*parts["quaternion"])
        found[name] = _Places(table.find(*parts["position"]), quat, "", "")
    return found


def _layout(found: Mapping[str, _Places], chosen: str, table: Table) -> SensorLayout:
    for name in (chosen,) if chosen else _LAYOUTS:
        worn = layout(name)
        if set(worn.names) <= set(found):
            return worn
    worn = layout(chosen or "three-trackers")
    raise FormatError(
        f"the table has no tracker {', '.join(name for name in worn.names if name not in found)}",
        cause=f"its trackers are {', '.join(found) or 'not known'}; its columns {', '.join(table.names)[:160]}",
        remedy=f"Name the columns head_x ... rightHand_qw, or map them (--columns MAP.toml): {' or '.join(_LAYOUTS)}",
        line=table.lines[0] - 1,
    )


def _quats(table: Table, places: Sequence[_Places], chosen: str) -> tuple[Floats[Array, "rows sensors 4"], str]:
    if chosen and chosen not in ORDERS:
        raise FormatError(f"{chosen!r} is no order of quaternions", remedy="Give wxyz or xyzw")
    named = all(place.order for place in places)
    if not (chosen or named):
        raise FormatError(
            "the order of the quaternions cannot be told: their columns are not called w, x, y, z",
            cause="no accelerometer shows where gravity points",
            remedy="Name the order (--quat-order wxyz or xyzw)",
        )
    quats = np.stack([table.columns(place.quat) for place in places], axis=1)
    lengths = np.linalg.norm(quats, axis=-1)
    if np.isfinite(lengths).any() and float(np.nanmedian(np.abs(lengths - 1))) > 0.05:
        raise FormatError(
            f"the rotations are no quaternions: their length is {float(np.nanmedian(lengths)):.3g}",
            remedy="Check which columns they are (--columns MAP.toml)",
        )
    quats = quats / np.where(lengths > 0.1, lengths, np.nan)[..., None]
    if named:
        return quats, "orientation: w, x, y, z as the columns say"
    return quats if chosen == "wxyz" else np.roll(quats, 1, axis=-1), f"orientation: {chosen}, as given"


def _uprights(positions: Floats[Array, "rows sensors 3"], worn: SensorLayout) -> Floats[Array, "3"]:
    """From the ankles, else the hands, to the head: the median, in the table's axes and unit."""
    low = [i for i, name in enumerate(worn.names) if name.endswith("Ankle")] or [
        i for i, name in enumerate(worn.names) if name.endswith("Hand")
    ]
    return np.nanmedian(positions[:, worn.index("head")] - positions[:, low].mean(axis=1), axis=0)


def _world(
    positions: Floats[Array, "rows sensors 3"], worn: SensorLayout, choices: TrackerChoices, step: float
) -> tuple[Floats[Array, "3 3"], str]:
    """The table's axes in ours: a rotation, or a reflection where its axes are left-handed."""
    up = choices.setting("up", choices.up)
    upright = _uprights(positions, worn)
    at = int(np.argmax(np.abs(upright)))
    seen = ("-" if upright[at] < 0 else "") + "xyz"[at]
    clear = abs(upright[at]) > 0.75 * float(np.linalg.norm(upright))
    if up and re.fullmatch(r"-?[xyz]", up) is None:
        raise FormatError(f"{up!r} is no axis", remedy="Give x, y, z, -x, -y or -z as up")
    if not up and not clear:
        raise FormatError(
            "which axis points up cannot be told: the head is above no other tracker along one",
            remedy="Name it (--up y or --up z)",
        )
    said = f"{up} is up, as given" if up else f"{seen} is up, for the head is above the other trackers along it"
    if up and clear and up != seen:
        said += f", though the head is above the other trackers along {seen}"
    chosen = up or seen
    upward = _Y_UP @ level((chosen[-1], -1 if chosen.startswith("-") else 1))
    handed = choices.setting("handedness", choices.handedness)
    if handed not in ("", "left", "right"):
        raise FormatError(f"{handed!r} is no handedness", remedy="Give left or right")
    mirror = np.diag([-1.0, 1.0, 1.0])
    crossed = _crossed(positions @ upward.T, worn, step)
    if not handed and crossed < -_CLEARLY:
        raise FormatError(
            "left and right are exchanged against the way that the wearer walks",
            cause="the axes are left-handed, the names of the sides are exchanged, or the wearer walks backwards",
            remedy="Say it (--handedness left or right)",
        )
    how = "as given" if handed else "as left and right lie in walking" if crossed > _CLEARLY else "assumed"
    said += f"; {handed or 'right'}-handed axes, {how}"
    return (
        upward @ mirror if chosen[-1] != "x" else upward @ np.diag([1.0, -1.0, 1.0])
    ) if handed == "left" else upward, said


def _crossed(positions: Floats[Array, "rows sensors 3"], worn: SensorLayout, step: float) -> float:
    """From 1 to -1, how much the left hand lies left of the right one in walking, y up; 0 where nobody walks.

    Only half seconds count in which the wearer is upright and goes a good part of an arm's length.
    """
    span = min(max(1, round(0.5 / step)), len(positions) - 1)
    head = positions[:, worn.index("head")]
    steps = (head[span:] - head[:-span])[:, [0, 2]]
    across = (positions[:, worn.index("leftHand")] - positions[:, worn.index("rightHand")])[span // 2 :, [0, 2]]
    across = across[: len(steps)]
    height = (head[:, 1] - np.nanmin(positions[:, :, 1], axis=1))[span // 2 :][: len(steps)]
    wide, tall = (float(np.nanmedian(values)) for values in (np.linalg.norm(across, axis=1), height))
    with np.errstate(invalid="ignore"):
        walks = (np.linalg.norm(steps, axis=1) > 0.5 * wide) & (np.abs(height / tall - 1) < 0.1)
    if np.count_nonzero(walks) < 2 * span:
        return 0.0
    left = np.stack([steps[walks, 1], -steps[walks, 0]], axis=1)  # up x forward, in x and z
    signs = np.sign(np.einsum("nj,nj->n", left, across[walks]))
    known = signs[np.isfinite(signs)]
    return float(known.mean()) if known.size else 0.0


def _length(
    positions: Floats[Array, "rows sensors 3"], worn: SensorLayout, places: Sequence[_Places], choices: TrackerChoices
) -> tuple[float, str]:
    """Metres in one unit, and how that is known."""
    tall = float(np.linalg.norm(_uprights(positions, worn)))
    least, most = _SIZES[worn.name]
    chosen = choices.setting("length_unit", choices.length_unit)
    named = next((place.unit for place in places if place.unit), "")
    if chosen:
        return parse_unit(chosen, LENGTH_UNITS, "length"), f"positions in {chosen}, as given"
    fitting = [unit for unit, size in LENGTH_UNITS.items() if least <= tall * size <= most]
    if named and named in fitting:
        return LENGTH_UNITS[named], f"positions in {named}, as the columns say"
    if named or not fitting:
        raise FormatError(
            f"the head is {tall:.3g} from the {'ankles' if worn.name == 'six-trackers' else 'hands'}"
            + (f", but the columns say {named}" if named else ""),
            cause=f"a person has {least:g} to {most:g} m there",
            remedy="Name the unit of length (--length-unit m, cm, mm, in or ft)",
        )
    return LENGTH_UNITS[fitting[0]], f"positions in {fitting[0]}, for the head is {tall:.3g} from the others"
