"""Figures of a batch of flex sensors from fits of single ones, and how well they foretell recordings held back."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats.bend_tables import BendTable
from poseloom.synthesis.flex_fit import (
    STRAIGHT,
    ChannelFit,
    Shape,
    curve,
    delayed,
    fit_channel,
    fit_scale,
    own_residuals,
    sound_rows,
)
from poseloom.synthesis.flex_sensors import FULL_BEND, FlexBoard, FlexSensors, Spread, check_sensors

_WINDOW_SECONDS = 5.0
"""Windows in which slip is read off the residuals."""

_LOOSE_BREAKS = 5.0
"""Breaks a minute from which on a contact is loose: a fault of its own, not what sound sensors do now and then."""

_UNEXPLAINED = 0.15
"""Residual, as a share of the range, from which on a fit tells nothing of the curve."""

_USER_SECONDS = 30.0
"""What a held-back sensor's offset and range are learnt from; the rest judges."""


@dataclass(frozen=True)
class Judgement:
    """How well a curve foretells one held-back sensor, past the seconds from which its offset and range were learnt.

    Attributes:
        table: Name of the recording.
        channel: Name of the sensor.
        range_counts: From its 1st to its 99th percentile.
        counts: Root mean square error in counts, of the curve of the batch.
        degrees: Mean absolute error of the bend that it tells, degrees.
        straight_counts: As `counts`, for a straight line.
        straight_degrees: As `degrees`, for a straight line.
        own_counts: As `counts`, for the curve fitted to this very recording: what no foretelling could undercut much.
    """

    table: str
    channel: str
    range_counts: float
    counts: float
    degrees: float
    straight_counts: float
    straight_degrees: float
    own_counts: float


@dataclass(frozen=True, eq=False)
class FlexStudy:
    """All that a fit found.

    Attributes:
        sensors: The batch; its figures are rounded.
        fitted: Names of the figures that come from the data; the others are assumed.
        fits: One for each sensor of each recording, held-back ones too.
        own: The same with what all sensors of a recording share taken out of the residuals.
        held_back: Names of the recordings that the figures do not come from.
        judgements: Of the sensors of these.
        measured: Other figures of the data, by name.
    """

    sensors: FlexSensors
    fitted: tuple[str, ...]
    fits: tuple[ChannelFit, ...]
    own: tuple[ChannelFit, ...]
    held_back: tuple[str, ...]
    judgements: tuple[Judgement, ...]
    measured: Mapping[str, float]

    @property
    def judged(self) -> dict[str, float]:
        """Medians over the held-back sensors, by name."""
        columns = ("range_counts", "counts", "degrees", "straight_counts", "straight_degrees", "own_counts")
        told = {name: [float(getattr(each, name)) for each in self.judgements] for name in columns}
        return {f"held back, median {name}": float(np.median(values)) for name, values in told.items() if values}


def study_flex_sensors(tables: Sequence[BendTable]) -> FlexStudy:
    """Fits every sensor of every recording, makes the figures of all but the last recording of each person, and judges
    them on that.

    Raises:
        FormatError: if no person has two recordings, or no sensor conducts.
    """
    last = {table.person: table.name for table in tables}
    held_back = tuple(name for name in last.values() if sum(t.person == name.rpartition("_")[0] for t in tables) > 1)
    if not held_back:
        raise FormatError("nobody has two recordings", remedy="Give two or more of each person: one judges the fit")
    fits: list[ChannelFit] = []
    own: list[ChannelFit] = []
    for table in tables:
        made = [fit for at in range(len(table.channels)) if (fit := fit_channel(table, at)) is not None]
        fits += made
        own += own_residuals(made)
    learnt = [fit for fit in fits if fit.table not in held_back]
    by_name = {table.name: table for table in tables}
    slips = [(fit, by_name[fit.table]) for fit in own if fit.table not in held_back]
    if not learnt:
        raise FormatError("no sensor's contact conducts", remedy="Give recordings of sound sensors")
    measured = _measured(tables, learnt, own)
    figures = {**_figures(learnt, slips), **_loose(measured)}
    sensors = replace(FlexSensors(), **figures)
    check_sensors(sensors)
    shape = batch_shape(sensors)
    judged = [
        judgement
        for fit in fits
        if fit.table in held_back and (judgement := _judge(by_name[fit.table], fit, shape)) is not None
    ]
    return FlexStudy(sensors, tuple(figures), tuple(fits), tuple(own), held_back, tuple(judged), measured)


def batch_shape(sensors: FlexSensors) -> Shape:
    """The median sensor's curve."""
    return Shape(
        sensors.curvature.median, sensors.hysteresis.median, sensors.lag_share.median, sensors.lag_seconds.median
    )


def provenance(study: FlexStudy, tables: Sequence[BendTable], source: str) -> dict[str, object]:
    """What to keep beside the figures: what was measured, how well it foretells, and of what data."""
    digest = hashlib.sha256()
    for table in tables:
        digest.update(table.name.encode())
        digest.update(np.ascontiguousarray(table.bends).tobytes())
        digest.update(table.counts.tobytes())
    return {
        "measured": {name: float(f"{value:.4g}") for name, value in study.measured.items()},
        "held back": {name: float(f"{value:.4g}") for name, value in study.judged.items()},
        "provenance": {
            "made by": "poseloom fit flex-sensor",
            "source": source,
            "recordings": len(tables),
            "people": len({table.person for table in tables}),
            "held back": f"the last recording of each of {len(study.held_back)} people",
            "data digest": digest.hexdigest(),
        },
    }


