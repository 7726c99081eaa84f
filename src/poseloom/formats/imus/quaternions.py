"""In what order and world quaternions of a table are: checked by where gravity points, and how the gyroscope turns.

With the right order the specific force of a sensor at rest lies along one axis of the world all the time, however the
sensor is turned; with a wrong one it wanders.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.rotations import (
    matrix_from_quat,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
    quat_rotate,
)
from poseloom.skeleton.differences import angular_velocity

ORDERS = ("wxyz", "xyzw")
NO_QUATS = "none"
"""As an order: leave the quaternions out."""

_UNIT = 0.05
"""How far a quaternion's length may be from one."""
_AGREES = 15.0
"""Degrees, median, between gravity and an axis of the world, below which a reading is right."""
_TURNS = 0.7
"""Least correlation of the orientations' angular rate with the gyroscope's in the right order."""
_CALM = 0.08
"""Samples whose specific force differs from gravity by less than this share show its direction."""
_UPS = (("z", 1), ("y", 1), ("z", -1), ("y", -1), ("x", 1), ("x", -1))
"""Axes that may point up, the usual ones first: z of inertial systems, y of graphics, z down of aircraft."""


class _Reading(NamedTuple):
    """One way to read quaternions, and how far gravity then strays from an axis, degrees."""

    order: str
    inverted: bool
    up: tuple[str, int]
    strays: float


def settle_quats(
    cells: Floats[Array, "samples 4"],
    stated: str,
    forces: Floats[Array, "samples 3"] | None,
    rates: Floats[Array, "samples 3"] | None,
    step: float,
    chosen: str = "",
) -> tuple[Floats[Array, "samples 4"], str]:
    """Quaternions as `R_world_sensor`, scalar first, in a world whose z points up, and a sentence that says how read.

    Args:
        cells: The four columns, in the order of the table or of their names (`stated`).
        stated: The order that the names say; empty where the columns are numbered.
        forces: Specific forces, m/s^2, if there are some.
        rates: Angular rates in any unit, if there are some.
        step: Seconds between samples.
        chosen: The order that the user gives.

    Raises:
        FormatError: for columns that are no quaternions, an order that gravity contradicts, or one that nothing tells.
    """
    norms = np.linalg.norm(cells, axis=1)
    known = np.isfinite(norms)
    if known.any() and float(np.median(np.abs(norms[known] - 1))) > _UNIT:
        raise FormatError(
            f"the orientation's four columns are no quaternions: their length is {float(np.median(norms[known])):.3g}",
            remedy="Check the columns, or leave them out (--quat-order none)",
        )
    if chosen and chosen not in ORDERS:
        raise FormatError(f"{chosen!r} is no order of quaternions", remedy="Give wxyz, xyzw or none")
    readings = _by_gravity(cells, forces)
    if not readings:
        return _without_gravity(cells, stated, rates, step, chosen)
    order = chosen or stated
    good = [reading for reading in readings if reading.strays < _AGREES]
    fitting = [reading for reading in good if reading.order == order] if order else good
    if order and not fitting:
        raise _contradiction(order, bool(chosen), min(readings, key=lambda reading: reading.strays), good)
    if not fitting:
        raise FormatError(
            f"the quaternions do not agree with gravity: it strays by {min(r.strays for r in readings):.0f} degrees",
            cause="they belong to a bone or another sensor, or have a left-handed or unknown order",
            remedy="Leave them out (--quat-order none)",
        )
    best = min(fitting, key=lambda reading: (round(reading.strays / 5), reading.inverted, _UPS.index(reading.up)))
    if not order:
        others = [r for r in good if r.order != best.order and r.strays < 2 * best.strays + 5]
        if others:
            return _without_gravity(cells, stated, rates, step, chosen)
    return _in_world(cells, best), _sentence(best, bool(stated and not chosen), bool(chosen))


def _by_gravity(cells: Floats[Array, "samples 4"], forces: Floats[Array, "samples 3"] | None) -> list[_Reading]:
    """All ways to read them, the best axis of each; nothing where no sample shows gravity."""
    if forces is None:
        return []
    lengths = np.linalg.norm(forces, axis=1)
    calm = np.isfinite(cells).all(axis=1) & (np.abs(np.nan_to_num(lengths) / 9.80665 - 1) < _CALM)
    if np.count_nonzero(calm) < 5:
        return []
    units = forces[calm] / lengths[calm, None]
    readings: list[_Reading] = []
    for order in ORDERS:
        quats = _scalar_first(cells[calm], order)
        for inverted in (False, True):
            gravity = quat_rotate(quat_conjugate(quats) if inverted else quats, units)
            for up in _UPS:
                cosines = np.clip(up[1] * gravity[:, "xyz".index(up[0])], -1, 1)
                readings.append(_Reading(order, inverted, up, float(np.degrees(np.median(np.arccos(cosines))))))
    return readings


