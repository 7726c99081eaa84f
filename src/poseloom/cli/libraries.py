"""`poseloom library`: build, add to, look at and search motion libraries."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._motion_options import RestPose, SourceRate, Unit, Up, motion_choices, tell_conventions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from poseloom.library import BuildReport, Clip, Skipped

_Sources = Annotated[
    list[str],
    typer.Argument(metavar="SRC...", help="Motion files, folders of them, or `samples` for the built-in motions."),
]
_Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The library's folder.")]
_Exclude = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude", metavar="GLOB", help="Leave out what fits: `bandai`, `cmu_bvh/16`, `*_walk.bvh`. May be repeated."
    ),
]
_Skeletons = Annotated[
    list[str] | None,
    typer.Option(
        "--skeleton",
        metavar="[GLOB=]FILE",
        help="The .asf (or skeleton.json) for motions that have none beside them. May be repeated.",
    ),
]
_Licence = Annotated[str, typer.Option(help="Note for sources beside which no licence is stated.")]
_Workers = Annotated[int, typer.Option(min=1, help="Number of processes.")]


def register(app: typer.Typer) -> None:
    """Adds the group `library` to the application."""
    group = typer.Typer(no_args_is_help=True, help="Build, add to, look at and search motion libraries.")
    for command in (build, add, info, search):
        group.command(command.__name__)(command)
    app.add_typer(group, name="library")


def build(
    sources: _Sources,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="The folder to make.")],
    mirror: Annotated[bool, typer.Option("--mirror", help="Add the mirror image of each clip.")] = False,
    rate: Annotated[float, typer.Option(help="Frames a second.")] = 40.0,
    exclude: _Exclude = None,
    skeleton: _Skeletons = None,
    licence: _Licence = "not stated",
    workers: _Workers = 2,
    unit: Unit = None,
    up: Up = None,
    source_rate: SourceRate = None,
    rest_pose: RestPose = "auto",
    replace: Annotated[bool, typer.Option("--replace", help="Replace the library that is there.")] = False,
) -> None:
    """Build a library of motions, all on one body and at one rate.

    Example: poseloom library build ~/mocap -o library --mirror
    """
    from poseloom.cli._progress import progress_bars
    from poseloom.library import build_library

    choices = motion_choices(unit, up, source_rate, rest_pose)
    rules = _skeleton_rules(skeleton)
    with progress_bars() as show:
        report = build_library(
            sources, out, rate, mirror, exclude or (), rules, licence, workers, replace, show, choices
        )
    _tell(report)


def add(
    folder: _Folder,
    sources: _Sources,
    exclude: _Exclude = None,
    skeleton: _Skeletons = None,
    licence: _Licence = "not stated",
    workers: _Workers = 2,
    unit: Unit = None,
    up: Up = None,
    source_rate: SourceRate = None,
    rest_pose: RestPose = "auto",
) -> None:
    """Add motions to a library, at its rate, mirrored if it is."""
    from poseloom.cli._progress import progress_bars
    from poseloom.library import add_to_library

    choices = motion_choices(unit, up, source_rate, rest_pose)
    rules = _skeleton_rules(skeleton)
    with progress_bars() as show:
        report = add_to_library(folder, sources, exclude or (), rules, licence, workers, show, choices)
    _tell(report)


def info(
    folder: _Folder,
    verify: Annotated[bool, typer.Option("--verify", help="Digest every byte of every file.")] = False,
    skipped: Annotated[bool, typer.Option("--skipped", help="List what was not taken in, and why.")] = False,
) -> None:
    """Say what a library holds and whether it is whole."""
    from rich.console import Console
    from rich.table import Table

    from poseloom.library import SkipKind, open_library

    library = open_library(folder, verify=verify)
    table = Table.grid(padding=(0, 2))
    subjects = {clip.subject for clip in library.clips}
    missed = sum(entry.kind is not SkipKind.COMPANION for entry in library.skipped)
    for what, value in (
        ("poses", f"{len(library):,} at {library.rate:g} Hz, {_duration(len(library) / library.rate)}"),
        ("clips", f"{len(library.clips):,}{', mirror images included' if library.mirror else ''}"),
        ("takes", f"{len({clip.take for clip in library.clips}):,}"),
        ("subjects", f"{len(subjects):,}"),
        ("not taken in", f"{missed:,}{'' if skipped or not missed else ' (--skipped lists them)'}"),
        ("files", "whole, every byte read" if verify else "whole, as far as a quick look tells"),
    ):
        table.add_row(what, value)
    Console().print(table)
    Console().print(_by_licence(library.clips, library.rate))
    if skipped:
        _list(library.skipped, err=False)


def search(
    folder: _Folder,
    text: Annotated[
        list[str] | None, typer.Argument(metavar="[TEXT]...", help="Words in name, subject, tags, take or source.")
    ] = None,
    clip: Annotated[Path | None, typer.Option(help="A motion file: search for its pose instead.")] = None,
    frame: Annotated[int, typer.Option(min=0, help="Which frame of that file.")] = 0,
    count: Annotated[int, typer.Option(min=1, help="At most so many clips.")] = 20,
) -> None:
    """Find clips by words, or by a pose that looks like one of a motion file.

    Example: poseloom library search library walk cmu

    Example: poseloom library search library --clip jump.bvh --frame 120
    """
    from poseloom.errors import PoseloomError
    from poseloom.library import open_library

    if (clip is None) == (not text):
        raise PoseloomError("nothing to search for", remedy="Give words, or a motion file with --clip FILE --frame N")
    library = open_library(folder)
    if clip is None:
        found = library.find(" ".join(text or ()))
        _print_clips([(each, f"{len(each) / library.rate:.1f} s") for each in found[:count]], "lasts")
        typer.echo(f"{len(found):,} clips" + (f", {count} shown" if len(found) > count else ""))
        return
    from poseloom.formats import read_motion
    from poseloom.library.similar import similar_poses
    from poseloom.skeleton.retarget import retarget

    motion = retarget(read_motion(clip))
    tell_conventions(motion)
    if frame >= len(motion):
        raise PoseloomError(f"there is no frame {frame}", remedy=f"Give a frame from 0 to {len(motion) - 1}", file=clip)
    similar = similar_poses(library, motion.q[frame], count)
    _print_clips(
        [(s.clip, f"{(s.row - s.clip.start) / library.rate:.2f} s, {100 * s.distance:.1f} cm") for s in similar],
        "at, joints apart by",
    )


def _skeleton_rules(given: "list[str] | None") -> dict[str, str | Path]:
    rules: dict[str, str | Path] = {}
    for rule in given or ():
        pattern, equals, file = rule.partition("=")
        if equals and not Path(rule).exists():
            rules[pattern] = file
        else:
            rules["*"] = rule
    return rules


def _tell(report: "BuildReport") -> None:
    from poseloom.library import SkipKind

    typer.echo(f"{report.path}: {report.clips:,} clips, {report.poses:,} poses added")
    for told, count in sorted(report.understood.items(), key=lambda entry: -entry[1]):
        typer.echo(f"  {count:,} read as {told}")
    companions = sum(entry.kind is SkipKind.COMPANION for entry in report.skipped)
    if companions:
        typer.echo(f"{companions:,} files beside them hold no motion (poseloom library info --skipped lists them)")
    missed = [entry for entry in report.skipped if entry.kind is not SkipKind.COMPANION]
    if missed:
        typer.echo(f"\n{len(missed):,} WERE NOT TAKEN IN:", err=True)
        _list(missed, err=True)


def _list(entries: "Sequence[Skipped]", err: bool) -> None:
    for entry in entries:
        typer.echo(f"  {entry.kind.value:<13} {entry.source}: {entry.reason}", err=err)


def _by_licence(clips: "Sequence[Clip]", rate: float) -> object:
    from rich.table import Table

    depth = 2 if len({clip.source.split("/")[0] for clip in clips}) == 1 else 1
    seconds: dict[tuple[str, str], float] = {}
    for clip in clips:
        folders = clip.source.split("/")[:-1]
        key = ("/".join(folders[:depth]), clip.licence)
        seconds[key] = seconds.get(key, 0.0) + len(clip) / rate
    table = Table("from", "under", "", title_justify="left")
    for (place, licence), total in sorted(seconds.items()):
        table.add_row(place, licence, _duration(total))
    return table


def _print_clips(rows: "Sequence[tuple[Clip, str]]", measure: str) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("clip", "subject", "tags", measure)
    for column in table.columns[:3]:
        column.overflow = "fold"
    for clip, value in rows:
        table.add_row(clip.name, clip.subject, " ".join(clip.tags), value)
    Console().print(table)


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{seconds:.0f} s" if seconds < 120 else f"{minutes} min" if minutes < 120 else f"{minutes / 60:.1f} h"
