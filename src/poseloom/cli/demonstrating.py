"""`poseloom demo`: the whole way once, from motions on disk to a report."""

import hashlib
import shutil
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._progress import ShowProgress, progress_bars
from poseloom.errors import LibraryError, PoseloomError

if TYPE_CHECKING:
    from poseloom.library import Clip, MotionLibrary

_BESIDE = ("local-regression", "inverse-kinematics")
"""Methods shown beside the recommended one."""
_SHORTEST, _LONGEST = 3.0, 20.0
"""Seconds of a motion to show: long enough to see, short enough to wait for."""
_LIVE_RATE = 60.0


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("demo")(demo)


def demo(
    data: Annotated[
        Path | None,
        typer.Option("--data", help="Folder of your own motion files, in place of the built-in motions."),
    ] = None,
    exclude: Annotated[
        list[str] | None, typer.Option("--exclude", help="Leave out files that fit this pattern; may be repeated.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for what is made.")] = Path("demo"),
    live: Annotated[
        bool, typer.Option("--live", help="Show a live session on simulated trackers in the browser instead.")
    ] = False,
    seconds: Annotated[float, typer.Option(help="With --live: end after so many seconds.", min=0.0)] = 0.0,
) -> None:
    """Go the whole way once: library, simulated trackers, reconstruction, report.

    The motion to reconstruct is hidden from the methods: its whole take, with mirror image and copies, is left out.
    """
    from rich.console import Console

    from poseloom.cli.evaluating import print_evaluation
    from poseloom.evaluation.cases import Conditions, case_of_motion
    from poseloom.evaluation.experiment import evaluate_cases
    from poseloom.evaluation.plan import Experiment
    from poseloom.formats import write_motion
    from poseloom.formats.atomic import atomic_file
    from poseloom.library import SkipKind
    from poseloom.methods import DEFAULT_METHOD
    from poseloom.report.charts import NO_CHARTS, has_charts
    from poseloom.report.evaluation import write_evaluation_report
    from poseloom.report.strip import sequence_strip

    out.mkdir(parents=True, exist_ok=True)
    if live:
        _live(out, seconds)
        return
    with progress_bars() as show:
        library, is_new = _library(data, (*(exclude or ()), *_own_files(data, out)), out, show)
        clip = choose_clip(library.clips, library.rate)
        case = case_of_motion(library.motion(clip), Conditions(), clip.name, clip.digest, clip.subject)
        methods = tuple(dict.fromkeys((DEFAULT_METHOD, *_BESIDE)))
        evaluation = evaluate_cases([case], Experiment(methods, library.path), show)
    for skipped in library.skipped if is_new else ():
        if skipped.kind == SkipKind.UNREADABLE:
            typer.echo(f"not in the library: {skipped.source}: {skipped.reason}", err=True)
    stem = Path(clip.name).name
    for suffix in (".bvh", ".glb"):
        write_motion(evaluation.sequences[0].results[0].motion, out / f"{stem}{suffix}")
    source = "the built-in motions" if data is None else str(data)
    story = (
        f"The library was built from {source}. Six virtual trackers, on head, chest, hands and ankles, were put on "
        f"{clip.name}; each method heard those alone, one sample at a time, and found its first pose itself."
    )
    title = f"{stem}: full-body motion from six trackers"
    if has_charts():
        write_evaluation_report(out / "report.html", evaluation, title, (story,))
    with atomic_file(out / f"{stem}.svg") as part:
        part.write_text(sequence_strip(evaluation.sequences[0]), encoding="utf-8")
    console = Console()
    print_evaluation(evaluation, console)
    console.print(_advice(out, stem, data), highlight=False, soft_wrap=True)
    if not has_charts():
        typer.echo(f"There is no report.html: {NO_CHARTS}", err=True)


def _live(out: Path, seconds: float) -> None:
    """A session on simulated trackers of a walk, which the library of the built-in motions does without."""
    from poseloom.cli.live import run_live
    from poseloom.library import build_library
    from poseloom.live.settings import LiveSettings

    folder = out / "live-library"
    if not folder.exists():
        with progress_bars() as show:
            build_library(["samples"], folder, rate=_LIVE_RATE, mirror=True, exclude=("walk",), progress=show)
    typer.echo(f"A walk, from six simulated trackers; {folder} holds the other built-in motions, and no walk.")
    settings = LiveSettings(
        source=("simulate://sample:walk",), library=str(folder), view=True, folder=str(out), seconds=seconds
    )
    run_live(settings)


