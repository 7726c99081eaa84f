"""What a state of the phase HMM expects of the signal: windows as columns, their scale and their precision."""

from collections.abc import Sequence

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints, frozen
from poseloom.methods.imus.features import SignalFeatures, fit_signal_features
from poseloom.methods.imus.pairs import SignalPair
from poseloom.methods.imus.settings import PhaseHmmSettings

_QUERIES = 400
"""States of a phase whose nearest other takes are sought for the emission's precision."""


def noise_scale(signals: Floats[Array, "states channels"], maps: Ints[Array, "states"]) -> Floats[Array, "channels"]:
    """Standard deviation of each channel about the mean of its phase and warped time.

    What differs at one moment of the cycle tells people and chance apart from the cycle: a channel that follows the
    cycle closely (of a foot) must count for more than one that each swings in its own way (of a hand).
    """
    counts = np.maximum(np.bincount(maps), 1)
    variances = np.empty(signals.shape[1])
    for channel, values in enumerate(signals.T):
        means = np.bincount(maps, values) / counts
        variances[channel] = ((values - means[maps]) ** 2).mean()
    return np.maximum(np.sqrt(variances), 1e-6)


def windowed(
    pairs: Sequence[SignalPair], scale: Floats[Array, "channels"], window: int, columns: int, seed: int
) -> tuple[SignalFeatures, Floats32[Array, "states columns"]]:
    """How windows of one length become columns, and those of all frames."""
    how = fit_signal_features([pair.signal for pair in pairs], scale, window, columns, seed)
    return how, frozen(np.concatenate([how.of_signal(pair.signal) for pair in pairs]))


def precision(
    columns: Floats32[Array, "states columns"],
    phase_of_state: Ints[Array, "states"],
    take_of_state: Ints[Array, "states"],
    maps: Ints[Array, "states"],
    phases: int,
    settings: PhaseHmmSettings,
    seed: int,
) -> Floats[Array, "phases columns"]:
    """The emission's precision of each phase.

    Either of each column about the mean of its warped time, tied over the phase (eq. 9 takes it of one sample, which
    has none); or one for all columns, from the squared distance to the nearest state of the phase in another take.
    """
    out = np.empty((phases, columns.shape[1]))
    generator = np.random.default_rng(seed)
    for phase in range(phases):
        rows = np.flatnonzero(phase_of_state == phase)
        if settings.window_emission:
            out[phase] = columns.shape[1] / _nearest(columns, rows, take_of_state, generator)
            continue
        kinds, places = np.unique(maps[rows], return_inverse=True)
        counts = np.bincount(places)
        means = np.stack(
            [np.bincount(places, columns[rows, k], len(kinds)) / counts for k in range(columns.shape[1])], axis=1
        )
        variance = ((columns[rows] - means[places]) ** 2).mean(axis=0)
        out[phase] = 1 / np.maximum(variance, 1e-3 * max(float(variance.mean()), 1e-6))
    if settings.window_emission:
        # Phases without a second take have no distance of their own, and the columns are not independent: a precision
        # of its own for each phase would give its normalising term the last word. One is shared.
        known = out[:, 0] > 0
        out[:] = float(np.median(out[known])) if known.any() else 1.0
    return settings.tempering * out


def _nearest(
    columns: Floats32[Array, "states columns"],
    rows: Ints[Array, "rows"],
    take_of_state: Ints[Array, "states"],
    generator: np.random.Generator,
) -> float:
    """Median squared distance of a phase's states to the nearest of its states in another take; infinite for none."""
    asked = rows if len(rows) <= _QUERIES else generator.choice(rows, _QUERIES, replace=False)
    values = columns[rows].astype(np.float64)
    squares = (values**2).sum(axis=1)
    found: list[float] = []
    for row in asked:
        apart = squares - 2 * values @ columns[row] + float((columns[row].astype(np.float64) ** 2).sum())
        apart[take_of_state[rows] == take_of_state[row]] = np.inf
        found.append(float(apart.min()))
    middle = float(np.median(found))
    return middle if middle > 0 else np.inf
