"""`poseloom import-imu`: recordings of real inertial sensors made ready for `poseloom reconstruct`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli.sensing import show_recording
from poseloom.errors import SensorError, unknown_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from poseloom.calibration.imu_alignment import ImuAlignment
    from poseloom.formats.imus import ImuTrack
    from poseloom.sensors import Recording

_ALIGNMENTS = ("walk", "none")


def register(app: typer.Typer) -> None:
    """Adds `import-imu` to the application."""
    app.command("import-imu")(import_imu)


def import_imu(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Files or folders of one recording; see docs/imus.md.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The recording to write, an .mcap file.")
    ] = None,
    sensors: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PLACE=NAME",
            help="Where a sensor is worn, and what the files call it, such as right-foot=00B40C48; one to three."
            " Without it, the sensors in the files are listed.",
        ),
    ] = None,
    rate: Annotated[float, typer.Option(help="Samples a second of the recording.")] = 60.0,
    bandwidth_hz: Annotated[float, typer.Option(help="Where the low-pass filter passes one half.")] = 10.0,
    align: Annotated[
        str, typer.Option(help="How sensors are turned on bones: found from standing and walking (walk), or none.")
    ] = "walk",
    standing: Annotated[str, typer.Option(metavar="FROM:TO", help="Seconds of standing still. Default: found.")] = "",
    walking: Annotated[str, typer.Option(metavar="FROM:TO", help="Seconds of walking. Default: found.")] = "",
    start: Annotated[float, typer.Option(help="Second at which the recording begins.")] = 0.0,
    stop: Annotated[float | None, typer.Option(help="Second at which it ends.")] = None,
    source_rate: Annotated[float | None, typer.Option(help="Samples a second of files that do not say it.")] = None,
    time_unit: Annotated[
        str, typer.Option(help="Of a table's time: s, ms, us, ns, seconds of a tick, or index to count rows.")
    ] = "",
    accel_unit: Annotated[
        str, typer.Option(help="Of a table's specific force: m/s2, g, mg, or m/s2 in one unit.")
    ] = "",
    gyro_unit: Annotated[
        str, typer.Option(help="Of a table's angular rate: rad/s, deg/s, mdps, or rad/s in one unit.")
    ] = "",
    quat_order: Annotated[
        str, typer.Option(help="Of a table's quaternions: wxyz, xyzw, or none to leave them out.")
    ] = "",
    columns: Annotated[
        Path | None,
        typer.Option(metavar="MAP.toml", help="Which columns of a table hold what; see docs/imus.md.", exists=True),
    ] = None,
    name: Annotated[str | None, typer.Option(help="What to call the recording.")] = None,
) -> None:
    """Put a recording of real IMUs on one clock, turn the sensors' axes to the bones', and write it for reconstruct.

    What is found out of a table's units, clock and order of quaternions is printed, and can be given by options.
    All seconds count from the first moment that all the sensors know, also with --start.

    Example: poseloom import-imu walk/ --sensors right-foot=00B40C48 -o walk.mcap
    """
    from poseloom.calibration.imu_alignment import align_imus, turn_to_bones
    from poseloom.formats.column_map import read_column_map
    from poseloom.formats.imus import ImuChoices, assemble_imus, read_imu_tracks
    from poseloom.formats.recording import write_recording

    if align not in _ALIGNMENTS:
        raise unknown_name("way to align", align, _ALIGNMENTS, SensorError)
    mapped = read_column_map(columns) if columns is not None else None
    choices = ImuChoices(source_rate, time_unit, accel_unit, gyro_unit, quat_order, mapped)
    tracks = read_imu_tracks(paths, choices=choices)
    _show_notes(tracks)
    if not sensors:
        _list(tracks)
        return
    if output is None or output.suffix.lower() != ".mcap":
        raise SensorError("the recording needs a file to go to", remedy="Name an .mcap file (-o REC.mcap)")
    worn = _worn(sensors, tracks)
    title = paths[0].stem if name is None else name
    recording = assemble_imus(worn, rate=rate, bandwidth_hz=bandwidth_hz, name=title)
    if align == "walk":
        found = align_imus(recording, _episode(standing), _episode(walking))
        recording = turn_to_bones(recording, found)
        _show_alignment(found)
    if start or stop is not None:
        recording = recording.cut(*_samples(recording, start, stop))
    write_recording(recording, output)
    show_recording(recording, output)


def _show_notes(tracks: "Mapping[str, ImuTrack]") -> None:
    """How units, clocks and orders of each file were found, one line a fact."""
    for file in dict.fromkeys(track.file for track in tracks.values()):
        notes = [note for track in tracks.values() if track.file == file for note in track.notes]
        for note in dict.fromkeys(notes):
            typer.echo(f"{file.name}: {note}")


def _worn(sensors: "Sequence[str]", tracks: "Mapping[str, ImuTrack]") -> "dict[str, ImuTrack]":
    worn: dict[str, ImuTrack] = {}
    for text in sensors:
        place, separator, track = text.partition("=")
        if not separator or place in worn:
            raise SensorError(
                f"the sensor {text!r} is not understood" if not separator else f"two sensors are worn at {place!r}",
                remedy="Write PLACE=NAME, such as right-foot=00B40C48, and each place once",
            )
        if track not in tracks:
            raise unknown_name("sensor", track, tracks, SensorError)
        worn[place] = tracks[track]
    return worn


def _episode(text: str) -> tuple[float, float] | None:
    if not text:
        return None
    try:
        start, stop = (float(part) for part in text.split(":"))
    except ValueError:
        start, stop = 1.0, 0.0
    if not start < stop:
        raise SensorError(f"the moments {text!r} are not understood", remedy="Write FROM:TO in seconds, such as 2:3.5")
    return start, stop


def _samples(recording: "Recording", start: float, stop: float | None) -> tuple[int, int]:
    end = recording.duration if stop is None else stop
    if not 0 <= start <= min(end, recording.duration):
        raise SensorError(
            f"nothing was recorded from {start:g} s to {end:g} s",
            cause=f"the recording lasts {recording.duration:.2f} s",
            remedy="Choose --start below --stop, and within the recording",
        )
    rate = recording.layout.rate
    return round(start * rate), round(min(end, recording.duration) * rate) + 1


def _list(tracks: "Mapping[str, ImuTrack]") -> None:
    import numpy as np
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table("sensor", "samples", "seconds", "Hz", "tells", box=None, pad_edge=False)
    for track in tracks.values():
        channels = {
            "specific force": track.specific_forces,
            "angular rate": track.angular_rates,
            "orientation": track.quats_wxyz,
        }
        told = ", ".join(channel for channel, values in channels.items() if np.isfinite(values).any())
        seconds = track.times[-1] - track.times[0]
        table.add_row(Text(track.name), f"{len(track)}", f"{seconds:.2f}", f"{1 / track.step:.1f}", told)
    Console().print(table)


def _show_alignment(alignments: "Sequence[ImuAlignment]") -> None:
    from rich.console import Console

    for found in alignments:
        doubt = "; this may be backwards: look at the result" if found.forward_trust < 0.3 else ""
        Console().print(
            f"{found.sensor}: forwards told with trust {found.forward_trust:.2f}, "
            f"axis with {found.axis_trust:.2f}{doubt}",
            markup=False,
            highlight=False,
        )
