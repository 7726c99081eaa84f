"""Whole files in and out, with errors a person can act on: the one place where readers open what strangers send.

Only regular files are opened: a named pipe waits for ever, and a device may do anything. `reading` is the last line of
defence of every reader: whatever damage makes a library raise ends as a `FormatError` with the file's name.
"""

import csv
import json
import lzma
import os
import re
import stat
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast

from poseloom.errors import FormatError, PoseloomError
from poseloom.formats.atomic import atomic_file

LARGEST = 1 << 30
"""Bytes that a file read whole may have. Ten hours of full-body motion at 60 Hz are less."""

_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
"""Byte order marks and what they stand for."""
_LOOKED_AT = 4096
_LINE_END = re.compile(r"\r*\n|\r")


DAMAGE = (
    ArithmeticError,
    AttributeError,
    BufferError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    csv.Error,
    lzma.LZMAError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What libraries raise on bytes that are not what they should be. RecursionError is a RuntimeError."""

_OPENING = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_SPECIAL = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def open_regular(path: str | Path, kind: type[PoseloomError] = FormatError) -> BinaryIO:
    """A regular file, opened to be read; links to one are followed.

    Raises:
        FormatError: or `kind`, where there is no such file, it may not be read, or it is a folder, named pipe, socket
            or device: those are never waited for.
    """
    try:
        _check_regular(os.stat(path).st_mode, path, kind)  # before opening: that alone may rewind a tape
        handle = os.open(path, _OPENING)
    except (OSError, ValueError) as error:
        raise _unreadable(error, path, kind) from None
    try:
        _check_regular(os.fstat(handle).st_mode, path, kind)  # it may have been exchanged in between
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def read_bytes(path: str | Path, kind: type[PoseloomError] = FormatError, largest: int = LARGEST) -> bytes:
    """The content of a regular file.

    Raises:
        FormatError: or `kind`, as `open_regular`, and where it holds nothing or more than `largest` bytes.
    """
    with open_regular(path, kind) as stream:
        try:
            size = os.fstat(stream.fileno()).st_size
            content = stream.read(size) if size <= largest else b""  # room is taken for all that is asked
        except (OSError, MemoryError) as error:
            raise _unreadable(error, path, kind) from None
    if size > largest:
        raise kind(
            f"the file has {size / 1e6:,.0f} MB, more than the {largest / 1e6:,.0f} MB it may have",
            cause="it is no file of this kind, or holds many takes",
            remedy="Split it",
            file=path,
        )
    if not content or content.isspace():
        raise kind("the file is empty", cause="its copy or download did not finish", remedy="Get it again", file=path)
    return content


def beginning(path: str | Path, count: int) -> bytes:
    """The first bytes of a regular file; nothing where it cannot be read. Never raises."""
    try:
        with open_regular(path) as stream:
            return stream.read(count)
    except (PoseloomError, OSError):
        return b""


def read_json(path: str | Path, what: str, kind: type[PoseloomError] = FormatError) -> Any:
    """The content of a JSON file.

    Args:
        path: The file.
        what: What it should be, for the error: "a body-size model".
        kind: Of the error.

    Raises:
        FormatError: or `kind`, as `read_bytes`, and for what is no JSON.
    """
    content = read_bytes(path, kind)
    try:
        return json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        line = error.lineno if isinstance(error, json.JSONDecodeError) else None
        raise kind(
            f"this cannot be read as {what}",
            cause=f"it is no whole JSON: {str(error)[:160]}",
            remedy="Get the file again, or name another",
            file=path,
            line=line,
        ) from None


def decode(content: bytes) -> str:
    """Text of a file of unknown origin.

    A byte order mark decides; UTF-16 without one is recognised by its zero bytes (a Windows shell writes it). Then
    UTF-8, else Latin-1, in which any byte is a letter. Never raises.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, errors="replace")
    wide = _wide_encoding(content[:_LOOKED_AT])
    if wide:
        return content.decode(wide, errors="replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


@contextmanager
def reading(path: str | Path, what: str = "", kind: type[PoseloomError] = FormatError) -> Generator[None, None, None]:
    """Around the reading of a file: every error that damage causes becomes one of ours, and each names the file.

    Args:
        path: The file.
        what: What it should be, for the error: "an MVNX file".
        kind: Of the error.

    Raises:
        PoseloomError: what the block raised, with the file filled in where it was missing.
        FormatError: or `kind`, for any of `DAMAGE`.
    """
    try:
        yield
    except PoseloomError as error:
        raise error if error.file else error.at(path) from None
    except DAMAGE as error:
        missing = isinstance(error, MemoryError)
        raise kind(
            f"the file cannot be read{f' as {what}' if what else ''}",
            cause="it asks for more memory than there is"
            if missing
            else f"it is damaged, cut off or of another kind ({type(error).__name__}: {str(error)[:160]})",
            remedy="Get or export the file again, or name another",
            file=path,
        ) from error


def split_lines(text: str) -> list[str]:
    """Lines of a text, parted by Windows, Unix or old Macintosh line ends, and by nothing else; empty ones stay.

    `str.splitlines` would also part at form feeds and at letters that Latin-1 has at the places of line ends.
    """
    lines = _LINE_END.split(text)
    return lines[:-1] if lines[-1] == "" else lines


def _wide_encoding(head: bytes) -> str:
    """UTF-16 of either byte order where every other byte is zero, as in digits and plain letters; else nothing."""
    pairs = len(head) // 2
    even, odd = head[0 : 2 * pairs : 2].count(0), head[1 : 2 * pairs : 2].count(0)
    if pairs >= 2 and odd > 0.7 * pairs and even <= 0.05 * pairs:
        return "utf-16-le"
    return "utf-16-be" if pairs >= 2 and even > 0.7 * pairs and odd <= 0.05 * pairs else ""


def write_bytes(path: str | Path, content: bytes) -> None:
    """Writes a file whole or not at all.

    Raises:
        FormatError: where the folder is missing, nothing can be written there, or the disk is full; the old file, if
            any, stands.
    """
    try:
        with atomic_file(path) as part:
            part.write_bytes(content)
    except OSError as error:
        raise FormatError(
            "the file cannot be written",
            cause=error.strerror or str(error),
            remedy="Name a file in an existing folder that you may write to, on a disk with room",
            file=path,
        ) from None


def _check_regular(mode: int, path: str | Path, kind: type[PoseloomError]) -> None:
    if stat.S_ISREG(mode):
        return
    if stat.S_ISDIR(mode):
        raise kind("this is a folder, not a file", remedy="Name one file in it", file=path)
    what = next((name for test, name in _SPECIAL if test(mode)), "no regular file")
    raise kind(f"this is {what}, not a file", remedy="Name a file on a disk", file=path)


def _unreadable(error: Exception, path: str | Path, kind: type[PoseloomError]) -> PoseloomError:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return kind("there is no such file", remedy="Check the path", file=path)
    reason = cast(str | None, getattr(error, "strerror", None)) or str(error) or type(error).__name__
    return kind("the file cannot be read", cause=reason, remedy="Check its path and permissions", file=path)
