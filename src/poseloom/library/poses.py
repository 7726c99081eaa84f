"""The poses on disk: one `.npy` of 32-bit pose vectors, written row by row."""

import hashlib
from functools import cache
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from poseloom.arrays import Array, Floats32
from poseloom.errors import LibraryError
from poseloom.library.opened import OpenArray
from poseloom.skeleton.body import average_body

POSES_FILE = "poses.npy"
_ROWS_AT_ONCE = 1 << 16
_LARGEST = 1e6
"""Metres or radians."""
_REMEDY = "Build the library again, or take it from a backup"


class PoseWriter:
    """Writes rows one after another to a `.npy` whose length is not known before the end."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._header_bytes = 0
        self.rows = 0
        self._write_header()

    def __enter__(self) -> "PoseWriter":
        return self

    def __exit__(self, *_: object) -> None:
        with self._file:
            self._write_header()

    def write(self, poses: Floats32[Array, "frames dofs"]) -> None:
        """Appends rows."""
        for start in range(0, len(poses), _ROWS_AT_ONCE):
            self._file.write(np.ascontiguousarray(poses[start : start + _ROWS_AT_ONCE], dtype="<f4").tobytes())
        self.rows += len(poses)

    def _write_header(self) -> None:
        # numpy leaves room in the header for the first axis to grow, so it keeps its length.
        self._file.seek(0)
        shape = (self.rows, average_body().size)
        npy.write_array_header_1_0(self._file, {"descr": "<f4", "fortran_order": False, "shape": shape})
        if self._header_bytes not in (0, self._file.tell()):
            raise LibraryError("the header of the poses has outgrown its room", file=self._file.name)
        self._header_bytes = self._file.tell()


def open_poses(path: Path) -> OpenArray:
    """The poses, read into memory.

    Raises:
        LibraryError: if the file is not one of finite pose vectors of the body.
    """
    opened = OpenArray(path, _REMEDY)
    poses = opened.values
    if poses.ndim != 2 or poses.shape[1] != average_body().size or poses.dtype != np.dtype("<f4"):
        raise LibraryError(
            f"the poses have shape {poses.shape} of {poses.dtype}",
            cause=f"the body has {average_body().size} entries of 32 bits",
            remedy=_REMEDY,
            file=path,
        )
    for start in range(0, len(poses), _ROWS_AT_ONCE):
        if not np.abs(poses[start : start + _ROWS_AT_ONCE]).max() <= _LARGEST:  # a NaN is not either
            raise LibraryError("a pose is no number, or is out of this world", remedy=_REMEDY, file=path)
    return opened


@cache
def body_digest() -> str:
    """Digest of the average body's bones: poses of one body mean nothing on another."""
    body = average_body()
    digest = hashlib.sha256(",".join(body.names).encode())
    digest.update(body.parents.tobytes() + body.offsets.tobytes())
    return digest.hexdigest()
