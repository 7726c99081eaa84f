"""One flex sensor over time, compiled: bend to counts."""

import math

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import compiled

SOUND, OPEN, SHORT, GONE = 0, 1, 2, 3
"""What a contact does in a sample: conducts, is open, is shorted, or the whole line is lost."""

PLAYS = 4
"""Play operators of the hysteresis."""

_UNIT = 0.05
"""Radius of the first play operator, as a share of the full bend; the others are its multiples."""


@compiled
def _strain(
    bend: float, loop: float, lag_share: float, lag_keep: float, inner: NDArray[np.float64], first: bool
) -> float:
    """How far the strip is strained by a bend: hysteresis by play operators, then a share that only follows.

    `inner` holds the plays and the following part, and moves on.
    """
    share = min(loop / (_UNIT * (PLAYS + 1)), 0.9)
    held = 0.0
    for i in range(PLAYS):
        radius = _UNIT * (i + 1)
        inner[i] = min(max(inner[i], bend - radius), bend + radius)
        held += inner[i]
    strain = (1.0 - share) * bend + share * held / PLAYS
    inner[PLAYS] = strain if first else lag_keep * inner[PLAYS] + (1.0 - lag_keep) * strain
    return (1.0 - lag_share) * strain + lag_share * inner[PLAYS]


@compiled
def strains_of_bends(
    bends: NDArray[np.float64], step: float, loop: float, lag_share: float, lag_seconds: float, out: NDArray[np.float64]
) -> None:
    """Fills `out` with the strains of bends (shares of the full bend), `step` seconds apart."""
    inner = np.zeros(PLAYS + 1)
    lag_keep = math.exp(-step / lag_seconds)
    for frame in range(len(bends)):
        out[frame] = _strain(bends[frame], loop, lag_share, lag_keep, inner, frame == 0)


@compiled
def counts_of_bends(
    bends: NDArray[np.float64],
    step: float,
    minutes: float,
    sensor: NDArray[np.float64],
    board: NDArray[np.float64],
    contacts: NDArray[np.int8],
    slip_draws: NDArray[np.float64],
    noise_draws: NDArray[np.float64],
    counts: NDArray[np.float64],
) -> None:
    """Fills `counts` (frames) from `bends` (frames, shares of the full bend), one sensor.

    `sensor` and `board` are columns in the order of `FlexSensors` and `FlexBoard`, the highest count last. `step` is
    the time between frames in seconds, `minutes` the use before the first one. Draws are standard normal.
    """
    reach, curvature, loop, lag_share, lag_seconds = sensor[0], sensor[1], sensor[2], sensor[3], sensor[4]
    divider, slip_size, slip_seconds, creep, creep_minutes = sensor[5], sensor[6], sensor[7], sensor[8], sensor[9]
    shrink, shrink_minutes, noise = sensor[10], sensor[11], sensor[12]
    gain, low_pass_hz, top = board[0], board[1], board[2]

    slip_keep = math.exp(-step / slip_seconds)
    slip_push = math.sqrt(1.0 - slip_keep * slip_keep)
    lag_keep = math.exp(-step / lag_seconds)
    filter_keep = math.exp(-2.0 * math.pi * low_pass_hz * step)
    curve_scale = 1.0 / math.expm1(curvature) if abs(curvature) > 1e-6 else 0.0

    inner = np.zeros(PLAYS + 1)
    slip = 0.0
    voltage = 0.0
    for frame in range(len(bends)):
        draw = slip_draws[frame]
        slip = draw if frame == 0 else slip_keep * slip + slip_push * draw
        bend = max(bends[frame] * (1.0 + slip_size * slip), 0.0)
        strain = _strain(bend, loop, lag_share, lag_keep, inner, frame == 0)
        curve = math.expm1(curvature * strain) * curve_scale if curve_scale != 0.0 else strain

        used = minutes + frame * step / 60.0
        flat = 1.0 + creep * math.log1p(used / creep_minutes)
        left = 1.0 - shrink * -math.expm1(-used / shrink_minutes)
        resistance = flat + reach * left * curve
        contact = contacts[frame]
        if contact in (SOUND, GONE):
            ratio = resistance / (resistance + divider)
        elif contact == OPEN:
            ratio = 1.0
        else:
            ratio = 0.0
        amplified = (ratio - 0.5) * gain
        voltage = amplified if frame == 0 else filter_keep * voltage + (1.0 - filter_keep) * amplified
        if contact == GONE:
            counts[frame] = np.nan
        else:
            read = math.floor(voltage * (top + 1.0) + noise * noise_draws[frame])
            counts[frame] = min(max(read, 0.0), top)
