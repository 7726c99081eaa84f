"""In which bands of frequency the specific force of walking people lies: of a real sensor, and of virtual ones.

This is what the default bandwidth of virtual IMUs rests on (`poseloom.synthesis.imus`).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
from scipy.signal import welch  # pyright: ignore

from poseloom.arrays import Array, Floats
from poseloom.benchmark.one_imu.alignment_check import walks_on
from poseloom.benchmark.one_imu.optical import FIRST_ROW
from poseloom.benchmark.one_imu.real_walk import NEURA_SENSORS
from poseloom.evaluation.rows import Row
from poseloom.formats.imus import read_imu_tracks
from poseloom.sensors.layout import imu_layout
from poseloom.skeleton.motion import Motion
from poseloom.synthesis.imus import NO_IMU_NOISE, ImuNoise, simulate_imus

BANDS_HZ = ((0.5, 3.0), (3.0, 6.0), (6.0, 10.0), (10.0, 15.0), (15.0, 25.0))
_PLACES = ("hips", "right-foot")
_WALKED = slice(FIRST_ROW + 50, FIRST_ROW + 900)
"""Packets of the real walk."""
_SEGMENT_SECONDS = 2.0


def signal_bands(data: Path, walks: Sequence[Motion]) -> tuple[Row, ...]:
    """Rows of the table "bands": root mean square of the specific force in each band, m/s^2.

    Args:
        data: Folder of the recordings; of `neura_walk` S02's sensors are taken.
        walks: Motions; those in which someone walks on are taken (`walks_on`).
    """
    asked = [walk for walk in walks if walks_on(walk)]
    tracks = read_imu_tracks(data / "imu" / "neura_walk" / "imu")
    rows: list[Row] = []
    for place in _PLACES:
        track = tracks[NEURA_SENSORS[place]]
        rows += _rows("real, S02", place, [(track.specific_forces[_WALKED], 1 / track.step)])
        for label, bandwidth in (("virtual, no filter", math.inf), ("virtual, as by default", ImuNoise().bandwidth_hz)):
            noise = replace(NO_IMU_NOISE, bandwidth_hz=bandwidth)
            heard = [simulate_imus(walk, imu_layout(place), noise) for walk in asked]
            rows += _rows(label, place, [(each.specific_forces[:, 0], each.layout.rate) for each in heard])
    return tuple(rows)


def _rows(label: str, place: str, signals: Iterable[tuple[Floats[Array, "samples 3"], float]]) -> list[Row]:
    powers = np.array([band_powers(values, rate) for values, rate in signals])
    return [
        Row("bands", label, place, "none", f"rms_{low:g}_{high:g}_hz", float(value), sequences=len(powers))
        for (low, high), value in zip(BANDS_HZ, np.sqrt(powers.mean(axis=0)), strict=True)
    ]


def band_powers(values: Floats[Array, "samples 3"], rate: float) -> Floats[Array, "bands"]:
    """Mean square in each of `BANDS_HZ`, all axes together (Welch's method)."""
    length = min(len(values), round(_SEGMENT_SECONDS * rate))
    frequencies, density = cast(tuple[np.ndarray, np.ndarray], welch(values, rate, nperseg=length, axis=0))
    total = density.sum(axis=1)
    step = float(frequencies[1])
    return np.array([total[(frequencies >= low) & (frequencies < high)].sum() * step for low, high in BANDS_HZ])
