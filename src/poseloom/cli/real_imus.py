"""`poseloom benchmark real-imus`: what real inertial sensors give."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._measured import DATA_VARIABLE, running_commit
from poseloom.cli._progress import progress_bars
from poseloom.errors import PoseloomError, unknown_name

if TYPE_CHECKING:
    from poseloom.benchmark.one_imu.real_imus import RealOutcome


def add_commands(benchmarks: typer.Typer) -> None:
    """Adds the command to the group `benchmark`."""
    benchmarks.command("real-imus")(real_imus)


def real_imus(
    data: Annotated[
        Path | None,
        typer.Option("--data", envvar=DATA_VARIABLE, help="Folder of the recordings: imu/ and mocap/."),
    ] = None,
    method: Annotated[
        list[str] | None, typer.Option(help="Methods of the walk with truth; may be repeated. Default: phase-hmm.")
    ] = None,
    json: Annotated[Path | None, typer.Option("--json", help="File for the figures as rows.")] = None,
    markdown: Annotated[
        Path | None, typer.Option("--markdown", help="Page to put the figures into, between its marks.")
    ] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder for SVG pictures, one a recording.")] = None,
    part: Annotated[
        list[str] | None,
        typer.Option(help="alignment, walk or cadence; may be repeated. Other tables of the JSON file stay."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
) -> None:
    """Measure alignment of sensors to bones, a real walk against cameras, and the cadence of other recordings.

    Example: poseloom benchmark real-imus --json real-imus.json --markdown real-imus.md --pictures pictures
    """
    from dataclasses import replace

    from rich.console import Console
    from rich.markdown import Markdown

    from poseloom.benchmark.one_imu.plan import METHODS, OURS
    from poseloom.benchmark.one_imu.real_imus import PARTS, measure_real_imus
    from poseloom.benchmark.one_imu.real_page import real_imus_figures
    from poseloom.benchmark.six_trackers.page import write_figures
    from poseloom.evaluation.rows import read_results, write_results

    if data is None or not (data / "imu").is_dir():
        raise PoseloomError(
            "no folder of recordings was given" if data is None else "this folder holds no imu/",
            remedy=f"Give --data (or {DATA_VARIABLE}) the folder that holds imu/ and mocap/",
            file=data,
        )
    for name in method or ():
        if name not in METHODS:
            raise unknown_name("method", name, METHODS)
    for name in part or ():
        if name not in PARTS:
            raise unknown_name("part", name, PARTS)
    with progress_bars() as show:
        outcome = measure_real_imus(data, tuple(method or (OURS,)), seed, show, tuple(part or PARTS))
    results = outcome.results
    if part and json is not None and json.is_file():
        measured = {row.table for row in results.rows}
        kept = tuple(row for row in read_results(json).rows if row.table not in measured)
        results = replace(results, rows=kept + results.rows)
    figures = real_imus_figures(results, running_commit())
    Console().print(Markdown(figures))
    if json is not None:
        write_results(results, json)
    if markdown is not None:
        write_figures(markdown, figures, "Real IMUs")
    if pictures is not None:
        _draw(outcome, pictures)


def _draw(outcome: "RealOutcome", folder: Path) -> None:
    from poseloom.formats.atomic import atomic_file
    from poseloom.report.page_data import TRUTH_COLOUR, method_colour
    from poseloom.report.strip import StripRow, strip_svg

    folder.mkdir(parents=True, exist_ok=True)
    for name, motions in outcome.pictures.items():
        rows: list[StripRow] = []
        for label, motion in motions.items():
            colour = TRUTH_COLOUR if label.startswith("cameras") else method_colour(len(rows) - (len(motions) > 1))
            rows.append(StripRow(label, motion, colour))
        with atomic_file(folder / f"real-{name.replace(', ', '-').replace(' ', '-')}.svg") as file:
            file.write_text(strip_svg(rows), encoding="utf-8")
