"""Flex methods: a fitted network that hears four bends, live."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.methods.flex.angles import angle_columns
from poseloom.methods.flex.hearing import Hearing, Moment, hear_first, hear_next
from poseloom.methods.flex.model_file import FlexModel, read_flex_model
from poseloom.methods.flex.step_network import Memory
from poseloom.sensors import Placement, Sample, SensorStatus, layout
from poseloom.sensors.flex_range import FlexRange, FlexRangeState
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.skeleton import Skeleton

RATE = 50.0
"""Ticks a second of all flex networks."""

_LOST_AFTER = 2.0
"""Seconds without any sensor after which the pose means little."""


@dataclass(frozen=True, eq=False)
class FlexState:
    """What changes as samples come.

    Attributes:
        skeleton: The wearer's.
        ranges: What is known of each sensor's range.
        hearing: Where the network's clock stands; None before the first sample.
        memory: What the network remembers.
        heard_at: Device time at which any sensor was last believed.
    """

    skeleton: Skeleton
    ranges: FlexRangeState
    hearing: Hearing | None
    memory: Memory
    heard_at: float


class FlexNetwork(Reconstructor[FlexState]):
    """Tells 39 joint angles from four flex sensors by a fitted network; samples may come at 20 to 200 a second.

    The network's clock ticks fifty times a second; samples in between are joined by straight lines up to the newest
    one. Where a sample lies between two ticks the network looks ahead to it without moving its clock, so every sample
    has its own frame. The hips are not observed: the root stands still, upright, and its spread says so.

    Args:
        model: The fitted network.
        ranges: How the sensors' ranges are learnt.
    """

    any_rate = True

    def __init__(self, model: FlexModel, ranges: FlexRange = FlexRange()) -> None:  # noqa: B008 - frozen
        self.model, self.ranges = model, ranges
        self.layout = layout("flex-four")
        self.delay = 0

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> FlexState:
        """The state before the first sample."""
        return FlexState(skeleton, self.ranges.start(len(self.layout)), None, self.model.network.start(), -np.inf)

    def step(self, state: FlexState, sample: Sample) -> tuple[FlexState, Frame | None]:
        """Takes in one sample; changes neither argument.

        Raises:
            MethodError: if the sample's time does not increase.
        """
        ranges, readings = self.ranges.step(state.ranges, sample.time, sample.counts)
        if state.hearing is None:
            hearing, moments = hear_first(sample.time, readings.values)
            between = None
        else:
            hearing, moments, between = hear_next(state.hearing, sample.time, readings.values, RATE)
        memory, answer = state.memory, None
        for number, moment in enumerate(moments):
            memory, *answer = self._hear(memory, moment, state.hearing is None and number == 0)
        if between is not None:
            _, *answer = self._hear(memory, between, False)
        assert answer is not None  # a sample is a tick or lies between two
        believed = readings.status == SensorStatus.OK
        heard_at = sample.time if believed.any() else max(state.heard_at, hearing.tick - _LOST_AFTER - 1)
        after = replace(state, ranges=ranges, hearing=hearing, memory=memory, heard_at=heard_at)
        frame = Frame(
            sample.time,
            self._pose(state.skeleton, answer[0]),
            self._spread(answer[1]),
            self._health(believed.tolist(), sample.time - heard_at),
        )
        return after, frame

    def _hear(
        self, memory: Memory, moment: Moment, fresh: bool
    ) -> tuple[Memory, Floats[Array, "angles"], Floats[Array, "angles"]]:
        return self.model.network.step(memory, moment.values, moment.measured, fresh)

    def _pose(self, skeleton: Skeleton, angles: Floats[Array, "angles"]) -> Pose:
        q = self.model.rest.copy()
        q[angle_columns()] = angles
        return Pose(skeleton, frozen_float(q))

    def _spread(self, angles: Floats[Array, "angles"]) -> Floats[Array, "dofs"]:
        spread = self.model.rest_spread.copy()
        spread[angle_columns()] = angles
        return frozen_float(spread)

    def _health(self, believed: Sequence[bool], silent: float) -> Health:
        doubted = tuple(name for name, sound in zip(self.layout.names, believed, strict=True) if not sound)
        if not doubted:
            return Health()
        if any(believed):
            return Health(HealthState.DEGRADED, doubted)
        return Health(HealthState.LOST if silent > _LOST_AFTER else HealthState.COASTING, doubted)


def load_flex_model(path: Path, method: str) -> FlexNetwork:
    """A method from its model's file.

    Raises:
        FormatError: if the file holds no such model.
    """
    return FlexNetwork(read_flex_model(path, method))


SHIPPED_MODEL = Path(__file__).with_name("flex-scales.npz")
"""The model that travels with the package, fitted to CMU's recordings."""

load_flex_lstm = partial(load_flex_model, method="flex-lstm")
load_flex_scales = partial(load_flex_model, method="flex-scales")
