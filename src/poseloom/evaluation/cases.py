"""What is evaluated: motions that virtual trackers are put on, and recordings that hold their own truth."""

import enum
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from poseloom.errors import LibraryError, PoseloomError
from poseloom.formats import drop_rest_frame, read_motions
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices
from poseloom.formats.recording import read_recording
from poseloom.library.naming import describe
from poseloom.library.sources import SAMPLES, Selection, find_sources
from poseloom.library.store import file_digest
from poseloom.samples import SAMPLE_PREFIX, sample_motion
from poseloom.sensors import Recording, SensorLayout
from poseloom.sensors import layout as layout_by_name
from poseloom.sensors.recording import SUBJECT
from poseloom.skeleton.families import recognise
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import resample
from poseloom.skeleton.retarget import retarget
from poseloom.synthesis import TrackerNoise

RECORDING_SUFFIX = ".mcap"
SHORTEST_SECONDS = 0.5
"""Motions shorter than this are refused: no method has found its feet by then."""


class Channels(enum.StrEnum):
    """What of trackers is used."""

    BOTH = "both"
    POSITION = "position"
    ORIENTATION = "orientation"


class NoTruth(PoseloomError):
    """A recording holds no truth to compare with; in a folder among others it is skipped and named."""


class TooShort(PoseloomError):
    """A sequence is too short to be evaluated; among others it is skipped and named."""


@dataclass(frozen=True)
class Conditions:
    """What the sensors are like that are put on motions, and what is used of them; recordings bring their own sensors.

    Attributes:
        layout: The sensors' layout, or its name.
        noise: The errors of trackers; sensors of other kinds have their simulators' usual ones.
        seed: Seed of what is drawn for the first sequence; the next one has the next number.
        channels: What of trackers is used.
        drop: Names of sensors that are missing throughout.
        start: Second of each sequence to begin at.
        stop: Second to end at; None: its end.
        subject: Who moves in sequences that do not say so.
        choices: What the user says of motion files that do not say it themselves.
    """

    layout: SensorLayout | str = "six-trackers"
    noise: TrackerNoise = field(default_factory=TrackerNoise)
    seed: int = 0
    channels: Channels = Channels.BOTH
    drop: tuple[str, ...] = ()
    start: float = 0.0
    stop: float | None = None
    subject: str = ""
    choices: MotionChoices = NOTHING_SAID

    @property
    def worn(self) -> SensorLayout:
        """The layout. Raises SensorError for an unknown name."""
        return layout_by_name(self.layout) if isinstance(self.layout, str) else self.layout


@dataclass(frozen=True, eq=False)
class Case:
    """One sequence to evaluate.

    Attributes:
        name: What the sequence is called.
        truth: The true motion on the body, at the sensors' rate.
        motion: The motion that trackers are put on, at its own rate; None for a recording.
        recording: The recording, or its file; None for a motion.
        digest: SHA-256 of the motion's file, as a library's catalogue has it; empty where unknown.
        subject: Who moves, as far as the recording or the file's name tells; empty where unknown.
        family: Family of the motion's own skeleton; empty where unknown.
    """

    name: str
    truth: Motion
    motion: Motion | None = None
    recording: Recording | Path | None = None
    digest: str = ""
    subject: str = ""
    family: str = ""


def case_of_motion(motion: Motion, conditions: Conditions, name: str = "", digest: str = "", subject: str = "") -> Case:
    """A motion of any skeleton as a case: put on the body, whose bones keep the motion's own lengths.

    Args:
        motion: The motion.
        conditions: The sensors that it will wear.
        name: What to call it; the motion's own name if empty.
        digest: SHA-256 of the file it comes from, by which a library knows it.
        subject: Who moves, as a library's catalogue calls them.

    Raises:
        PoseloomError: for a motion that cannot be put on the body or is too short.
    """
    called = name or motion.name
    motion = _part(motion, called, conditions)
    if motion.duration < SHORTEST_SECONDS:
        raise TooShort(
            f"the motion {called!r} lasts {motion.duration:.2f} s",
            remedy=f"Give motions of at least {SHORTEST_SECONDS:g} s",
        )
    on_body = retarget(motion)
    truth = resample(on_body, conditions.worn.rate)
    return Case(called, truth, on_body, None, digest, subject or conditions.subject, recognise(motion.skeleton).name)


def case_of_recording(recording: Recording, conditions: Conditions, name: str = "") -> Case:
    """A recording with its ground truth as a case.

    Args:
        recording: The recording; what of it is used, `conditions` say.
        conditions: Of its sensors only what is used counts.
        name: What to call it; its own name if empty.

    Raises:
        PoseloomError: for a recording without truth, or a part of it that is not there or too short.
    """
    called = name or recording.name
    if recording.truth is None:
        raise NoTruth(
            "this recording holds no truth to compare with",
            remedy="Give a simulated recording or a motion file; `poseloom reconstruct` needs no truth",
        )
    recording = _cut_recording(recording, called, conditions)
    assert recording.truth is not None
    if recording.duration < SHORTEST_SECONDS:
        raise TooShort(
            f"the recording {called!r} lasts {recording.duration:.2f} s",
            remedy=f"Give recordings of at least {SHORTEST_SECONDS:g} s",
        )
    subject = recording.settings.get(SUBJECT, "") or conditions.subject
    return Case(called, recording.truth, recording=recording, subject=subject)


