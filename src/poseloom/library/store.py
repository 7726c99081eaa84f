"""The library on disk: a header that points to one generation of files, switched in one step.

    DIR/library.json        header: format version, settings, sizes and digests, and which generation holds
    DIR/generation-N/       poses.npy, catalogue.sqlite and the index's files, never changed once the header names them
    DIR/.lock               held by whoever writes

A writer fills a new generation and replaces the header, which the file system does in one step; then it removes the old
generation. Whoever is killed on the way leaves the old header and a nameless generation, which the next writer removes.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from poseloom.errors import LibraryError
from poseloom.formats._files import open_regular, read_json, reading
from poseloom.formats.artefact_arrays import RATES, checked_number
from poseloom.formats.atomic import atomic_file, naming
from poseloom.library.folders import check_inside, to_disk

HEADER_FILE = "library.json"
KIND = "poseloom-library"
VERSION = 1

_SEAL_FILE = "seal.json"
_BLOCK = 1 << 16
_WHOLE_UP_TO = 1 << 27
_BLOCKS = 512
REBUILD = "Build the library again, or take it from a backup"


@dataclass(frozen=True)
class StoredFile:
    """A file of a generation, as it was when it was written.

    Attributes:
        name: Its name in the generation's folder.
        bytes: Its size.
        quick: SHA-256 of 512 blocks of 64 KiB spread over it, or of all of it up to 128 MiB.
        sha256: SHA-256 of all of it.
    """

    name: str
    bytes: int
    quick: str
    sha256: str


@dataclass(frozen=True)
class Header:
    """What `library.json` says.

    Attributes:
        rate: Frames a second of all poses.
        mirror: Whether mirror images are held too.
        body: Digest of the skeleton that the poses belong to.
        poses: Number of poses.
        clips: Number of clips.
        history: One entry for each build and addition: what was given.
        generation: Name of the folder that holds.
        files: Its files.
    """

    rate: float
    mirror: bool
    body: str
    poses: int
    clips: int
    history: tuple[Mapping[str, Any], ...]
    generation: str
    files: tuple[StoredFile, ...]


def read_header(folder: Path) -> Header:
    """Reads and checks the header of a library.

    Raises:
        LibraryError: if there is none, it is damaged, or of another version.
    """
    path = folder / HEADER_FILE
    if not os.path.lexists(path):
        raise LibraryError(
            "no motion library in this folder" if folder.is_dir() else "no such folder",
            remedy="Make one: poseloom library build SRC... -o DIR",
            file=folder,
        )
    content = read_json(path, "the header of a motion library", LibraryError)
    if not isinstance(content, dict) or cast(dict[str, Any], content).get("kind") != KIND:
        raise LibraryError("this is not the header of a motion library", remedy=REBUILD, file=path)
    fields = cast(dict[str, Any], content)
    if fields.get("version") != VERSION:
        raise LibraryError(
            f"this library has format version {fields.get('version')}, this poseloom reads version {VERSION}",
            remedy="Build the library again with this poseloom, or use the poseloom that made it",
            file=path,
        )
    if fields.pop("digest", None) != _digest(fields):
        raise LibraryError("the library's header was changed", cause="its digest differs", remedy=REBUILD, file=path)
    with reading(path, "the header of a motion library", LibraryError):
        header = _header(fields)
    check_inside(folder, header.generation)
    return header


def _header(fields: Mapping[str, Any]) -> Header:
    """The header's fields, each of its type and in its range: a stranger may have written them."""
    if type(fields["mirror"]) is not bool or not isinstance(fields["body"], str):
        raise ValueError("'mirror' or 'body' is of another type")
    generation = str(fields["generation"])
    if not is_plain(generation) or not generation.startswith("generation-"):
        raise ValueError(f"the generation {generation[:80]!r} is no folder of the library")
    history = fields["history"]
    if not isinstance(history, list) or not all(isinstance(entry, dict) for entry in cast("list[Any]", history)):
        raise ValueError("'history' is no list of entries")
    return Header(
        rate=checked_number("the rate", fields["rate"], *RATES),
        mirror=fields["mirror"],
        body=fields["body"],
        poses=_count(fields["poses"]),
        clips=_count(fields["clips"]),
        history=tuple(cast("list[Mapping[str, Any]]", history)),
        generation=generation,
        files=_stored(fields["files"]),
    )


