"""Files that appear whole or not at all."""

import secrets
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from poseloom.errors import PoseloomError


def check_folder(target: Path, kind: type[PoseloomError] = PoseloomError) -> None:
    """Raises `kind` unless the folder that a file is to be written to is there: asked before long work, not after."""
    if not target.resolve().parent.is_dir():
        raise kind("the output's folder does not exist", remedy="Make it first", file=target)


@contextmanager
def atomic_file(target: str | Path) -> Generator[Path, None, None]:
    """A temporary path beside the target, to write to; its file takes the target's place when the block ends well.

    If the block raises, what it wrote is removed and the target stays as it was. The temporary name is hidden and keeps
    the target's suffix, by which writers choose their format.

    Raises:
        OSError: if the folder does not exist or cannot be written to.
    """
    path = Path(target)
    part = path.with_name(f".part-{secrets.token_hex(6)}-{path.name}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
