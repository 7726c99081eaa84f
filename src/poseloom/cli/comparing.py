"""`poseloom fit nearest-window` and the other comparators of the phase HMM."""

from pathlib import Path
from typing import Annotated

import typer

from poseloom.cli._progress import progress_bars

_SUMMARIES = {
    "nearest-window": "Keep windows of IMU signals with their poses: the mean of the nearest is the pose.",
    "phase-regression": "Learn phases and a regression in each from IMU signals (after Eom et al. 2014).",
    "sparse-accelerometers": "Keep examples for neighbours and the least energy among them (after Riaz et al. 2015).",
    "motion-primitives": "Learn motion primitives and mixtures over them (after Min and Chai 2012).",
    "motion-graph": "Make a motion graph that IMU signals steer (after Kovar et al. 2002).",
}


def add_comparators(fit: typer.Typer) -> None:
    """Adds a command for each comparator to the group `fit`."""
    for name, summary in _SUMMARIES.items():
        fit.command(name, help=summary)(_command(name))


def _command(name: str):  # typer reads the signature of what is returned
    def command(
        library: Annotated[Path, typer.Option("--library", "-l", help="Folder of a motion library.")],
        layout: Annotated[str, typer.Option("--layout", help="One to three IMUs, such as right-foot-imu.")],
        output: Annotated[Path, typer.Option("--output", "-o", metavar="MODEL", help="The model's file.")],
        seed: Annotated[int, typer.Option(min=0, help="Of what is drawn.")] = 0,
        without: Annotated[
            list[str] | None, typer.Option("--without-take", help="Leave this take out. May be repeated.")
        ] = None,
    ) -> None:
        _fit(name, library, layout, output, seed, without)

    return command


def _fit(name: str, folder: Path, layout_name: str, output: Path, seed: int, without: list[str] | None) -> None:
    from poseloom.formats.atomic import check_folder
    from poseloom.library import open_library
    from poseloom.methods.imus.baselines.driving import save_comparator
    from poseloom.methods.imus.baselines.fitting import fit_comparator
    from poseloom.methods.imus.pairs import LOCOMOTION, WELL_MOUNTED, library_pairs
    from poseloom.sensors import layout

    check_folder(output)
    worn = layout(layout_name)
    with progress_bars() as show:
        pairs = library_pairs(
            open_library(folder), worn, noise=WELL_MOUNTED, seed=seed, without_takes=without or (),
            behaviours=LOCOMOTION, progress=lambda done, total: show("simulating IMUs", done, total),
        )  # fmt: skip
        method = fit_comparator(name, pairs, worn)
    save_comparator(method, output)
    typer.echo(f"{output}: {name} for {worn.name}, {len(pairs)} clips, {len(method.examples):,} frames")
