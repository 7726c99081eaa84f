"""What flex sensors read of given bends."""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.errors import SensorError
from poseloom.synthesis import flex_kernels
from poseloom.synthesis.flex_sensors import FULL_BEND, FlexChannels


def flex_counts(
    bends: Floats[Array, "frames channels"],
    rate: float,
    channels: FlexChannels,
    minutes_of_use: float = 0.0,
    seed: int | Generator = 0,
) -> Floats[Array, "frames channels"]:
    """What drawn sensors read of given bends: the inner, fast part of the simulator.

    Slip, hysteresis, lag, the curve, ageing, bridge and amplifier, low-pass, noise, converter, open contacts, shorts
    and lost lines. More than a million frames of four channels a second.

    Args:
        bends: Radians.
        rate: Frames a second.
        channels: One sensor a column.
        minutes_of_use: Of each sensor before the first frame; use goes on from there.
        seed: Number or generator for all that is drawn.

    Returns:
        Whole counts; NaN where the line is lost.

    Raises:
        SensorError: for another number of channels, a rate or minutes that make no sense, or bends that are not finite.
    """
    if bends.shape[1] != len(channels):
        raise SensorError(f"{bends.shape[1]} bends for {len(channels)} sensors", remedy="Draw one sensor a bend")
    if not (np.isfinite(rate) and rate > 0 and np.isfinite(minutes_of_use) and minutes_of_use >= 0):
        raise SensorError(
            f"flex sensors at {rate} Hz after {minutes_of_use} minutes of use",
            remedy="Give a positive rate and minutes that are not negative",
        )
    if not np.isfinite(bends).all():
        raise SensorError("a bend is not finite", remedy="Mend or cut out that part of the motion")
    generator = np.random.default_rng(seed) if isinstance(seed, int) else seed
    shares = np.ascontiguousarray(bends.T) / FULL_BEND
    events = _draw_events(channels, bends.shape[0], rate, generator)
    draws = generator.standard_normal((2, *shares.shape))
    board = np.array([channels.board.gain, channels.board.low_pass_hz, channels.board.top])
    counts = np.empty_like(shares)
    for column, figures in enumerate(channels.figures):
        flex_kernels.counts_of_bends(
            shares[column],
            1 / rate,
            float(minutes_of_use),
            figures,
            board,
            events[column],
            draws[0, column],
            draws[1, column],
            counts[column],
        )
    return np.ascontiguousarray(counts.T)


def _draw_events(channels: FlexChannels, frames: int, rate: float, generator: Generator) -> NDArray[np.int8]:
    """What each contact does in each frame, see `flex_kernels`; channels x frames."""
    events = np.zeros((len(channels), frames), dtype=np.int8)
    minutes = frames / rate / 60
    for column in range(len(channels)):
        opens, seconds, spikes = (float(channels.figure(name)[column]) for name in ("opens", "open_seconds", "spikes"))
        for begin in generator.integers(frames, size=generator.poisson(opens * minutes)):
            lasts = max(1, round(generator.exponential(seconds) * rate))
            events[column, begin : begin + lasts] = flex_kernels.OPEN
        events[column, generator.integers(frames, size=generator.poisson(spikes * minutes))] = flex_kernels.SHORT
    events[:, generator.integers(frames, size=generator.binomial(frames, channels.lost_lines))] = flex_kernels.GONE
    return events
