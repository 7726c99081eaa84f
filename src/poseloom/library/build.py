"""Makes a motion library, and adds to one."""

from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from poseloom.errors import LibraryError
from poseloom.formats.atomic import naming
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices
from poseloom.library import folders, store
from poseloom.library.catalogue import CATALOGUE_FILE, SkipKind, Skipped, write_catalogue
from poseloom.library.conversion import Recipe, convert
from poseloom.library.features import FeatureSettings
from poseloom.library.filling import Filling
from poseloom.library.index import moment_rows
from poseloom.library.moments import make_moments
from poseloom.library.pool import in_order
from poseloom.library.poses import POSES_FILE, PoseWriter, body_digest, open_poses
from poseloom.library.sources import UNSTATED, Found, Selection, find_sources
from poseloom.library.takes import find_takes
from poseloom.sensors import layout

Progress = Callable[[str, int, int], None]
"""Called with the name of what is being done, and how many of how many are."""

_READING = "reading motions"
_COMPARING = "finding copies of takes"
_INDEXING = "indexing poses"


@dataclass(frozen=True)
class BuildReport:
    """What a build or an addition did.

    Attributes:
        path: The library.
        clips: Clips added, mirror images included.
        poses: Poses added.
        skipped: Files and motions that were not taken, with reasons.
        understood: How many files were understood in which way: unit, up axis, rest pose.
    """

    path: Path
    clips: int
    poses: int
    skipped: tuple[Skipped, ...]
    understood: Mapping[str, int] = field(default_factory=dict[str, int])


def build_library(
    sources: Sequence[str | Path],
    out: str | Path,
    rate: float = 40.0,
    mirror: bool = False,
    exclude: Sequence[str] = (),
    skeletons: Mapping[str, str | Path] | None = None,
    licence: str = UNSTATED,
    workers: int = 1,
    replace_existing: bool = False,
    progress: Progress | None = None,
    choices: MotionChoices = NOTHING_SAID,
) -> BuildReport:
    """Builds a motion library: every motion on the average body, at one rate, catalogued and indexed.

    The library appears whole or not at all. The same sources give the same bytes, with any number of workers. With more
    than one (`poseloom library build` takes two) a script must guard its top level by `if __name__ == "__main__"`.

    Args:
        sources: Files and folders, or `samples` for the built-in motions.
        out: Folder to make.
        rate: Frames a second.
        mirror: Add the left-right mirror image of each clip.
        exclude: Glob patterns of sources to leave out; one fits any run of parts of a source's path.
        skeletons: ASF file by glob pattern, for AMC files that have no ASF of their own.
        licence: Note for sources beside which no licence is stated.
        workers: Number of processes.
        replace_existing: Put the new content in place of the library that `out` holds.
        progress: Told how far it is.
        choices: What the user says of files that do not say it themselves: unit, up axis, rate, rest pose.

    Raises:
        LibraryError: if `out` holds something, a source does not exist, or not one motion could be read.
    """
    folder = Path(out)
    if not (np.isfinite(rate) and rate > 0):
        raise LibraryError(f"a rate of {rate} frames a second", remedy="Give a positive, finite rate")
    existing = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
    if existing and not replace_existing:
        raise LibraryError(
            "this is in the way of the new library",
            remedy="Choose another folder, or replace the library (--replace)",
            file=folder,
        )
    if existing:
        store.read_header(folder)  # only a library is replaced
    job = _Job(
        found=find_sources(sources, _selection(exclude, skeletons, licence)),
        recipe=Recipe(float(rate), mirror, choices),
        entry=_history_entry("build", sources, exclude, skeletons, licence, choices),
        workers=workers,
        progress=progress or _silent,
    )
    with _place(folder, existing) as part:
        return replace(_write(part, None, job), path=folder)


def add_to_library(
    folder: str | Path,
    sources: Sequence[str | Path],
    exclude: Sequence[str] = (),
    skeletons: Mapping[str, str | Path] | None = None,
    licence: str = UNSTATED,
    workers: int = 1,
    progress: Progress | None = None,
    choices: MotionChoices = NOTHING_SAID,
) -> BuildReport:
    """Adds motions to a library, at its rate and with mirror images if it has them.

    Until the last step, one renaming, the library stays as it was; readers that have it open keep what they opened.
    Files whose content it holds already are left out and listed.

    Args:
        folder: The library.
        sources: See `build_library`, as for the rest.

    Raises:
        LibraryError: if the library is damaged or being written to, a source does not exist, or nothing could be read.
    """
    path = Path(folder)
    found = find_sources(sources, _selection(exclude, skeletons, licence))
    store.read_header(path)
    with folders.writing(path):
        header = store.read_header(path)
        store.check_files(path / header.generation, header.files)
        job = _Job(
            found=found,
            recipe=Recipe(header.rate, header.mirror, choices),
            entry=_history_entry("add", sources, exclude, skeletons, licence, choices),
            workers=workers,
            progress=progress or _silent,
        )
        return _write(path, header, job)


