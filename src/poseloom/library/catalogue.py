"""The library's list of clips, and of what it could not take in, kept in one sqlite file."""

import enum
import errno
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from poseloom.errors import FormatError, LibraryError
from poseloom.formats._files import DAMAGE, open_regular
from poseloom.formats.artefact_arrays import RATES, checked_number

CATALOGUE_FILE = "catalogue.sqlite"

_LONGEST = 1 << 20
"""Bytes that a value of the catalogue may have."""

_SCHEMA = """
CREATE TABLE clips (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, take TEXT NOT NULL, subject TEXT NOT NULL, source TEXT NOT NULL,
    digest TEXT NOT NULL, start INTEGER NOT NULL, stop INTEGER NOT NULL, mirrored INTEGER NOT NULL,
    source_rate REAL NOT NULL, family TEXT NOT NULL, licence TEXT NOT NULL, tags TEXT NOT NULL,
    conventions TEXT NOT NULL
);
CREATE TABLE skipped (source TEXT NOT NULL, kind TEXT NOT NULL, reason TEXT NOT NULL);
"""
_CLIP_COLUMNS = "id, name, take, subject, source, digest, start, stop, mirrored, source_rate, family, licence, tags"
_LATER_COLUMNS = ("conventions",)
"""Columns that catalogues of earlier versions lack: empty there."""


@dataclass(frozen=True)
class Clip:
    """One continuous stretch of the library's poses.

    Attributes:
        id: Place among the library's clips, from 0.
        name: Unique name: the source without its suffix; mirror images end in `~mirror`.
        take: The recorded take it belongs to: name of the take's first clip. A mirror image, a copy in another format
            and clips that overlap in time share it.
        subject: Who moves, as far as names tell.
        source: The file, from the name of the folder that was given on, or `samples/...`.
        digest: SHA-256 of the file.
        start: First row of the poses.
        stop: Row after the last.
        mirrored: Whether it is the mirror image of what the file holds.
        source_rate: Frames a second in the file.
        family: To which family of skeletons the file's belongs, by the names of its joints.
        licence: Under what terms the source is, as far as stated beside it.
        tags: Words for what happens in it.
        conventions: How the file's unit, up axis and rest pose were understood; empty where nothing had to be.
    """

    id: int
    name: str
    take: str
    subject: str
    source: str
    digest: str
    start: int
    stop: int
    mirrored: bool
    source_rate: float
    family: str
    licence: str
    tags: tuple[str, ...]
    conventions: str = ""

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def rows(self) -> slice:
        """Its rows among the library's poses."""
        return slice(self.start, self.stop)


class SkipKind(enum.StrEnum):
    """Why a file, or a motion in it, is not in the library."""

    UNREADABLE = "unreadable"
    SHORT = "too short"
    KNOWN = "already held"
    COMPANION = "companion"


@dataclass(frozen=True)
class Skipped:
    """A file or motion that is not in the library.

    Attributes:
        source: The file, from the name of the folder that was given on.
        kind: What sort of trouble.
        reason: What was wrong, for a person.
    """

    source: str
    kind: SkipKind
    reason: str


def write_catalogue(path: Path, clips: Iterable[Clip], skipped: Iterable[Skipped]) -> None:
    """Writes a new catalogue; the same entries give the same bytes. Raises OSError where it cannot be written."""
    try:
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.executescript(_SCHEMA)
            connection.executemany(
                f"INSERT INTO clips ({', '.join((_CLIP_COLUMNS, *_LATER_COLUMNS))}) "
                f"VALUES ({', '.join('?' * len(fields(Clip)))})",
                (_row(clip) for clip in clips),
            )
            connection.executemany(
                "INSERT INTO skipped (source, kind, reason) VALUES (?, ?, ?)",
                ((s.source, s.kind.value, s.reason) for s in skipped),
            )
    except sqlite3.OperationalError as error:  # a full disk, above all
        raise OSError(errno.EIO, str(error), str(path)) from None


def _row(clip: Clip) -> tuple[Any, ...]:
    *values, _, conventions = astuple(clip)
    return (*values, " ".join(clip.tags), conventions)


def _clip(row: tuple[Any, ...]) -> Clip:
    """A row of the table, each column of its type: sqlite keeps anything anywhere."""
    id, name, take, subject, source, digest, start, stop, mirrored, rate, family, licence, tags, told = row
    words, numbers = (name, take, subject, source, digest, family, licence, tags, told), (id, start, stop, mirrored)
    if not all(isinstance(word, str) for word in words) or not all(isinstance(number, int) for number in numbers):
        raise ValueError(f"clip {str(id)[:20]} has an entry of another type")
    if not 0 <= start < stop or mirrored not in (0, 1):
        raise ValueError(f"clip {id} has rows from {start} to {stop}")
    rate = checked_number(f"the rate of clip {id}", rate, *RATES)
    return Clip(
        id,
        name,
        take,
        subject,
        source,
        digest,
        start,
        stop,
        bool(mirrored),
        rate,
        family,
        licence,
        tuple(tags.split()),
        told,
    )


def _skip(row: tuple[Any, ...]) -> Skipped:
    if not all(isinstance(word, str) for word in row):
        raise ValueError("a skipped file has an entry of another type")
    source, kind, reason = row
    return Skipped(source, SkipKind(kind), reason)


def _columns(connection: sqlite3.Connection) -> str:
    """The columns of a clip, with nothing for those that this catalogue lacks."""
    present = {row[1] for row in connection.execute("PRAGMA table_info(clips)")}
    return ", ".join((_CLIP_COLUMNS, *(column if column in present else "''" for column in _LATER_COLUMNS)))


def read_catalogue(path: Path) -> tuple[tuple[Clip, ...], tuple[Skipped, ...]]:
    """Clips in the order of their rows, and what was skipped.

    Raises:
        LibraryError: if the file is no catalogue.
    """
    open_regular(path, LibraryError).close()
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as connection:
            # What the file itself brings along, such as views and triggers, runs nothing, and no value is huge.
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST)
            tables = dict(connection.execute("SELECT name, type FROM sqlite_schema WHERE name IN ('clips', 'skipped')"))
            if tables != {"clips": "table", "skipped": "table"}:
                raise ValueError("it has no tables of clips and skipped files")
            columns = _columns(connection)
            clips = tuple(_clip(row) for row in connection.execute(f"SELECT {columns} FROM clips ORDER BY id"))
            rows = connection.execute("SELECT source, kind, reason FROM skipped ORDER BY rowid")
            skipped = tuple(_skip(row) for row in rows)
    except (sqlite3.Error, FormatError, *DAMAGE) as error:
        raise LibraryError(
            "the library's catalogue cannot be read",
            cause=str(error)[:160],
            remedy="Build the library again",
            file=path,
        ) from None
    return clips, skipped
