"""Which files a library is built from: folders searched, companions set aside, names and licences read."""

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path, PurePosixPath

from poseloom.errors import FormatError, LibraryError
from poseloom.formats import format_name, is_motion_file, motion_suffixes
from poseloom.formats._files import beginning, decode, read_bytes, reading
from poseloom.formats.asf_amc import find_asf
from poseloom.library.catalogue import SkipKind, Skipped
from poseloom.library.naming import describe
from poseloom.library.store import HEADER_FILE
from poseloom.samples import SAMPLE_PREFIX, sample_motions

SAMPLES = "samples"
"""The word that stands for the built-in sample motions where a file or folder could stand."""
UNSTATED = "not stated"
"""Licence note of a source beside which no licence stands."""

_OVERRIDES_FILE = "tags.csv"
_SKELETON_FILE = "skeleton.json"
_UNCERTAIN_SUFFIXES = frozenset({".txt", ".json", ".csv", ".npz"})
_COMPANION_STEMS = frozenset(
    {"license", "licence", "licenses", "copying", "readme", "notice", "notes", "requirements", "changelog", "citation"}
)
_FOREIGN_SUFFIXES = frozenset(
    {".fbx", ".c3d", ".trc", ".vmd", ".mvnx", ".glb", ".gltf", ".vrma", ".usd", ".usda", ".tvd"}
)
_LONGEST_NOTE = 80


@dataclass(frozen=True)
class Source:
    """One file (or built-in sample) to take motions from.

    Attributes:
        name: Path with forward slashes, from the name of the given folder on.
        path: The file; None for a built-in sample.
        skeleton: Skeleton to animate the file on, should it have none of its own.
        subject: Who moves.
        tags: Words for what happens.
        licence: Under what terms it is.
    """

    name: str
    path: Path | None
    skeleton: Path | None
    subject: str
    tags: tuple[str, ...]
    licence: str


@dataclass(frozen=True)
class Selection:
    """What of the given files to take, and what to say of them.

    Attributes:
        exclude: Glob patterns of sources to leave out (see `matches`).
        skeletons: Skeleton file by glob pattern, for motions that have none beside them (ASF for AMC, JSON for
            exponential maps); the first match counts.
        licence: Note for sources beside which no licence stands.
    """

    exclude: tuple[str, ...] = ()
    skeletons: tuple[tuple[str, Path], ...] = ()
    licence: str = UNSTATED


@dataclass(frozen=True)
class Found:
    """Sources in a fixed order, and files that were set aside, with reasons."""

    sources: tuple[Source, ...]
    aside: tuple[Skipped, ...]


def matches(pattern: str, name: str) -> bool:
    """Whether a glob pattern fits a source's name, or any run of its parts.

    `bandai` fits everything in a folder of that name, `cmu_bvh/16` all of that folder's subfolder, `*_15.bvh` files.
    """
    parts = PurePosixPath(name).parts
    length = len(PurePosixPath(pattern).parts)
    runs = ("/".join(parts[i : i + length]) for i in range(len(parts) - length + 1))
    return any(fnmatchcase(run, pattern) for run in runs) or fnmatchcase(name, pattern)


def find_sources(given: Sequence[str | Path], selection: Selection) -> Found:
    """Lists the motion files of files and folders, in a fixed order.

    Folders are searched to their depths, hidden files and poseloom libraries left out. A `.txt`, `.json` or `.csv`
    that is known to be no motion (licences, labels of a motion of the same name, `skeleton.json`) is set aside. A
    `tags.csv` in a given folder, with the columns file, subject and tags, overrides what names tell.

    Args:
        given: Files and folders, or `samples` for the built-in motions (`./samples` for a folder of that name).
        selection: What to take.

    Raises:
        LibraryError: for a file or folder that does not exist, a wrong `tags.csv`, or if nothing is left to read.
    """
    sources: list[Source] = []
    aside: list[Skipped] = []
    for item in given:
        if str(item) == SAMPLES:
            sources += _samples()
            continue
        path = Path(item)
        if path.is_dir():
            root = path.resolve()
            overrides = _overrides(root / _OVERRIDES_FILE)
            files, companions = _motion_files(root)
            aside += companions
            licence_of = cache(partial(_licence, root=root))
            sources += [_source(file, root, selection, overrides, licence_of(file.parent)) for file in files]
        elif path.is_file():
            file = path.resolve()
            overrides = _overrides(file.parent / _OVERRIDES_FILE)
            sources.append(_source(file, file.parent, selection, overrides, _licence(file.parent, file.parent)))
        else:
            raise LibraryError(
                "no such file or folder",
                remedy=f"Give motion files, folders that hold some, or {SAMPLES!r} for the built-in motions",
                file=path,
            )
    kept = [source for source in sources if not any(matches(pattern, source.name) for pattern in selection.exclude)]
    kept = list({(source.name, source.path): source for source in kept}.values())
    aside = [entry for entry in aside if not any(matches(pattern, entry.source) for pattern in selection.exclude)]
    if not kept:
        raise LibraryError(
            f"no motion files in {', '.join(str(item) for item in given) or 'nothing'}",
            cause=f"{len(sources)} were found and all are excluded" if sources else "",
            remedy=f"Motion files end in {', '.join(sorted(motion_suffixes()))}",
        )
    return Found(tuple(kept), tuple(aside))