def read_cases(
    given: Sequence[str],
    conditions: Conditions,
    skeleton: Path | None = None,
    progress: Callable[[int, int], object] | None = None,
    skipped: list[str] | None = None,
) -> tuple[Case, ...]:
    """Reads recordings (.mcap), motion files, folders of them, `sample:NAME`, or `samples` for all built-in motions.

    A first frame that is only the pose the skeleton was drawn in is left out, as in a library.

    Args:
        given: What to read.
        conditions: The sensors that motions will wear.
        skeleton: ASF file for AMC files that have none of their own.
        progress: Told how many of how many are read.
        skipped: Takes what is too short, in words; None: that is an error. Recordings in folders that hold no truth
            are skipped, too.

    Raises:
        PoseloomError: for what cannot be read, or a recording without truth that is named by itself.
    """
    found: list[Case] = []
    for done, item in enumerate(given, 1):
        path = Path(item)
        if item.startswith(SAMPLE_PREFIX):
            _keep(found, skipped, lambda name=item: _sample(name.removeprefix(SAMPLE_PREFIX), conditions))
        elif path.is_dir():
            recordings = sorted(file for file in path.rglob(f"*{RECORDING_SUFFIX}") if file.is_file())
            for file in recordings:
                _keep(found, skipped, lambda file=file: _recorded(file, conditions), NoTruth)
            _motions(item, conditions, skeleton, found, skipped, needed=not recordings)
        elif path.suffix.lower() == RECORDING_SUFFIX:
            _keep(found, skipped, lambda path=path: _recorded(path, conditions))
        else:
            _motions(item, conditions, skeleton, found, skipped)
        if progress is not None:
            progress(done, len(given))
    return tuple(found)


def _keep(
    found: list[Case],
    skipped: list[str] | None,
    read: Callable[[], Case],
    other: type[PoseloomError] = TooShort,
) -> None:
    """Keeps a case, or the reason why it is skipped."""
    try:
        found.append(read())
    except (TooShort, other) as error:
        if skipped is None:
            raise
        skipped.append(str(error))


def _part(motion: Motion, called: str, conditions: Conditions) -> Motion:
    start, stop = conditions.start, conditions.stop
    if start == 0.0 and stop is None:
        return motion
    end = motion.duration if stop is None else min(stop, motion.duration)
    if not 0.0 <= start < end:
        raise _no_part(called, conditions, motion.duration)
    return motion.cut(round(start * motion.rate), round(end * motion.rate) + 1)


def _cut_recording(recording: Recording, called: str, conditions: Conditions) -> Recording:
    start, stop = conditions.start, conditions.stop
    if start == 0.0 and stop is None:
        return recording
    since = recording.times - recording.times[0]
    inside = np.flatnonzero((since >= start - 1e-9) & (since <= (np.inf if stop is None else stop) + 1e-9))
    if not inside.size:
        raise _no_part(called, conditions, recording.duration)
    return recording.cut(int(inside[0]), int(inside[-1]) + 1)


def _no_part(called: str, conditions: Conditions, lasts: float) -> TooShort:
    end = "its end" if conditions.stop is None else f"{conditions.stop:g} s"
    return TooShort(
        f"{called!r} has no part from {conditions.start:g} s to {end}",
        cause=f"it lasts {lasts:.2f} s",
        remedy="Choose --start below --stop, and within the sequence",
    )


def _sample(name: str, conditions: Conditions) -> Case:
    motion = sample_motion(name)
    # The same digest and subject as a library's catalogue has for a built-in motion.
    digest = hashlib.sha256(motion.q.tobytes()).hexdigest()
    return case_of_motion(motion, conditions, name, digest, describe(f"{SAMPLES}/{name}").subject)


def _recorded(path: Path, conditions: Conditions) -> Case:
    recording = read_recording(path)
    try:
        return case_of_recording(recording, conditions, recording.name or path.stem)
    except PoseloomError as error:
        raise error.at(path) from None


def _motions(
    item: str,
    conditions: Conditions,
    skeleton: Path | None,
    found: list[Case],
    skipped: list[str] | None,
    needed: bool = True,
) -> None:
    selection = Selection() if skeleton is None else Selection(skeletons=(("*", skeleton),))
    try:
        sources = find_sources([item], selection).sources
    except LibraryError:
        if needed:
            raise
        return
    for source in sources:
        if source.path is None:
            _keep(found, skipped, lambda name=source.name: _sample(name.removeprefix(f"{SAMPLES}/"), conditions))
            continue
        digest = file_digest(source.path)
        read = read_motions(source.path, skeleton=source.skeleton, choices=conditions.choices)
        motions = [drop_rest_frame(motion) for motion in read]
        for motion in motions:
            name = source.path.stem + (f":{motion.name}" if len(motions) > 1 else "")
            try:
                _keep(
                    found, skipped,
                    lambda motion=motion, name=name, source=source, digest=digest: case_of_motion(
                        motion, conditions, name, digest, source.subject
                    ),
                )  # fmt: skip
            except PoseloomError as error:
                raise error.at(source.path) from None
