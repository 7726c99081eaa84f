"""Figures of a batch of flex sensors from fits of single ones, and their file."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from poseloom.errors import FormatError, PoseloomError
from poseloom.formats.bend_tables import BendTable
from poseloom.synthesis.flex_fit import ChannelFit, Shape, curve, delayed
from poseloom.synthesis.flex_sensors import FlexBoard, FlexSensors, Spread, check_sensors

_WINDOW_SECONDS = 5.0
"""Windows in which slip is read off the residuals."""

_ASSUMED_PART: Mapping[str, str] = {
    "range": "median",
    **dict.fromkeys(("creep", "slip_seconds", "loose_opens", "open_seconds"), "log_sd"),
}
"""Of figures from data, the part that the data do not tell."""

_UNEXPLAINED = 0.15
"""Residual, as a share of the range, from which on a fit tells nothing of the curve."""


def batch_shape(sensors: FlexSensors) -> Shape:
    """The median sensor's curve."""
    return Shape(
        sensors.curvature.median, sensors.hysteresis.median, sensors.lag_share.median, sensors.lag_seconds.median
    )


def fitted_figures(fits: Sequence[ChannelFit], own: Sequence[tuple[ChannelFit, BendTable]]) -> dict[str, Spread]:
    """The figures of `FlexSensors` that fits of real channels show, by name.

    Args:
        fits: One a channel; those that a curve hardly explains are left out where others remain.
        own: Channels with the tables of their own curves, from which slipping on the cloth is told.
    """
    told = [fit for fit in fits if residual_share(fit) < _UNEXPLAINED] or list(fits)
    lagging = [fit.shape.lag_seconds for fit in told if fit.shape.lag_share > 0.03]
    slip, slip_seconds = _slip(own)
    figures = {
        "range": Spread(FlexSensors().range.median, _range_spread(fits)),
        "curvature": spread_of([fit.shape.curvature for fit in told], 0.3),
        "hysteresis": spread_of([fit.shape.hysteresis for fit in told], 0.005),
        "lag_share": spread_of([fit.shape.lag_share for fit in told], 0.01),
        "lag_seconds": spread_of(lagging or [FlexSensors().lag_seconds.median], 0.1),
        "slip": slip,
        "slip_seconds": slip_seconds,
        "creep": _creep(fits),
    }
    return {name: Spread(rounded(each.median), rounded(each.log_sd)) for name, each in figures.items()}


def residual_share(fit: ChannelFit) -> float:
    """Root mean square of the residuals, in shares of the range; what the odd broken reading adds is cut."""
    return float(np.sqrt(np.nanmean(np.clip(fit.residuals, -0.5, 0.5) ** 2)))


def _range_spread(fits: Sequence[ChannelFit]) -> float:
    """Standard deviation of the logarithm of the counts that sensors at the same place run through.

    The place over the joint decides most of a range, and it changes with the session: so people are compared who wore
    the sensor of one name in their session of one number. Not the range of the fit, which is an extrapolation.
    """
    groups: dict[tuple[str, str], list[float]] = {}
    for fit in fits:
        groups.setdefault((fit.channel, fit.table.rpartition("_")[2]), []).append(float(np.log(fit.reach)))
    squares = [((np.array(group) - np.mean(group)) ** 2).sum() for group in groups.values() if len(group) > 1]
    freedom = sum(len(group) - 1 for group in groups.values() if len(group) > 1)
    return float(np.sqrt(np.sum(squares) / freedom)) if freedom else FlexSensors().range.log_sd


def spread_of(values: Sequence[float], floor: float) -> Spread:
    """Geometric mean and standard deviation, small values lifted to a floor below which nothing can be told apart."""
    logs = np.log(np.maximum(values, floor))
    return Spread(float(np.exp(logs.mean())), float(logs.std()))


def rounded(value: float) -> float:
    """A figure to three digits, as it is shipped and told."""
    return float(f"{value:.3g}")


