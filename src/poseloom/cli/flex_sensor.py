"""`poseloom fit flex-sensor` and `import-flex`: real flex sensors, on the bench and in logs."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Adds `import-flex` to the application."""
    app.command("import-flex")(import_flex)


def import_flex(
    log: Annotated[Path, typer.Argument(help="Lines of a time and counts, as a board wrote them.", metavar="LOG")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write, an .mcap file.")],
    columns: Annotated[
        str | None,
        typer.Option(help="What the columns are, such as time,leftKnee,rightKnee,leftElbow,rightElbow,-"),
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Lines a second, where they carry no time.", min=1.0)] = None,
    unit: Annotated[float | None, typer.Option(help="Seconds in which the time counts; found if left out.")] = None,
    values: Annotated[
        str, typer.Option(help="What the values are: counts, volts, millivolts or percent; told if left out.")
    ] = "",
    full_scale: Annotated[
        float | None, typer.Option(help="The value at the converter's upper end, such as 5 for volts.")
    ] = None,
) -> None:
    """Make a recording of a log of four flex sensors, from a memory card or a serial line.

    Example: poseloom import-flex LOG.CSV -o log.mcap
    """
    from rich.console import Console

    from poseloom.errors import SensorError
    from poseloom.formats.flex_log import read_flex_log
    from poseloom.formats.recording import write_recording
    from poseloom.sensors import layout
    from poseloom.sensors.summary import summarise

    if output.suffix.lower() != ".mcap":
        raise SensorError("a recording is an .mcap file", remedy=f"Name {output.with_suffix('.mcap')}", file=output)
    recording, notes = read_flex_log(
        log,
        layout("flex-four"),
        (columns or "").split(",") if columns else (),
        rate,
        unit,
        values=values,
        full_scale=full_scale,
    )
    write_recording(recording, output)
    console = Console()
    for label, text in [("recording", str(output)), *summarise(recording)]:
        console.print(f"{label:<18}{text}", soft_wrap=True, highlight=False, markup=False)
    console.print(f"{notes.good} of {notes.lines} lines used")
    console.print(notes.said, soft_wrap=True, highlight=False, markup=False)


def fit_flex_sensor(
    data: Annotated[
        Path,
        typer.Argument(help="Folder of bench recordings: PERSON_NUMBER.csv with r1, r2 ... and angle.", metavar="DATA"),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The figures, a JSON file.")] = Path(
        "flex_sensors.json"
    ),
    report: Annotated[Path | None, typer.Option("--report", help="A page with fit beside data, .html.")] = None,
    rate: Annotated[float, typer.Option(help="Rows a second: the files do not say.", min=1.0)] = 50.0,
    source: Annotated[str, typer.Option(help="Where the recordings come from, to be kept in the file.")] = "",
) -> None:
    """Learn what flex sensors are like from counts beside a true angle; judge that on recordings held back."""
    from rich.console import Console

    from poseloom.formats.atomic import atomic_file
    from poseloom.formats.bend_tables import read_bend_tables, read_displaced_tables
    from poseloom.report.charts import require_charts
    from poseloom.synthesis.flex_figures import sensors_to_json
    from poseloom.synthesis.flex_study import provenance, study_flex_sensors

    if report is not None:
        require_charts()
    tables = read_bend_tables(data, rate)
    study = study_flex_sensors(tables, read_displaced_tables(data, rate))
    facts = provenance(study, tables, source)
    with atomic_file(output) as part:
        part.write_text(sensors_to_json(study.sensors, study.fitted, facts), encoding="utf-8")
    if report is not None:
        from poseloom.report.flex_sensor import write_flex_report

        write_flex_report(report, study, tables, f"poseloom fit flex-sensor, {len(tables)} recordings")
    console = Console()
    for name, value in {**study.measured, **study.judged}.items():
        console.print(f"{name}: {value:.4g}", highlight=False)
    console.print(f"{output}: {len(study.fits)} sensors of {len(tables)} recordings")
