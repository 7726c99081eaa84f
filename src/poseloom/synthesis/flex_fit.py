"""What one real flex sensor is like: the simulator's own curve, hysteresis and lag, fitted to counts beside a truth."""

from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, NamedTuple, cast

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.formats.bend_tables import BendTable
from poseloom.synthesis import flex_kernels
from poseloom.synthesis.flex_sensors import FULL_BEND

SETTLING_SECONDS = 4.0
"""What is left out at the start: people stand still and sensors settle."""

_BROKEN = 200.0
"""Counts from the channel's median from which on a contact is taken for broken: several ranges of these sensors."""

_BOUNDS = {"curvature": (0.1, 6.0), "hysteresis": (0.0, 0.2), "lag_share": (0.0, 0.6), "lag_seconds": (0.2, 5.0)}
_DELAY = 0.06
"""Seconds by which truth and counts may be misaligned, either way: three rows."""

_ROUNDS = 6
"""Reweightings against outliers (Huber)."""


class Shape(NamedTuple):
    """The curve of a sensor without its scale; see `FlexSensors`."""

    curvature: float
    hysteresis: float
    lag_share: float
    lag_seconds: float


STRAIGHT = Shape(0.0, 0.0, 0.0, 1.0)
"""Counts in proportion to the bend: the simplest model of all, to compare with."""


@dataclass(frozen=True, eq=False)
class ChannelFit:
    """One sensor in one recording.

    Attributes:
        table: Name of the recording.
        channel: Name of the sensor.
        shape: Its curve.
        delay: Seconds by which the counts follow the truth.
        offset: Counts of the straight joint at the start.
        drift: Counts a minute by which that grows.
        range: Counts from straight to `FULL_BEND`.
        reach: Counts from the 1st to the 99th percentile.
        sound: Rows in which the contact conducts and that are past the settling.
        residuals: Counts minus fit, in shares of the range, all rows; NaN where not sound.
        minutes: Length of the recording.
        breaks: Number of times the contact broke.
        broken: Share of rows in which it was broken.
    """

    table: str
    channel: str
    shape: Shape
    delay: float
    offset: float
    drift: float
    range: float
    reach: float
    sound: Bools[Array, "rows"]
    residuals: Floats[Array, "rows"]
    minutes: float
    breaks: int
    broken: float


