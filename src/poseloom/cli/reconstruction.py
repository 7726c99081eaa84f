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
    recording: Annotated[Path, typer.Argument(help="Recorded sensors, also of a live session (.mcap).", metavar="REC")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The motion: .bvh, .glb, .npz or .csv.")] = None,
    method: Annotated[
        str | None,
        typer.Option(
            "--method",
            "-m",
            help="How; see `poseloom methods`. Unless given: the session's own; with a library local-filter;"
            " the one that the model is for; else inverse-kinematics or flex-scales.",
        ),
    ] = None,
    library: Annotated[
        Path | None, typer.Option("--library", "-l", help="Folder of a motion library; a session's own unless given.")
    ] = None,
    model: Annotated[
        Path | None, typer.Option("--model", help="A fitted model, from `poseloom fit`; a session's own unless given.")
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option("--calibration", "-c", help="Sizes and placements, from `poseloom calibrate`.")
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Compare with the session's own poses; exit code 1 unless every bit is the same."),
    ] = False,
) -> None:
    """Reconstruct the full-body motion of a recording.

    A live session's recording is run as the session ran it, unless told otherwise: the same method, library or model,
    calibration and headings, without the samples that its method did not receive.

    Examples: poseloom reconstruct walk.mcap -l my-library -o walk.bvh;
    poseloom reconstruct session.mcap --check
    """
    from dataclasses import replace

    from rich.console import Console

    from poseloom.errors import PoseloomError
    from poseloom.formats.session_recording import read_session
    from poseloom.live.reprocess import compare_with_session, plan_reprocessing, reprocess
    from poseloom.live.sinks.motion_export import check_export, export_motion

    if output is not None:
        check_export(output)
    elif not check:
        raise PoseloomError(
            "no output was given", remedy="Give --output FILE.bvh, or --check for a session's recording"
        )
    session = read_session(recording)
    if check and not len(session.steps):
        raise PoseloomError(
            "this recording holds no session's poses to compare with",
            remedy="Give --check for a recording of `poseloom live` only",
            file=recording,
        )
    if calibration is not None:
        from poseloom.calibration.calibration import apply_calibration, read_calibration

        session = replace(session, recording=apply_calibration(session.recording, read_calibration(calibration)))
    how = plan_reprocessing(session, method, library, model)
    with progress_bars() as show:
        total = len(session.recording)
        result = reprocess(session, how, lambda done: show("Reconstructing", done, total))
    console = Console()
    if output is not None:
        export_motion(result.even(output.stem), output)
    console.print(_summary(result, how.method, output or recording))
    for note in (*how.differences, *result.notes):
        console.print(f"note: {note}", highlight=False)
    if check:
        same = compare_with_session(session, result)
        console.print(
            f"beside the session's own {same.session:,} poses: {same.identical:,} the same in every bit, "
            f"{same.session - same.compared:,} without counterpart, largest difference {same.largest:.3g}",
            highlight=False,
        )
        if not same.agrees:
            raise typer.Exit(1)


def list_methods() -> None:
    """List the methods that can be chosen."""
    from rich.console import Console
    from rich.table import Table

    from poseloom.methods import METHODS

    table = Table("method", "what it is", "needs")
    for name, entry in METHODS.items():
        table.add_row(name, entry.summary, "nothing" if entry.shipped else entry.needs.value)
    Console().print(table)


def _summary(result: "Reconstruction", method: str, title: Path) -> "Table":
    import numpy as np
    from rich.table import Table

    states = [health.state.value for health in result.health]
    milliseconds = 1e3 * np.percentile(result.step_seconds, [50, 95, 99])
    table = Table(title=str(title), show_header=False)
    table.add_row("method", method)
    table.add_row("frames", f"{len(result.motion)} at {result.motion.rate:g} Hz")
    table.add_row("health", ", ".join(f"{states.count(s)} {s}" for s in dict.fromkeys(states)))
    table.add_row("step p50, p95, p99", " ".join(f"{value:.2f}" for value in milliseconds) + " ms")
    return table