def _creep(fits: Sequence[ChannelFit]) -> Spread:
    """The median drift, as growth of the flat resistance by each factor e of 1 + minutes / creep_minutes.

    Single drifts go both ways, for sleeves move: their spread is not that of creep, which is assumed.
    """
    usual = FlexSensors()
    share = max(float(np.median([fit.drift * fit.minutes / fit.range for fit in fits])), 0.001)
    grown = np.log1p(float(np.median([fit.minutes for fit in fits])) / usual.creep_minutes.median)
    return Spread(share * usual.range.median / float(grown), usual.creep.log_sd)


def _slip(own: Sequence[tuple[ChannelFit, BendTable]]) -> tuple[Spread, Spread]:
    """Standard deviation and time constant of slip, from the slow part of the sensors' own residuals.

    In each window the share by which the bend seems larger is regressed on the curve's slope. Noise within windows does
    not correlate between them: their covariances one and two windows apart give the slow part alone.
    """
    sizes: list[float] = []
    pairs = np.zeros(2)
    for fit, table in own:
        bends = delayed(table.bends, fit.delay, table.rate)
        step = 0.01
        slope = (curve(fit.shape, bends * (1 + step), table.rate) - curve(fit.shape, bends, table.rate)) / step
        rows = round(_WINDOW_SECONDS * table.rate)
        count = len(slope) // rows
        errors = np.where(np.isfinite(fit.residuals), fit.residuals, 0.0)[: count * rows].reshape(count, rows)
        slopes = np.where(np.isfinite(fit.residuals), slope, 0.0)[: count * rows].reshape(count, rows)
        power = (slopes**2).sum(axis=1)
        good = power > 0.2 * np.median(power)
        slips = np.clip((errors * slopes).sum(axis=1)[good] / power[good], -0.5, 0.5)
        if len(slips) < 6:
            continue
        slips = slips - slips.mean()
        near, far = float((slips[1:] * slips[:-1]).mean()), float((slips[2:] * slips[:-2]).mean())
        pairs += near, far
        sizes.append(float(np.sqrt(max(near, 1e-6))))
    usual = FlexSensors()
    if not sizes:
        return usual.slip, usual.slip_seconds
    kept = float(np.clip(pairs[1] / max(pairs[0], 1e-9), 0.2, 0.95))
    size = spread_of(sizes, 0.005)
    return Spread(size.median / np.sqrt(kept), size.log_sd), Spread(-_WINDOW_SECONDS / float(np.log(kept)), 0.5)


def sensors_to_json(sensors: FlexSensors, fitted: Sequence[str], facts: Mapping[str, object]) -> str:
    """A batch of sensors as JSON, with what is fitted, what is assumed, and where it comes from."""
    figures = {
        name: {
            **asdict(spread),
            "from": "data" if name in fitted else "assumed",
            **({"but assumed": _ASSUMED_PART[name]} if name in fitted and name in _ASSUMED_PART else {}),
        }
        for name, spread in sensors.spreads.items()
    }
    content = {
        "figures": figures,
        "loose": sensors.loose,
        "lost_lines": sensors.lost_lines,
        "board": asdict(sensors.board),
        **facts,
    }
    return json.dumps(content, indent=1) + "\n"


def sensors_from_json(text: str) -> FlexSensors:
    """The batch that `sensors_to_json` wrote.

    Raises:
        FormatError: for anything else.
    """
    try:
        content = json.loads(text)
        figures = {
            name: Spread(float(figure["median"]), float(figure["log_sd"]))
            for name, figure in content["figures"].items()
        }
        board = FlexBoard(**content["board"])
        loose, lost = float(content["loose"]), float(content["lost_lines"])
        sensors = replace(replace(FlexSensors(), **figures), loose=loose, lost_lines=lost, board=board)
        check_sensors(sensors)
    except (PoseloomError, ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
        raise FormatError(
            "these are not the figures of flex sensors",
            cause=str(error),
            remedy="Give a file that `poseloom fit flex-sensor` wrote",
        ) from None
    return sensors
