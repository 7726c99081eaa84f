"""From sensors on clocks of their own to one recording on one clock."""

import math
from collections.abc import Mapping

import numpy as np

from poseloom.arrays import Array, Bools, Floats, exceeds_room
from poseloom.errors import FormatError, SensorError
from poseloom.formats.imus.tracks import ImuTrack
from poseloom.rotations import matrix_from_quat
from poseloom.sensors.layout import imu_layout
from poseloom.sensors.paths import SmoothPath
from poseloom.sensors.placement import default_placements
from poseloom.sensors.recording import Recording, make_recording
from poseloom.skeleton.body import average_body
from poseloom.skeleton.differences import angular_velocity
from poseloom.skeleton.skeleton import Skeleton

_GAP = 1.5
"""Samples further apart than this many steps have lost something between them."""
_SHORTEST_RUN = 5


def assemble_imus(
    worn: Mapping[str, ImuTrack],
    *,
    rate: float = 60.0,
    bandwidth_hz: float = 10.0,
    start: float = 0.0,
    stop: float = math.inf,
    skeleton: Skeleton | None = None,
    name: str = "",
) -> Recording:
    """Puts tracks on one clock, as a recording of the layout that they make.

    What all sensors measured is low-passed as simulated sensors are (`SmoothPath`: without delay, so it looks a few
    hundredths of a second ahead) and read off at the recording's moments. Between two samples that have lost others
    between them nothing is known, and the recording says missing. Angular rates that no file tells are derived from
    orientations. The clocks are taken at their word: sensors that were set together but tick apart stay as they were.

    Args:
        worn: Tracks by where the sensors are worn, in words of `imu_layout` such as "right-foot".
        rate: Samples a second of the recording.
        bandwidth_hz: Where the low-pass filter passes one half; infinite for none.
        start: Seconds after the first moment that all sensors know.
        stop: Seconds after that at which to end.
        skeleton: The wearer's; the average body if left out.
        name: What to call it.

    Returns:
        Times begin at nought; the placements are the default ones, which say nothing of how the sensors were turned:
        see `poseloom.calibration.imu_alignment`.

    Raises:
        SensorError: for unknown places, or an interval in which there is nothing.
        FormatError: if the tracks have no moment in common.
    """
    layout = imu_layout(*worn, rate=rate)
    tracks = list(worn.values())
    begin = max(float(track.times[0]) for track in tracks)
    end = min(float(track.times[-1]) for track in tracks)
    if end <= begin:
        raise FormatError(
            f"the sensors {', '.join(track.name for track in tracks)} have no moment in common",
            cause="they were recorded one after another, or their clocks were set apart",
            remedy="Give sensors that were recorded together",
            file=tracks[0].file,
        )
    if not (start >= 0 and start < min(stop, end - begin)):
        raise SensorError(
            f"nothing was recorded from {start:g} s to {stop:g} s",
            cause=f"the sensors have {end - begin:.2f} s in common",
            remedy="Choose --start below --stop, and within the recording",
        )
    length = min(stop, end - begin) - start
    if exceeds_room(length * rate, max(len(track) for track in tracks), 10 * len(tracks)):
        longest = max(tracks, key=lambda track: float(np.diff(track.times).max()))
        gap = int(np.argmax(np.diff(longest.times)))
        raise FormatError(
            f"the sensors have {length:.4g} s in common, too long for a recording at {rate:g} Hz",
            cause=f"after {longest.times[gap] - begin:.4g} s come {np.diff(longest.times)[gap]:.4g} s without a sample",
            remedy="Choose --start and --stop, or correct the times",
            file=longest.file,
        )
    times = np.arange(math.floor(length * rate + 1e-6) + 1) / rate
    forces, rates, quats = (np.full((len(times), len(tracks), width), np.nan) for width in (3, 3, 4))
    for index, track in enumerate(tracks):
        read = _read_off(track, begin + start + times, bandwidth_hz)
        forces[:, index], rates[:, index], quats[:, index] = read[:, :3], read[:, 3:6], read[:, 6:]
    body = average_body() if skeleton is None else skeleton
    derived = [track.name for track in tracks if not np.isfinite(track.angular_rates).any()]
    notes = list(dict.fromkeys(note for track in tracks for note in track.notes))
    settings = {
        "made by": "import",
        "source": ", ".join(f"{place} = {track.name}" for place, track in worn.items()),
        "bandwidth": f"{bandwidth_hz:g} Hz",
        "begins at": f"{begin + start:.6f} s",
        **({"read as": "; ".join(notes)} if notes else {}),
        **({"angular rates derived from orientations": ", ".join(derived)} if derived else {}),
    }
    return make_recording(
        layout,
        default_placements(layout, body),
        body,
        times,
        specific_forces=forces,
        angular_rates=rates,
        quats_wxyz=quats,
        name=name,
        settings=settings,
    )


def _read_off(track: ImuTrack, moments: Floats[Array, "moments"], bandwidth_hz: float) -> Floats[Array, "moments 10"]:
    """Specific force, angular rate and orientation at moments of the track's clock."""
    out = np.full((len(moments), 10), np.nan)
    step = track.step
    gyros = np.isfinite(track.angular_rates[:, 0])
    values = np.concatenate([track.specific_forces, track.angular_rates, track.quats_wxyz], axis=1)
    # Channels are looked at apart: a file may lack one of them throughout, or here and there.
    for columns in (slice(0, 3), slice(3, 6), slice(6, 10)):
        known = np.asarray(np.isfinite(values[:, columns]).all(axis=1))
        for run in _runs(track.times, known, step):
            part = values[run, columns]
            if columns.start == 6:
                part = _same_sign(part)
            inside = (moments >= track.times[run][0] - 1e-9) & (moments <= track.times[run][-1] + 1e-9)
            places = np.interp(moments[inside], track.times[run], np.arange(len(part), dtype=np.float64))
            out[inside, columns] = SmoothPath(part, 1 / step, bandwidth_hz).at(places)
            if columns.start == 6 and not gyros.any():
                rotations = matrix_from_quat(part)
                spin = np.einsum("nji,nj->ni", rotations, angular_velocity(rotations, 1 / step))
                out[inside, 3:6] = SmoothPath(spin, 1 / step, bandwidth_hz).at(places)
    out[:, 6:] /= np.linalg.norm(out[:, 6:], axis=1, keepdims=True)
    return out


def _runs(times: Floats[Array, "samples"], known: Bools[Array, "samples"], step: float) -> list[slice]:
    """Stretches of known samples in which none is lost."""
    places = np.flatnonzero(known)
    if places.size == 0:
        return []
    breaks = np.flatnonzero((np.diff(places) > 1) | (np.diff(times[places]) > _GAP * step)) + 1
    stretches = np.split(places, breaks)
    return [slice(int(s[0]), int(s[-1]) + 1) for s in stretches if len(s) >= _SHORTEST_RUN]


def _same_sign(quats: Floats[Array, "samples 4"]) -> Floats[Array, "samples 4"]:
    flips = np.where(np.sum(quats[1:] * quats[:-1], axis=1) < 0, -1.0, 1.0)
    return quats * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
