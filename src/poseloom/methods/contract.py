"""The contract that every method keeps: samples in, frames out, one at a time, state explicit."""

import abc
import enum
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from poseloom.arrays import Array, Floats, Ints, frozen_float
from poseloom.errors import MethodError
from poseloom.sensors import Placement, Recording, Sample, SensorLayout
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.motion import Motion, Pose, make_motion
from poseloom.skeleton.skeleton import Skeleton

State = TypeVar("State")


class HealthState(enum.StrEnum):
    """How far a frame can be trusted."""

    OK = "ok"
    DEGRADED = "degraded"
    COASTING = "coasting"
    LOST = "lost"
    REJOINING = "rejoining"


@dataclass(frozen=True)
class Health:
    """What a frame's maker knows of its own trouble.

    Attributes:
        state: ok: all sensors spoke and agree; degraded: some are missing or disbelieved; coasting: none spoke, the
            motion is carried on from the model alone; lost: coasting for so long that the pose means little; rejoining:
            sensors are back, and the pose still glides from where it was to where they say.
        sensors: Names of the sensors that are missing or disbelieved.
    """

    state: HealthState = HealthState.OK
    sensors: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Frame:
    """One reconstructed pose.

    Attributes:
        time: The device time, in seconds, to which the pose belongs.
        pose: The pose, on the wearer's skeleton.
        spread: The method's own standard deviation of each pose-vector entry (metres for the root, else radians).
        health: What the method knows of its trouble.
    """

    time: float
    pose: Pose
    spread: Floats[Array, "dofs"]
    health: Health


class Reconstructor(abc.ABC, Generic[State]):
    """Turns samples into poses, one at a time. Holds parameters and fitted data only; what changes is in `State`.

    Attributes:
        layout: Which sensors it listens to and at what rate.
        delay: Samples between hearing a moment and speaking of it.
    """

    layout: SensorLayout
    delay: int = 0

    @abc.abstractmethod
    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> State:
        """The state before the first sample, for a wearer's skeleton and the sensors' places on it."""

    @abc.abstractmethod
    def step(self, state: State, sample: Sample) -> tuple[State, Frame | None]:
        """Takes in one sample; changes neither argument. None while `delay` samples have not been heard yet."""


def check_wearer(who: str, layout: SensorLayout, skeleton: Skeleton, placements: Sequence[Placement]) -> None:
    """Raises MethodError unless the wearer is the 22-bone body with the layout's sensors on it.

    Args:
        who: Whom the message is about, with its verb, such as "tracker methods move".
        layout: The method's sensors.
        skeleton: The wearer's.
        placements: Where the sensors are said to sit.
    """
    if skeleton.names != BODY_BONES:
        raise MethodError(
            f"{who} the 22-bone body, and this skeleton is another",
            remedy="Retarget the wearer's skeleton to the body first",
        )
    bones = [placement.bone for placement in placements]
    if bones != [sensor.bone for sensor in layout.sensors]:
        raise MethodError(
            f"the placements are on {', '.join(bones)}; the layout {layout.name!r} has its sensors elsewhere",
            remedy="Give one placement for each sensor of the layout, in its order",
        )


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What a method made of a recording.

    Attributes:
        motion: The estimate, on the wearer's skeleton.
        samples: Index of the sample to which each frame belongs.
        times: Device time of each frame, seconds.
        spread: Standard deviation of each pose-vector entry.
        health: One a frame.
        step_seconds: Wall time of each step.
    """

    motion: Motion
    samples: Ints[Array, "frames"]
    times: Floats[Array, "frames"]
    spread: Floats[Array, "frames dofs"]
    health: tuple[Health, ...]
    step_seconds: Floats[Array, "steps"]


def reconstruct(
    method: Reconstructor[State], recording: Recording, progress: Callable[[int], object] | None = None
) -> Reconstruction:
    """Runs a method over a recording: a fold over `step`, the very calls that a live session makes.

    Args:
        method: The method.
        recording: Samples, the wearer's skeleton and placements. Its truth, if any, is not looked at.
        progress: Called with the number of samples done.

    Raises:
        MethodError: if the method's sensors are not the recording's, or nothing came out.
    """
    if [s.name for s in recording.layout.sensors] != [s.name for s in method.layout.sensors]:
        raise MethodError(
            f"the method listens to the layout {method.layout.name!r}, the recording has {recording.layout.name!r}",
            remedy="Choose the layout of the recording when you make the method",
        )
    state = method.start(recording.skeleton, recording.placements)
    frames: list[Frame] = []
    owners: list[int] = []
    seconds = np.empty(len(recording))
    for index in range(len(recording)):
        sample = recording.sample(index)
        begin = time.perf_counter()
        state, frame = method.step(state, sample)
        seconds[index] = time.perf_counter() - begin
        if frame is not None:
            frames.append(frame)
            owners.append(index - method.delay)
        if progress is not None:
            progress(index + 1)
    if not frames:
        raise MethodError(
            f"no frame came of {len(recording)} samples",
            cause=f"the method speaks {method.delay} samples late",
            remedy="Give a longer recording",
        )
    return Reconstruction(
        motion=make_motion(
            recording.skeleton, np.stack([frame.pose.q for frame in frames]), recording.layout.rate, recording.name
        ),
        samples=np.array(owners, dtype=np.int64),
        times=np.array([frame.time for frame in frames]),
        spread=frozen_float(np.stack([frame.spread for frame in frames])),
        health=tuple(frame.health for frame in frames),
        step_seconds=seconds,
    )
