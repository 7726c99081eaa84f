"""Files that appear whole or not at all."""

import os
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

_NEW_FILE_MODE = 0o666


@contextmanager
def atomic_file(target: str | Path) -> Generator[Path, None, None]:
    """A temporary file beside the target, to write into; it takes the target's place when the block ends well.

    If the block raises, the temporary file is removed and the target stays as it was.

    Raises:
        OSError: if the folder does not exist or cannot be written to.
    """
    path = Path(target)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    part = Path(name)
    try:
        yield part
        part.chmod(_NEW_FILE_MODE & ~_umask())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _umask() -> int:
    # mkstemp makes files that only their owner may read; the finished file gets the permissions of any new file. The mask
    # can be read only by setting it.
    mask = os.umask(0)
    os.umask(mask)
    return mask
