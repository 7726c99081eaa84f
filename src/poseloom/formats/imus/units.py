"""In what unit accelerometers and gyroscopes were written down: told from names, checked and found from values.

A sensor at rest measures gravity, so the length of the specific force there is 9.81 in m/s^2, 1 in g, 1000 in mg. An
angular rate on a body that moves lies between 0.3 and 45 rad/s at its peaks; where that leaves two units, the
orientation's derivative or the way gravity turns in the sensor's frame decides.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats.column_names import FORCE_UNITS, RATE_UNITS
from poseloom.rotations import matrix_from_rotvec

_WINDOW_SECONDS = 0.4
_CALMEST = 0.1
"""Share of the windows that count as rest: the calmest ones."""
_NEAR, _NEAR_NAMED = 1.35, 1.6
"""How far, as a factor, a sensor at rest may be from gravity: in a unit that is found, in one that a name says."""
_NEAR_RESTLESS = 2.5
"""The same for a sensor that is never at rest: a runner's foot feels twice gravity on average."""
_RESTLESS = 0.3
"""Spread of the calmest windows, as a share of the median length, above which there is no rest."""
_DIRECTED = 0.5
"""Least share of the mean length that the mean vector of a second has where gravity is in it; swings average out.
In the real recordings it is 0.69 to 1.00, and 0.06 to 0.65 once gravity is taken off."""
_LEAST_REST = 0.3
"""Least share of the median length that is left at rest where gravity is in it: 0.8 to 1.1 and 0.01 to 0.9 there."""
_STIRRED = 0.3
"""m/s^2, standard deviation of the specific force, above which the body moves."""
_LEAST_PEAK, _MOST_PEAK = 0.3, 45.0
"""rad/s between which the peaks of a moving body's angular rate lie (a kick's shank reaches 30)."""
_QUIET_RAD, _QUIET_DEG = 0.02, 0.06
"""Peaks at rest: below the first a gyroscope's noise and bias are in rad/s, above the second in degrees a second."""
_TURNING_DEG = 20.0
"""Degrees a second beyond which a body turns, though its accelerometer may not show it."""
_RAW_COUNTS = (2048, 4096, 8192, 16384)


def force_unit(
    forces: Sequence[Floats[Array, "samples 3"]], step: float, named: str = "", linear: bool = False
) -> tuple[str, str]:
    """The unit of the specific forces of a file's sensors, and how it is known.

    Args:
        forces: One a sensor, in the unit to be found; NaN = missing.
        step: Seconds between samples.
        named: What the columns' names say.
        linear: Whether they say that gravity was taken off.

    Raises:
        FormatError: where gravity was taken off, or the values contradict every unit or the name's.
    """
    rests = [rest for force in forces if (rest := find_rest(force, step)) is not None]
    if not rests:
        raise _no_gravity(linear, forces)
    length = float(np.median([rest.length for rest in rests]))
    for unit in [named] if named else FORCE_UNITS:
        size = 9.80665 / FORCE_UNITS[unit]
        limit = _NEAR_NAMED if named else _NEAR
        if all(_near(rest.length / size, _NEAR_RESTLESS if rest.restless else limit) for rest in rests):
            moment = "on average (it is never at rest)" if any(rest.restless for rest in rests) else "at rest"
            how = "as the column names say" if named else f"for its length is {length:.4g} {moment}"
            return unit, f"specific force in {unit}, {how}"
    raise _no_unit(length, named)


class Rest(NamedTuple):
    """The length of a specific force in the calmest moments, in its own unit, and whether these are no rest."""

    length: float
    restless: bool


def find_rest(force: Floats[Array, "samples 3"], step: float) -> Rest | None:
    """The specific force at rest; None where gravity is not in it."""
    whole = force[np.isfinite(force).all(axis=1)]
    if len(whole) == 0:
        return None
    norms, spreads = _windows(whole, step, _WINDOW_SECONDS)
    calm = np.argsort(spreads, kind="stable")[: max(1, int(_CALMEST * len(spreads)))]
    lengths = np.linalg.norm(whole, axis=1)
    means, _ = _windows(whole, step, 1.0)
    directed = float(np.median(means)) / max(float(lengths.mean()), 1e-300)
    rest = float(np.median(norms[calm]))
    typical = float(np.median(lengths))
    if directed < _DIRECTED or rest < _LEAST_REST * typical:
        return None
    return Rest(rest, bool(np.mean(spreads[calm]) > (_RESTLESS * typical) ** 2))


