"""The baseline that every method must beat: one pose, whatever the sensors say."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.methods.contract import Frame, Health, Reconstructor
from poseloom.sensors import Placement, Sample, SensorLayout
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.skeleton import Skeleton

CONSTANT_POSE = "constant-pose"
"""Its name in an evaluation."""

_ARM_DOWN = np.deg2rad(75.0)
_SPREAD = 1.0


@dataclass(frozen=True, eq=False)
class ConstantState:
    """The wearer, who stands.

    Attributes:
        skeleton: The bones.
        q: The one pose.
    """

    skeleton: Skeleton
    q: Floats[Array, "dofs"]


class ConstantPose(Reconstructor[ConstantState]):
    """Upright, arms hanging, on the floor; where trackers give places, above the mean of theirs.

    Args:
        layout: Any sensors.
    """

    any_rate = True

    def __init__(self, layout: SensorLayout) -> None:
        self.layout = layout
        self.delay = 0

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> ConstantState:
        """See `Reconstructor.start`."""
        q = np.zeros(skeleton.size)
        q[1] = -float(skeleton.rest_positions()[:, 1].min())
        for side, sign in (("left", -1.0), ("right", 1.0)):
            q[3 + 3 * skeleton.index(f"{side}UpperArm") + 2] = sign * _ARM_DOWN
        return ConstantState(skeleton, frozen_float(q))

    def step(self, state: ConstantState, sample: Sample) -> tuple[ConstantState, Frame | None]:
        """See `Reconstructor.step`."""
        places = sample.positions[np.isfinite(sample.positions).all(axis=1)]
        q = state.q.copy()
        if len(places):
            q[[0, 2]] = places[:, [0, 2]].mean(axis=0)
        following = ConstantState(state.skeleton, frozen_float(q))
        return following, Frame(sample.time, Pose(state.skeleton, following.q), np.full(len(q), _SPREAD), Health())
