"""`poseloom benchmark live`: what the live path promises, measured."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from poseloom.cli._measured import running_commit
from poseloom.cli._progress import progress_bars
from poseloom.errors import unknown_name


def add_commands(benchmarks: typer.Typer) -> None:
    """Adds the command to the group `benchmark`."""
    benchmarks.command("live")(live)


def live(
    quick: Annotated[bool, typer.Option("--quick", help="45 s instead of half an hour, and less of the rest.")] = False,
    json: Annotated[
        Path | None,
        typer.Option("--json", help="File for the figures as rows; what it holds of parts left out now stays."),
    ] = None,
    markdown: Annotated[
        Path | None,
        typer.Option("--markdown", help="Page to put the figures into, made if missing."),
    ] = None,
    part: Annotated[
        list[str] | None,
        typer.Option("--part", help="endurance, fast, two, faults, hostile or time; may be repeated. All if left out."),
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="Length of the long session.", min=10.0)] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
) -> None:
    """Measure delays, losses, memory and faults of live sessions on simulated devices in other processes.

    Example: poseloom benchmark live --quick
    """
    from rich.console import Console
    from rich.markdown import Markdown

    from poseloom.benchmark.live.page import live_figures
    from poseloom.benchmark.live.run import PARTS, QUICK, LivePlan, measure_live, with_rows_of
    from poseloom.benchmark.six_trackers.page import write_figures
    from poseloom.evaluation.rows import read_results, write_results

    for name in part or ():
        if name not in PARTS:
            raise unknown_name("part", name, PARTS)
    plan = replace(QUICK if quick else LivePlan(), seed=seed, parts=tuple(part) if part else PARTS)
    if seconds is not None:
        plan = replace(plan, endurance=seconds)
    with progress_bars() as show:
        results = measure_live(plan, show)
    if json is not None and json.is_file():
        results = with_rows_of(results, read_results(json))
    figures = live_figures(results, running_commit())
    Console().print(Markdown(figures))
    if json is not None:
        write_results(results, json)
    if markdown is not None:
        write_figures(markdown, figures, "Live")
