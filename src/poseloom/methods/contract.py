"""The contract that every method keeps: samples in, frames out, one at a time, state explicit."""

import abc
import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from poseloom.arrays import Array, Floats
from poseloom.errors import MethodError
from poseloom.sensors import Placement, Sample, SensorLayout
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.motion import Pose
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
        any_rate: Whether `step` takes samples of any rate; a recording of another rate than the layout's is resampled
            for a method that does not (see `poseloom.sensors.rate`).
    """

    layout: SensorLayout
    delay: int = 0
    any_rate: bool = False

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
