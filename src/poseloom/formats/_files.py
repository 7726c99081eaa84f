"""Whole files in and out, with errors a person can act on."""

from pathlib import Path

from poseloom.errors import FormatError
from poseloom.formats.atomic import atomic_file


def read_bytes(path: Path) -> bytes:
    """The content of a file.

    Raises:
        FormatError: where there is no such file, it is a folder, may not be read, or holds nothing.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise FormatError("there is no such file", remedy="Check the path", file=path) from None
    except IsADirectoryError:
        raise FormatError("this is a folder, not a file", remedy="Name one motion file in it", file=path) from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise FormatError("the file cannot be read", cause=reason, remedy="Check its permissions", file=path) from None
    if not content.strip():
        raise FormatError(
            "the file is empty", cause="its copy or download did not finish", remedy="Get it again", file=path
        )
    return content


def decode(content: bytes) -> str:
    """Text of a file of unknown age: UTF-8 with or without its mark, else Latin-1, in which any byte is a letter."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def write_bytes(path: Path, content: bytes) -> None:
    """Writes a file whole or not at all.

    Raises:
        FormatError: where the folder is missing or nothing can be written there; the old file, if any, stands.
    """
    try:
        with atomic_file(path) as part:
            part.write_bytes(content)
    except OSError as error:
        raise FormatError(
            "the file cannot be written",
            cause=error.strerror or str(error),
            remedy="Name a file in an existing folder that you may write to",
            file=path,
        ) from None
