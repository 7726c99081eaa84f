"""The poses on disk: one `.npy` of 32-bit pose vectors, written row by row and mapped into memory."""

import hashlib
from functools import cache
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from poseloom.arrays import Array, Floats32
from poseloom.errors import LibraryError
from poseloom.skeleton.body import average_body

POSES_FILE = "poses.npy"
_ROWS_AT_ONCE = 1 << 16


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
        self._write_header()
        self._file.close()

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


def map_poses(path: Path) -> Floats32[Array, "rows dofs"]:
    """The poses, mapped into memory and read only.

    Raises:
        LibraryError: if the file is not one of pose vectors of the body.
    """
    try:
        poses = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise LibraryError(
            "the poses cannot be read", cause=str(error), remedy="Build the library again", file=path
        ) from None
    if poses.ndim != 2 or poses.shape[1] != average_body().size or poses.dtype != np.dtype("<f4"):
        raise LibraryError(
            f"the poses have shape {poses.shape} of {poses.dtype}",
            cause=f"the body has {average_body().size} entries of 32 bits",
            remedy="Build the library again",
            file=path,
        )
    return poses


@cache
def body_digest() -> str:
    """Digest of the average body's bones: poses of one body mean nothing on another."""
    body = average_body()
    digest = hashlib.sha256(",".join(body.names).encode())
    digest.update(body.parents.tobytes() + body.offsets.tobytes())
    return digest.hexdigest()