@dataclass(frozen=True, eq=False)
class _Job:
    found: Found
    recipe: Recipe
    entry: Mapping[str, Any]
    workers: int
    progress: Progress


def six_trackers() -> FeatureSettings:
    """The features for which every library is indexed when it is built; others are indexed when first asked for."""
    return FeatureSettings(sensor_bones=tuple(sensor.bone for sensor in layout("six-trackers").sensors))


def _silent(what: str, done: int, total: int) -> None:
    pass


def _selection(exclude: Sequence[str], skeletons: Mapping[str, str | Path] | None, licence: str) -> Selection:
    named = tuple((pattern, Path(path)) for pattern, path in (skeletons or {}).items())
    for _, path in named:
        if not path.is_file():
            raise LibraryError("no such skeleton file", remedy="Give an ASF file", file=path)
    return Selection(tuple(exclude), named, licence)


def _history_entry(
    what: str,
    sources: Sequence[str | Path],
    exclude: Sequence[str],
    skeletons: Mapping[str, str | Path] | None,
    licence: str,
    choices: MotionChoices,
) -> Mapping[str, Any]:
    return {
        "command": what,
        "sources": [str(source) for source in sources],
        "exclude": list(exclude),
        "skeletons": {pattern: str(path) for pattern, path in (skeletons or {}).items()},
        "licence": licence,
        **{name: value for name, value in asdict(choices).items() if value not in (None, "auto")},
    }


@contextmanager
def _place(folder: Path, existing: bool) -> Generator[Path, None, None]:
    """Where a new library's first generation goes: a hidden folder that will be renamed, or the library to replace."""
    if existing:
        with folders.writing(folder):
            yield folder
    else:
        with folders.new_folder(folder) as part:
            yield part


def _write(folder: Path, earlier: store.Header | None, job: _Job) -> BuildReport:
    """Fills a new generation with what an earlier one held and the job's motions, and switches to it."""
    with folders.new_generation(folder) as generation:
        filled = Filling()
        with naming(generation / POSES_FILE), PoseWriter(generation / POSES_FILE) as writer:
            if earlier is not None:
                filled.take_over(folder / earlier.generation, writer)
            before, rows_before, skipped_before = len(filled.clips), writer.rows, len(filled.skipped)
            _read(job, filled, writer)
            rows = writer.rows
        if len(filled.clips) == before:
            raise _nothing(filled.skipped[skipped_before:], earlier is not None)
        poses = open_poses(generation / POSES_FILE).values
        takes = find_takes(poses, filled.clips, job.recipe.rate, partial(job.progress, _COMPARING))
        clips = tuple(replace(clip, take=takes[clip.take]) for clip in filled.clips)
        write_catalogue(generation / CATALOGUE_FILE, clips, filled.skipped)
        features = six_trackers()
        if len(moment_rows(clips, features.reach)):
            job.progress(_INDEXING, 0, 1)
            make_moments(generation, poses, clips, features)
            job.progress(_INDEXING, 1, 1)
        header = store.Header(
            rate=job.recipe.rate,
            mirror=job.recipe.mirror,
            body=body_digest(),
            poses=rows,
            clips=len(clips),
            history=(*(earlier.history if earlier else ()), job.entry),
            generation="",
            files=(),
        )
        store.write_header(folder, store.with_generation(header, generation))
    folders.remove_other_generations(folder, generation.name)
    understood = Counter(clip.conventions for clip in clips[before:] if clip.conventions and not clip.mirrored)
    skipped = tuple(filled.skipped[skipped_before:])
    return BuildReport(folder, len(clips) - before, rows - rows_before, skipped, dict(understood))


def _read(job: _Job, filled: Filling, writer: PoseWriter) -> None:
    """Converts the job's sources, in their order."""
    sources = job.found.sources
    filled.skipped += job.found.aside
    job.progress(_READING, 0, len(sources))
    results = in_order(partial(convert, recipe=job.recipe), sources, job.workers)
    for done, (source, conversion) in enumerate(zip(sources, results, strict=True), 1):
        filled.add(source, conversion, writer)
        job.progress(_READING, done, len(sources))


def _nothing(skipped: Sequence[Skipped], adding: bool) -> LibraryError:
    told = [entry for entry in skipped if entry.kind is not SkipKind.COMPANION][:3]
    return LibraryError(
        "nothing new could be read" if adding else "not one motion could be read",
        cause="; ".join(f"{entry.source}: {entry.reason}" for entry in told),
        remedy="Mend or exclude these files, or give others",
    )
