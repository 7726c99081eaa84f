"""The world turned and moved so that the wearer stands at its origin and faces +Z."""

from dataclasses import dataclass, replace

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.rotations import heading_angle, matrix_from_rotvec, quat_from_rotvec, quat_multiply
from poseloom.sensors import Sample


@dataclass(frozen=True)
class Alignment:
    """From the sensors' world to the session's: first moved, then turned about the vertical.

    Attributes:
        heading: Radians by which the sensors' world is turned back.
        x: Metres of the session's origin in the sensors' world.
        z: The same along Z.
    """

    heading: float = 0.0
    x: float = 0.0
    z: float = 0.0


NO_ALIGNMENT = Alignment()


def aligned(sample: Sample, alignment: Alignment) -> Sample:
    """The sample in the session's world. What sensors say in their own frames stays."""
    if alignment == NO_ALIGNMENT:
        return sample
    back = np.array([0.0, -alignment.heading, 0.0])
    moved = sample.positions - np.array([alignment.x, 0.0, alignment.z])
    turned = quat_multiply(np.broadcast_to(quat_from_rotvec(back), sample.quats_wxyz.shape), sample.quats_wxyz)
    return replace(sample, positions=frozen_float(moved @ matrix_from_rotvec(back).T), quats_wxyz=frozen_float(turned))


def facing_ahead(alignment: Alignment, q: Floats[Array, "dofs"]) -> Alignment:
    """The alignment that puts a wearer at the origin who has this pose vector under the present alignment."""
    heading = float(heading_angle(quat_from_rotvec(q[3:6])))
    sine, cosine = np.sin(alignment.heading), np.cos(alignment.heading)
    x, z = float(q[0]), float(q[2])
    return Alignment(
        heading=float(np.arctan2(np.sin(alignment.heading + heading), np.cos(alignment.heading + heading))),
        x=float(alignment.x + cosine * x + sine * z),
        z=float(alignment.z + cosine * z - sine * x),
    )
