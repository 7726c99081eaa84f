"""What drawn sensors say of a session, as a network hears it."""

from dataclasses import dataclass, field

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Floats32
from poseloom.methods.flex.hearing import carried_on
from poseloom.sensors.flex_range import FlexRange
from poseloom.synthesis.flex_readings import flex_counts
from poseloom.synthesis.flex_sensors import FlexSensors, draw_channels
from poseloom.training.sessions import Session, session_seed

CHANNELS = 4


@dataclass(frozen=True)
class DrawSettings:
    """How sensors are drawn for a session.

    Attributes:
        sensors: The batch that they come from.
        most_minutes: Minutes of use before the session are drawn evenly from 0 to this.
        drop_outs: Further silences of single channels a minute, so that a network learns to do without one.
        drop_out_seconds: Their mean length.
    """

    sensors: FlexSensors = field(default=FlexSensors())
    most_minutes: float = 60.0
    drop_outs: float = 0.0
    drop_out_seconds: float = 5.0


def draw_counts(session: Session, seed: int, sensors: FlexSensors, minutes: float) -> Floats[Array, "frames channels"]:
    """Counts of four sensors drawn for a session and worn for `minutes` before; the same seed, the same sensors."""
    generator = np.random.default_rng([*session_seed(session, seed), 0])
    channels = draw_channels(sensors, CHANNELS, generator)
    return flex_counts(session.bends, session.rate, channels, minutes, generator)


def hear(counts: Floats[Array, "frames channels"], rate: float, ranges: FlexRange) -> Floats32[Array, "frames inputs"]:
    """Counts as a network hears them: normalised by the range known at that time, and flags (see `StepNetwork`)."""
    times = np.arange(len(counts)) / rate
    _, readings = ranges.follow(ranges.start(counts.shape[1]), times, counts)
    measured = np.isfinite(readings.values)
    return np.concatenate([carried_on(readings.values), measured], axis=1).astype(np.float32)


def hear_at_fixed_range(
    counts: Floats[Array, "frames channels"], low: Floats[Array, "channels"], high: Floats[Array, "channels"]
) -> Floats32[Array, "frames inputs"]:
    """The same by a range that was found once and is kept, as the paper's min-max normalisation is."""
    believed = np.isfinite(counts) & (counts > 0) & (counts < 4095)
    values = np.where(believed, (counts - low) / np.maximum(high - low, 1.0), np.nan)
    return np.concatenate([carried_on(values), believed], axis=1).astype(np.float32)


def silence(
    counts: Floats[Array, "frames channels"], rate: float, settings: DrawSettings, generator: np.random.Generator
) -> Floats[Array, "frames channels"]:
    """Counts with further silences of single channels."""
    quiet: Bools[Array, "frames channels"] = np.zeros(counts.shape, dtype=np.bool_)
    mean = settings.drop_outs * len(counts) / rate / 60
    for channel in range(counts.shape[1]):
        for begin in generator.integers(len(counts), size=generator.poisson(mean)):
            quiet[begin : begin + 1 + round(generator.exponential(settings.drop_out_seconds) * rate), channel] = True
    return np.where(quiet, np.nan, counts)


def draw_inputs(
    session: Session,
    seed: int,
    settings: DrawSettings,
    ranges: FlexRange = FlexRange(),  # noqa: B008 - frozen
    minutes: float | None = None,
) -> Floats32[Array, "frames inputs"]:
    """Draws sensors for a session and tells what a network hears of them.

    Args:
        session: Who wears them.
        seed: Of the sensors, their minutes of use and all else that is drawn.
        settings: How they are drawn.
        ranges: How ranges are learnt.
        minutes: Minutes of use before the session, in place of drawn ones.
    """
    generator = np.random.default_rng([*session_seed(session, seed), 1])
    used = float(generator.uniform(0, settings.most_minutes)) if minutes is None else minutes
    counts = draw_counts(session, seed, settings.sensors, used)
    if settings.drop_outs > 0:
        counts = silence(counts, session.rate, settings, generator)
    return hear(counts, session.rate, ranges)


_FIRST_SECONDS = 60.0
_LEAST_SPAN = 500.0


def draw_inputs_at_first_range(
    session: Session, seed: int, settings: DrawSettings, minutes: float | None = None
) -> Floats32[Array, "frames inputs"]:
    """The same sensors as `draw_inputs` draws, heard by the range that their first minute had when they were new.

    What a min-max normalisation does that is made once: as the sensors creep, the values leave their range.

    Args:
        session: Who wears them.
        seed: As in `draw_inputs`.
        settings: As in `draw_inputs`.
        minutes: Minutes of use before the session, in place of drawn ones.
    """
    generator = np.random.default_rng([*session_seed(session, seed), 1])
    used = float(generator.uniform(0, settings.most_minutes)) if minutes is None else minutes
    new = draw_counts(session, seed, settings.sensors, 0.0)[: round(_FIRST_SECONDS * session.rate)]
    sound = np.where((new > 0) & (new < settings.sensors.board.top), new, np.nan)
    # Percentiles, for a single short must not become the range's end.
    low, high = np.nanpercentile(sound, 0.5, axis=0), np.nanpercentile(sound, 99.5, axis=0)
    counts = draw_counts(session, seed, settings.sensors, used)
    if settings.drop_outs > 0:
        counts = silence(counts, session.rate, settings, generator)
    return hear_at_fixed_range(counts, low, np.maximum(high, low + _LEAST_SPAN))