def sound_rows(counts: Floats[Array, "rows"], rate: float) -> Bools[Array, "rows"]:
    """Rows in which a channel's contact conducts, and that are past the settling."""
    usual = float(np.median(counts[counts > 0.5 * np.median(np.sort(counts)[-len(counts) // 4 :])]))
    sound = np.abs(counts - usual) < _BROKEN
    sound[: round(SETTLING_SECONDS * rate)] = False
    return sound


def curve(shape: Shape, bends: Floats[Array, "rows"], rate: float) -> Floats[Array, "rows"]:
    """What a sensor of this shape makes of bends (radians), in shares of its range: the simulator's own model."""
    strains = np.empty_like(bends)
    shares = np.ascontiguousarray(bends) / FULL_BEND
    flex_kernels.strains_of_bends(shares, 1 / rate, shape.hysteresis, shape.lag_share, shape.lag_seconds, strains)
    if abs(shape.curvature) < 1e-6:
        return strains
    return np.expm1(shape.curvature * strains) / np.expm1(shape.curvature)


def delayed(bends: Floats[Array, "rows"], seconds: float, rate: float) -> Floats[Array, "rows"]:
    """The bends `seconds` later."""
    rows = np.arange(len(bends), dtype=np.float64)
    return np.interp(rows - seconds * rate, rows, bends)


class Scale(NamedTuple):
    """Offset (counts), drift (counts a minute) and range (counts) of a channel, and the weights of its rows."""

    offset: float
    drift: float
    range: float
    weights: Floats[Array, "rows"]


def fit_scale(
    shares: Floats[Array, "rows"], counts: Floats[Array, "rows"], minutes: Floats[Array, "rows"], drifting: bool = True
) -> Scale:
    """Least squares with Huber weights of counts on a constant, time and the curve."""
    design = np.stack([np.ones_like(shares), minutes if drifting else np.zeros_like(minutes), shares], axis=1)
    weights = np.ones_like(counts)
    solution = np.zeros(3)
    for _ in range(_ROUNDS):
        solution = np.linalg.lstsq(design * weights[:, None], counts * weights, rcond=None)[0]
        errors = np.abs(counts - design @ solution)
        width = 1.5 * 1.4826 * float(np.median(errors)) + 1e-9
        weights = np.sqrt(1.0 / np.maximum(errors / width, 1.0))
    return Scale(float(solution[0]), float(solution[1]), float(solution[2]), weights)


def fit_channel(table: BendTable, channel: int) -> ChannelFit | None:
    """Fits shape, misalignment and scale to one channel; None for one whose contact is broken most of the time.

    Least squares with a loss that outliers hardly move (soft L1): the truth itself errs now and then.
    """
    counts = table.counts[:, channel]
    sound = sound_rows(counts, table.rate)
    if sound.mean() < 0.5:
        return None
    minutes = np.arange(len(counts)) / table.rate / 60
    low_count, high_count = np.percentile(counts[sound], [1, 99])
    reach = float(high_count - low_count)

    def errors(parameters: Floats[Array, "8"], rows: Bools[Array, "rows"] = sound) -> Floats[Array, "sound"]:
        *shape, delay, offset, drift, span = (float(value) for value in parameters)
        shares = curve(Shape(*shape), delayed(table.bends, delay, table.rate), table.rate)
        left = (counts - low_count) / reach - offset - drift * minutes - span * shares
        return left[rows]

    low, high = zip(*_BOUNDS.values(), (-_DELAY, _DELAY), (-3.0, 3.0), (-2.0, 2.0), (0.05, 20.0), strict=True)
    optimize = cast(Any, import_module("scipy.optimize"))  # takes a while to load, and few need it
    found = min(
        (
            optimize.least_squares(
                errors,
                np.array([curvature, 0.03, 0.1, 1.0, -0.01, 0.0, 0.0, 2.0]),
                bounds=(low, high),
                x_scale=[1.0, 0.02, 0.1, 1.0, 0.01, 0.1, 0.1, 1.0],
                loss="soft_l1",
                f_scale=0.05,
                diff_step=1e-3,
                max_nfev=60,
            )
            for curvature in (1.5, 4.0)
        ),
        key=lambda each: float(each.cost),
    )
    *shape, delay, offset, drift, span = (float(value) for value in found.x)
    broken = np.abs(counts - np.median(counts[sound])) >= _BROKEN
    left = errors(found.x, np.ones(len(counts), np.bool_)) / span
    return ChannelFit(
        table.name,
        table.channels[channel],
        Shape(*shape),
        delay,
        float(low_count) + reach * offset,
        reach * drift,
        reach * span,
        reach,
        sound,
        np.where(sound, left, np.nan),
        float(minutes[-1]),
        int((np.diff(broken.astype(np.int64)) == 1).sum()),
        float(broken.mean()),
    )


def own_residuals(fits: list[ChannelFit]) -> list[ChannelFit]:
    """The fits of one recording with what all its channels share taken out of the residuals.

    Where six sensors over one joint all read the same odd bend, the truth was wrong, or the whole sleeve moved: no
    property of one sensor. The share of each is regressed on the mean of the others.
    """
    made: list[ChannelFit] = []
    for fit in fits:
        others = [other.residuals for other in fits if other is not fit]
        if len(others) < 2:
            made.append(fit)
            continue
        both = np.isfinite(np.stack([fit.residuals, *others])).all(axis=0)
        common = np.median(np.stack(others), axis=0)
        gain = float((common[both] * fit.residuals[both]).sum() / max((common[both] ** 2).sum(), 1e-12))
        made.append(replace(fit, residuals=np.where(both, fit.residuals - gain * common, np.nan)))
    return made