def _near(ratio: float, limit: float) -> bool:
    return 1 / limit <= ratio <= limit


def rate_unit(
    rates: Sequence[Floats[Array, "samples 3"]],
    moving: bool,
    references: Sequence[Floats[Array, "samples 3"]],
    carriers: Sequence[Floats[Array, "samples 3"]],
    forces: Sequence[Floats[Array, "samples 3"]],
    step: float,
    named: str = "",
) -> tuple[str, str]:
    """The unit of the angular rates of a file's sensors, and how it is known.

    Args:
        rates: One a sensor, in the unit to be found.
        moving: Whether the sensors move.
        references: Angular rates in rad/s from the orientations, one for each of `rates`, or none.
        carriers: The angular rates of sensors with specific forces; may be empty.
        forces: Their specific forces, in any unit.
        step: Seconds between samples.
        named: What the columns' names say.

    Raises:
        FormatError: where the values leave no unit, more than one, or contradict the name's.
    """
    peak = max(
        (float(np.nanpercentile(np.linalg.norm(r, axis=1), 99.5)) for r in rates if np.isfinite(r).any()), default=0.0
    )
    by_turning = _by_turning(rates, references)
    if by_turning:
        if named and by_turning != named:
            raise _contradiction(named, f"the orientations turn as fast as in {by_turning}")
        return by_turning, f"angular rate in {by_turning}, as the orientations turn"
    possible = [unit for unit, size in RATE_UNITS.items() if peak * size <= _MOST_PEAK]
    if moving:
        possible = [unit for unit in possible if peak * RATE_UNITS[unit] >= _LEAST_PEAK]
    elif not named:
        possible = ["rad/s"] if peak < _QUIET_RAD else ["deg/s"] if _QUIET_DEG < peak < _TURNING_DEG else []
    if named:
        if peak * RATE_UNITS[named] > _MOST_PEAK or (moving and named not in possible and possible):
            raise _contradiction(named, f"its peaks of {peak:.4g} would be {peak * RATE_UNITS[named]:.4g} rad/s")
        return named, f"angular rate in {named}, as the column names say"
    if len(possible) > 1:
        best = _by_gravity(carriers, forces, step, possible)
        if best:
            return best, f"angular rate in {best}, as gravity turns in the sensor's frame (peaks of {peak:.4g})"
    if len(possible) != 1:
        raise FormatError(
            f"the unit of the angular rate cannot be told: its peaks are {peak:.4g}",
            cause=f"they may be {' or '.join(possible)}" if possible else "the sensor hardly moves",
            remedy="Name the unit (--gyro-unit rad/s, deg/s or mdps)",
        )
    return possible[0], f"angular rate in {possible[0]}, for its peaks are {peak:.4g}"


def stirred(force: Floats[Array, "samples 3"]) -> bool:
    """Whether a specific force in m/s^2 is one of a sensor that moves."""
    whole = force[np.isfinite(force).all(axis=1)]
    return len(whole) > 1 and float(np.linalg.norm(whole.std(axis=0))) > _STIRRED


def _windows(
    values: Floats[Array, "samples 3"], step: float, seconds: float
) -> tuple[Floats[Array, "windows"], Floats[Array, "windows"]]:
    """Of each window the length of the mean vector, and the variance about it."""
    length = int(np.clip(round(seconds / step), 1, len(values)))
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)])
    squares = np.concatenate([[0.0], np.cumsum(np.sum(values**2, axis=1))])
    means = (sums[length:] - sums[:-length]) / length
    powers = (squares[length:] - squares[:-length]) / length
    norms = np.linalg.norm(means, axis=1)
    return norms, np.maximum(powers - norms**2, 0.0)


