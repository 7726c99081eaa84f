"""`poseloom view`: recordings and motions in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from poseloom.cli._progress import progress_bars


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("view")(view)


def view(
    files: Annotated[
        list[str],
        typer.Argument(help="A recording (.mcap), motions (.bvh, .npz, .glb, ...), sample:NAME.", metavar="FILE..."),
    ],
    method: Annotated[
        list[str] | None, typer.Option("--method", "-m", help="Also show what this makes of the recording; up to two.")
    ] = None,
    library: Annotated[Path | None, typer.Option("--library", "-l", help="Folder of a motion library.")] = None,
    model: Annotated[Path | None, typer.Option("--model", help="A fitted model, from `poseloom fit`.")] = None,
    calibration: Annotated[
        Path | None, typer.Option("--calibration", "-c", help="Sizes and placements, from `poseloom calibrate`.")
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(help="Where to listen; the first free one from 8080 on unless given.", min=0, max=65535),
    ] = None,
    bind: Annotated[
        str, typer.Option(help="Address to listen at. Other than 127.0.0.1, only who has the token can look.")
    ] = "127.0.0.1",
    token: Annotated[
        str,
        typer.Option(help="Secret that a visitor must know, on this machine too; 'new' draws one.", metavar="SECRET"),
    ] = "",
) -> None:
    """Play recordings and motions in the browser, truth and methods side by side.

    Example: poseloom view walk.mcap -m inverse-kinematics
    """
    from rich.console import Console

    from poseloom.viewer.player import Player
    from poseloom.viewer.tracks import Wanted, load_take

    with progress_bars() as show:
        take = load_take(files, Wanted(tuple(method or ()), library, model, calibration), show)
    player = Player(take, bind, port, token)
    console = Console()
    console.print(f"Open {player.url} in a browser; Ctrl-C ends it.", highlight=False, soft_wrap=True)
    if player.exposure:
        console.print(player.exposure, style="yellow", highlight=False, soft_wrap=True)
    try:
        player.wait()
    except KeyboardInterrupt:
        console.print("Ended.")
    finally:
        player.close()
