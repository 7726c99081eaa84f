"""A session's recordings: one after the other, each with its own beginning."""

import threading
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path

from poseloom.formats.recording_header import RecordingHeader
from poseloom.formats.session_recording import MethodStart
from poseloom.live.contract import Finding, Level, SessionFacts
from poseloom.live.sinks.outlet import Tell
from poseloom.live.sinks.recorder import Recorder
from poseloom.live.worker import Worked
from poseloom.methods.fold import Engine
from poseloom.sensors import Sample

_LOOK_EVERY = 0.2
"""Seconds between looks at recordings that are ending."""


class RecordingDesk:
    """Begins and ends recordings, and passes on to the present one, if there is one.

    Args:
        folder: Where files go for which only a kind is asked for.
        settings: What every recording says of how the session was set up.
        tell: Where trouble is told.

    Attributes:
        paths: Files that are whole, once their recording has ended.
        failures: What was to be recorded and was not, in words.
    """

    def __init__(self, folder: Path, settings: Mapping[str, str], tell: Tell) -> None:
        self.paths: list[Path] = []
        self.failures: list[str] = []
        self._folder, self._settings, self._tell = folder, settings, tell
        self._recorder: Recorder | None = None
        self._closing: list[threading.Thread] = []
        self._ending: list[Recorder] = []

    @property
    def path(self) -> Path | None:
        """The file that is being written."""
        recorder = self._recorder
        return None if recorder is None or recorder.failed else recorder.path

    @property
    def waiting(self) -> int:
        """How much has still to be written to files that have ended."""
        return sum(recorder.waiting for recorder in self._ending)

    def begin(self, path: Path, facts: SessionFacts, engine: Engine, number: int) -> None:
        """Begins a recording at a sample's number; the present one ends.

        Raises:
            SensorError, FormatError, OSError: if the file cannot be begun.
        """
        self.end()
        header = RecordingHeader(
            facts.layout,
            facts.placements,
            facts.skeleton,
            path.stem,
            {
                "made by": "poseloom live",
                "method": engine.name,
                "sources": "; ".join(facts.sources),
                "begun": datetime.now().astimezone().isoformat(timespec="seconds"),
                **self._settings,
            },
        )
        recorder = Recorder(path, header, number, self._tell)
        recorder.start(number, method_start(engine), 0.0)
        self._recorder = recorder

    def continue_with(self, facts: SessionFacts, engine: Engine, number: int) -> None:
        """Begins the next file of a recording that goes on, because the wearer's body is another now."""
        recorder = self._recorder
        if recorder is not None:
            self.begin(_next_path(recorder.path), facts, engine, number)

    def end(self) -> None:
        """Ends the present recording; its file is finished in the background, however slow the disk is."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            thread = threading.Thread(target=self._finish, args=(recorder,), daemon=True)
            thread.start()
            self._closing.append(thread)
            self._ending.append(recorder)

    def wait(self, waited: Callable[[], None] | None = None) -> None:
        """Returns when all files are finished; `waited` is called a few times a second while that takes long."""
        for thread in self._closing:
            while thread.is_alive():
                thread.join(_LOOK_EVERY)
                if waited is not None:
                    waited()

    def discard(self) -> None:
        """Ends the present recording without a file: the session has not begun."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.stop()
            recorder.path.unlink(missing_ok=True)

    def sample(self, number: int, sample: Sample) -> None:
        """Passes on a raw sample."""
        recorder = self._recorder
        if recorder is not None:
            recorder.sample(number, sample)

    def step(self, worked: Worked) -> None:
        """Passes on what the method made of a sample."""
        recorder = self._recorder
        if recorder is not None:
            recorder.step(worked.number, worked.raw, worked.frame, worked.finished)

    def start(self, number: int, engine: Engine, at: float) -> None:
        """Passes on that the method begins anew."""
        recorder = self._recorder
        if recorder is not None:
            recorder.start(number, method_start(engine), at)

    def finding(self, number: int, finding: Finding, at: float, over: bool) -> None:
        """Passes on that a trouble began or ended."""
        recorder = self._recorder
        if recorder is not None:
            recorder.finding(number, finding, at, over)

    def file(self, stem: str, suffix: str) -> Path:
        """A name in the session's folder that is not taken, by the time of day."""
        return _free_path(self._folder / f"{stem}-{datetime.now():%Y%m%d-%H%M%S}{suffix}")

    def _finish(self, recorder: Recorder) -> None:
        recorder.stop()
        path, samples = recorder.path, recorder.samples
        if recorder.failed:
            self.failures.append(f"the recording {path} ends early, after {samples} samples: {recorder.failure}")
        elif recorder.dropped:
            self.failures.append(f"the recording {path} lacks {recorder.dropped} parts: the disk was too slow")
        elif samples == 0:
            path.unlink(missing_ok=True)
            self._tell(Level.WARNING, f"nothing came while {path} was open: there is no recording of it")
        else:
            self.paths.append(path)
            self._tell(Level.NOTE, f"recorded {samples} samples to {path}")


def method_start(engine: Engine) -> MethodStart:
    """What a recording says of an engine's beginning."""
    turned = engine.alignment
    return MethodStart(0, engine.name, turned.heading, turned.x, turned.z)


def _next_path(path: Path) -> Path:
    """The same name with the next number behind it."""
    stem, _, number = path.stem.rpartition("-")
    if not (stem and number.isdigit() and len(number) < 4):
        stem, number = path.stem, "1"
    return _free_path(path.with_stem(f"{stem}-{int(number) + 1}"))


def _free_path(path: Path) -> Path:
    """The path, or one with a number behind it that is not taken."""
    number, free = 2, path
    while free.exists():
        free = path.with_stem(f"{path.stem}-{number}")
        number += 1
    return free
