"""A live session's recording solved again: with the same method bit for bit, or with another."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.errors import MethodError
from poseloom.formats.session_recording import MethodStart, SessionRecording
from poseloom.live.alignment import Alignment, aligned
from poseloom.live.sinks.motion_export import even_motion
from poseloom.methods.contract import Reconstructor
from poseloom.skeleton.motion import Motion


@dataclass(frozen=True, eq=False)
class Resolved:
    """What a method made of a session's samples.

    Attributes:
        samples: Index of the sample after which each pose was spoken of.
        times: Time to which each pose belongs, seconds.
        q: Pose vectors.
        motion: The same as a motion at the session's rate.
        compared: Poses that the recording holds, too.
        identical: Of these, those that are the same in every bit.
        largest: Largest difference of an entry, metres or radians; 0 where none was compared.
    """

    samples: Ints[Array, "frames"]
    times: Floats[Array, "frames"]
    q: Floats[Array, "frames dofs"]
    motion: Motion
    compared: int
    identical: int
    largest: float


def resolve(
    session: SessionRecording, method: Reconstructor[Any], progress: Callable[[int], object] | None = None
) -> Resolved:
    """Solves a session's recording again, as the session did: the same beginnings, the same turns of the world.

    Samples that the live method did not hear, because newer ones were waiting, are left out, so that the same method
    gives the same poses. A recording without steps (not of a live session) is heard whole.

    Args:
        session: The recording.
        method: The method, whichever the session ran.
        progress: Called with the number of samples done.

    Raises:
        MethodError: if the method's sensors are not the recording's, or no pose came out.
    """
    recording = session.recording
    if recording.layout.names != method.layout.names:
        raise MethodError(
            f"the method listens to the layout {method.layout.name!r}, the recording has {recording.layout.name!r}",
            remedy="Choose the layout of the recording when you make the method",
        )
    starts = {start.sample: start for start in session.starts} or {0: MethodStart(0, "")}
    heard = _heard(session)
    state, alignment = method.start(recording.skeleton, recording.placements), Alignment()
    samples: list[int] = []
    times: list[float] = []
    poses: list[NDArray[np.float64]] = []
    for index in range(len(recording)):
        if index in starts:
            start = starts[index]
            alignment = Alignment(start.heading, start.x, start.z)
            state = method.start(recording.skeleton, recording.placements)
        if heard[index]:
            state, frame = method.step(state, aligned(recording.sample(index), alignment))
            if frame is not None:
                samples.append(index)
                times.append(frame.time)
                poses.append(frame.pose.q)
        if progress is not None:
            progress(index + 1)
    if not poses:
        raise MethodError("no pose came of the recording", remedy="Give a longer recording")
    q = np.stack(poses)
    owners, moments = np.array(samples, dtype=np.int64), np.array(times)
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(moments)) > 0])
    motion = even_motion(recording.skeleton, moments[rising], q[rising], recording.layout.rate, recording.name)
    return Resolved(owners, moments, q, motion, *_compared(session, owners, q))


def recorded_motion(session: SessionRecording) -> Motion | None:
    """The poses that the live session spoke of, as a motion at its rate; None if it holds none."""
    steps = session.steps
    spoke = np.isfinite(steps.times)
    if not spoke.any():
        return None
    times, q = steps.times[spoke], steps.q[spoke]
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(times)) > 0])
    recording = session.recording
    return even_motion(recording.skeleton, times[rising], q[rising], recording.layout.rate, recording.name)


def _heard(session: SessionRecording) -> Bools[Array, "samples"]:
    count = len(session.recording)
    if not session.starts:
        return np.ones(count, dtype=np.bool_)
    heard = np.zeros(count, dtype=np.bool_)
    heard[session.steps.samples] = True
    # What the method had not done when the file was cut off, it would have heard.
    last = int(session.steps.samples[-1]) if len(session.steps) else -1
    heard[last + 1 :] = True
    return heard


def _compared(
    session: SessionRecording, owners: Ints[Array, "frames"], q: Floats[Array, "frames dofs"]
) -> tuple[int, int, float]:
    steps = session.steps
    spoke = np.isfinite(steps.times)
    _, mine, its = np.intersect1d(owners, steps.samples[spoke], return_indices=True)
    if not len(mine):
        return 0, 0, 0.0
    live = steps.q[spoke][its]
    same = (live == q[mine]).all(axis=1)
    return len(mine), int(same.sum()), float(np.abs(live - q[mine]).max())
