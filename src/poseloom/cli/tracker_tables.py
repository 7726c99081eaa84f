"""`poseloom import-trackers`: tables of foreign trackers made ready for `poseloom reconstruct`."""

from pathlib import Path
from typing import Annotated

import typer

from poseloom.errors import SensorError


def register(app: typer.Typer) -> None:
    """Adds `import-trackers` to the application."""
    app.command("import-trackers")(import_trackers)


def import_trackers(
    table: Annotated[Path, typer.Argument(help="A text table of positions and quaternions.", metavar="TABLE")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write, an .mcap file.")],
    columns: Annotated[
        Path | None, typer.Option(metavar="MAP.toml", help="Which columns hold what; see docs/sensors.md.", exists=True)
    ] = None,
    layout: Annotated[str, typer.Option(help="six-trackers or three-trackers; found if left out.")] = "",
    source_rate: Annotated[float | None, typer.Option(help="Samples a second of tables without times.")] = None,
    time_unit: Annotated[
        str, typer.Option(help="Of the time: s, ms, us, ns, seconds of a tick, or index to count rows.")
    ] = "",
    length_unit: Annotated[str, typer.Option(help="Of positions: m, cm, mm, in, ft, or metres in one unit.")] = "",
    up: Annotated[str, typer.Option(help="The axis that points up: y, z, x, -y ...; found if left out.")] = "",
    handedness: Annotated[str, typer.Option(help="Of the axes: right or left.")] = "",
    quat_order: Annotated[str, typer.Option(help="Of the quaternions: wxyz or xyzw.")] = "",
) -> None:
    """Make a recording of a table of trackers' positions and quaternions.

    Example: poseloom import-trackers session.tsv --columns map.toml -o session.mcap
    """
    from poseloom.cli.sensing import show_recording
    from poseloom.formats.column_map import read_column_map
    from poseloom.formats.recording import write_recording
    from poseloom.formats.tracker_tables import TrackerChoices, read_tracker_table

    if output.suffix.lower() != ".mcap":
        raise SensorError("a recording is an .mcap file", remedy=f"Name {output.with_suffix('.mcap')}", file=output)
    mapped = read_column_map(columns) if columns is not None else None
    choices = TrackerChoices(layout, source_rate, time_unit, length_unit, up, handedness, quat_order, mapped)
    recording, notes = read_tracker_table(table, choices)
    for note in notes:
        typer.echo(f"{table.name}: {note}")
    write_recording(recording, output)
    show_recording(recording, output)
