"""What a judge of a live session writes down, and how far figures jumped by it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats
from poseloom.live.contract import Post, SessionFacts, Update
from poseloom.live.virtual import virtual_recording
from poseloom.sensors import SensorLayout
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import make_motion
from poseloom.skeleton.skeleton import Skeleton

_SETTLING = 1.0
"""Seconds at the beginning in which the figure finds itself."""
_LONGEST_STEP = 0.05
"""Seconds between two samples at 60 Hz from which a device is taken to have been kept waiting."""
_AFTERWARDS = 2.0
"""Seconds after that for which what the figure does is put down to it."""


class Jumps(NamedTuple):
    """How far any joint went from one pose to the next, beyond the fastest that it goes in the clip; centimetres.

    Attributes:
        largest: While the device spoke as it should, the fault on trial apart.
        kept_waiting: After its process was kept waiting, so that all its sensors were silent; 0 if it never was.
        waits: How often that was.
    """

    largest: float
    kept_waiting: float
    waits: int


class Notebook:
    """A sink that keeps what a judge of the session needs, and no more.

    Attributes:
        times: Of each update's sample, session seconds.
        poses: Pose vectors.
        states: Health, in words.
        silent: How many sensors the sample had no word of.
    """

    name = "notebook"
    capacity = 100_000

    def __init__(self) -> None:
        self.times: list[float] = []
        self.poses: list[NDArray[np.float64]] = []
        self.states: list[str] = []
        self.silent: list[int] = []
        self._skeleton: Skeleton | None = None
        self._sensors = 0

    def open(self, facts: SessionFacts, post: Post) -> None:
        """See `Sink`."""
        self._skeleton, self._sensors = facts.skeleton, len(facts.layout)

    def changed(self, facts: SessionFacts) -> None:
        """See `Sink`."""

    def show(self, update: Update) -> None:
        """See `Sink`."""
        if update.frame is not None:
            self.times.append(update.sample.time)
            self.poses.append(update.frame.pose.q)
            self.states.append(update.frame.health.state.value)
            self.silent.append(int((~np.isfinite(update.sample.positions[:, 0])).sum()))

    def close(self) -> None:
        """See `Sink`."""

    def jumps(self, fastest: Floats[Array, "joints"], silent: int | None) -> Jumps:
        """How far the figure jumped.

        Args:
            fastest: Metres a second that each joint goes at most in the clip.
            silent: How many sensors the fault on trial silences at once; more mean that the device was kept waiting.
                None: all of them, so that nothing can be told apart.
        """
        # The device's end is nobody's fault.
        spoke = np.flatnonzero(np.array(self.silent) < self._sensors)
        count = int(spoke[-1]) + 1 if len(spoke) else 0
        if self._skeleton is None or count < 2:
            return Jumps(0.0, 0.0, 0)
        times, missing = np.array(self.times[:count]), np.array(self.silent[1:count])
        steps = np.diff(times)
        places = motion_frames(make_motion(self._skeleton, np.stack(self.poses[:count]), 1.0)).positions
        ways = np.linalg.norm(np.diff(places, axis=0), axis=2) - fastest * steps[:, None]
        beyond = 100.0 * ways.max(axis=1)
        late = np.zeros(len(steps), dtype=np.bool_) if silent is None else (steps > _LONGEST_STEP) | (missing > silent)
        begun = times[1:] > times[0] + _SETTLING
        waited = _soon_after(late, times[1:])
        return Jumps(
            float(beyond[begun & ~waited].max(initial=0.0)),
            float(beyond[begun & waited].max(initial=0.0)),
            int((np.diff(np.concatenate([[False], late & begun]).astype(int)) > 0).sum()),
        )


def _soon_after(events: Bools[Array, "steps"], times: Floats[Array, "steps"]) -> Bools[Array, "steps"]:
    """Which moments are events, or follow one within `_AFTERWARDS`."""
    last = np.maximum.accumulate(np.where(events, times, -np.inf))
    return times - last <= _AFTERWARDS


def fastest_in(clip: str, worn: SensorLayout) -> Floats[Array, "joints"]:
    """Metres a second that each joint goes at most in a clip, as simulated devices perform it."""
    truth = virtual_recording(clip, worn).truth
    assert truth is not None  # it was simulated
    ways = np.linalg.norm(np.diff(motion_frames(truth).positions, axis=0), axis=2)
    return ways.max(axis=0) * truth.rate
