"""A method of your own: the body stands as it rests, under the head's tracker. A starting point, not a good method.

python examples/04_your_own_method.py
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import poseloom
from poseloom.methods import Frame, Health, HealthState, Reconstructor
from poseloom.sensors import Placement, Sample, SensorLayout
from poseloom.skeleton.motion import Pose


@dataclass(frozen=True, eq=False)
class Standing:
    """Everything that changes from sample to sample: here the last pose."""

    skeleton: poseloom.Skeleton
    q: np.ndarray


class UnderTheHead(Reconstructor[Standing]):
    """Puts the resting body under the head's tracker."""

    def __init__(self, layout: SensorLayout) -> None:
        self.layout = layout
        self.head = layout.index("head")

    def start(self, skeleton: poseloom.Skeleton, placements: Sequence[Placement]) -> Standing:
        return Standing(skeleton, np.zeros(skeleton.size))

    def step(self, state: Standing, sample: Sample) -> tuple[Standing, Frame]:
        place = sample.positions[self.head]
        q, heard = state.q, bool(np.isfinite(place).all())
        if heard:
            rest = state.skeleton.rest_positions()[state.skeleton.index("head")]
            q = np.concatenate([place - rest, state.q[3:]])  # a new array: step changes neither argument
        health = Health() if heard else Health(HealthState.COASTING, ("head",))
        frame = Frame(sample.time, Pose(state.skeleton, q), np.full(len(q), 0.5), health)
        return Standing(state.skeleton, q), frame


def main() -> None:
    recording = poseloom.simulate_trackers(poseloom.sample_motions()["walk"], poseloom.layout("six-trackers"))
    assert recording.truth is not None  # it was simulated
    for method in (UnderTheHead(recording.layout), poseloom.InverseKinematics(recording.layout)):
        result = poseloom.reconstruct(method, recording)
        error = poseloom.evaluate_motion(recording.truth, result.motion)
        print(f"{type(method).__name__:20} {error['joint_position_cm']:6.2f} cm  {error['joint_angle_deg']:6.2f}°")


if __name__ == "__main__":
    main()