def subject_of(clip: str) -> str:
    """Who moves in a file or built-in motion (`sample:NAME`), as a library that holds it says.

    Raises:
        LibraryError: for a file that does not exist or is no motion.
    """
    if clip.startswith(SAMPLE_PREFIX):
        return describe(f"{SAMPLES}/{clip.removeprefix(SAMPLE_PREFIX)}").subject
    return find_sources([clip], Selection()).sources[0].subject


def _samples() -> list[Source]:
    licence = "zlib (pybullet's data); from CMU recordings, free for all uses, NSF EIA-0196217"
    described = {name: describe(f"{SAMPLES}/{name}") for name in sample_motions()}
    return [
        Source(f"{SAMPLES}/{name}", None, None, about.subject, about.tags, licence) for name, about in described.items()
    ]


def _motion_files(root: Path) -> tuple[list[Path], list[Skipped]]:
    readable = motion_suffixes()
    files: list[Path] = []
    aside: list[Skipped] = []
    for folder, below, names in os.walk(root):
        if HEADER_FILE in names and "poseloom-library" in _beginning(Path(folder) / HEADER_FILE):
            below.clear()
            continue
        below[:] = sorted(name for name in below if not name.startswith("."))
        certain = {Path(n).stem for n in names if Path(n).suffix.lower() in set(readable) - _UNCERTAIN_SUFFIXES}
        for name in sorted(name for name in names if not name.startswith(".")):
            path = Path(folder) / name
            suffix = path.suffix.lower()
            reason = _companion_reason(path, certain) if suffix in _UNCERTAIN_SUFFIXES else ""
            if suffix in readable and suffix not in _FOREIGN_SUFFIXES and not reason:
                files.append(path)
            elif reason:
                aside.append(Skipped(_name(path, root), SkipKind.COMPANION, reason))
            elif suffix in _FOREIGN_SUFFIXES:
                why = "GLB is for viewers" if suffix == ".glb" else f"poseloom reads no {suffix} files"
                why += ": convert it to BVH"
                aside.append(Skipped(_name(path, root), SkipKind.UNREADABLE, why))
    return sorted(files, key=lambda file: file.relative_to(root).parts), aside


def _companion_reason(path: Path, certain: set[str]) -> str:
    """Why a file that could be a motion by its suffix is none; empty if it may be one."""
    if path.name in (_SKELETON_FILE, _OVERRIDES_FILE, HEADER_FILE):
        return "describes the motions beside it"
    if path.stem.lower() in _COMPANION_STEMS:
        return "a document"
    motion = is_motion_file(path)
    if path.stem in certain and not (motion and _can_stand_alone(path)):
        return "labels of the motion of the same name"
    return "" if motion else "by its beginning, no motion"


def _can_stand_alone(path: Path) -> bool:
    """Whether a file of numbers is more than a table beside a motion: it has a skeleton."""
    return format_name(path) != "exponential-map CSV" or _has_skeleton_above(path.parent)


def _source(
    file: Path, root: Path, selection: Selection, overrides: Mapping[str, tuple[str, str]], licence: str
) -> Source:
    name = _name(file, root)
    exponential_maps = file.suffix.lower() in (".txt", ".csv") and _has_skeleton_above(file.parent)
    about = describe(name, exponential_maps)
    subject, tags = about.subject, about.tags
    for pattern, (new_subject, new_tags) in overrides.items():
        if matches(pattern, name):
            subject, tags = new_subject or subject, tuple(new_tags.split()) or tags
    skeleton = None if not selection.skeletons or _has_skeleton(file) else _skeleton_for(name, selection)
    return Source(name, file, skeleton, subject, tags, licence or selection.licence)