def _by_turning(rates: Sequence[Floats[Array, "samples 3"]], references: Sequence[Floats[Array, "samples 3"]]) -> str:
    """The unit in which rates are as fast as orientations turn; empty where none is, or nothing turns."""
    if not references:
        return ""
    ratios: list[float] = []
    for rate, reference in zip(rates, references, strict=True):
        fast = np.linalg.norm(reference, axis=1)
        use = np.isfinite(rate).all(axis=1) & np.isfinite(fast) & (np.nan_to_num(fast) > 0.3)
        if np.count_nonzero(use) >= 20:
            slope = float(np.sum(rate[use] * reference[use]) / np.sum(rate[use] ** 2))
            fit = float(np.sum(rate[use] * reference[use])) / float(
                np.sqrt(np.sum(rate[use] ** 2) * np.sum(reference[use] ** 2))
            )
            if fit > 0.7:
                ratios.append(slope)
    if not ratios:
        return ""
    slope = float(np.median(ratios))
    return next((unit for unit, size in RATE_UNITS.items() if 0.6 < slope / size < 1.6), "")


def _by_gravity(
    rates: Sequence[Floats[Array, "samples 3"]],
    forces: Sequence[Floats[Array, "samples 3"]],
    step: float,
    possible: Sequence[str],
) -> str:
    """Of two units the one in which turning carries gravity's direction along; empty where that is not clear."""
    errors = {unit: _carried_error(rates, forces, step, RATE_UNITS[unit]) for unit in possible}
    best, second = sorted(errors, key=lambda unit: errors[unit])[:2]
    return best if errors[best] < 0.6 * errors[second] and errors[second] > 0.02 else ""


def _carried_error(
    rates: Sequence[Floats[Array, "samples 3"]], forces: Sequence[Floats[Array, "samples 3"]], step: float, size: float
) -> float:
    """Median angle, radians, between gravity a fifth of a second later and where the turning carries it."""
    span = max(1, round(0.2 / step))
    errors: list[float] = []
    for rate, force in zip(rates, forces, strict=True):
        if len(force) <= 2 * span:
            continue
        norms = np.linalg.norm(force, axis=1)
        calm = np.abs(norms / np.nanmedian(norms) - 1) < 0.15
        for start in range(0, len(force) - span, span):
            if not (calm[start] and calm[start + span]) or not np.isfinite(rate[start : start + span]).all():
                continue
            carried = force[start] / norms[start]
            for turn in matrix_from_rotvec(-rate[start : start + span] * size * step):
                carried = turn @ carried
            errors.append(float(np.arccos(np.clip(carried @ force[start + span] / norms[start + span], -1, 1))))
    return float(np.median(errors)) if errors else float("inf")


def _no_gravity(linear: bool, forces: Sequence[Floats[Array, "samples 3"]]) -> FormatError:
    typical = float(np.nanmedian([np.nanmedian(np.linalg.norm(force, axis=1)) for force in forces]))
    return FormatError(
        f"gravity is not in the acceleration: its length is {typical:.3g} in the median, and swings about nought",
        cause="the columns are called linear or free acceleration: gravity was taken off"
        if linear
        else "gravity was taken off (linear, user or free acceleration), or these are no accelerations",
        remedy="Export the raw acceleration (specific force, with gravity): no method can align this one",
    )


def _no_unit(rest: float, named: str) -> FormatError:
    raw = next((count for count in _RAW_COUNTS if 0.92 < rest / count < 1.08), 0)
    if raw:
        cause, remedy = f"these are raw counts of {raw} a g", f"Name their size (--accel-unit {9.80665 / raw:.7f})"
    else:
        fits = [unit for unit, size in FORCE_UNITS.items() if _near(rest * size / 9.80665, _NEAR)]
        cause = f"it would be gravity in {fits[0]}" if fits else "gravity is 9.81 m/s2, 1 g or 1000 mg"
        remedy = f"Name the unit (--accel-unit {fits[0] if fits else 'UNIT'}), or export the raw acceleration"
    return FormatError(
        f"the acceleration at rest is {rest:.4g}"
        + (f", but its columns say {named}" if named else ", in no unit known"),
        cause=cause,
        remedy=remedy,
    )


def _contradiction(named: str, why: str) -> FormatError:
    return FormatError(
        f"the columns of the angular rate say {named}, but that cannot be",
        cause=why,
        remedy="Name the unit (--gyro-unit rad/s, deg/s or mdps)",
    )
