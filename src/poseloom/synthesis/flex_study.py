"""All sensors of bench recordings: fits, the batch's figures, and how well these foretell recordings held back."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats.bend_tables import BendTable
from poseloom.synthesis.flex_figures import batch_shape, fitted_figures, residual_share, rounded
from poseloom.synthesis.flex_fit import (
    STRAIGHT,
    ChannelFit,
    Shape,
    curve,
    fit_channel,
    fit_scale,
    own_residuals,
    sound_rows,
)
from poseloom.synthesis.flex_readings import flex_counts
from poseloom.synthesis.flex_sensors import FULL_BEND, FlexSensors, Spread, check_sensors, draw_channels

_LOOSE_BREAKS = 5.0
"""Breaks a minute from which on a contact is loose: a fault of its own, not what sound sensors do now and then."""

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


def study_flex_sensors(
    tables: Sequence[BendTable], displaced: Mapping[tuple[float, float], BendTable] = MappingProxyType({})
) -> FlexStudy:
    """Fits every sensor of every recording, makes the figures of all but the last recording of each person, and judges
    them on that.

    Args:
        tables: The recordings.
        displaced: Recordings with the sensors shifted on the joint, by how far (`read_displaced_tables`).

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
    measured = _measured(tables, learnt, own) | displacement_figures(displaced)
    figures = {**fitted_figures(learnt, slips), **_loose(measured)}
    sensors = replace(FlexSensors(), **figures)
    check_sensors(sensors)
    shape = batch_shape(sensors)
    measured |= _beside_drawn([by_name[name] for name in held_back], own, sensors)
    judged = [
        judgement
        for fit in fits
        if fit.table in held_back and (judgement := _judge(by_name[fit.table], fit, shape)) is not None
    ]
    return FlexStudy(sensors, tuple(figures), tuple(fits), tuple(own), held_back, tuple(judged), measured)


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


def _loose(measured: Mapping[str, float]) -> dict[str, Spread]:
    """How often and for how long a loose contact opens."""
    usual = FlexSensors()
    found = {"loose_opens": "breaks a minute of a loose contact", "open_seconds": "seconds of a break"}
    return {
        name: Spread(rounded(measured[what]), getattr(usual, name).log_sd)
        for name, what in found.items()
        if measured[what] > 0
    }


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
        "residual, share of the range": float(np.median([residual_share(fit) for fit in fits])),
        "residual of one sensor's own, share of the range": float(np.median([residual_share(fit) for fit in mine])),
        "hysteresis, share of the range, mean": float(np.mean([fit.shape.hysteresis for fit in fits])),
        "delay of the counts after the truth, seconds": float(np.median([fit.delay for fit in fits])),
        "drift a minute, share of the range": float(np.median([fit.drift / fit.range for fit in fits])),
    }


def _beside_drawn(tables: Sequence[BendTable], own: Sequence[ChannelFit], sensors: FlexSensors) -> dict[str, float]:
    """What is left of held-back sensors beside what is left of drawn ones on the same bends, by the same fit.

    In shares of the reach, for a range beyond the deepest bend is an extrapolation. Drawn counts are scaled to the real
    ones' reach and rounded like these.
    """
    names = {table.name for table in tables}
    real = [residual_share(fit) * fit.range / fit.reach for fit in own if fit.table in names]
    drawn: list[float] = []
    for number, table in enumerate(tables):
        generator = np.random.default_rng(number)
        count = len(table.channels)
        channels = draw_channels(replace(sensors, lost_lines=0.0), count, generator)
        bends = np.repeat(np.minimum(table.bends, FULL_BEND)[:, None], count, axis=1)
        counts = flex_counts(bends, table.rate, channels, 0.0, generator)
        reach = np.ptp(np.percentile(counts, [1, 99], axis=0), axis=0)
        made = replace(table, counts=np.rint(1000.0 + 40.0 * (counts - np.median(counts, axis=0)) / reach))
        fits = [fit for at in range(count) if (fit := fit_channel(made, at)) is not None]
        drawn += [residual_share(fit) * fit.range / fit.reach for fit in own_residuals(fits)]
    return {
        "held back, residual of one sensor's own, share of the reach": float(np.median(real)) if real else 0.0,
        "the same of drawn sensors": float(np.median(drawn)) if drawn else 0.0,
    }


def displacement_figures(displaced: Mapping[tuple[float, float], BendTable]) -> dict[str, float]:
    """How much less a sensor reacts for each step that it slid along the limb; nothing where that was not recorded.

    For each place round the limb the three sensors that react most: the slope of the logarithm of the range, of a
    straight line, over the steps along the limb.
    """
    slopes: list[float] = []
    for circular in {place[0] for place in displaced}:
        laterals = sorted(place[1] for place in displaced if place[0] == circular)
        if len(laterals) < 3:
            continue
        tables = [displaced[circular, lateral] for lateral in laterals]
        ranges = np.array([[_straight_range(table, at) for at in range(len(table.channels))] for table in tables])
        strongest = np.argsort(-np.median(ranges, axis=0))[:3]
        logs = np.log(np.maximum(ranges[:, strongest], 1.0))
        slopes += [float(each) for each in np.polyfit(np.array(laterals), logs, 1)[0]]
    return {"reaction lost by a step along the limb, share": 1 - float(np.exp(np.median(slopes)))} if slopes else {}


def _straight_range(table: BendTable, channel: int) -> float:
    counts = table.counts[:, channel]
    shares = table.bends / FULL_BEND
    return fit_scale(shares, counts, np.zeros_like(shares), drifting=False).range
