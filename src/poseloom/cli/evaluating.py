"""`poseloom evaluate`: methods against the truth."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._motion_options import RestPose, SourceRate, Unit, Up, motion_choices
from poseloom.cli._progress import progress_bars

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from poseloom.evaluation.experiment import Evaluation

_SHOWN = {
    "poses: joint angle, rotations, joint position": (
        *("joint_angle_deg", "joint_rotation_deg", "global_rotation_deg", "sip_deg", "joint_position_cm"),
    ),
    "path and smoothness": ("root_position_cm", "root_drift_per_metre", "jitter_deg_s3", "foot_skate_cm_s"),
    "time": ("look_ahead_ms", "step_ms_p50", "step_ms_p99"),
}
"""Metrics of each block, by its title."""
_HEADING = 10
"""Letters of a heading's line."""
_THOUSANDS = 5000
"""From here on figures are shown in thousands."""
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
            help="Recordings with truth (.mcap), motion files, folders of both, sample:NAME, or samples for all.",
        ),
    ],
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            "-m",
            help="A method (see `poseloom methods`), or constant-pose; may be repeated. Unless given: the default one"
            " and the baselines that can run.",
        ),
    ] = None,
    library: Annotated[Path | None, typer.Option("--library", "-l", help="Folder of a motion library.")] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            "--model", metavar="[METHOD=]FILE", help="A fitted model, for the method that it says. May be repeated."
        ),
    ] = None,
    split: Annotated[
        str, typer.Option(help="What of the library is left out: by-sequence, by-subject or none.")
    ] = "by-sequence",
    subject: Annotated[str, typer.Option(help="Who moves, where a recording does not say so.")] = "",
    layout: Annotated[
        str, typer.Option(help="Sensors that motions wear: six-trackers, right-foot-imu, flex-four ...")
    ] = "six-trackers",
    channels: Annotated[str, typer.Option(help="What of trackers is used: position, orientation or both.")] = "both",
    drop: Annotated[
        list[str] | None, typer.Option(metavar="SENSOR", help="A sensor to leave out. May be repeated.")
    ] = None,
    start: Annotated[float, typer.Option(help="Second of each sequence to begin at.", min=0.0)] = 0.0,
    stop: Annotated[float | None, typer.Option(help="Second of each sequence to end at.", min=0.0)] = None,
    noise_mm: Annotated[float, typer.Option(help="Position noise of trackers, millimetres an axis.")] = 3.0,
    noise_deg: Annotated[float, typer.Option(help="Orientation noise of trackers, degrees an axis.")] = 0.5,
    seed: Annotated[int, typer.Option(help="Seed of all that is drawn.")] = 0,
    json: Annotated[Path | None, typer.Option(help="Write the figures as rows of JSON.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a page with moving figures and plots (.html).")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; as many as processors if left out.")] = None,
    skeleton: Annotated[Path | None, typer.Option(help="An ASF file, for AMC files without their own.")] = None,
    unit: Unit = None,
    up: Up = None,
    source_rate: SourceRate = None,
    rest_pose: RestPose = "auto",
) -> None:
    """Measure how far methods are from the truth, with the sequence itself left out of the library.

    Example: poseloom evaluate sample:walk -m local-filter -m inverse-kinematics -l lib --report walk.html
    """
    from math import radians

    from rich.console import Console

    from poseloom.evaluation.request import evaluate as run
    from poseloom.evaluation.rows import write_results
    from poseloom.synthesis import TrackerNoise

    for output in (json, report):
        _check_output(output)
    noise = TrackerNoise(position_m=noise_mm / 1e3, orientation_rad=radians(noise_deg))
    with progress_bars() as show:
        evaluation = run(
            clips, method, library=library, models=model or (), layout=layout, split=split, noise=noise,
            channels=channels, drop=drop or (), start=start, stop=stop, subject=subject, seed=seed,
            workers=workers or os.cpu_count() or 1, skeleton=skeleton, progress=show,
            choices=motion_choices(unit, up, source_rate, rest_pose),
        )  # fmt: skip
    console = Console()
    print_evaluation(evaluation, console)
    if 1 < len(evaluation.sequences) <= _MOST_SEQUENCES:
        console.print(_by_sequence(evaluation))
    for text in evaluation.skipped:
        console.print(f"skipped: {text}", highlight=False)
    for text in evaluation.notes:
        console.print(f"note: {text}", highlight=False)
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


def print_evaluation(evaluation: "Evaluation", console: "Console") -> None:
    """The main figures of an evaluation for the terminal, under the facts of what they are of."""
    for name, value in evaluation.facts().items():
        console.print(f"{name}: {value}", highlight=False)
    for title, metrics in _SHOWN.items():
        table = _figures_table(evaluation, metrics)
        table.title, table.title_justify, table.title_style = title, "left", ""
        if table.columns[1:]:
            console.print(table)
    count = len(evaluation.sequences)
    if count > 1:
        console.print(f"mean±standard deviation over {count} sequences; smaller is better", highlight=False)


def _figures_table(evaluation: "Evaluation", metrics: tuple[str, ...]) -> "Table":
    """One line a method, one column a metric: six methods fit on a narrow terminal."""
    from textwrap import wrap

    from rich import box
    from rich.table import Table

    from poseloom.evaluation.metrics import METRIC_LABELS
    from poseloom.evaluation.results import mean_over_sequences

    means = mean_over_sequences(evaluation.sequences)
    table = Table("method", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.columns[0].no_wrap = True
    shown = [metric for metric in metrics if any(metric in figures for figures in means.values())]
    for metric in shown:
        label, _, unit = METRIC_LABELS[metric].rpartition(", ")
        heading = [*wrap(label, _HEADING), unit]
        table.add_column("\n".join(heading), justify="right", vertical="bottom", no_wrap=True)
    for name, figures in means.items():
        cells = [figures.get(metric) for metric in shown]
        table.add_row(name, *("–" if cell is None else _figure(cell.value, cell.spread) for cell in cells))
    return table


def _by_sequence(evaluation: "Evaluation") -> "Table":
    from rich import box
    from rich.table import Table

    table = Table("joint angle, °", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.columns[0].overflow = "fold"
    for name in evaluation.experiment.names:
        table.add_column(name.replace("-", "-\n"), justify="right", vertical="bottom")
    for sequence in evaluation.sequences:
        figures = [_figure(result.metrics["joint_angle_deg"], None) for result in sequence.results]
        table.add_row(sequence.name, *figures)
    return table


def _figure(value: float, spread: float | None) -> str:
    from math import floor, log10

    if abs(value) >= _THOUSANDS:
        return f"{value / 1000:.1f}k" + ("" if spread is None else f"±{spread / 1000:.0f}k")
    digits = max(0, 2 - floor(log10(max(abs(value), 1e-3)))) if value else 0
    return f"{value:.{digits}f}" + ("" if spread is None else f"±{spread:.{max(0, digits - 1)}f}")
