"""What `poseloom view` shows: figures along one time, from recordings, motion files and methods."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.calibration.calibration import apply_calibration, read_calibration
from poseloom.errors import MethodError, ViewerError
from poseloom.evaluation import profiles
from poseloom.formats import read_motion
from poseloom.formats.glb_reading import read_glb
from poseloom.formats.session_recording import SessionRecording, read_session
from poseloom.live.reprocess import plan_reprocessing, reprocess
from poseloom.methods.choose import default_method
from poseloom.methods.contract import Health
from poseloom.methods.reconstruction import Reconstruction
from poseloom.samples import SAMPLE_PREFIX, sample_motion
from poseloom.sensors import Recording
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.contacts import contacts, floor_height
from poseloom.skeleton.motion import Motion
from poseloom.viewer.colours import METHODS, TRUTH, Colour

MOST_FIGURES = 3
"""Truth and two others: more do not fit side by side on a screen."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Track:
    """One figure's poses along time.

    Attributes:
        label: What it is called.
        colour: Of the figure.
        motion: The poses.
        times: Seconds of each, on the time of all tracks, increasing.
        floor: Height of the floor it stands on.
        standing: Whether left heel, left toe, right heel and right toe stand; None where that is not known.
        spread: Standard deviations, where a method stated them.
        health: What the method knew of its trouble.
    """

    label: str
    colour: Colour
    motion: Motion
    times: Floats[Array, "frames"]
    floor: float = 0.0
    standing: Bools[Array, "frames 4"] | None = None
    spread: Floats[Array, "frames dofs"] | None = None
    health: tuple[Health, ...] | None = None

    def frame_at(self, time: float) -> int:
        """The frame shown at a moment: the last that is not later, or else the first."""
        return max(int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1, 0)


@dataclass(frozen=True, eq=False)
class Take:
    """Everything that is shown together.

    Attributes:
        name: What it is called.
        tracks: The figures, the truth first where there is one.
        truth: Whether the first track is the truth.
        recording: What the sensors said, if they did.
        duration: Seconds.
    """

    name: str
    tracks: tuple[Track, ...]
    truth: bool
    recording: Recording | None
    duration: float


@dataclass(frozen=True)
class Wanted:
    """What to show beside the files.

    Attributes:
        methods: Names of methods that reconstruct the recording.
        library: Folder of the library that they ask.
        model: File of a fitted model.
        calibration: File of sizes and placements.
    """

    methods: tuple[str, ...] = ()
    library: Path | None = None
    model: Path | None = None
    calibration: Path | None = None


def load_take(files: Sequence[str | Path], wanted: Wanted | None = None, progress: Progress | None = None) -> Take:
    """Reads files and reconstructs what is asked.

    Args:
        files: At most one recording (.mcap), and motion files or `sample:NAME`; all begin at time zero.
        wanted: Methods and what they need.
        progress: Called with what is being done, and how many of how many steps are.

    Raises:
        ViewerError: for two recordings, more than three figures, methods without a recording, or a recording that
            holds no truth when no method is named and none works without being told.
        PoseloomError: whatever the readers and methods raise.
    """
    how, tell = wanted or Wanted(), progress or _untold
    session: SessionRecording | None = None
    motions: list[Motion] = []
    for name in files:
        path = Path(name)
        if path.suffix.lower() == ".mcap":
            if session is not None:
                raise ViewerError("two recordings cannot be shown at once", remedy="Name one .mcap file", file=path)
            session = read_session(path)
        else:
            motions.append(_motion(str(name)))
    if session is not None and how.calibration is not None:
        calibrated = apply_calibration(session.recording, read_calibration(how.calibration))
        session = replace(session, recording=calibrated)
    recording = None if session is None else session.recording
    methods = _methods(recording, motions, how)
    _check_count(recording, motions, methods)
    tracks = _tracks(session, motions, methods, how, tell)
    name = recording.name if recording is not None else " and ".join(motion.name for motion in motions)
    duration = max(float(track.times[-1]) for track in tracks)
    truth = recording is not None and recording.truth is not None
    return Take(name or "recording", tuple(tracks), truth, recording, duration)