def choose_clip(clips: "tuple[Clip, ...]", rate: float) -> "Clip":
    """The clip to leave out and reconstruct: a CMU walk if there is one, else a walk, else any; of a handy length.

    Among these one of which the library holds most alike: other takes of the same person doing the same.

    Raises:
        LibraryError: if leaving its take out would leave nothing.
    """

    alike: dict[object, set[str]] = {}
    for clip in clips:
        alike.setdefault((clip.subject, clip.tags), set()).add(clip.take)

    def rank(clip: "Clip") -> tuple[int, bool, bool, bool, int, str]:
        walk = 0 if clip.tags == ("walk",) else 1 if "walk" in clip.tags else 2
        handy = _SHORTEST <= len(clip) / rate <= _LONGEST
        company = len(alike[clip.subject, clip.tags])
        return (walk, not clip.subject.startswith("cmu"), not handy, clip.mirrored, -company, clip.name)

    chosen = min(clips, key=rank)
    if all(clip.take == chosen.take for clip in clips):
        raise LibraryError(
            f"the only motion here is the take {chosen.take!r}",
            cause="the demo hides one take from the library and reconstructs it from the others",
            remedy="Give a folder with at least two different motions",
        )
    return chosen


def _library(
    data: Path | None, exclude: tuple[str, ...], out: Path, show: ShowProgress
) -> "tuple[MotionLibrary, bool]":
    """The demo's library in `out`, built again if its sources are not what they were, and whether it was."""
    from poseloom.library import build_library, open_library

    folder, mark = out / "library", out / "library.sources"
    wanted = _fingerprint(data, exclude, out)
    if folder.exists() and not mark.is_file():
        raise LibraryError(
            "this is in the way of the demo's library", remedy="Choose another folder with --out", file=folder
        )
    if folder.exists() and mark.read_text(encoding="utf-8") == wanted:
        with suppress(LibraryError):  # a damaged one is ours, and made again
            return open_library(folder), False
    mark.write_text("unfinished", encoding="utf-8")
    shutil.rmtree(folder, ignore_errors=True)
    build_library(["samples" if data is None else data], folder, mirror=True, exclude=exclude, progress=show)
    mark.write_text(wanted, encoding="utf-8")
    return open_library(folder), True


def _fingerprint(data: Path | None, exclude: tuple[str, ...], out: Path) -> str:
    """What a library is made from: the package's version, and names, sizes and times of all files."""
    from poseloom import __version__

    if data is None:
        return f"poseloom {__version__}: samples"
    if not data.is_dir():
        raise PoseloomError("no such folder", remedy="Give --data a folder of motion files", file=data)
    digest = hashlib.sha256(repr(exclude).encode())
    own = out.resolve()
    for path in sorted(data.resolve().rglob("*")):
        if path.is_file() and not path.is_relative_to(own):
            state = path.stat()
            digest.update(f"{path}\0{state.st_size}\0{state.st_mtime_ns}\0".encode())
    return f"poseloom {__version__}: {digest.hexdigest()}"


def _own_files(data: Path | None, out: Path) -> tuple[str, ...]:
    """The pattern that keeps the demo from reading its own results as motions, if they lie within the data."""
    if data is None or not out.resolve().is_relative_to(data.resolve()):
        return ()
    root = data.resolve()
    return ((PurePosixPath(root.name) / out.resolve().relative_to(root)).as_posix(),)


def _advice(out: Path, stem: str, data: Path | None) -> str:
    from poseloom.report.charts import has_charts

    library, shown = out / "library", "report.html" if has_charts() else f"{stem}.svg"
    lines = [
        f"Look at it:           {out / shown} in a browser; {out / stem}.bvh and .glb in Blender",
        "Your own motions:     make demo DATA=FOLDER" if data is None else "",
        "Step by step:         . .venv/bin/activate",
        "                      poseloom simulate sample:dance_a -o dance.mcap",
        f"                      poseloom reconstruct dance.mcap --library {library} -o dance.glb",
        "What else there is:   poseloom --help",
    ]
    return "\n".join(line for line in lines if line)
