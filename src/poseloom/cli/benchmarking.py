"""`poseloom benchmark`: figures, measured again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._measured import DATA_VARIABLE
from poseloom.cli._progress import progress_bars
from poseloom.cli.flex import add_benchmark_commands
from poseloom.cli.live_benchmark import add_commands as add_live
from poseloom.cli.one_imu import add_commands as add_one_imu
from poseloom.cli.real_imus import add_commands as add_real_imus
from poseloom.cli.six_trackers import add_commands
from poseloom.errors import PoseloomError

if TYPE_CHECKING:
    from poseloom.benchmark.core import Measurement


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    benchmarks = typer.Typer(no_args_is_help=True, help="Measure figures of this machine.")
    benchmarks.callback()(_benchmark)
    benchmarks.command("core")(core)
    add_commands(benchmarks)
    add_one_imu(benchmarks)
    add_real_imus(benchmarks)
    add_benchmark_commands(benchmarks)
    add_live(benchmarks)
    app.add_typer(benchmarks, name="benchmark")


def _benchmark() -> None:
    """Measure figures of this machine."""


def core(
    json: Annotated[Path | None, typer.Option("--json", help="File for the figures as rows.")] = None,
    markdown: Annotated[Path | None, typer.Option("--markdown", help="File for the figures as a page.")] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            "--data",
            envvar=DATA_VARIABLE,
            help="Folder of real recordings for the library; the built-in motions without it.",
        ),
    ] = None,
) -> None:
    """Measure kinematics, solve, files, library, one step and start-up, on one thread."""
    from rich.console import Console
    from rich.table import Table

    from poseloom.benchmark.core import measure_core
    from poseloom.benchmark.pages import core_page, core_results, shown
    from poseloom.evaluation.rows import write_results
    from poseloom.formats.atomic import atomic_file

    if data is not None and not data.is_dir():
        raise PoseloomError(
            "no such folder", remedy=f"Give --data (or {DATA_VARIABLE}) a folder of motion files", file=data
        )
    motions = None if data is None else data / "mocap" if (data / "mocap").is_dir() else data
    with progress_bars() as show:
        measured = measure_core(motions, show)
    table = Table("what", "on", "median", "least", "most", "repeats", "bound")
    for each in measured:
        table.add_row(*shown(each), style="" if each.timing.median <= each.bound else "bold red")
    Console().print(table)
    if json is not None:
        write_results(core_results(measured), json)
    if markdown is not None:
        with atomic_file(markdown) as part:
            part.write_text(core_page(measured), encoding="utf-8")
    _judge(measured)


def _judge(measured: "tuple[Measurement, ...]") -> None:
    slow = [each.name for each in measured if each.timing.median > each.bound]
    typer.echo(f"over its bound: {', '.join(slow)}" if slow else "everything within its bound")
