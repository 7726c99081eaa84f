"""`poseloom fit`: models learnt from data."""

from pathlib import Path
from typing import Annotated

import typer

from poseloom.cli._progress import progress_bars
from poseloom.cli.calibrating import fit_sizes
from poseloom.cli.comparing import add_comparators
from poseloom.cli.flex import add_fit_commands
from poseloom.cli.flex_sensor import fit_flex_sensor

_NAMED = 5
"""Clips of a kind that are named; the rest are counted."""

_Library = Annotated[Path, typer.Option("--library", "-l", help="Folder of a motion library.")]
_Layout = Annotated[
    str, typer.Option("--layout", help="One to three IMUs, such as right-foot-imu or left-shank+right-hand-imu.")
]
_Output = Annotated[Path, typer.Option("--output", "-o", metavar="MODEL", help="The model's file.")]
_Seed = Annotated[int, typer.Option(min=0, help="Of what is drawn.")]
_Behaviours = Annotated[
    list[str] | None,
    typer.Option(
        "--behaviour", help="Learn these alone, such as walking. May be repeated; all locomotion if left out."
    ),
]
_Without = Annotated[
    list[str] | None, typer.Option("--without-take", help="Leave this take out, copies too. May be repeated.")
]
_Find = Annotated[str, typer.Option("--find", help="Only clips with these words in name, tags, take or source.")]


def register(app: typer.Typer) -> None:
    """Adds the group `fit` to the application."""
    fit = typer.Typer(no_args_is_help=True, help="Fit models to data.")
    fit.command("body-size")(fit_sizes)
    fit.command("flex-sensor")(fit_flex_sensor)
    add_fit_commands(fit)
    fit.command("phase-hmm")(fit_hmm)
    fit.command("phase-hmm-paper")(fit_hmm_of_the_paper)
    add_comparators(fit)
    fit.callback()(_fit)
    app.add_typer(fit, name="fit")


def _fit() -> None:
    """Fit models to data."""


def fit_hmm(
    library: _Library,
    layout: _Layout,
    output: _Output,
    seed: _Seed = 0,
    behaviour: _Behaviours = None,
    without: _Without = None,
    find: _Find = "",
) -> None:
    """Learn full-body locomotion from one to three IMUs: the phase HMM.

    Example: poseloom fit phase-hmm --library library --layout right-foot-imu -o foot.npz
    """
    _fit_hmm("phase-hmm", library, layout, output, seed, behaviour, without, find)


def fit_hmm_of_the_paper(
    library: _Library,
    layout: _Layout,
    output: _Output,
    seed: _Seed = 0,
    behaviour: _Behaviours = None,
    without: _Without = None,
    find: _Find = "",
) -> None:
    """Learn the phase HMM as the single-IMU paper has it, to compare with."""
    _fit_hmm("phase-hmm-paper", library, layout, output, seed, behaviour, without, find)


def _fit_hmm(
    name: str,
    folder: Path,
    layout_name: str,
    output: Path,
    seed: int,
    behaviours: list[str] | None,
    without: list[str] | None,
    find: str,
) -> None:
    from poseloom.errors import PoseloomError, unknown_name
    from poseloom.formats.atomic import check_folder
    from poseloom.library import open_library
    from poseloom.methods.imus.behaviours import Behaviour
    from poseloom.methods.imus.model_file import write_phase_hmm
    from poseloom.methods.imus.pairs import LOCOMOTION, WELL_MOUNTED, library_pairs
    from poseloom.methods.imus.phase_hmm import fit_phase_hmm
    from poseloom.methods.imus.settings import PAPER_SETTINGS, PhaseHmmSettings
    from poseloom.sensors import layout

    known = [each.value for each in Behaviour]
    for wanted in behaviours or ():
        if wanted not in known:
            raise unknown_name("behaviour", wanted, known, PoseloomError)
    check_folder(output)
    sensors = layout(layout_name)
    opened = open_library(folder)
    found = {clip.name for clip in opened.find(find)} if find else None
    left_out: dict[str, list[str]] = {}
    with progress_bars() as show:
        pairs = library_pairs(
            opened,
            sensors,
            left_out=lambda clip, why: left_out.setdefault(why, []).append(clip.name),
            noise=WELL_MOUNTED,
            seed=seed,
            without_takes=without or (),
            behaviours=[Behaviour(each) for each in behaviours] if behaviours else LOCOMOTION,
            choose=None if found is None else lambda clip: clip.name in found,
            progress=lambda done, total: show("simulating IMUs", done, total),
        )
        for why, clips in sorted(left_out.items(), key=lambda item: -len(item[1])):
            named = ", ".join(clips[:_NAMED]) + (", ..." if len(clips) > _NAMED else "")
            typer.echo(f"left out {len(clips)} of {len(opened.clips)} clips: {why} ({named})", err=True)
        how = PAPER_SETTINGS if name == "phase-hmm-paper" else PhaseHmmSettings()
        method = fit_phase_hmm(pairs, sensors, how, seed, show)
    write_phase_hmm(method, output)
    typer.echo(
        f"{output}: {name} for {sensors.name}, {len(pairs)} clips, {len(method.model):,} frames, "
        f"{len(method.model.first):,} segments in {len(method.model.phase_names)} phases"
    )
