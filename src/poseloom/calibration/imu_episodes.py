"""When someone who wears inertial sensors stands still, and when they walk."""

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import SensorError
from poseloom.sensors.recording import Recording

Episode = tuple[float, float]
"""Seconds from and to, on a recording's clock."""

_STILL_SECONDS = 1.0
_STILL_RAD_S = 0.2
"""Who turns more does not stand still."""
_CALM, _SWAY_RAD_S = 1.5, 0.01
"""How much more than in the calmest second of all still counts as still: gyroscopes are off, and people sway."""
_MOVES = 0.4
"""Share of the greatest shaking from which on someone walks."""
_SHAKEN_SECONDS = 1.5
_SHAKEN_M_S2 = 0.4
_WALK_SECONDS = 3.0


def find_walking(recording: Recording) -> Episode:
    """The longest stretch in which the sensors are shaken about as much as they ever are for some seconds.

    Shaking is what the size of the specific force varies by: turning round on the spot is no walking.

    Raises:
        SensorError: if there is none of three seconds.
    """
    size = np.linalg.norm(recording.specific_forces, axis=2)
    shaking = _root_mean(recording, (size - np.nanmedian(size, axis=0)) ** 2, _SHAKEN_SECONDS)
    known = shaking[np.isfinite(shaking)]
    busy = np.isfinite(shaking) & (shaking > _MOVES * (np.quantile(known, 0.95) if known.size else np.inf))
    runs = _runs(busy)
    start, stop = max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
    if (stop - start) / recording.layout.rate < _WALK_SECONDS or shaking[start:stop].mean() < _SHAKEN_M_S2:
        raise SensorError(
            "nobody walks in this recording",
            cause=f"no stretch of {_WALK_SECONDS:g} s moves steadily",
            remedy="Say when its wearer walks (--walking FROM:TO), or import it without alignment (--align none)",
        )
    return float(recording.times[start]), float(recording.times[stop - 1])


def find_standing(recording: Recording, walking: Episode) -> Episode:
    """The still second that is nearest to the walk: who is about to walk stands, who is still long before may sit.

    Raises:
        SensorError: if no second is still.
    """
    turning = _root_mean(recording, np.sum(recording.angular_rates**2, axis=2), _STILL_SECONDS)
    calmest = float(turning.min())
    still = np.flatnonzero(turning < min(_STILL_RAD_S, _CALM * calmest + _SWAY_RAD_S))
    half = _STILL_SECONDS / 2
    centres = recording.times[still]
    inside = (centres >= recording.times[0] + half) & (centres <= recording.times[-1] - half)
    centres = centres[inside]
    if centres.size == 0:
        raise SensorError(
            "nobody stands still in this recording",
            cause=f"the sensors turn more than {_STILL_RAD_S:g} rad/s in every second",
            remedy="Say when its wearer stands (--standing FROM:TO), or import it without alignment (--align none)",
        )
    away = np.maximum(walking[0] - centres, centres - walking[1])
    centre = float(centres[np.argmin(away)])
    return centre - half, centre + half


def _root_mean(
    recording: Recording, squares: Floats[Array, "samples sensors"], seconds: float
) -> Floats[Array, "samples"]:
    """Root of the mean over sensors and some seconds about each sample; infinite where nothing was measured."""
    known = np.isfinite(squares)
    width = max(1, round(seconds * recording.layout.rate)) | 1
    window = np.ones(min(width, len(squares)))
    total = np.convolve(np.where(known, squares, 0.0).sum(axis=1), window, "same")
    count = np.convolve(known.sum(axis=1).astype(np.float64), window, "same")
    return np.sqrt(np.where(count > 0.5, np.maximum(total, 0.0) / np.maximum(count, 1.0), np.inf))


def _runs(busy: Bools[Array, "samples"]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], busy.astype(np.int64), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
