"""A motion as a table of plain numbers, for spreadsheets and other programs."""

import csv
import io
from io import BufferedIOBase
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.formats._files import write_bytes
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton


def write_pose_table(motion: Motion, path: str | Path) -> None:
    """Writes a CSV file, whole or not at all: one line a frame below one line of names.

    Columns: `time` in seconds; for each joint its place in the world `NAME.x`, `.y`, `.z` in metres, and its rotation
    vector relative to its parent `NAME.rx`, `.ry`, `.rz` in radians (the root's relative to the world).

    Raises:
        FormatError: where the file cannot be written.
    """
    text = io.BytesIO()
    PoseTableStream(text, motion.skeleton, motion.rate).add(motion.q)
    write_bytes(Path(path), text.getvalue())


class PoseTableStream:
    """The same table, written frame by frame.

    Args:
        file: Where to.
        skeleton: The bones.
        rate: Frames a second.

    Raises:
        OSError: also from the method, where the file cannot be written.
    """

    def __init__(self, file: BufferedIOBase, skeleton: Skeleton, rate: float) -> None:
        self._file, self._skeleton, self._rate = file, skeleton, rate
        self._count = 0
        self._write([["time", *(f"{j}.{a}" for j in skeleton.names for a in ("x", "y", "z", "rx", "ry", "rz"))]])

    def add(self, q: Floats[Array, "frames dofs"]) -> None:
        """Appends frames by their pose vectors."""
        motion = make_motion(self._skeleton, q, self._rate)
        cells = np.concatenate([motion_frames(motion).positions, motion.rotvecs], axis=-1).reshape(len(motion), -1)
        rows = enumerate(cells.tolist(), start=self._count)
        self._write([[f"{n / self._rate:.6f}", *(f"{value:.6f}" for value in row)] for n, row in rows])
        self._count += len(motion)

    def finish(self) -> None:
        """Nothing is left to do: a table's length stands nowhere in it."""

    def _write(self, rows: list[list[str]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        self._file.write(text.getvalue().encode())
