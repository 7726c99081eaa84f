"""Parameters and state that all tracker methods share."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import SensorMount, SolverSettings


@dataclass(frozen=True)
class TrackerSettings:
    """What every tracker method needs to know.

    Attributes:
        sigma_position: Standard deviation of a tracker's position, metres.
        sigma_orientation: Standard deviation of a tracker's orientation, radians.
        solver: How the pose is solved for.
        lost_after: Seconds of silence of all sensors after which the pose means little.
        step_position: Metres that a tracker may plausibly be away from where the newest pose puts it; a few that are
            farther off are not used to search for neighbours.
        step_orientation: The same for its orientation, radians.
        misfit_position: Metres by which the median tracker may miss its solved place before the pose counts as astray.
        misfit_orientation: The same for its orientation, radians.
        misfit_frames: Astray frames in a row after which the search starts anew from the sensors alone.
    """

    sigma_position: float = 0.003
    sigma_orientation: float = np.deg2rad(0.5)
    solver: SolverSettings = field(default_factory=SolverSettings)
    lost_after: float = 2.0
    step_position: float = 0.2
    step_orientation: float = np.deg2rad(60.0)
    misfit_position: float = 0.05
    misfit_orientation: float = np.deg2rad(12.0)
    misfit_frames: int = 8


class BoneView(NamedTuple):
    """Where sensors' bones are: rotations, and the places of the features' points on them.

    Attributes:
        points: Metres.
        rotations: Bone rotations.
    """

    points: Floats[Array, "sensors 3"]
    rotations: Floats[Array, "sensors 3 3"]


@dataclass(frozen=True, eq=False)
class Wearer:
    """What stays the same from the first sample to the last.

    Attributes:
        skeleton: The wearer's bones.
        mount: The sensors on them.
        reference: The sensor nearest to the trunk.
        points: The point on each sensor's bone that features look at, in the bone's frame.
        scale: Wearer's metres for one metre of the library's body.
    """

    skeleton: Skeleton
    mount: SensorMount
    reference: int
    points: Floats[Array, "sensors 3"]
    scale: float


@dataclass(frozen=True, eq=False)
class TrackerState:
    """What changes from sample to sample.

    Attributes:
        wearer: What does not.
        history: The last solved poses in the world, newest first; fewer than asked for at the start.
        spread: Standard deviations of the newest pose.
        silent: Samples in a row in which no sensor spoke.
        astray: Samples in a row in which the sensors did not fit.
    """

    wearer: Wearer
    history: Floats[Array, "moments dofs"]
    spread: Floats[Array, "dofs"]
    silent: int = 0
    astray: int = 0