def track_of(label: str, colour: Colour, motion: Motion, times: Floats[Array, "frames"] | None = None) -> Track:
    """A track of a motion, with the floor and the standing feet found from it where it is the body's."""
    moments = np.arange(len(motion)) / motion.rate if times is None else times
    if motion.skeleton.names != BODY_BONES:
        return Track(label, colour, motion, moments)
    found = contacts(motion)
    standing = np.stack([found.left_heel, found.left_toe, found.right_heel, found.right_toe], axis=1)
    return Track(label, colour, motion, moments, floor_height(motion), standing)


def position_errors_cm(take: Take, track: Track) -> tuple[Floats[Array, "frames"], Floats[Array, "frames"]] | None:
    """Mean distance of a figure's joints from the first's, root positions removed, at the figure's own times.

    None where they are not both the body, or have no time in common.
    """
    reference = take.tracks[0]
    if track is reference or {m.skeleton.names for m in (track.motion, reference.motion)} != {BODY_BONES}:
        return None
    inside = np.flatnonzero(track.times <= reference.times[-1] + 0.5 / reference.motion.rate)
    if len(inside) == 0:
        return None
    rows = [reference.frame_at(float(track.times[frame])) for frame in inside]
    truth = Motion(reference.motion.skeleton, reference.motion.q[rows], track.motion.rate)
    estimate = Motion(track.motion.skeleton, track.motion.q[inside], track.motion.rate)
    return track.times[inside], profiles.position_errors(truth, estimate).mean(axis=1)


def _motion(name: str) -> Motion:
    if name.startswith(SAMPLE_PREFIX):
        return sample_motion(name, ViewerError)
    path = Path(name)
    return read_glb(path) if path.suffix.lower() == ".glb" else read_motion(path)


def _methods(recording: Recording | None, motions: Sequence[Motion], how: Wanted) -> tuple[str, ...]:
    """The methods asked for, or the one that needs nothing where the sensors alone would otherwise be seen."""
    methods = tuple(dict.fromkeys(how.methods))
    if recording is None:
        if methods:
            raise ViewerError(
                "a method needs a recording of sensors",
                remedy="Name an .mcap file; `poseloom simulate` makes one from a motion",
            )
        return ()
    if methods or recording.truth is not None or motions:
        return methods
    try:
        return (default_method(recording.layout, how.library, how.model),)
    except MethodError as error:
        raise ViewerError(
            "this recording holds no motion, only what the sensors said",
            cause=str(error),
            remedy="Name a method that makes a motion of it with --method; see `poseloom methods`",
        ) from None


def _check_count(recording: Recording | None, motions: Sequence[Motion], methods: Sequence[str]) -> None:
    truth = int(recording is not None and recording.truth is not None)
    count = truth + len(motions) + len(methods)
    if count > MOST_FIGURES:
        raise ViewerError(
            f"{count} figures do not fit side by side",
            remedy=f"Choose at most {MOST_FIGURES}, the truth among them",
        )


def _tracks(
    session: SessionRecording | None, motions: Sequence[Motion], methods: Sequence[str], how: Wanted, tell: Progress
) -> list[Track]:
    recording = None if session is None else session.recording
    tracks: list[Track] = []
    if recording is not None and recording.truth is not None:
        tracks.append(track_of("truth", TRUTH, recording.truth, recording.times - recording.times[0]))
    others = iter(METHODS)
    for name in methods:
        assert session is not None
        assert recording is not None
        made = _reconstruct(name, session, how, tell)
        track = track_of(name, next(others), made.motion, made.times - recording.times[0])
        tracks.append(_with_doubt(track, made))
    tracks += [track_of(motion.name or "motion", next(others), motion) for motion in motions]
    return tracks


def _reconstruct(name: str, session: SessionRecording, how: Wanted, tell: Progress) -> Reconstruction:
    plan = plan_reprocessing(session, name, how.library, how.model)
    return reprocess(session, plan, lambda done: tell(name, done, len(session.recording)))


def _with_doubt(track: Track, made: Reconstruction) -> Track:
    return Track(
        track.label,
        track.colour,
        track.motion,
        track.times,
        track.floor,
        track.standing,
        made.spread,
        made.health,
    )


def _untold(_what: str, _done: int, _total: int) -> None:
    """Progress that nobody looks at."""