def _without_gravity(
    cells: Floats[Array, "samples 4"],
    stated: str,
    rates: Floats[Array, "samples 3"] | None,
    step: float,
    chosen: str,
) -> tuple[Floats[Array, "samples 4"], str]:
    """The order as named, or the one in which the orientations turn as the gyroscope says."""
    fits = (
        {order: turning_fit(_scalar_first(cells, order), rates, step) for order in ORDERS} if rates is not None else {}
    )
    best = max(fits, key=lambda order: fits[order], default="")
    clear = best if best and fits[best] > _TURNS and 1 - min(fits.values()) > 4 * (1 - fits[best]) + 0.02 else ""
    order = chosen or stated or clear
    if not order:
        raise FormatError(
            "the order of the quaternions cannot be told: their columns are numbered",
            cause="no specific force or angular rate of a sensor that turns shows which is the scalar",
            remedy="Name the order (--quat-order wxyz or xyzw)",
        )
    if stated and not chosen and clear not in ("", stated):
        raise FormatError(
            f"the columns say the quaternions' order is {stated}, but the gyroscope turns as in {clear}",
            remedy=f"Name the order (--quat-order {clear})",
        )
    how = "as given" if chosen else "as the columns say" if stated else "as the gyroscope turns"
    return _in_world(
        cells, _Reading(order, False, ("z", 1), 0.0)
    ), f"orientation: {order}, {how}; from the sensor to a world with z up (not checked)"


def turning_fit(quats: Floats[Array, "samples 4"], rates: Floats[Array, "samples 3"] | None, step: float) -> float:
    """The correlation of the orientations' angular rate with the gyroscope's, -1 to 1; 0 where nothing turns."""
    turning = turning_of(quats, step)
    if rates is None or turning is None:
        return 0.0
    both = np.isfinite(turning).all(axis=1) & np.isfinite(rates).all(axis=1)
    if np.count_nonzero(both) < 5:
        return 0.0
    power = float(np.sum(turning[both] ** 2) * np.sum(rates[both] ** 2))
    return float(np.sum(turning[both] * rates[both])) / power**0.5 if power > 0 else 0.0


def turning_of(quats: Floats[Array, "samples 4"], step: float) -> Floats[Array, "samples 3"] | None:
    """Angular rates in the sensor's frame from orientations; None where too few are known."""
    known = np.flatnonzero(np.isfinite(quats).all(axis=1))
    if len(known) < 5:
        return None
    out = np.full((len(quats), 3), np.nan)
    rotations = matrix_from_quat(quats[known] / np.linalg.norm(quats[known], axis=1, keepdims=True))
    out[known] = np.einsum("nji,nj->ni", rotations, angular_velocity(rotations, 1 / step))
    out[known[1:][np.diff(known) > 1]] = np.nan
    return out


def _scalar_first(cells: Floats[Array, "samples 4"], order: str) -> Floats[Array, "samples 4"]:
    return cells if order == "wxyz" else np.roll(cells, 1, axis=1)


def _in_world(cells: Floats[Array, "samples 4"], reading: _Reading) -> Floats[Array, "samples 4"]:
    """Sensor to a world with z up."""
    quats = _scalar_first(cells, reading.order)
    quats = quat_conjugate(quats) if reading.inverted else quats
    return quats if reading.up == ("z", 1) else quat_multiply(quat_from_matrix(level(reading.up)), quats)


def level(up: tuple[str, int]) -> Floats[Array, "3 3"]:
    """A rotation that takes the axis that points up to z."""
    axis = up[1] * np.eye(3)["xyz".index(up[0])]
    other = np.eye(3)[("xyz".index(up[0]) + 1) % 3]
    return np.stack([other, np.cross(axis, other), axis])


def _sentence(best: _Reading, named: bool, chosen: bool) -> str:
    how = "as given" if chosen else "as the columns say" if named else "found"
    sense = "the world to the sensor" if best.inverted else "the sensor to a world"
    up = f"{'-' if best.up[1] < 0 else ''}{best.up[0]}"
    return (
        f"orientation: {best.order}, {how}, from {sense} with {up} up; gravity agrees within {best.strays:.1f} degrees"
    )


def _contradiction(order: str, chosen: bool, best: _Reading, good: Sequence[_Reading]) -> FormatError:
    who = "was given as" if chosen else "is, as the columns say,"
    return FormatError(
        f"the quaternions' order {who} {order}, but gravity then strays from every axis of the world",
        cause=f"gravity fits {best.order}" if good else f"no order fits: gravity strays by {best.strays:.0f} degrees",
        remedy=f"Name the order (--quat-order {best.order})" if good else "Leave them out (--quat-order none)",
    )
