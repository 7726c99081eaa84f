"""Recordings of real inertial sensors of any known kind: which reader serves which file or folder."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from poseloom.errors import FormatError, Named
from poseloom.formats._files import open_regular, reading
from poseloom.formats.imus.choices import ImuChoices
from poseloom.formats.imus.csv_tables import is_imu_csv, read_imu_csv
from poseloom.formats.imus.mat_struct import read_imu_mat
from poseloom.formats.imus.mvnx import read_mvnx
from poseloom.formats.imus.opensim_sto import read_sto
from poseloom.formats.imus.tracks import ImuTrack
from poseloom.formats.imus.units import force_unit
from poseloom.formats.imus.xio import is_xio_folder, read_xio
from poseloom.formats.imus.xsens_text import is_xsens_text, read_xsens_text

_HEAD = 8192
_KNOWN = (
    "Xsens text (.txt), .mvnx, x-IMU3 folders, tables with columns acc_x ... gyr_z (.csv, .tsv, .txt), OpenSim .sto, "
    "qmt's .mat"
)


def read_imu_tracks(
    paths: Path | Iterable[Path], rate: float | None = None, choices: ImuChoices | None = None
) -> Mapping[str, ImuTrack]:
    """Reads real recordings: every sensor in some files and folders, by name.

    A folder stands for the x-IMU3 sensors in it, or else its Xsens texts, or else its CSV tables.

    Args:
        paths: Files or folders.
        rate: Samples a second, for files that do not say it.
        choices: Units, order and columns of text tables, where they shall not be told from names and values; its own
            rate gives way to `rate`.

    Returns:
        Tracks by the sensors' names as the files have them, in the files' order.

    Raises:
        FormatError: with file and line, for damaged or unknown files, and for two sensors of one name.
    """
    tracks: dict[str, ImuTrack] = {}
    chosen = choices or ImuChoices()
    chosen = chosen if rate is None else replace(chosen, rate=rate)
    for path in [paths] if isinstance(paths, Path) else paths:
        for track in _guarded(path, chosen):
            _check_stated(track, chosen)
            if track.name in tracks:
                raise FormatError(
                    f"there are two sensors {track.name!r}",
                    cause=f"the other one is in {tracks[track.name].file}",
                    remedy="Name only one of the files",
                    file=track.file,
                )
            tracks[track.name] = track
    return MappingProxyType(Named("sensor in these files", tracks, FormatError))


def _guarded(path: Path, choices: ImuChoices) -> tuple[ImuTrack, ...]:
    with reading(path, "an inertial recording"):
        return tuple(_read(path, choices))


def _read(path: Path, choices: ImuChoices) -> Iterable[ImuTrack]:
    if path.is_dir():
        return _read_folder(path, choices)
    suffix = path.suffix.lower()
    if suffix in _BY_SUFFIX:
        return _BY_SUFFIX[suffix](path)
    head = _head(path)
    if is_xsens_text(head):
        return (read_xsens_text(path, choices.rate),)
    if is_imu_csv(head) or (choices.columns is not None and choices.columns.sensors):
        return read_imu_csv(path, choices)
    raise FormatError(
        "this file holds no inertial recording that poseloom reads", remedy=f"Give one of: {_KNOWN}", file=path
    )


_BY_SUFFIX: Mapping[str, Callable[[Path], tuple[ImuTrack, ...]]] = {
    ".mvnx": read_mvnx,
    ".sto": read_sto,
    ".mat": read_imu_mat,
}


def _check_stated(track: ImuTrack, choices: ImuChoices) -> None:
    """Raises where a file of a kind that states its units holds no gravity, or where units are given for it.

    Tables of any wording check themselves, and say so in their tracks' notes.
    """
    if track.notes:
        return
    for option in ("time_unit", "accel_unit", "gyro_unit", "quat_order", "columns"):
        if getattr(choices, option):
            raise FormatError(
                f"--{option.replace('_', '-')} was given, but files of this kind state it themselves",
                remedy="Leave it out",
                file=track.file,
            )
    if np.isfinite(track.specific_forces).all(axis=1).any():
        try:
            force_unit([track.specific_forces], track.step, "m/s2")
        except FormatError as error:
            raise FormatError(
                f"sensor {track.name!r}: {error.fact.partition(', but')[0]} (m/s2)",
                cause="gravity is 9.81: it was taken off, or the unit is another than this kind of file has",
                remedy="Export the raw acceleration (specific force, with gravity)",
                file=track.file,
            ) from None


def _read_folder(folder: Path, choices: ImuChoices) -> Iterable[ImuTrack]:
    if is_xio_folder(folder):
        return (read_xio(folder),)
    inside = sorted(folder.iterdir())
    sensors = [path for path in inside if path.is_dir() and is_xio_folder(path)]
    if sensors:
        return [read_xio(path) for path in sensors]
    files = [path for path in inside if path.is_file()]
    texts = [path for path in files if path.suffix.lower() == ".txt" and is_xsens_text(_head(path))]
    if texts:
        return [read_xsens_text(path, choices.rate) for path in texts]
    tables = [path for path in files if path.suffix.lower() in (".csv", ".tsv") and is_imu_csv(_head(path))]
    if not tables:
        raise FormatError(
            "this folder holds no inertial recording that poseloom reads", remedy=f"Give one of: {_KNOWN}", file=folder
        )
    return [track for path in tables for track in read_imu_csv(path, choices)]


def _head(path: Path) -> bytes:
    with open_regular(path) as stream:
        return stream.read(_HEAD)
