"""The whole session as one motion file, written as it goes on."""

import contextlib
import os
import secrets
from io import BufferedIOBase
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats import write_motion
from poseloom.formats._bvh_writing import BvhStream
from poseloom.formats.atomic import check_folder
from poseloom.formats.pose_table import PoseTableStream, write_pose_table
from poseloom.live.contract import Post, SessionFacts, Update
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import EvenPoses
from poseloom.skeleton.skeleton import Skeleton

EXPORT_SUFFIXES = (".bvh", ".glb", ".npz", ".csv")
"""What a session can be exported as."""

_WRITE_EVERY = 1.0
"""Seconds of poses that are written at once."""


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


class PoseFile(Protocol):
    """A file that poses are written to one after the other."""

    def add(self, q: Floats[Array, "frames dofs"]) -> None:
        """Appends poses at the file's rate."""
        ...

    def finish(self) -> None:
        """Completes what was written."""
        ...


class _Spool:
    """Poses of a format that can only be written whole: kept beside the file that they become.

    Args:
        file: Where they are kept.
        skeleton: The bones.
        rate: Poses a second.
    """

    def __init__(self, file: BufferedIOBase, skeleton: Skeleton, rate: float) -> None:
        self._file, self._skeleton, self._rate = file, skeleton, rate

    def add(self, q: Floats[Array, "frames dofs"]) -> None:
        """See `PoseFile`."""
        self._file.write(q.tobytes())

    def finish(self) -> None:
        """See `PoseFile`."""

    def write(self, path: Path) -> None:
        """Writes them as the motion that they are. Raises FormatError."""
        self._file.seek(0)
        rows = np.frombuffer(self._file.read(), dtype=np.float64).reshape(-1, self._skeleton.size)
        export_motion(make_motion(self._skeleton, rows, self._rate, path.stem), path)


class MotionExport:
    """Writes the whole session as one motion file while it goes on; the file takes its name when the session ends.

    BVH and CSV are written frame by frame; of NPZ and GLB the poses are kept beside the file and written at the end. So
    a disk that is full shows as soon as it is, not at the end. What was written before then stays, under the file's
    name with `-incomplete` behind it, where the format allows.

    After a calibration the wearer's bones are others; the motion then begins anew, and what came before goes to a file
    of its own, with a number before its suffix.

    Args:
        path: The file to write, `.bvh`, `.glb`, `.npz` or `.csv`; replaced if it exists, once the new one is whole.

    Attributes:
        keeps: That it makes a file that must not be lost in silence.
        written: Files that are whole.

    Raises:
        FormatError: for another suffix, or a folder that is not there.
    """

    capacity = 600
    keeps = True

    def __init__(self, path: Path) -> None:
        check_export(path)
        self.path = path
        self.name = f"export to {path.name}"
        self.written: list[Path] = []
        self._discarded = False

    def open(self, facts: SessionFacts, post: Post) -> None:
        """See `Sink`. Raises FormatError where nothing can be written there."""
        self._facts = facts
        try:
            self._begin()
        except OSError as error:
            raise unwritable(self.path, error) from None

    def changed(self, facts: SessionFacts) -> None:
        """See `Sink`."""
        other = facts.skeleton is not self._facts.skeleton
        if other and self._count:
            self._finish(self.path.with_stem(f"{self.path.stem}-{len(self.written) + 1}"))
            self._facts = facts
            self._begin()
        self._facts = facts

    def show(self, update: Update) -> None:
        """See `Sink`."""
        frame = update.frame
        if frame is None or frame.time <= self._last:
            return
        self._last = frame.time
        self._waiting.append((frame.time, frame.pose.q))
        if len(self._waiting) >= self._facts.layout.rate * _WRITE_EVERY:
            self._write()

    def close(self) -> None:
        """See `Sink`."""
        if self._discarded or self._failed or not (self._count or self._waiting):
            self._drop()
        else:
            self._finish(self.path)

    def discard(self) -> None:
        """Leaves no file when it is closed: the session has not begun."""
        self._discarded = True

    def _begin(self) -> None:
        self._count, self._last, self._failed = 0, -np.inf, False
        self._waiting: list[tuple[float, NDArray[np.float64]]] = []
        skeleton, rate = self._facts.skeleton, self._facts.layout.rate
        self._even = EvenPoses(rate)
        # Hidden and beside the file, as `atomic_file` has it: the file that is there now stays until this one is whole.
        self._part = self.path.with_name(f".part-{secrets.token_hex(6)}-{self.path.name}")
        self._file = self._part.open("w+b")
        kind = self.path.suffix.lower()
        try:
            self._poses: PoseFile = (
                BvhStream(self._file, skeleton, rate, self.path)
                if kind == ".bvh"
                else PoseTableStream(self._file, skeleton, rate)
                if kind == ".csv"
                else _Spool(self._file, skeleton, rate)
            )
        except BaseException:
            self._drop()
            raise

    def _write(self) -> None:
        """Appends what waits. Raises FormatError where the file cannot be written."""
        times, q = np.array([time for time, _ in self._waiting]), np.stack([q for _, q in self._waiting])
        self._waiting = []
        rows = self._even.add(times, q)
        if not len(rows):
            return
        self._file.seek(0, os.SEEK_END)
        whole = self._file.tell()
        try:
            self._poses.add(rows)
            self._file.flush()
        except OSError as error:
            raise self._failure(error, whole) from None
        self._count += len(rows)

    def _finish(self, path: Path) -> None:
        try:
            if self._waiting:
                self._write()
            if isinstance(self._poses, _Spool):
                self._poses.write(path)
            else:
                self._poses.finish()
                self._file.close()
                self._part.replace(path)
        except OSError as error:
            raise self._failure(error, None) from None
        except PoseloomError:
            self._failed = True
            raise
        finally:
            self._drop()
        self.written.append(path)

    def _failure(self, error: OSError, whole: int | None) -> FormatError:
        """What to raise for a file that cannot be written; keeps what is whole of it, so many bytes, where it can."""
        self._failed = True
        kept = None
        if whole is not None and self._count and not isinstance(self._poses, _Spool):
            with contextlib.suppress(OSError):
                # What could not be flushed must not be tried again by `close`; the file is cut where it was whole.
                with contextlib.suppress(OSError):
                    self._file.close()
                kept = self._keep(whole)
        self._drop()
        told = unwritable(self.path, error)
        return told if kept is None else FormatError(f"{told}. The first {self._count} frames are in {kept}")

    def _keep(self, whole: int) -> Path:
        with self._part.open("r+b") as file:
            file.truncate(whole)
            if isinstance(self._poses, BvhStream):
                self._poses.set_count(file, self._count)
        kept = self.path.with_stem(f"{self.path.stem}-incomplete")
        self._part.replace(kept)
        return kept

    def _drop(self) -> None:
        with contextlib.suppress(OSError):
            self._file.close()
        with contextlib.suppress(OSError):
            self._part.unlink(missing_ok=True)


def unwritable(path: Path, error: OSError) -> FormatError:
    """The error for a file that cannot be written."""
    return FormatError(
        "the file cannot be written",
        cause=error.strerror or str(error),
        remedy="Make room on the disk, or name a file in a folder that you may write to",
        file=path,
    )
