"""`poseloom reconstruct`: a recording in, a full-body motion out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._progress import progress_bars

if TYPE_CHECKING:
    from rich.table import Table

    from poseloom.methods import Reconstruction


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("reconstruct")(reconstruct_recording)
    app.command("methods")(list_methods)


def reconstruct_recording(
    recording: Annotated[Path, typer.Argument(help="What the sensors said (.mcap).", metavar="REC")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The motion: .bvh, .glb or .npz.")],
    method: Annotated[str, typer.Option("--method", "-m", help="How; see `poseloom methods`.")] = "local-filter",
    library: Annotated[Path | None, typer.Option("--library", "-l", help="Folder of a motion library.")] = None,
    model: Annotated[Path | None, typer.Option("--model", help="A fitted model, from `poseloom fit`.")] = None,
    calibration: Annotated[
        Path | None, typer.Option("--calibration", "-c", help="Sizes and placements, from `poseloom calibrate`.")
    ] = None,
) -> None:
    """Reconstruct the full-body motion of a recording."""
    from rich.console import Console

    from poseloom.formats import writable_suffixes, write_motion
    from poseloom.formats.recording import read_recording
    from poseloom.library import open_library
    from poseloom.methods import make_method, needs_library, reconstruct

    _check_output(output, writable_suffixes())
    wanted = needs_library(method)
    heard = read_recording(recording)
    if calibration is not None:
        from poseloom.calibration.calibration import apply_calibration, read_calibration

        heard = apply_calibration(heard, read_calibration(calibration))
    opened = open_library(library) if wanted and library is not None else None
    chosen = make_method(method, heard.layout, opened, model=model)
    with progress_bars() as show:
        result = reconstruct(chosen, heard, lambda done: show("Reconstructing", done, len(heard)))
    write_motion(result.motion, output)
    Console().print(_summary(result, method, output))


def list_methods() -> None:
    """List the methods that can be chosen."""
    from rich.console import Console
    from rich.table import Table

    from poseloom.methods import METHODS

    table = Table("method", "what it is", "needs")
    for name, entry in METHODS.items():
        model = "a model" if entry.load and entry.shipped is None else "nothing"
        table.add_row(name, entry.summary, "a library" if entry.kind else model)
    Console().print(table)


def _check_output(output: Path, suffixes: tuple[str, ...]) -> None:
    from poseloom.errors import FormatError
    from poseloom.formats.atomic import check_folder

    if output.suffix.lower() not in suffixes:
        raise FormatError(
            f"no motion can be written as {output.suffix or 'a file without suffix'}",
            remedy=f"Choose one of {', '.join(suffixes)}",
            file=output,
        )
    check_folder(output, FormatError)


def _summary(result: "Reconstruction", method: str, output: Path) -> "Table":
    import numpy as np
    from rich.table import Table

    states = [health.state.value for health in result.health]
    milliseconds = 1e3 * np.percentile(result.step_seconds, [50, 95, 99])
    table = Table(title=str(output), show_header=False)
    table.add_row("method", method)
    table.add_row("frames", f"{len(result.motion)} at {result.motion.rate:g} Hz")
    table.add_row("health", ", ".join(f"{states.count(s)} {s}" for s in dict.fromkeys(states)))
    table.add_row("step p50, p95, p99", " ".join(f"{value:.2f}" for value in milliseconds) + " ms")
    return table
