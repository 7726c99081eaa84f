"""`poseloom benchmark libraries`, `sweep` and `six-trackers`: the six-sensor paper's experiments."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._measured import DATA_VARIABLE, recordings_of, rows_table, running_commit
from poseloom.cli._progress import progress_bars

if TYPE_CHECKING:
    pass

_Data = Annotated[
    Path | None,
    typer.Option("--data", envvar=DATA_VARIABLE, help="Folder of the recordings that the benchmark is defined on."),
]
_Json = Annotated[Path | None, typer.Option("--json", help="File for the figures as rows.")]
_Markdown = Annotated[
    Path | None, typer.Option("--markdown", help="Page to put the figures into, between its marks; made if missing.")
]
_Workers = Annotated[int, typer.Option(min=1, help="Number of processes.")]
_Seed = Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")]
_SHOWN_METRICS = frozenset(
    {
        *("joint_angle_deg", "error_over_no_fault", "settled_after_s", "worst_jump_cm", "difference_deg"),
        *("step_ms_p50", "step_ms_p99", "memory_gib", "step_p50_ratio", "bone_error_percent", "worst_bone_percent"),
        *("sensor_offset_cm", "sensor_turn_deg"),
        *("named_percent", "named_percent_to"),
    }
)


_TITLES = {"2": "table 2", "5": "figure 5", "1": "table 1: calibration", "search": "search against exact search"}


def _is_shown(metric: str) -> bool:
    return metric in _SHOWN_METRICS or metric.startswith("recall")


def add_commands(benchmarks: typer.Typer) -> None:
    """Adds the commands to the group `benchmark`."""
    benchmarks.command("libraries")(libraries)
    benchmarks.command("sweep")(sweep)
    benchmarks.command("six-trackers")(six_trackers)


def libraries(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for both libraries.")],
    data: _Data = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the takes that the small library does without.")] = 0,
    workers: _Workers = 2,
    replace: Annotated[bool, typer.Option("--replace", help="Replace the libraries that are there.")] = False,
) -> None:
    """Build the two libraries of the six-trackers benchmark: `small` (65,609 poses) and `large` (all, mirrored)."""
    from poseloom.benchmark.six_trackers.subset import build_libraries

    with progress_bars() as show:
        small, large = build_libraries(recordings_of(data), out, seed, workers, replace, show)
    typer.echo(f"{small}\n{large}")


def sweep(
    library: Annotated[Path, typer.Option("--library", "-l", help="Folder of a motion library of the recordings.")],
    data: _Data = None,
    json: _Json = None,
    markdown: _Markdown = None,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of trials.")] = 3,
    trials: Annotated[int, typer.Option(min=1, help="Trials a round and method.")] = 6,
    limit: Annotated[int, typer.Option(min=20, help="Samples of each sequence.")] = 60,
    seed: _Seed = 0,
    workers: _Workers = 2,
) -> None:
    """Try settings of every method on the validation sequences, as many for each, and name the best.

    Example: poseloom benchmark sweep --library libraries/small --data recordings
    """
    from rich.console import Console
    from rich.table import Table

    from poseloom.benchmark.six_trackers.page import sweep_figures, write_figures
    from poseloom.benchmark.sweep import SPACES, SweepPlan, best_of, in_words
    from poseloom.benchmark.sweep import sweep as run
    from poseloom.evaluation.rows import write_results

    with progress_bars() as show:
        folder = recordings_of(data)
        tried, results = run(library, folder, SweepPlan(rounds, trials, limit, seed, workers=workers), show)
    table = Table("method", "best of", "what differs from its settings", "degrees", "jitter / truth's", "step, ms")
    for method in SPACES:
        own = [each for each in tried if each.method == method]
        best = best_of(own)
        score = best.score
        table.add_row(
            method, str(len(own)), in_words(best.setting), f"{score.error:.2f}", f"{score.jitter:.1f}",
            f"{score.step_ms:.2f}",
        )  # fmt: skip
    Console().print(table)
    if json is not None:
        write_results(results, json)
    if markdown is not None:
        write_figures(markdown, sweep_figures(results, running_commit()), "Choosing settings")


def six_trackers(
    library: Annotated[
        list[Path],
        typer.Option("--library", "-l", help="Folder of a library of the recordings; the small one first."),
    ],
    data: _Data = None,
    quick: Annotated[bool, typer.Option("--quick", help="An honest subset, within a minute.")] = False,
    json: _Json = None,
    markdown: _Markdown = None,
    report: Annotated[Path | None, typer.Option("--report", help="HTML page with figures 5 and 7.")] = None,
    picture: Annotated[Path | None, typer.Option("--picture", help="SVG file for figure 7.")] = None,
    sizes: Annotated[
        Path | None, typer.Option("--sizes", help="Table of skeletons for table 1; DATA/sizes if left out.")
    ] = None,
    part: Annotated[
        list[str] | None,
        typer.Option("--part", help="1, 2, 5, three, faults, rejections, search, speed; repeatable; all if left out"),
    ] = None,
    limit: Annotated[int, typer.Option(min=20, help="Samples of each sequence.")] = 200,
    seed: _Seed = 0,
    workers: _Workers = 2,
) -> None:
    """Measure what the six-sensor paper measures: tables 1 and 2, figures 5 and 7, faults, search and speed.

    Example: poseloom benchmark six-trackers --quick -l libraries/small

    Example: poseloom benchmark six-trackers -l libraries/small -l libraries/large --json six-trackers.json
    """
    from dataclasses import replace

    from rich.console import Console

    from poseloom.benchmark.six_trackers.page import six_trackers_figures, write_figures
    from poseloom.benchmark.six_trackers.plan import PARTS, Plan, quick_plan
    from poseloom.benchmark.six_trackers.run import run_six_trackers
    from poseloom.errors import unknown_name
    from poseloom.evaluation.cases import Conditions
    from poseloom.evaluation.rows import write_results
    from poseloom.formats.atomic import atomic_file
    from poseloom.report.charts import require_charts

    if report is not None:
        require_charts()
    recordings, conditions = recordings_of(data), Conditions(seed=seed)
    for name in part or ():
        if name not in PARTS:
            raise unknown_name("part", name, PARTS)
    plan = (
        quick_plan(recordings, library[0], conditions)
        if quick
        else Plan(recordings, tuple(library), limit=limit, conditions=conditions)
    )
    plan = replace(plan, workers=workers, parts=tuple(part) if part else plan.parts)
    with progress_bars() as show:
        outcome = run_six_trackers(plan, show, sizes)
    console = Console()
    for name in dict.fromkeys(row.table for row in outcome.results.rows):
        mine = [row for row in outcome.results.rows if row.table == name]
        console.print(rows_table(_TITLES.get(name, name), mine, _is_shown))
    console.print(f"data digest {outcome.results.data_digest[:16]}, seed {seed}", highlight=False)
    if json is not None:
        write_results(outcome.results, json)
    if markdown is not None:
        write_figures(markdown, six_trackers_figures(outcome.results, running_commit()), "Six trackers")
    if report is not None:
        from poseloom.report.six_trackers import write_six_trackers_page

        write_six_trackers_page(report, outcome)
    if picture is not None and outcome.curves:
        from poseloom.report.six_trackers import error_curves_svg

        with atomic_file(picture) as file:
            file.write_text(error_curves_svg(outcome.curves), encoding="utf-8")
