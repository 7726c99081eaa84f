"""`poseloom fit flex-lstm`, `fit flex-scales` and `benchmark flex`: networks for four flex sensors."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._measured import DATA_VARIABLE, recordings_of, running_commit
from poseloom.cli._progress import progress_bars
from poseloom.errors import PoseloomError, missing_extra

if TYPE_CHECKING:
    from poseloom.evaluation.rows import Row

_Library = Annotated[Path, typer.Option("--library", "-l", help="Folder of a motion library at 50 poses a second.")]
_Output = Annotated[Path, typer.Option("--output", "-o", metavar="MODEL", help="The model to write (.npz).")]
_Epochs = Annotated[int | None, typer.Option(min=1, help="The most epochs.")]
_Hidden = Annotated[int | None, typer.Option(min=8, help="Hidden units.")]
_Seed = Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")]
_Only = Annotated[
    list[str] | None, typer.Option("--only", metavar="FOLDER", help="Learn from these folders' clips only.")
]
_Checkpoint = Annotated[
    Path | None, typer.Option("--checkpoint", help="File to go on from after a kill; MODEL.checkpoint if left out.")
]


def add_fit_commands(fit: typer.Typer) -> None:
    """Adds the commands to the group `fit`."""
    fit.command("flex-lstm")(fit_flex_lstm)
    fit.command("flex-scales")(fit_flex_scales)


def add_benchmark_commands(benchmarks: typer.Typer) -> None:
    """Adds the command to the group `benchmark`."""
    benchmarks.command("flex")(benchmark_flex)


def fit_flex_lstm(
    library: _Library,
    output: _Output,
    epochs: _Epochs = None,
    hidden: _Hidden = None,
    seed: _Seed = 0,
    only: _Only = None,
    checkpoint: _Checkpoint = None,
) -> None:
    """Fit the flex paper's network: calibrator, Bi-LSTM, median.

    Example: poseloom fit flex-lstm --library library -o flex-lstm.npz
    """
    _fit("flex-lstm", library, output, epochs, hidden, seed, only, checkpoint)


def fit_flex_scales(
    library: _Library,
    output: _Output,
    epochs: _Epochs = None,
    hidden: _Hidden = None,
    seed: _Seed = 0,
    only: _Only = None,
    checkpoint: _Checkpoint = None,
) -> None:
    """Fit our network for four flex sensors: filters over many time scales, an LSTM, smoothing.

    Example: poseloom fit flex-scales --library library -o flex-scales.npz
    """
    _fit("flex-scales", library, output, epochs, hidden, seed, only, checkpoint)


def _fit(
    method: str, library: Path, output: Path, epochs: int | None, hidden: int | None, seed: int,
    only: list[str] | None, checkpoint: Path | None,
) -> None:  # fmt: skip
    from poseloom.library import open_library

    _require_torch()
    if output.suffix != ".npz" or not output.resolve().parent.is_dir():
        raise PoseloomError("a model is an .npz file in a folder that exists", remedy="Name such a file", file=output)
    from poseloom.training.from_library import fit_to_library, flex_settings

    kept = checkpoint or output.with_suffix(".checkpoint")
    opened = open_library(library)
    folders = tuple(f"{folder.rstrip('/')}/" for folder in only or ())
    with progress_bars() as show:
        report = fit_to_library(
            opened, output, method, flex_settings(method, epochs, hidden), seed,
            lambda clip: not folders or clip.source.startswith(folders), kept,
            lambda done, most, _: show(f"Fitting {method}, epochs", done, most),
        )  # fmt: skip
    if checkpoint is None:
        kept.unlink(missing_ok=True)
    typer.echo(
        f"{report.path}: {report.takes} takes, {report.frames:,} frames, {report.epochs} epochs, "
        f"{report.error:.2f} degrees on takes left out"
    )


def benchmark_flex(
    data: Annotated[
        Path | None,
        typer.Option("--data", envvar=DATA_VARIABLE, help="Folder of the recordings that the benchmark is defined on."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="All parts at a small size; figures mean little.")] = False,
    work: Annotated[
        Path | None,
        typer.Option(help="Folder for the library and checkpoints; a run that was killed goes on from there."),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds of the within-sequence split.")] = 3,
    subject_seeds: Annotated[int, typer.Option(min=1, help="Seeds of the by-subject split.")] = 2,
    other_seeds: Annotated[int, typer.Option(min=1, help="Seeds of the Transformer, FCN and TCN, at most.")] = 2,
    full: Annotated[bool, typer.Option("--full", help="Fit the paper's network at its full size, too.")] = False,
    length_seeds: Annotated[
        int, typer.Option(min=1, help="Seeds of each calibration length, and of ranges found once.")
    ] = 1,
    json: Annotated[Path | None, typer.Option("--json", help="File for the figures as rows.")] = None,
    markdown: Annotated[
        Path | None, typer.Option("--markdown", help="Page to put the figures into, between its marks.")
    ] = None,
    picture: Annotated[Path | None, typer.Option("--picture", help="SVG file: accuracy and jitter.")] = None,
) -> None:
    """Measure what the flex paper measures: tables 2, 3, 5 and 6, ageing, faults, replaced sensors, speed.

    Example: poseloom benchmark flex --data recordings --work work --json flex.json --markdown flex.md
    """
    import tempfile

    _require_torch()
    recordings = recordings_of(data)
    from dataclasses import replace

    from poseloom.benchmark.flex.material import BY_SUBJECT, WITHIN
    from poseloom.benchmark.flex.run import Plan, quick_plan, run_flex
    from poseloom.evaluation.rows import write_results

    with tempfile.TemporaryDirectory() as temporary, progress_bars() as show:
        folder = work or Path(temporary)
        plan = Plan(recordings, folder)
        counts = {WITHIN: seeds, BY_SUBJECT: subject_seeds}
        plan = replace(plan, seeds=counts, other_seeds=other_seeds, length_seeds=length_seeds, full=full)
        results = run_flex(quick_plan(recordings, folder) if quick else plan, show)
    _show(results.rows)
    if json is not None:
        write_results(results, json)
    if markdown is not None:
        from poseloom.benchmark.flex.page import flex_figures
        from poseloom.benchmark.six_trackers.page import write_figures

        write_figures(markdown, flex_figures(results, running_commit()), "Four flex sensors")
    if picture is not None:
        from poseloom.benchmark.flex.picture import accuracy_and_jitter_svg
        from poseloom.formats.atomic import atomic_file

        with atomic_file(picture) as part:
            part.write_text(accuracy_and_jitter_svg(results.rows), encoding="utf-8")


def _show(rows: "tuple[Row, ...]") -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    for name in dict.fromkeys(row.table for row in rows):
        table = Table("what", "on", "split", "metric", title=name, box=box.SIMPLE_HEAD, title_justify="left")
        for column in ("value", "± over seeds", "frames"):
            table.add_column(column, justify="right")
        for row in rows:
            if row.table == name and not row.metric.endswith(("_ci95", "_seeds")):
                spread = "" if row.spread is None else f"{row.spread:.2f}"
                table.add_row(
                    row.method, row.setting, row.split, row.metric, f"{row.value:,.2f}", spread, f"{row.frames:,}"
                )
        Console().print(table)


def _require_torch() -> None:
    from importlib.util import find_spec

    missing = [name for name in ("torch", "onnx", "onnxruntime") if find_spec(name) is None]
    if missing:
        raise missing_extra(f"training needs {' and '.join(missing)}", "train")
