"""A live session's recording run again: with the session's own methods bit for bit, or with another."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from poseloom.arrays import Array, Bools
from poseloom.errors import FormatError, LibraryError, MethodError, PoseloomError
from poseloom.formats.session_recording import MethodStart, SessionRecording
from poseloom.library import open_library
from poseloom.methods.alignment import Alignment
from poseloom.methods.choose import Library, Method, choose, method_name
from poseloom.methods.fold import Engine
from poseloom.methods.reconstruction import Course, Progress, Reconstruction, run_course
from poseloom.methods.registry import METHODS, needs_library, needs_model
from poseloom.sensors.recording import Recording
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import even_motion

LIBRARY_DIGEST, MODEL_DIGEST, CONFIGURATION = "library digest", "model digest", "configuration"
"""Keys of a session's settings in its recording."""


@dataclass(frozen=True)
class Comparison:
    """The estimates of a run beside those of the session.

    Attributes:
        session: Estimates that the session gave.
        compared: Of these, those that the run gave, too.
        identical: Of these, those that are the same in every bit.
        largest: Largest difference of an entry, metres or radians; 0 where none was compared.
    """

    session: int
    compared: int
    identical: int
    largest: float

    @property
    def agrees(self) -> bool:
        """Whether every estimate of the session came again, the same in every bit."""
        return self.identical == self.session


@dataclass(frozen=True, eq=False)
class Reprocessing:
    """How a recording is run.

    Attributes:
        course: What begins before which sample, and which samples are received.
        method: Names of the methods, in order.
        differences: What is not as it was in the session, in words.
    """

    course: Course
    method: str
    differences: tuple[str, ...] = ()


def plan_reprocessing(
    session: SessionRecording,
    method: Method | None = None,
    library: Library | None = None,
    model: str | Path | None = None,
) -> Reprocessing:
    """How a recording is to be run; what is left out is as in the session.

    Samples that the session's method did not receive, because newer ones were waiting, are left out. A recording
    without steps (not of a live session) is received whole.

    Args:
        session: The recording; a calibration that is to be used has been put in its place.
        method: A method or its name, for all of the recording; None: each of the session's own.
        library: The library or its folder.
        model: File of the fitted model.

    Raises:
        PoseloomError: if the method does not fit, or its library or model is not where the session had it.
    """
    recording, differences = session.recording, list[str]()
    told = _configuration(recording)
    starts = session.starts or (MethodStart(0, ""),)
    own = {start.method for start in session.starts}
    if method is not None and own - {method_name(method)}:
        differences.append(f"the session ran {', '.join(sorted(own))}, not {method_name(method)}")
    made: dict[Method | None, Any] = {}
    beginnings: dict[int, Engine] = {}
    for start in starts:
        asked = method if method is not None else _known(start.method)
        if asked not in made:
            stored_library, stored_model = _of_session(asked, told, library, model)
            made[asked] = choose(recording.layout, asked, library=stored_library, model=stored_model)
        chosen = made[asked]
        alignment = Alignment(start.heading, start.x, start.z)
        beginnings[start.sample] = Engine(
            chosen.name, chosen.method, recording.skeleton, recording.placements, alignment
        )
    for chosen in made.values():
        if chosen.library is not None and _other(session, LIBRARY_DIGEST, chosen.library.digest):
            differences.append("this library's poses are not those that the session had")
        if chosen.model is not None and _other(session, MODEL_DIGEST, file_sha256(chosen.model)):
            differences.append("this model is not the one that the session had")
    received = _received(session)
    left = int((~received).sum())
    if left:
        differences.append(f"{left} samples are left out that the session's method did not receive")
    names = ", ".join(chosen.name for chosen in made.values())
    return Reprocessing(Course(beginnings, received), names, tuple(differences))


def reprocess(session: SessionRecording, how: Reprocessing, progress: Progress | None = None) -> Reconstruction:
    """Runs a session's recording again, as the session did: the same beginnings, the same aligned world.

    Args:
        session: The recording.
        how: See `plan_reprocessing`.
        progress: Called with the number of samples done.

    Raises:
        MethodError: if the method's sensors are not the recording's, or no estimate came out.
    """
    return run_course(session.recording, how.course, progress)


def compare_with_session(session: SessionRecording, again: Reconstruction) -> Comparison:
    """Sets a run beside what the session's method gave at the same samples; nothing compares at another rate."""
    steps = session.steps
    spoke = np.isfinite(steps.times)
    total = int(spoke.sum())
    if again.recording is not session.recording:
        return Comparison(total, 0, 0, 0.0)
    _, mine, its = np.intersect1d(again.given, steps.samples[spoke], return_indices=True)
    if not len(mine):
        return Comparison(total, 0, 0, 0.0)
    live, q = steps.q[spoke][its], again.motion.q[mine]
    same = (live == q).all(axis=1)
    return Comparison(total, len(mine), int(same.sum()), float(np.abs(live - q).max()))


def recorded_motion(session: SessionRecording) -> Motion | None:
    """The estimates that the live session gave, as a motion at its rate; None if it holds none."""
    steps = session.steps
    spoke = np.isfinite(steps.times)
    if not spoke.any():
        return None
    recording = session.recording
    return even_motion(recording.skeleton, steps.times[spoke], steps.q[spoke], recording.layout.rate, recording.name)


def file_sha256(path: Path) -> str:
    """SHA-256 of a file. Raises PoseloomError where it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise PoseloomError("the file cannot be read", cause=error.strerror or "", file=path) from None


def _known(name: str) -> str | None:
    """A session's method by name; None where the recording names none."""
    if name and name not in METHODS:
        raise MethodError(
            f"the session ran the method {name!r}, which is not known here", remedy="Name another with --method"
        )
    return name or None


def _configuration(recording: Recording) -> dict[str, str]:
    """How the session was set up, as far as words say; raises FormatError where the recording holds no such thing."""
    try:
        told = json.loads(recording.settings.get(CONFIGURATION, "{}"))
        if isinstance(told, dict):
            settings = cast(dict[str, object], told)
            return {key: value for key, value in settings.items() if isinstance(value, str)}
    except (ValueError, RecursionError):
        pass
    raise FormatError(
        f"what recording {recording.name!r} says of its session's settings is damaged",
        remedy="Say the method, and its library or model, for the recording anew (poseloom reconstruct)",
    )


def _of_session(
    method: Method | None, told: dict[str, str], library: Library | None, model: str | Path | None
) -> tuple[Library | None, str | Path | None]:
    """Library and model for a method: as given, or where the session had them."""
    if not isinstance(method, str):
        return library, model
    if library is None and needs_library(method) and told.get("library"):
        try:
            library = open_library(told["library"])
        except (LibraryError, OSError) as error:
            raise MethodError(
                f"the library of the session cannot be opened: {error}", remedy="Name it with --library"
            ) from None
    if model is None and needs_model(method) and told.get("model"):
        model = Path(told["model"])
        if not model.exists():
            raise MethodError("the model of the session is not where it was", remedy="Name it with --model", file=model)
    return library, model


def _other(session: SessionRecording, key: str, digest: str) -> bool:
    return session.recording.settings.get(key, digest) != digest


def _received(session: SessionRecording) -> Bools[Array, "samples"]:
    count = len(session.recording)
    if not session.starts:
        return np.ones(count, dtype=np.bool_)
    received = np.zeros(count, dtype=np.bool_)
    received[session.steps.samples] = True
    # What the method had not done when the file was cut off, it would have received.
    last = int(session.steps.samples[-1]) if len(session.steps) else -1
    received[last + 1 :] = True
    return received
