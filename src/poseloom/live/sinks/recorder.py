"""A session on its way to disk: raw samples, what the method was told, and what it made of them."""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from poseloom.errors import PoseloomError
from poseloom.formats.recording_header import RecordingHeader
from poseloom.formats.session_recording import HEALTH_STATES, MethodStart, RecordedFinding, SessionWriter, Step
from poseloom.live.contract import Finding, Level
from poseloom.live.sinks.outlet import Tell
from poseloom.methods.contract import Frame
from poseloom.sensors import Sample

_FLUSH_EVERY = 0.5
"""Seconds between flushes: a kill loses at most these, and what is on its way."""
_MOST_WAITING = 20000
"""Samples, steps and findings that may wait for a slow disk: about two minutes at 60 Hz."""


class Recorder:
    """Writes one recording from its own thread. Calls come from any thread, and never wait for the disk.

    Args:
        path: The new file.
        header: The sensors, the wearer and the settings.
        first: Number of the first sample that it keeps.
        tell: Where trouble with the disk is told.

    Attributes:
        samples: How many were written.
        dropped: Samples, steps and findings that were not, because the disk was too slow.
        failure: Why the recording has stopped; empty while it has not.

    Raises:
        SensorError, FormatError, OSError: if the file cannot be begun.
    """

    def __init__(self, path: Path, header: RecordingHeader, first: int, tell: Tell) -> None:
        self.path, self.first = path, first
        self.samples = 0
        self.dropped = 0
        self.failure = ""
        self._names = header.layout.names
        self._tell = tell
        self._writer = SessionWriter(path, header)
        self._writer.__enter__()
        self._waiting: deque[Callable[[], None] | None] = deque()
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=f"recorder {path.name}", daemon=True)
        self._thread.start()

    @property
    def failed(self) -> bool:
        """Whether the recording has stopped."""
        return bool(self.failure)

    @property
    def waiting(self) -> int:
        """How much has still to be written."""
        return len(self._waiting)

    def sample(self, number: int, sample: Sample) -> None:
        """Keeps a raw sample; they come in order."""
        if number >= self.first:
            self._put(lambda: self._write_sample(sample))

    def step(self, number: int, sample: Sample, frame: Frame | None, finished: float) -> None:
        """Keeps what the method made of a sample."""
        if number < self.first:
            return
        step = Step(number - self.first, finished)
        if frame is not None:
            step = Step(
                number - self.first,
                finished,
                frame.time,
                frame.pose.q,
                frame.spread,
                HEALTH_STATES.index(frame.health.state.value),
                tuple(name in frame.health.sensors for name in self._names),
            )
        self._put(lambda: self._writer.write_step(step, sample.time))

    def start(self, number: int, start: MethodStart, at: float) -> None:
        """Keeps that a method begins anew before a sample."""
        told = MethodStart(max(number - self.first, 0), start.method, start.heading, start.x, start.z)
        self._put(lambda: self._writer.write_start(told, at))

    def finding(self, number: int, finding: Finding, at: float, over: bool) -> None:
        """Keeps that a trouble began or ended."""
        told = RecordedFinding(
            max(number - self.first, 0), at, finding.sensor, finding.trouble.value, finding.text, over
        )
        self._put(lambda: self._writer.write_finding(told))

    def stop(self) -> None:
        """Finishes the file, after all that waits has been written."""
        with self._change:
            self._waiting.append(None)
            self._change.notify()
        self._thread.join()

    def _put(self, write: Callable[[], None]) -> None:
        if self.failed:
            return
        with self._change:
            if len(self._waiting) >= _MOST_WAITING:
                self.dropped += 1
                if self.dropped == 1:
                    self._tell(Level.ERROR, f"the disk is too slow for the recording {self.path}: parts are missing")
                return
            self._waiting.append(write)
            self._change.notify()

    def _write_sample(self, sample: Sample) -> None:
        self._writer.write_sample(sample)
        self.samples += 1

    def _run(self) -> None:
        try:
            self._write_all()
            self._writer.__exit__(None, None, None)
        except OSError as error:
            self._give_up(error.strerror or str(error))
        except PoseloomError as error:
            self._give_up(str(error))
        # Whatever it is, the file is not whole, and nobody else would say so.
        except Exception as error:
            self._give_up(f"{type(error).__name__}: {error}")

    def _write_all(self) -> None:
        flushed = time.monotonic()
        while True:
            with self._change:
                if not self._waiting:
                    self._change.wait(_FLUSH_EVERY)
                writes = list(self._waiting)
                self._waiting.clear()
            for write in writes:
                if write is None:
                    return
                write()
            if time.monotonic() - flushed >= _FLUSH_EVERY:
                self._writer.flush()
                flushed = time.monotonic()

    def _give_up(self, reason: str) -> None:
        self.failure = reason or "unknown reason"
        with contextlib.suppress(Exception):  # finishing needs the disk, too; what was flushed stays readable
            self._writer.__exit__(None, None, None)
        self._tell(
            Level.ERROR,
            f"THE RECORDING HAS STOPPED: {self.path} cannot be written ({reason}). The session goes on unrecorded. "
            f"Make room on the disk and begin a new recording; what was written before can be read",
        )
