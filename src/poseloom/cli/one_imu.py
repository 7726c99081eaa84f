"""`poseloom benchmark one-imu`: the single-IMU paper's experiments."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._measured import DATA_VARIABLE, recordings_of, rows_table, running_commit
from poseloom.cli._progress import progress_bars

if TYPE_CHECKING:
    pass

_SHOWN = frozenset(
    {
        *("joint_position_cm", "foot_skate_over_truth", "turned_path_error_percent", "step_ms_p50", "step_ms_p99"),
        *(
            "largest_velocity_jump_m_s",
            "jerk_km_s3",
            "recognised_after_s",
            "right_phase_percent",
            "phase_begins_off_ms",
        ),
        *("first_minute_ms_p50", "last_minute_ms_p50", "peak_gained_kb"),
        *("largest_jump_cm", "worst_jump_cm", "leg_position_cm", "mean_over_behaviours_cm", "frames_a_second"),
    }
)

_TITLES = {"3": "table 3", "10": "figure 10", "2": "table 2"}


def add_commands(benchmarks: typer.Typer) -> None:
    """Adds the command to the group `benchmark`."""
    benchmarks.command("one-imu")(one_imu)


def one_imu(
    data: Annotated[
        Path | None,
        typer.Option("--data", envvar=DATA_VARIABLE, help="Folder of the recordings that the benchmark is defined on."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="An honest subset, within a minute.")] = False,
    json: Annotated[Path | None, typer.Option("--json", help="File for the figures as rows.")] = None,
    markdown: Annotated[
        Path | None,
        typer.Option("--markdown", help="Page to put the figures into, between its marks; made if missing."),
    ] = None,
    picture: Annotated[Path | None, typer.Option("--picture", help="SVG file for figure 10.")] = None,
    part: Annotated[
        list[str] | None,
        typer.Option(
            "--part",
            help="3, specialists, subject, 10, 2, long, transitions, phases, dropouts, real, sweep; all but this.",
        ),
    ] = None,
    method: Annotated[
        list[str] | None, typer.Option("--method", help="Ask this method alone. May be repeated; all if left out.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=60, help="Samples of each sequence; all if left out.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes.")] = 1,
) -> None:
    """Measure what the single-IMU paper measures: tables 2 and 3, figure 10, transitions; and drop-outs, a real walk.

    Example: poseloom benchmark one-imu --quick --data recordings
    """
    from rich.console import Console

    from poseloom.benchmark.one_imu.page import one_imu_figures
    from poseloom.benchmark.one_imu.plan import METHODS, PARTS, Plan
    from poseloom.benchmark.one_imu.run import run_one_imu
    from poseloom.benchmark.six_trackers.page import write_figures
    from poseloom.errors import unknown_name
    from poseloom.evaluation.rows import write_results
    from poseloom.formats.atomic import atomic_file

    usual = ("3", "2", "dropouts") if quick else tuple(each for each in PARTS if each != "sweep")
    for name in method or ():
        if name not in METHODS:
            raise unknown_name("method", name, METHODS)
    plan = Plan(
        recordings_of(data), tuple(part) if part else usual, tuple(method) if method else METHODS, quick,
        min(limit or 120, 120) if quick else limit, seed, workers,
    )  # fmt: skip
    console = Console()
    with progress_bars() as show:
        results = run_one_imu(plan, show)
    for name in dict.fromkeys(row.table for row in results.rows):
        mine = [row for row in results.rows if row.table == name]
        console.print(rows_table(_TITLES.get(name, name), mine, _SHOWN.__contains__))
    console.print(f"data digest {results.data_digest[:16]}, seed {seed}", highlight=False)
    if json is not None:
        write_results(results, json)
    if markdown is not None:
        write_figures(markdown, one_imu_figures(results, running_commit()), "One or two IMUs")
    if picture is not None:
        from poseloom.report.one_imu import placements_svg

        with atomic_file(picture) as file:
            file.write_text(placements_svg(results.rows), encoding="utf-8")
