"""Where a body's soles are, whatever its size, and which feet stand in a guided pose."""

from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.calibration.body_size import BodySizeModel
from poseloom.calibration.poses import sole_heights
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.contacts import sole_points

_STANDING = 0.05
"""Metres by which a standing foot may be higher than the other in a guided pose."""


@dataclass(frozen=True, eq=False)
class SoleModel:
    """Left heel, left toe, right heel and right toe of a body-size model's bodies: `local + coefficients . by_size`.

    Attributes:
        bones: Index of the bone of each point.
        local: On the mean body, metres in their bones' frames.
        by_size: Their change with each coefficient.
    """

    bones: Ints[Array, "4"]
    local: Floats[Array, "4 3"]
    by_size: Floats[Array, "components 4 3"]


def sole_model(model: BodySizeModel) -> SoleModel:
    """The sole points of a model's bodies. They scale with the foot, whose direction is the same in all bodies."""

    def points(coefficients: Floats[Array, "components"]) -> Floats[Array, "4 3"]:
        body = model.body_of(coefficients)
        return np.concatenate([np.stack(sole_points(body, side)) for side in ("left", "right")])

    mean = points(np.zeros(model.size))
    bones = [BODY_BONES.index(f"{side}{bone}") for side in ("left", "right") for bone in ("Foot", "Toes")]
    by_size = [points(unit) - mean for unit in np.eye(model.size)]
    return SoleModel(np.array(bones, dtype=np.int64), mean, np.array(by_size).reshape(model.size, 4, 3))


def standing_feet(guided: Floats[Array, "holds dofs"]) -> Bools[Array, "holds 2"]:
    """Which feet, left and right, stand in guided poses: the lower one, and the other if nearly as low."""
    lowest = np.stack([sole_heights(average_body(), q).min(axis=1) for q in guided])
    return np.asarray(lowest < lowest.min(axis=1, keepdims=True) + _STANDING)