def _figures(fits: Sequence[ChannelFit], own: Sequence[tuple[ChannelFit, BendTable]]) -> dict[str, Spread]:
    told = [fit for fit in fits if _residual(fit) < _UNEXPLAINED] or list(fits)
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
    return {name: Spread(_rounded(each.median), _rounded(each.log_sd)) for name, each in figures.items()}


def _loose(measured: Mapping[str, float]) -> dict[str, Spread]:
    """How often and for how long a loose contact opens."""
    usual = FlexSensors()
    found = {"loose_opens": "breaks a minute of a loose contact", "open_seconds": "seconds of a break"}
    return {
        name: Spread(_rounded(measured[what]), getattr(usual, name).log_sd)
        for name, what in found.items()
        if measured[what] > 0
    }


def _residual(fit: ChannelFit) -> float:
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


def _rounded(value: float) -> float:
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


def _judge(table: BendTable, fit: ChannelFit, shape: Shape) -> Judgement | None:
    """Learns offset and range on the first seconds and foretells the rest; None for too few sound rows."""
    counts = table.counts[:, table.channels.index(fit.channel)]
    sound = sound_rows(counts, table.rate)
    first = np.arange(len(counts)) < _USER_SECONDS * table.rate
    learn, rest = sound & first, sound & ~first
    if learn.sum() < 5 * table.rate or rest.sum() < 5 * table.rate:
        return None
    minutes = np.arange(len(counts)) / table.rate / 60
    errors: list[float] = []
    degrees: list[float] = []
    for tried in (shape, STRAIGHT, fit.shape):
        shares = curve(tried, table.bends, table.rate)
        scale = fit_scale(shares[learn], counts[learn], minutes[learn], drifting=False)
        foretold = scale.offset + scale.range * shares
        errors.append(float(np.sqrt(np.mean((counts[rest] - foretold[rest]) ** 2))))
        told = _bend_told((counts[rest] - scale.offset) / scale.range, tried.curvature)
        degrees.append(float(np.degrees(np.abs(told - table.bends[rest]).mean())))
    reach = float(np.ptp(np.percentile(counts[sound], [1, 99])))
    return Judgement(table.name, fit.channel, reach, errors[0], degrees[0], errors[1], degrees[1], errors[2])


def _bend_told(shares: Floats[Array, "rows"], curvature: float) -> Floats[Array, "rows"]:
    """The bend that a share of the range stands for on the curve without hysteresis, radians, 0 to `FULL_BEND`."""
    held = np.clip(shares, 0.0, 1.0)
    if abs(curvature) > 1e-6:
        held = np.log1p(held * np.expm1(curvature)) / curvature
    return held * FULL_BEND


def _measured(tables: Sequence[BendTable], fits: Sequence[ChannelFit], own: Sequence[ChannelFit]) -> dict[str, float]:
    channels = sum(len(table.channels) for table in tables)
    minutes = float(np.mean([len(table.bends) / table.rate / 60 for table in tables]))
    breaks = np.array([fit.breaks / fit.minutes for fit in own])
    loose = breaks > _LOOSE_BREAKS
    left = {fit.table + fit.channel for fit in fits}
    mine = [fit for fit in own if fit.table + fit.channel in left]

    return {
        "channels": float(channels),
        "channels that conduct": float(len(own)),
        "minutes of each": minutes,
        "channels with a loose contact": float(channels - len(own) + loose.sum()),
        "breaks a minute of a loose contact": float(np.mean(breaks[loose])) if loose.any() else 0.0,
        "seconds of a break": float(
            np.mean([fit.broken * fit.minutes * 60 / fit.breaks for fit in own if fit.breaks > _LOOSE_BREAKS])
        )
        if loose.any()
        else 0.0,
        "breaks a minute of the others": float(np.mean(breaks[~loose])) if (~loose).any() else 0.0,
        "residual, share of the range": float(np.median([_residual(fit) for fit in fits])),
        "residual of one sensor's own, share of the range": float(np.median([_residual(fit) for fit in mine])),
        "hysteresis, share of the range, mean": float(np.mean([fit.shape.hysteresis for fit in fits])),
        "delay of the counts after the truth, seconds": float(np.median([fit.delay for fit in fits])),
        "drift a minute, share of the range": float(np.median([fit.drift / fit.range for fit in fits])),
    }


def sensors_to_json(sensors: FlexSensors, fitted: Sequence[str], facts: Mapping[str, object]) -> str:
    """A batch of sensors as JSON, with what is fitted, what is assumed, and where it comes from."""
    figures = {
        name: {**asdict(spread), "from": "data" if name in fitted else "assumed"}
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
    except (ValueError, KeyError, TypeError, PoseloomError) as error:
        raise FormatError(
            "these are not the figures of flex sensors",
            cause=str(error),
            remedy="Give a file that `poseloom fit flex-sensor` wrote",
        ) from None
    return sensors