def is_plain(name: str) -> bool:
    """Whether a name is that of something in a folder itself: it leads nowhere else, on any system."""
    return bool(name) and name not in (".", "..") and not set(name) & set("/\\:\0")


def _stored(entries: Any) -> tuple[StoredFile, ...]:
    """Files as a header or seal lists them."""
    files = tuple(
        StoredFile(str(entry["name"]), _count(entry["bytes"]), str(entry["quick"]), str(entry["sha256"]))
        for entry in entries
    )
    for file in files:
        if not is_plain(file.name):
            raise ValueError(f"the file {file.name[:80]!r} is not one of the library's folder")
    return files


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 2**53:
        raise ValueError(f"{str(value)[:40]} is no number of things")
    return value


def write_header(folder: Path, header: Header) -> None:
    """Puts a header in place in one step: from then on its generation holds."""
    fields = {"kind": KIND, "version": VERSION, **asdict(header)}
    text = json.dumps({**fields, "digest": _digest(fields)}, indent=1, sort_keys=True)
    with atomic_file(folder / HEADER_FILE) as part:
        part.write_text(text + "\n", encoding="utf-8")
        to_disk(part)
    to_disk(folder)


def _digest(fields: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()


def seal(folder: Path) -> tuple[StoredFile, ...]:
    """Sizes and digests of the files in a finished folder, hidden ones apart; each is forced to the disk first."""
    files: list[StoredFile] = []
    for path in sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")):
        to_disk(path)
        whole = file_digest(path)
        size = path.stat().st_size
        files.append(StoredFile(path.name, size, whole if size <= _WHOLE_UP_TO else _spread_digest(path), whole))
    to_disk(folder)
    return tuple(files)


def write_seal(folder: Path) -> None:
    """Leaves the sizes and digests of a folder's files in it."""
    with naming(folder / _SEAL_FILE):
        (folder / _SEAL_FILE).write_text(
            json.dumps([asdict(file) for file in seal(folder)], indent=1), encoding="utf-8"
        )
    to_disk(folder / _SEAL_FILE)


def check_seal(folder: Path, remedy: str, full: bool = False) -> None:
    """Checks a folder's files against its seal; see `check_files`.

    Raises:
        LibraryError: naming the first file that is missing, or of another size or content.
    """
    path = folder / _SEAL_FILE
    check_inside(folder.parent, folder.name)
    with reading(path, "the list of an index's files", LibraryError):
        files = _stored(read_json(path, "the list of an index's files", LibraryError))
    check_files(folder, files, full, remedy)


def check_files(folder: Path, files: Iterable[StoredFile], full: bool = False, remedy: str = REBUILD) -> None:
    """Checks files against what was noted when they were written.

    Args:
        folder: Where they are.
        files: What was noted.
        full: Digest whole files, rather than blocks spread over the large ones.
        remedy: What to do about a difference.

    Raises:
        LibraryError: naming the first file that is missing, or of another size or content.
    """
    for file in files:
        path = folder / file.name
        check_inside(folder, file.name)
        try:
            size = path.stat().st_size
        except OSError:
            raise LibraryError("a file of the library is missing", remedy=remedy, file=path) from None
        if size != file.bytes:
            raise LibraryError(
                f"a file of the library was changed: it has {size} bytes, and had {file.bytes}",
                remedy=remedy,
                file=path,
            )
        whole = full or size <= _WHOLE_UP_TO
        found, noted = (file_digest(path), file.sha256) if whole else (_spread_digest(path), file.quick)
        if found != noted:
            raise LibraryError(
                "a file of the library is damaged or was changed", cause="its digest differs", remedy=remedy, file=path
            )


def file_digest(path: Path) -> str:
    """SHA-256 of a regular file."""
    with open_regular(path) as file:
        return hashlib.file_digest(cast(Any, file), "sha256").hexdigest()


def _spread_digest(path: Path) -> str:
    total = path.stat().st_size
    digest = hashlib.sha256()
    with open_regular(path) as file:
        for block in range(_BLOCKS):
            file.seek((total - _BLOCK) * block // (_BLOCKS - 1))
            digest.update(file.read(_BLOCK))
    return digest.hexdigest()


def with_generation(header: Header, generation: Path) -> Header:
    """The header for a finished generation: its name and files filled in."""
    return replace(header, generation=generation.name, files=seal(generation))
