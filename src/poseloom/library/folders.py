"""Folders that appear whole or not at all, and the right to write to one."""

import os
import shutil
import sqlite3
import sys
from collections.abc import Generator, Iterable
from contextlib import closing, contextmanager
from pathlib import Path

from poseloom.errors import LibraryError
from poseloom.formats.atomic import naming, patiently

LOCK_FILE = ".lock"

_GENERATION = "generation-"


def to_disk(path: Path) -> None:
    """Forces a file, or a folder's list of files, to the disk (folders: where the system can)."""
    windows = sys.platform == "win32"
    if windows and path.is_dir():
        return
    with naming(path):
        handle = os.open(path, os.O_RDWR if windows else os.O_RDONLY)  # Windows forces only what it may write
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def check_inside(folder: Path, name: str) -> None:
    """Raises LibraryError where something in a library's folder is a link, which may lead anywhere."""
    path = folder / name
    if path.is_symlink() or (path.exists() and path.resolve().parent != folder.resolve()):  # junctions of Windows
        raise LibraryError(
            "this part of the library is a link to somewhere else",
            cause="a library holds its own files; whoever follows a link reads, and writes, what it points to",
            remedy="Copy the library with its files (cp -rL), if you trust where the link leads",
            file=path,
        )


@contextmanager
def writing(folder: Path) -> Generator[None, None, None]:
    """Holds the right to write into a folder; it falls back when the process ends, however it ends.

    Raises:
        LibraryError: if another process holds it.
    """
    check_inside(folder, LOCK_FILE)
    # sqlite locks its file on every system; a transaction without a journal that changes nothing leaves nothing behind.
    with closing(sqlite3.connect(folder / LOCK_FILE, timeout=0, isolation_level=None)) as connection:
        try:
            connection.execute("PRAGMA journal_mode = OFF")
            connection.execute("BEGIN EXCLUSIVE")
        except sqlite3.OperationalError as error:
            if getattr(error, "sqlite_errorname", "SQLITE_BUSY") != "SQLITE_BUSY":
                raise LibraryError("the library cannot be written to", cause=str(error), file=folder) from None
            raise LibraryError(
                "another process is writing to this library", remedy="Wait until it has ended", file=folder
            ) from None
        yield


@contextmanager
def new_folder(target: Path) -> Generator[Path, None, None]:
    """A hidden folder beside the target that takes the target's place when the block ends well, else is removed.

    Folders that killed builds of the same target have left are removed first. The target must not exist, or be an empty
    folder.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{target.name}.building-"
    for old in target.parent.glob(f"{prefix}*"):
        _remove_if_abandoned(old)
    part = target.with_name(f"{prefix}{os.getpid()}-{os.urandom(3).hex()}")
    part.mkdir()
    try:
        with naming(target, within=part), writing(part):
            yield part
            if sys.platform != "win32":
                part.rename(target)
        if sys.platform == "win32":  # it renames no folder in which a file is open, and onto no folder
            if target.is_dir():
                target.rmdir()
            patiently(lambda: part.rename(target))
        to_disk(target.parent)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _remove_if_abandoned(folder: Path) -> None:
    if not (folder / LOCK_FILE).exists():
        return
    try:
        with writing(folder):
            pass
    except LibraryError:
        return
    shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def new_generation(folder: Path) -> Generator[Path, None, None]:
    """A new folder for a generation's files; removed if the block raises, else left for `write_header` to name."""
    numbers = [
        int(tail) for tail in (path.name.removeprefix(_GENERATION) for path in generations(folder)) if tail.isdigit()
    ]
    generation = folder / f"{_GENERATION}{max(numbers, default=0) + 1}"
    try:
        with naming(folder, within=generation):
            generation.mkdir()
            yield generation
    except BaseException:
        shutil.rmtree(generation, ignore_errors=True)
        raise


def generations(folder: Path) -> Iterable[Path]:
    """All generations that lie in a library, in use or not."""
    return sorted(folder.glob(f"{_GENERATION}*"))


def remove_other_generations(folder: Path, kept: str) -> None:
    """Removes what killed writers have left and what no header names any more. Files open elsewhere live on."""
    for path in generations(folder):
        if path.name != kept:
            shutil.rmtree(path, ignore_errors=True)
    for part in folder.glob(".part-*"):
        part.unlink(missing_ok=True)
