"""Finding the held poses in a recording: still moments, and which pose each of them is."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.rotations import matrix_from_quat, mean_quat
from poseloom.sensors import Recording

STILL_SPEED = 0.12
"""Metres a second, over half a second, below which every tracker of a person who holds a pose stays."""

_SPAN_S = 0.5
_LEAST_SHARE = 0.3
_SHORTEST_S = 0.7
_MARGIN_S = 0.15
_SAME_POSE_M = 0.05
_LONGEST_GAP_S = 0.6


class Window(NamedTuple):
    """A still moment.

    Attributes:
        start: Its first sample.
        stop: The sample after its last.
    """

    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class StillReadings:
    """What the sensors said in still moments, averaged robustly; NaN where a sensor was silent.

    Attributes:
        windows: The moments.
        positions: Metres, world.
        rotations: `R_world_sensor`.
        stuck: For each sensor, in how many moments it repeated one reading; there it counts as silent.
    """

    windows: tuple[Window, ...]
    positions: Floats[Array, "windows sensors 3"]
    rotations: Floats[Array, "windows sensors 3 3"]
    stuck: Ints[Array, "sensors"]


def still_readings(recording: Recording) -> StillReadings:
    """The still moments of a recording, in order."""
    windows = _still_windows(recording)
    sensors = len(recording.layout)
    positions, rotations = np.full((len(windows), sensors, 3), np.nan), np.full((len(windows), sensors, 3, 3), np.nan)
    stuck = np.zeros(sensors, dtype=np.int64)
    for i, window in enumerate(windows):
        part = slice(window.start, window.stop)
        for sensor in range(sensors):
            places, quats = recording.positions[part, sensor], recording.quats_wxyz[part, sensor]
            came = np.isfinite(places[:, 0]) & np.isfinite(quats[:, 0])
            if (
                came.sum() > 1
                and (np.ptp(places[came], axis=0) == 0).all()
                and (np.ptp(quats[came], axis=0) == 0).all()
            ):
                stuck[sensor] += 1
            elif came.sum() >= _LEAST_SHARE * len(came):
                positions[i, sensor] = np.median(places[came], axis=0)
                rotations[i, sensor] = matrix_from_quat(_typical_quat(quats[came]))
    return StillReadings(windows, positions, rotations, stuck)


def _typical_quat(quats: Floats[Array, "samples 4"]) -> Floats[Array, "4"]:
    """The mean of those half of the quaternions that lie nearest to the mean of all."""
    middle = mean_quat(quats, np.ones(len(quats)))
    near = np.abs(quats @ middle)
    half = quats[near >= np.median(near)]
    return np.asarray(mean_quat(half, np.ones(len(half))))


def _still_windows(recording: Recording) -> tuple[Window, ...]:
    rate = recording.layout.rate
    reach = max(1, round(0.5 * _SPAN_S * rate))
    still = _slow(recording, reach)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    runs = [Window(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    merged: list[Window] = []
    for run in runs:
        if merged and run.start - merged[-1].stop <= _LONGEST_GAP_S * rate and _together(recording, merged[-1], run):
            merged[-1] = Window(merged[-1].start, run.stop)
        else:
            merged.append(run)
    margin = round(_MARGIN_S * rate)
    trimmed = (Window(w.start + margin, w.stop - margin) for w in merged)
    return tuple(w for w in trimmed if w.stop - w.start >= (_SHORTEST_S - 2 * _MARGIN_S) * rate)


def _slow(recording: Recording, reach: int) -> Bools[Array, "samples"]:
    """Samples around which no sensor gets anywhere; gaps and outliers of a sensor do not count."""
    count = len(recording)
    still = np.ones(count, dtype=np.bool_)
    for sensor in range(len(recording.layout)):
        places = _smoothed(recording.positions[:, sensor], max(1, reach // 2))
        before, after = np.clip(np.arange(count) - reach, 0, None), np.clip(np.arange(count) + reach, None, count - 1)
        seconds = np.maximum(recording.times[after] - recording.times[before], 1e-9)
        speed = np.linalg.norm(places[after] - places[before], axis=1) / seconds
        still &= ~(speed > STILL_SPEED)
    return still


def _smoothed(places: Floats[Array, "samples 3"], reach: int) -> Floats[Array, "samples 3"]:
    """Running median; NaN only where nothing came for its whole length."""
    padded = np.concatenate([np.full((reach, 3), np.nan), places, np.full((reach, 3), np.nan)])
    views = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)
    some = np.isfinite(views[:, 0]).any(axis=1)
    result = np.full_like(places, np.nan)
    result[some] = np.nanmedian(views[some], axis=2)
    return result


def _together(recording: Recording, first: Window, second: Window) -> bool:
    """Whether two still runs are one and the same pose."""
    with np.errstate(all="ignore"):
        a = np.nanmedian(recording.positions[first.start : first.stop], axis=0)
        b = np.nanmedian(recording.positions[second.start : second.stop], axis=0)
    apart = np.linalg.norm(a - b, axis=1)
    return bool(np.nanmax(apart, initial=0.0) < _SAME_POSE_M)


def pose_costs(
    measured: Floats[Array, "windows sensors 3"],
    expected: Floats[Array, "poses sensors 3"],
    orders: Sequence[Sequence[int]] | None = None,
) -> Floats[Array, "orders windows poses"]:
    """Mean squared distance between still moments and poses, after the best turn about the vertical and shift.

    Args:
        measured: Sensors' places in still moments; NaN where silent.
        expected: Sensors' places in poses.
        orders: For each hypothesis and sensor of the body, which measured sensor it is; as they are if left out.

    Returns:
        m^2 for each hypothesis, moment and pose.
    """
    hypotheses = np.array([range(measured.shape[1])] if orders is None else orders, dtype=np.int64)
    costs = np.empty((len(hypotheses), len(measured), len(expected)))
    for window, places in enumerate(measured):
        # One weight a sensor, 0 for silent ones, so that all hypotheses and poses are computed at once.
        here = places[hypotheses]
        weights = np.isfinite(here[..., :1]).astype(np.float64)
        count = np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
        here = np.nan_to_num(here)
        a = weights * (here - (weights * here).sum(axis=1, keepdims=True) / count)
        means = np.einsum("hs,psa->hpa", weights[..., 0], expected) / count
        b = expected - means[:, :, None]
        level = np.einsum("hs,hps->hp", a[..., 1], b[..., 1])
        planar = np.einsum("hs,hps->hp", a[..., 0], b[..., 0]) + np.einsum("hs,hps->hp", a[..., 2], b[..., 2])
        crossed = np.einsum("hs,hps->hp", a[..., 0], b[..., 2]) - np.einsum("hs,hps->hp", a[..., 2], b[..., 0])
        squares = (a**2).sum(axis=(1, 2))[:, None] + np.einsum("hs,hpsa->hp", weights[..., 0], b**2)
        costs[:, window] = (squares - 2 * (level + np.hypot(planar, crossed))) / count[:, :, 0]
    return np.maximum(costs, 0.0)


def all_orders(sensors: int) -> list[tuple[int, ...]]:
    """Every way in which sensors may have been exchanged, as they should be first."""
    return list(permutations(range(sensors)))


_SKIP_WINDOW = 0.09
_SKIP_POSE = 0.12
"""Costs, in m^2, of a still moment that is no pose and of a pose that was not held."""


def match_in_order(costs: Floats[Array, "windows poses"]) -> tuple[Ints[Array, "poses"], float]:
    """Which still moment is which pose, both in order, at the least total cost.

    Args:
        costs: Of each moment as each pose of the whole sequence (all rounds), m^2.

    Returns:
        For each pose its moment, -1 where none fits, and the total cost.
    """
    windows, poses = costs.shape
    total = np.full((windows + 1, poses + 1), np.inf)
    total[:, 0] = _SKIP_WINDOW * np.arange(windows + 1)
    total[0] = _SKIP_POSE * np.arange(poses + 1)
    for w in range(1, windows + 1):
        for p in range(1, poses + 1):
            total[w, p] = min(
                total[w - 1, p - 1] + costs[w - 1, p - 1],
                total[w - 1, p] + _SKIP_WINDOW,
                total[w, p - 1] + _SKIP_POSE,
            )
    found = np.full(poses, -1, dtype=np.int64)
    w, p = windows, poses
    while w and p:
        if np.isclose(total[w, p], total[w - 1, p - 1] + costs[w - 1, p - 1], rtol=1e-12, atol=0):
            w, p = w - 1, p - 1
            found[p] = w
        elif np.isclose(total[w, p], total[w - 1, p] + _SKIP_WINDOW, rtol=1e-12, atol=0):
            w -= 1
        else:
            p -= 1
    return found, float(total[windows, poses])
