"""`poseloom phases`: the phases of a motion, drawn."""

from pathlib import Path
from typing import Annotated

import typer

from poseloom.cli._motion_options import tell_conventions


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("phases")(draw_phases)


def draw_phases(
    clip: Annotated[str, typer.Argument(help="A motion file, or sample:NAME for a built-in sample motion.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The page to write (.html).")],
    behaviour: Annotated[
        str | None,
        typer.Option(help="What happens in it, such as walking or jumping; told from the motion if left out."),
    ] = None,
    skeleton: Annotated[
        Path | None, typer.Option(help="The .asf (or skeleton.json) of a motion that has none beside it.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Frames a second at which phases are told.")] = 60.0,
) -> None:
    """Draw the phases of a motion: gait cycle or leap, contacts and ankle crossings.

    Example: poseloom phases 02_01.amc -o phases.html
    """
    from poseloom.errors import PoseloomError, unknown_name
    from poseloom.methods.imus.behaviours import Behaviour, behaviour_of
    from poseloom.methods.imus.phases import label_phases
    from poseloom.report.phases import write_phases
    from poseloom.samples import read_clip
    from poseloom.skeleton.resample import resample
    from poseloom.skeleton.retarget import retarget

    if output.suffix.lower() not in (".html", ".htm"):
        raise PoseloomError("the phases are drawn as a page", remedy="Name a file that ends in .html", file=output)
    if behaviour is not None and behaviour not in [each.value for each in Behaviour]:
        raise unknown_name("behaviour", behaviour, [each.value for each in Behaviour], PoseloomError)
    motion = resample(retarget(read_clip(clip, skeleton)), rate)
    tell_conventions(motion)
    told = Behaviour(behaviour) if behaviour is not None else behaviour_of((), motion)
    track = label_phases(motion, told)
    write_phases(output, motion, track, told.value)
    typer.echo(f"{output}: {len(track.segments())} segments of {told.value}")
