"""The method `under-the-head`: the body stands as it rests, under the head's tracker."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poseloom import Frame, Reconstructor, Skeleton
from poseloom.methods import Health, HealthState, MethodEntry
from poseloom.methods.registry import Needs
from poseloom.sensors import Placement, Sample, SensorKind, SensorLayout
from poseloom.skeleton import Pose


@dataclass(frozen=True, eq=False)
class Standing:
    """Everything that changes from sample to sample."""

    skeleton: Skeleton
    q: np.ndarray


class UnderTheHead(Reconstructor[Standing]):
    """Puts the resting body under the head's tracker."""

    any_rate = True

    def __init__(self, layout: SensorLayout) -> None:
        self.layout = layout
        self.head = layout.index("head")

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> Standing:
        return Standing(skeleton, np.zeros(skeleton.size))

    def step(self, state: Standing, sample: Sample) -> tuple[Standing, Frame]:
        place = sample.positions[self.head]
        q = state.q
        if np.isfinite(place).all():
            rest = state.skeleton.rest_positions()[state.skeleton.index("head")]
            q = np.concatenate([place - rest, state.q[3:]])  # a new array: step changes neither argument
        silent = [not np.isfinite(each).all() for each in sample.positions]
        missing = tuple(name for name, gone in zip(self.layout.names, silent, strict=True) if gone)
        state_of = HealthState.COASTING if silent[self.head] else HealthState.DEGRADED if missing else HealthState.OK
        frame = Frame(sample.time, Pose(state.skeleton, q), np.full(len(q), 0.5), Health(state_of, missing))
        return Standing(state.skeleton, q), frame


METHOD = MethodEntry(
    "the resting body under the head's tracker; an example",
    SensorKind.TRACKER,
    Needs.NOTHING,
    lambda layout, library, model: UnderTheHead(layout),
)
