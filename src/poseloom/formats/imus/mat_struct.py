"""MATLAB files of inertial data as the qmt toolbox has them: a vector `t`, and one structure a sensor.

Each structure has `acc` in m/s^2 and `gyr` in rad/s. Its `quat`, if there is one, is left alone: in qmt's own example
it turns with the body segment, in the axes of that toolbox's figure, and not with the sensor.
"""

import io
from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy.io import loadmat  # pyright: ignore

from poseloom.errors import FormatError
from poseloom.formats._files import read_bytes
from poseloom.formats.imus._mat_elements import check_mat
from poseloom.formats.imus.tracks import ImuTrack, make_track


def read_imu_mat(path: Path) -> tuple[ImuTrack, ...]:
    """Reads all sensors by the names of their structures.

    Raises:
        FormatError: for a file that is no MATLAB 5 file, or has no `t` or no structure with acc and gyr of its length.
    """
    whole = read_bytes(path)
    try:
        check_mat(whole)
        content = cast(dict[str, Any], loadmat(io.BytesIO(whole), squeeze_me=True, struct_as_record=True))
        # Damaged files make this reader raise almost anything; none of it comes from here.
    except Exception as error:
        raise FormatError(
            "this MATLAB file cannot be read",
            cause=f"{type(error).__name__}: {error}"[:160],
            remedy="Save it from MATLAB with -v7, or get it again",
            file=path,
        ) from None
    times = np.atleast_1d(np.asarray(content.get("t", []), dtype=np.float64))
    tracks: list[ImuTrack] = []
    for name, value in content.items():
        fields = getattr(getattr(value, "dtype", None), "names", None) or ()
        if {"acc", "gyr"} <= set(fields):
            acc, gyr = (_vectors(value, name, part, len(times), path) for part in ("acc", "gyr"))
            tracks.append(make_track(name, times, path, specific_forces=acc, angular_rates=gyr))
    if not tracks:
        raise FormatError(
            "this MATLAB file holds no inertial sensors",
            cause="no structure in it has acc and gyr",
            remedy="Save t, and one structure with acc and gyr a sensor",
            file=path,
        )
    return tuple(tracks)


def _vectors(value: Any, name: str, part: str, moments: int, path: Path) -> np.ndarray:
    try:
        array = np.asarray(value[part].item(), dtype=np.float64)
    except (ValueError, TypeError):
        array = np.empty(0)
    if array.shape != (moments, 3):
        raise FormatError(
            f"{name}.{part} has shape {array.shape}, but t has {moments} moments",
            remedy="Give three numbers a moment",
            file=path,
        )
    return array
