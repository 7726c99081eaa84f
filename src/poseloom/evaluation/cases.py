"""What is evaluated: motions that virtual trackers are put on, and recordings that hold their own truth."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from poseloom.errors import PoseloomError
from poseloom.formats import drop_rest_frame, read_motions
from poseloom.formats.recording import read_recording
from poseloom.library.naming import describe
from poseloom.library.sources import SAMPLES, Selection, find_sources
from poseloom.library.store import file_digest
from poseloom.samples import SAMPLE_PREFIX, sample_motion
from poseloom.sensors import Recording
from poseloom.sensors import layout as layout_by_name
from poseloom.skeleton.families import recognise
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import resample
from poseloom.skeleton.retarget import retarget
from poseloom.synthesis import TrackerNoise, simulate_trackers

RECORDING_SUFFIX = ".mcap"
SHORTEST_SECONDS = 0.5
"""Motions shorter than this are refused: no method has found its feet by then."""


@dataclass(frozen=True)
class Conditions:
    """What the sensors are like that are put on motions; recordings bring their own.

    Attributes:
        layout: Name of the sensors' layout.
        noise: Their errors.
        seed: Seed of what is drawn for the first sequence; the next one has the next number.
    """

    layout: str = "six-trackers"
    noise: TrackerNoise = field(default_factory=TrackerNoise)
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Case:
    """One sequence to evaluate.

    Attributes:
        name: What the sequence is called.
        truth: The true motion on the body, at the sensors' rate.
        motion: The motion that trackers are put on, at its own rate; None for a recording.
        recording: The recording's file; None for a motion.
        digest: SHA-256 of the motion's file, as a library's catalogue has it; empty where unknown.
        subject: Who moves, as far as the file's name tells.
        family: Family of the motion's own skeleton; empty where unknown.
    """

    name: str
    truth: Motion
    motion: Motion | None = None
    recording: Path | None = None
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
    if motion.duration < SHORTEST_SECONDS:
        raise PoseloomError(
            f"the motion {called!r} lasts {motion.duration:.2f} s",
            remedy=f"Give motions of at least {SHORTEST_SECONDS:g} s",
        )
    on_body = retarget(motion)
    truth = resample(on_body, layout_by_name(conditions.layout).rate)
    return Case(called, truth, on_body, None, digest, subject, recognise(motion.skeleton).name)


def read_cases(
    given: Sequence[str],
    conditions: Conditions,
    skeleton: Path | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> tuple[Case, ...]:
    """Reads recordings (.mcap), motion files, folders of them, `sample:NAME`, or `samples` for all built-in motions.

    A first frame that is only the pose the skeleton was drawn in is left out, as in a library.

    Args:
        given: What to read.
        conditions: The sensors that motions will wear.
        skeleton: ASF file for AMC files that have none of their own.
        progress: Told how many of how many are read.

    Raises:
        PoseloomError: for what cannot be read, or a recording without truth.
    """
    found: list[Case] = []
    for done, item in enumerate(given, 1):
        if item.startswith(SAMPLE_PREFIX):
            found.append(_sample(item.removeprefix(SAMPLE_PREFIX), conditions))
        elif Path(item).suffix.lower() == RECORDING_SUFFIX:
            found.append(_recorded(Path(item)))
        else:
            found += _motions(item, conditions, skeleton)
        if progress is not None:
            progress(done, len(given))
    return tuple(found)


def sensed(case: Case, conditions: Conditions, seed: int) -> Recording:
    """What the sensors say of a case: read, or simulated with this seed."""
    if case.recording is not None:
        return read_recording(case.recording)
    motion = case.truth if case.motion is None else case.motion
    return simulate_trackers(motion, layout_by_name(conditions.layout), conditions.noise, seed=seed)


def _sample(name: str, conditions: Conditions) -> Case:
    motion = sample_motion(name)
    # The same digest and subject as a library's catalogue has for a built-in motion.
    digest = hashlib.sha256(motion.q.tobytes()).hexdigest()
    return case_of_motion(motion, conditions, name, digest, describe(f"{SAMPLES}/{name}").subject)


def _recorded(path: Path) -> Case:
    recording = read_recording(path)
    if recording.truth is None:
        raise PoseloomError(
            "this recording holds no truth to compare with",
            remedy="Give a simulated recording or a motion file; `poseloom reconstruct` needs no truth",
            file=path,
        )
    return Case(recording.name or path.stem, recording.truth, recording=path)


def _motions(item: str, conditions: Conditions, skeleton: Path | None) -> list[Case]:
    selection = Selection() if skeleton is None else Selection(skeletons=(("*", skeleton),))
    found: list[Case] = []
    for source in find_sources([item], selection).sources:
        if source.path is None:
            found.append(_sample(source.name.removeprefix(f"{SAMPLES}/"), conditions))
            continue
        digest = file_digest(source.path)
        motions = [drop_rest_frame(motion) for motion in read_motions(source.path, skeleton=source.skeleton)]
        for motion in motions:
            name = source.path.stem + (f":{motion.name}" if len(motions) > 1 else "")
            try:
                found.append(case_of_motion(motion, conditions, name, digest, source.subject))
            except PoseloomError as error:
                raise error.at(source.path) from None
    return found
