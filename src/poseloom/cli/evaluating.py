"""`poseloom evaluate`: methods against the truth."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._progress import progress_bars

if TYPE_CHECKING:
    from rich.table import Table

    from poseloom.evaluation.experiment import Evaluation

_SHOWN = (
    *("joint_angle_deg", "joint_rotation_deg", "global_rotation_deg", "sip_deg", "joint_position_cm"),
    *("root_position_cm", "jitter_deg_s3", "foot_skate_cm_s", "look_ahead_ms", "step_ms_p50", "step_ms_p99"),
)
_MOST_SEQUENCES = 12
"""Sequences up to which each has a line of its own."""


def register(app: typer.Typer) -> None:
    """Adds `evaluate` to the application."""
    app.command("evaluate")(evaluate)


def evaluate(
    clips: Annotated[
        list[str],
        typer.Argument(
            metavar="REC_OR_CLIP...",
            help="Recordings with truth (.mcap), motion files, folders of them, sample:NAME, or samples for all.",
        ),
    ],
    method: Annotated[
        list[str] | None,
        typer.Option("--method", "-m", help="A method (see `poseloom methods`); may be repeated."),
    ] = None,
    library: Annotated[Path | None, typer.Option("--library", "-l", help="Folder of a motion library.")] = None,
    split: Annotated[
        str, typer.Option(help="What of the library is left out: by-sequence, by-subject or none.")
    ] = "by-sequence",
    layout: Annotated[str, typer.Option(help="Trackers that motions wear.")] = "six-trackers",
    noise_mm: Annotated[float, typer.Option(help="Position noise of those, millimetres an axis.")] = 3.0,
    noise_deg: Annotated[float, typer.Option(help="Orientation noise of those, degrees an axis.")] = 0.5,
    seed: Annotated[int, typer.Option(help="Seed of all that is drawn.")] = 0,
    json: Annotated[Path | None, typer.Option(help="Write the figures as rows of JSON.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a page with moving figures and plots (.html).")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; as many as processors if left out.")] = None,
    skeleton: Annotated[Path | None, typer.Option(help="An ASF file, for AMC files without their own.")] = None,
) -> None:
    """Measure how far methods are from the truth, with the sequence itself left out of the library.

    Example: poseloom evaluate sample:walk -m local-filter -m inverse-kinematics -l lib --report walk.html
    """
    from math import radians

    from rich.console import Console

    from poseloom.evaluation.cases import Conditions, read_cases
    from poseloom.evaluation.experiment import Experiment
    from poseloom.evaluation.experiment import evaluate as run
    from poseloom.evaluation.rows import write_results
    from poseloom.evaluation.splits import split_named
    from poseloom.report.charts import require_charts
    from poseloom.synthesis import TrackerNoise

    if report is not None:
        require_charts()
    for output in (json, report):
        _check_output(output)
    conditions = Conditions(layout, TrackerNoise(position_m=noise_mm / 1e3, orientation_rad=radians(noise_deg)), seed)
    methods = tuple(dict.fromkeys(method or ("local-filter", "inverse-kinematics")))
    experiment = Experiment(methods, library, split_named(split), conditions, workers or os.cpu_count() or 1)
    with progress_bars() as show:
        cases = read_cases(clips, conditions, skeleton, lambda done, total: show("reading motions", done, total))
        evaluation = run(cases, experiment, show)
    console = Console()
    console.print(evaluation_table(evaluation))
    if 1 < len(cases) <= _MOST_SEQUENCES:
        console.print(_by_sequence(evaluation))
    if json is not None:
        write_results(evaluation.results(), json)
        console.print(f"rows: {json}", highlight=False)
    if report is not None:
        from poseloom.report.evaluation import write_evaluation_report

        write_evaluation_report(report, evaluation)
        console.print(f"report: {report}", highlight=False)


def _check_output(output: Path | None) -> None:
    from poseloom.formats.atomic import check_folder

    if output is not None:
        check_folder(output)


def evaluation_table(evaluation: "Evaluation") -> "Table":
    """The main figures of an evaluation as a table for the terminal, its title saying of what they are."""
    from rich import box
    from rich.table import Table

    from poseloom.evaluation.metrics import METRIC_LABELS
    from poseloom.evaluation.results import mean_over_sequences

    means = mean_over_sequences(evaluation.sequences)
    told = "\n".join(f"{name}: {value}" for name, value in evaluation.facts().items())
    table = Table("metric", title=told, box=box.SIMPLE_HEAD, title_justify="left", title_style="")
    for name in means:
        table.add_column(name, justify="right")
    for metric in _SHOWN:
        cells = [means[name].get(metric) for name in means]
        if any(cell is not None for cell in cells):
            shown = ["–" if cell is None else _figure(cell.value, cell.spread) for cell in cells]
            table.add_row(METRIC_LABELS[metric], *shown)
    if len(evaluation.sequences) > 1:
        table.caption = f"mean ± standard deviation over {len(evaluation.sequences)} sequences; smaller is better"
    return table


def _by_sequence(evaluation: "Evaluation") -> "Table":
    from rich import box
    from rich.table import Table

    table = Table("joint angle, °", "frames", box=box.SIMPLE_HEAD)
    for name in evaluation.experiment.methods:
        table.add_column(name, justify="right")
    for sequence in evaluation.sequences:
        figures = [_figure(result.metrics["joint_angle_deg"], None) for result in sequence.results]
        table.add_row(sequence.name, str(len(sequence.truth)), *figures)
    return table


def _figure(value: float, spread: float | None) -> str:
    from math import floor, log10

    digits = max(0, 2 - floor(log10(max(abs(value), 1e-3)))) if value else 0
    return f"{value:.{digits}f}" + ("" if spread is None else f" ± {spread:.{digits}f}")
