"""Files that appear whole or not at all."""

import errno
import secrets
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

from poseloom.errors import PoseloomError

_TRIES = 20
_PAUSE = 0.05
"""Tries, and seconds between them, to move what another program has open: one second in all."""


def check_folder(target: Path, kind: type[PoseloomError] = PoseloomError) -> None:
    """Raises `kind` unless the folder that a file is to be written to is there: asked before long work, not after."""
    if not target.resolve().parent.is_dir():
        raise kind("the output's folder does not exist", remedy="Make it first", file=target)


@contextmanager
def naming(target: str | Path, within: Path | None = None) -> Generator[None, None, None]:
    """Names the target in every OSError of the block that names no file, as that of a full disk, or a hidden one.

    Args:
        target: What the user knows of.
        within: A folder that the user does not, such as one that will be renamed to the target: the target is named
            for all that lies in it, in errors of ours too.
    """
    try:
        yield
    except PoseloomError as error:
        if within is None or error.file is None or not Path(error.file).is_relative_to(within):
            raise
        raise error.at(target) from None
    except OSError as error:
        named = error.filename
        if error.errno is None:  # numpy's, where not all of an array could be written
            raise OSError(errno.ENOSPC, f"not all could be written ({error})", str(target)) from None
        hidden = named is None or Path(str(named)).name.startswith(".")
        if hidden or (within is not None and Path(str(named)).is_relative_to(within)):
            error.filename, error.filename2 = str(target), None
        raise


def patiently(move: Callable[[], object]) -> None:
    """Moves a file or folder; on Windows tries again for a second while another program has it open.

    There a file that is open can be neither replaced nor moved, and virus scanners and indexers open whatever is new.

    Raises:
        OSError: what the last try raised.
    """
    for left in reversed(range(_TRIES if sys.platform == "win32" else 1)):
        try:
            move()
            return
        except PermissionError:
            if left == 0:
                raise
            time.sleep(_PAUSE)


@contextmanager
def atomic_file(target: str | Path) -> Generator[Path, None, None]:
    """A temporary path beside the target, to write to; its file takes the target's place when the block ends well.

    If the block raises, what it wrote is removed and the target stays as it was. The temporary name is hidden and keeps
    the target's suffix, by which writers choose their format.

    Raises:
        OSError: naming the target, if the folder does not exist or cannot be written to, or the disk is full.
    """
    path = Path(target)
    part = path.with_name(f".part-{secrets.token_hex(6)}-{path.name}")
    try:
        with naming(path):
            yield part
            patiently(lambda: part.replace(path))
    finally:
        part.unlink(missing_ok=True)
