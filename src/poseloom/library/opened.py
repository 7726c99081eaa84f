"""Files of a library in use: read into memory, and watched for being cut off.

A file that is mapped into memory ends the process with a bus error if another program cuts it off, at the first touch
of what is no longer there; no check before the touch can be soon enough. So arrays are read into memory, and the file
is kept open, to say so when its size falls: what was read then belongs to nothing on the disk any more.
"""

import os
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from poseloom.errors import LibraryError
from poseloom.formats._files import DAMAGE, open_regular
from poseloom.formats._npy import read_npy


class OpenArray:
    """An array of a library's `.npy` file.

    Args:
        path: The file.
        remedy: What to do where it is damaged.

    Raises:
        LibraryError: where it cannot be read, or holds no array of numbers.
    """

    def __init__(self, path: Path, remedy: str) -> None:
        self._path, self._remedy = path, remedy
        self._stream = open_regular(path, LibraryError)
        self._size = os.fstat(self._stream.fileno()).st_size
        try:
            self.values: NDArray[Any] = read_npy(self._stream, self._size, path.name)
        except DAMAGE as error:
            self._stream.close()
            raise LibraryError(
                "this file of the library cannot be read", cause=str(error)[:160], remedy=remedy, file=path
            ) from None

    def __del__(self) -> None:
        if hasattr(self, "_stream"):
            self._stream.close()

    def check(self) -> None:
        """Raises LibraryError where the file is shorter than when it was opened."""
        if os.fstat(self._stream.fileno()).st_size < self._size:
            raise LibraryError(
                "this file of the library was cut off while it was open",
                cause="another program wrote to it, or the disk failed",
                remedy=self._remedy,
                file=self._path,
            )
