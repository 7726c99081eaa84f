"""A recording in, estimates out: the fold over a whole recording, as a live session ran it or would run it."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints, frozen_float
from poseloom.errors import MethodError
from poseloom.methods.contract import Frame, Health, Reconstructor
from poseloom.methods.fold import Engine, Fold, advance, begin
from poseloom.sensors import Recording
from poseloom.sensors.rate import resample_recording, same_rate
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.resample import even_motion

Progress = Callable[[int], object]
"""Called with the number of samples done."""


@dataclass(frozen=True, eq=False)
class Course:
    """What a session did with its samples.

    Attributes:
        beginnings: What began before which sample; the first one before sample 0.
        received: Which samples the method received; None: all.
    """

    beginnings: Mapping[int, Engine]
    received: Bools[Array, "samples"] | None = None


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What a method made of a recording.

    Attributes:
        motion: The estimates, one frame each, on the wearer's skeleton, at the recording's rate.
        samples: Index of the sample to which each frame belongs.
        given: Index of the sample with which each frame was given: `delay` samples later.
        times: Device time of each frame, seconds.
        spread: Standard deviation of each pose-vector entry.
        health: One a frame.
        step_seconds: Wall time of each step.
        recording: What the method received: the recording, resampled where its rate is not the method's. Indices are
            into this one.
        notes: What was changed on the way, for people.
    """

    motion: Motion
    samples: Ints[Array, "frames"]
    given: Ints[Array, "frames"]
    times: Floats[Array, "frames"]
    spread: Floats[Array, "frames dofs"]
    health: tuple[Health, ...]
    step_seconds: Floats[Array, "steps"]
    recording: Recording
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Reconstruction({len(self.motion)} frames at {self.motion.rate:g} Hz of {self.motion.name!r})"

    def even(self, name: str = "") -> Motion:
        """The estimates at even times: what a live session exports. Frames are interpolated where times are uneven."""
        motion = self.motion
        return even_motion(motion.skeleton, self.times, motion.q, motion.rate, name or motion.name)


def reconstruct(method: Reconstructor[Any], recording: Recording, progress: Progress | None = None) -> Reconstruction:
    """Runs a method over a recording: a fold over `step`, the very calls that a live session makes.

    A recording of another rate than the method's is resampled first (see `poseloom.sensors.rate`), and `notes` say so.

    Args:
        method: The method.
        recording: Samples, the wearer's skeleton and placements. Its ground truth, if any, is not looked at.
        progress: Called with the number of samples done.

    Raises:
        MethodError: if the method's sensors are not the recording's, or nothing came out.
    """
    engine = Engine(type(method).__name__, method, recording.skeleton, recording.placements)
    return run_course(recording, Course({0: engine}), progress)


def run_course(recording: Recording, course: Course, progress: Progress | None = None) -> Reconstruction:
    """Runs what a session ran over its recording.

    Args:
        recording: The samples.
        course: What began where, and which samples were received.
        progress: Called with the number of samples done.

    Raises:
        MethodError: if a method's sensors are not the recording's, methods need different rates, or nothing came out.
    """
    recording, course, notes = _at_the_methods_rate(recording, course)
    fold: Fold | None = None
    frames: list[Frame] = []
    owners: list[int] = []
    given: list[int] = []
    since: list[int] = []
    seconds = np.full(len(recording), np.nan)
    for index in range(len(recording)):
        engine = course.beginnings.get(index)
        if engine is not None:
            fold, since = begin(engine), []
        if fold is not None and (course.received is None or course.received[index]):
            began = time.perf_counter()
            fold, _, frame = advance(fold, recording.sample(index))
            seconds[index] = time.perf_counter() - began
            since.append(index)
            if frame is not None:
                frames.append(frame)
                owners.append(since[-1 - fold.engine.method.delay])
                given.append(index)
        if progress is not None:
            progress(index + 1)
    if not frames:
        delay = max(engine.method.delay for engine in course.beginnings.values())
        raise MethodError(
            f"no frame came of {len(recording)} samples",
            cause=f"the method speaks {delay} samples late",
            remedy="Give a longer recording",
        )
    return Reconstruction(
        motion=make_motion(
            recording.skeleton, np.stack([frame.pose.q for frame in frames]), recording.layout.rate, recording.name
        ),
        samples=np.array(owners, dtype=np.int64),
        given=np.array(given, dtype=np.int64),
        times=np.array([frame.time for frame in frames]),
        spread=frozen_float(np.stack([frame.spread for frame in frames])),
        health=tuple(frame.health for frame in frames),
        step_seconds=seconds[np.isfinite(seconds)],
        recording=recording,
        notes=notes,
    )


def _at_the_methods_rate(recording: Recording, course: Course) -> tuple[Recording, Course, tuple[str, ...]]:
    """Recording and course at the rate that the methods need."""
    methods = [engine.method for engine in course.beginnings.values()]
    for method in methods:
        if method.layout.names != recording.layout.names:
            raise MethodError(
                f"the method listens to the layout {method.layout.name!r}, the recording has {recording.layout.name!r}",
                remedy="Choose the layout of the recording when you make the method",
            )
    needed = {method.layout.rate for method in methods if not method.any_rate}
    if len(needed) > 1:
        raise MethodError(
            f"the methods need rates of {' and '.join(f'{rate:g}' for rate in sorted(needed))} Hz",
            remedy="Name one method for all of the recording",
        )
    old = recording.layout.rate
    rate = needed.pop() if needed else old
    if same_rate(old, rate):
        return recording, course, ()
    if course.received is not None:
        recording = recording.only(course.received)
    new = resample_recording(recording, rate)
    moments = {index: float(recording.times[min(index, len(recording) - 1)]) for index in course.beginnings}
    first = np.searchsorted(new.times, np.array(list(moments.values())) - 1e-3 / max(old, rate))
    beginnings = {int(at): engine for at, engine in zip(first, course.beginnings.values(), strict=True)}
    return new, Course(beginnings), (rate_note(old, rate),)


def rate_note(old: float, new: float) -> str:
    """What people are told of a recording that is resampled."""
    return f"the recording has {old:g} samples a second; they are resampled to the {new:g} that the method needs"