def _skeleton_for(name: str, selection: Selection) -> Path | None:
    suffix = ".asf" if name.lower().endswith(".amc") else ".json"
    fitting = (
        path for pattern, path in selection.skeletons if matches(pattern, name) and path.suffix.lower() == suffix
    )
    return next(fitting, None)


def _has_skeleton(file: Path) -> bool:
    """Whether a motion's file holds its skeleton, or one stands beside it."""
    suffix = file.suffix.lower()
    if suffix == ".amc":
        try:
            find_asf(file)
        except FormatError:
            return False
        return True
    return suffix not in (".txt", ".csv") or _has_skeleton_above(file.parent)


def _name(file: Path, root: Path) -> str:
    return str(PurePosixPath(root.name or "root", *file.relative_to(root).parts))


def _has_skeleton_above(folder: Path) -> bool:
    return any((place / _SKELETON_FILE).is_file() for place in (folder, *list(folder.parents)[:3]))


def _overrides(path: Path) -> dict[str, tuple[str, str]]:
    """Subject and tags by glob pattern, from a table beside the motions."""
    if not path.is_file():
        return {}
    with reading(path, "a table of subjects and tags", LibraryError):
        table = csv.DictReader(io.StringIO(decode(read_bytes(path, LibraryError)), newline=""))
        columns = list(table.fieldnames or ())
        if "file" not in columns or not {"subject", "tags"} & set(columns):
            raise LibraryError(
                f"the columns are {', '.join(columns) or 'none'}",
                remedy="Give the columns file, subject and tags; file is a glob pattern, tags are separated by spaces",
                file=path,
                line=1,
            )
        return {row["file"]: (row.get("subject") or "", row.get("tags") or "") for row in table if row["file"]}


def _licence(folder: Path, root: Path) -> str:
    """The licence stated in a folder or the nearest one above it, up to the given one; empty if none is.

    A README one level above the given folder counts too: collections are described where they lie side by side.
    """
    for place in (folder, *folder.parents):
        above = place == root.parent and place != folder
        for path in sorted(place.iterdir()) if os.access(place, os.R_OK) else ():
            stem, suffix = path.stem.lower(), path.suffix.lower()
            if not path.is_file() or suffix not in ("", ".txt", ".md", ".rst"):
                continue
            if stem in ("license", "licence", "copying") and not above and suffix != ".rst":
                return _note(line for line in _beginning(path).splitlines())
            if stem == "readme":
                lines = _beginning(path).splitlines()
                stated = _stated_licence(lines) or _tabled_licence(lines, folder.relative_to(place).parts)
                if stated:
                    return stated
        if above:
            break
    return ""


def _stated_licence(lines: Iterable[str]) -> str:
    for line in lines:
        what, colon, terms = line.strip(" *_#-").partition(":")
        if colon and what.strip(" *_").lower() in ("license", "licence") and terms.strip(" *_"):
            return _note([terms.strip(" *_")])
    return ""


def _tabled_licence(lines: Iterable[str], folders: Sequence[str]) -> str:
    """The licence that a Markdown table states for one of these folders: a column of folders, and one of licences."""
    column, stated = -1, ""
    for line in lines:
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.lstrip().startswith("|"):
            column, stated = -1, ""
        elif column < 0:
            column = next((at for at, cell in enumerate(cells) if cell.lower().startswith("licen")), -1)
        elif column < len(cells):
            stated = stated if cells[column].lower().startswith(("same", "as above")) else cells[column]
            named = {word.strip("`*").partition("/")[0] for word in cells[0].split()}
            if named & set(folders):
                return _note([stated])
    return ""


def _note(lines: Iterable[str]) -> str:
    first = next((line.strip(" #=*\t") for line in lines if line.strip(" #=*\t")), "")
    return first if len(first) <= _LONGEST_NOTE else first[: _LONGEST_NOTE - 3] + "..."


def _beginning(path: Path) -> str:
    return beginning(path, 16384).decode("utf-8", errors="replace")
