"""The whole session as one motion file, written when it ends."""

import tempfile
from pathlib import Path

import numpy as np

from poseloom.errors import FormatError
from poseloom.formats import write_motion
from poseloom.formats.atomic import check_folder
from poseloom.formats.pose_table import write_pose_table
from poseloom.live.contract import Post, SessionFacts, Update
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import even_motion

EXPORT_SUFFIXES = (".bvh", ".glb", ".npz", ".csv")
"""What a session can be exported as."""


def check_export(path: Path) -> None:
    """Raises FormatError if a motion cannot be written there."""
    if path.suffix.lower() not in EXPORT_SUFFIXES:
        raise FormatError(
            f"no motion can be exported as {path.suffix or 'a file without suffix'}",
            remedy=f"Choose one of {', '.join(EXPORT_SUFFIXES)}",
            file=path,
        )
    check_folder(path, FormatError)


def export_motion(motion: Motion, path: Path) -> None:
    """Writes a motion as the file's suffix says. Raises FormatError."""
    if path.suffix.lower() == ".csv":
        write_pose_table(motion, path)
    else:
        write_motion(motion, path)


class MotionExport:
    """Keeps all poses in a temporary file, and writes them as a motion at the end.

    After a calibration the wearer's bones are others; the motion then begins anew, and what came before goes to a file
    of its own, with a number before its suffix.

    Args:
        path: The file to write, `.bvh`, `.glb`, `.npz` or `.csv`; replaced if it exists.

    Raises:
        FormatError: for another suffix, or a folder that is not there.
    """

    capacity = 600

    def __init__(self, path: Path) -> None:
        check_export(path)
        self.path = path
        self.name = f"export to {path.name}"
        self.written: list[Path] = []

    def open(self, facts: SessionFacts, post: Post) -> None:
        """See `Sink`."""
        self._facts = facts
        self._begin()

    def changed(self, facts: SessionFacts) -> None:
        """See `Sink`."""
        other = facts.skeleton is not self._facts.skeleton
        if other and self._count:
            self._finish(self.path.with_stem(f"{self.path.stem}-{len(self.written) + 1}"))
            self._begin()
        self._facts = facts

    def show(self, update: Update) -> None:
        """See `Sink`."""
        frame = update.frame
        if frame is None or frame.time <= self._last:
            return
        self._spool.write(np.concatenate([[frame.time], frame.pose.q]).tobytes())
        self._last = frame.time
        self._count += 1

    def close(self) -> None:
        """See `Sink`."""
        if self._count:
            self._finish(self.path)
        else:
            self._spool.close()

    def _begin(self) -> None:
        self._spool = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the motion is written
        self._count, self._last = 0, -np.inf

    def _finish(self, path: Path) -> None:
        skeleton = self._facts.skeleton
        with self._spool:
            self._spool.seek(0)
            rows = np.frombuffer(self._spool.read(), dtype=np.float64).reshape(self._count, 1 + skeleton.size)
        rate = self._facts.layout.rate
        export_motion(even_motion(skeleton, rows[:, 0].copy(), rows[:, 1:].copy(), rate, path.stem), path)
        self.written.append(path)
