"""Parameters and state that all tracker methods share."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.methods.gliding import GlideSettings
from poseloom.skeleton.skeleton import Skeleton
from poseloom.solve import SensorMount, SolverSettings


@dataclass(frozen=True)
class GateSettings:
    """When a tracker's reading is rejected, and how it is taken up again.

    Attributes:
        step_position: Metres that a tracker may be away from where its own movement leads to.
        step_orientation: Radians that it may turn from one sample to the next.
        patience: Samples in a row for which a tracker that stays where it jumped to is rejected.
        fading: Share of the difference that is left a sample after a tracker came back.
        glide_position: Most metres by which it shrinks in a sample.
        glide_orientation: The same for the orientation, radians.
        hold_position: Metres of standard deviation, times the samples it is missing, with which a lost tracker is held
            where the pose carries it.
        hold_orientation: The same for its orientation, radians.
        hold_samples: Samples after which it is let go.
    """

    step_position: float = 0.15
    step_orientation: float = np.deg2rad(50.0)
    patience: int = 4
    fading: float = 0.8
    glide_position: float = 0.08
    glide_orientation: float = np.deg2rad(25.0)
    hold_position: float = 0.02
    hold_orientation: float = np.deg2rad(5.0)
    hold_samples: int = 40


@dataclass(frozen=True)
class MisfitSettings:
    """When sensors that move soundly contradict the library, or the body, and what is made of it.

    Attributes:
        contradiction: Robust weight below which a reading contradicts the prediction.
        widening_joint: Standard deviation of a joint's rotation, radians, that is added to a wrong prediction's.
        widening_root: The same for the root, metres and radians.
        iterations: Most steps to a pose that fits the sensors all the same.
        impossible_position: Metres by which a sensor is missed even then, from which on it is not believed.
        impossible_orientation: The same for its orientation, radians.
    """

    contradiction: float = 0.5
    widening_joint: float = 0.05
    widening_root: float = 0.02
    iterations: int = 50
    impossible_position: float = 0.1
    impossible_orientation: float = np.deg2rad(30.0)


@dataclass(frozen=True)
class TrackerSettings:
    """What every tracker method needs to know.

    Attributes:
        sigma_position: Standard deviation of a tracker's position, metres.
        sigma_orientation: Standard deviation of a tracker's orientation, radians.
        solver: How the pose is solved for.
        misfit: When sensors that the gate took contradict the library or the body.
        gate: When a tracker is rejected.
        glide: How the figure follows where the search, begun anew, finds the pose.
        lost_after: Seconds of silence of all sensors after which the pose means little.
        anew_after: Seconds of such silence after which the search starts anew from the sensors alone.
        misfit_position: Metres by which most trackers may miss their solved places before the pose counts as astray.
        misfit_orientation: The same for their orientations, radians.
        misfit_frames: Astray frames in a row after which the search starts anew from the sensors alone.
    """

    sigma_position: float = 0.003
    sigma_orientation: float = np.deg2rad(0.5)
    solver: SolverSettings = field(default_factory=SolverSettings)
    misfit: MisfitSettings = field(default_factory=MisfitSettings)
    gate: GateSettings = field(default_factory=GateSettings)
    glide: GlideSettings = field(default_factory=GlideSettings)
    lost_after: float = 2.0
    anew_after: float = 0.5
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
