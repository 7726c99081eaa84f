"""How virtual sensors on batches err: what is drawn for each stretch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor
from torch.nn.functional import interpolate

from poseloom.skeleton.body import BODY_BONES
from poseloom.training.prior.kinematics import matrix_from_rotvec, rotvec_from_matrix
from poseloom.training.prior.scene import known_pose
from poseloom.training.tensors import tensor

_FOREARMS = tuple(BODY_BONES.index(f"{side}{bone}") for side in ("left", "right") for bone in ("LowerArm", "Hand"))


@dataclass(frozen=True)
class SensorErrors:
    """Standard deviations of errors at scale 1, in radians and SI units.

    Attributes:
        mounting: Constant turn on the bone, each axis.
        heading: Constant turn about the vertical, of sensors without positions.
        heading_drift: The same, slowly varying.
        tissue: Varying turn on the bone, each axis.
        twist: Constant turn of a forearm's sensor about the forearm.
        twist_varying: The same, varying.
        acceleration: White noise of each sample.
        acceleration_bias: Constant error in the sensor's axes.
        rate: White noise of the angular rate.
        place: Constant offset of the sensor on its bone, each axis.
        position: White noise of a tracker's position.
        floor: Error of the floor's height.
        bend_gain: Relative error of a flex sensor's scale.
        bend: Varying error of a flex sensor.
        tracker_share: Share of the turns that trackers have.
        pose: By how much people miss a calibration pose, each bone and axis.
        scales: All are multiplied, for each stretch, by a factor drawn evenly from this range.
        dropout: Share of sensors that fall out once in a stretch.
        calibrated: Share of stretches whose calibration pose the network receives.
        taken_out: Share of those in which the sensors' turns on the bones were found in that very pose.
    """

    mounting: float = math.radians(3.0)
    heading: float = math.radians(3.0)
    heading_drift: float = math.radians(1.0)
    tissue: float = math.radians(2.5)
    twist: float = math.radians(7.0)
    twist_varying: float = math.radians(6.0)
    acceleration: float = 0.15
    acceleration_bias: float = 0.1
    rate: float = 0.02
    place: float = 0.02
    position: float = 0.004
    floor: float = 0.02
    bend_gain: float = 0.1
    bend: float = 0.07
    tracker_share: float = 0.2
    pose: float = math.radians(4.0)
    scales: tuple[float, float] = (0.0, 1.5)
    dropout: float = 0.1
    calibrated: float = 0.6
    taken_out: float = 0.6


@dataclass(frozen=True, eq=False)
class Wear:
    """How each stretch's sensors sit, and what its calibration pose showed.

    Attributes:
        scale: (batch, 1, 1, 1): of all errors.
        heading: (batch, frames, bones): turn about the vertical.
        mounted: (batch, bones, 3, 3): constant turn on the bone.
        tissue: (batch, frames, bones, 3): varying turn on the bone.
        pose: (batch,): the calibration pose.
        given: (batch,): whether the network receives it.
        held: (batch, bones, 3, 3): measured in that pose, facing +Z.
        residuals: (batch, bones, 3): from the known pose to what was measured.
    """

    scale: Tensor
    heading: Tensor
    mounted: Tensor
    tissue: Tensor
    pose: Tensor
    given: Tensor
    held: Tensor
    residuals: Tensor


def draw_wear(bones: Sequence[int], frames: int, trackers: Tensor, errors: SensorErrors, generator: Generator) -> Wear:
    """Draws how sensors sit on bones.

    Args:
        bones: Their indices in the body.
        frames: Of a stretch.
        trackers: (batch, bones): which are trackers.
        errors: How large errors are.
        generator: Of all that is drawn.
    """
    batch, count = trackers.shape
    scale = uniform(generator, *errors.scales, batch)[:, None, None, None]
    share = torch.where(trackers, errors.tracker_share, 1.0)[:, None, :, None] * scale
    heading = normal(generator, errors.heading, batch, 1, count, 1)
    heading = heading + errors.heading_drift * varying(batch, frames, count, 1, generator)
    heading = (heading * share * ~trackers[:, None, :, None])[..., 0]
    constant = normal(generator, errors.mounting, batch, 1, count, 3)
    tissue = errors.tissue * varying(batch, frames, count, 3, generator)
    forearm = torch.tensor([float(bone in _FOREARMS) for bone in bones])[:, None] * torch.tensor([1.0, 0.0, 0.0])
    constant = constant + forearm * normal(generator, errors.twist, batch, 1, count, 1)
    tissue = tissue + forearm * errors.twist_varying * varying(batch, frames, count, 1, generator)
    mounted = matrix_from_rotvec(constant * share)[:, 0]

    pose = tensor(generator.integers(1, 3, batch))
    known = known_pose(pose)[:, list(bones)]
    missed = matrix_from_rotvec(normal(generator, errors.pose, batch, count, 3) * scale[:, 0])
    turned = yaw(heading[:, 0]) @ known @ missed
    given = tensor(generator.random(batch) < errors.calibrated)
    # Sensor-to-bone found in the pose: what was measured there counts as the known pose, misses and all.
    found = (given & tensor(generator.random(batch) < errors.taken_out))[:, None, None, None]
    mounted = torch.where(found, turned.transpose(-1, -2) @ known, mounted)
    held = turned @ mounted
    residuals = rotvec_from_matrix(known.transpose(-1, -2) @ held)
    return Wear(scale, heading, mounted, tissue * share, pose, given, held, residuals)


def draw_dropouts(batch: int, frames: int, count: int, share: float, generator: Generator) -> Tensor:
    """(batch, frames, sensors): which samples are missing, in one span of up to two seconds a sensor at most."""
    hit = generator.random((batch, count)) < share
    begin = generator.integers(0, frames, (batch, count))
    length = generator.integers(2, 80, (batch, count))
    at = np.arange(frames)[None, :, None]
    return tensor(hit[:, None] & (at >= begin[:, None]) & (at < (begin + length)[:, None]))


def yaw(angle: Tensor) -> Tensor:
    """Rotations about the vertical (..., 3, 3)."""
    return matrix_from_rotvec(angle[..., None] * torch.tensor([0.0, 1.0, 0.0]))


def varying(batch: int, frames: int, sensors: int, axes: int, generator: Generator) -> Tensor:
    """(batch, frames, sensors, axes) of standard deviation about 1, varying within quarter seconds and seconds."""
    total = torch.zeros(batch, frames, sensors * axes)
    for every in (10, 80):
        knots = tensor(generator.normal(size=(batch, sensors * axes, frames // every + 3)).astype(np.float32))
        line = interpolate(knots, size=knots.shape[-1] * every, mode="linear", align_corners=False)
        begin = every // 2 + int(generator.integers(every))
        total += 0.85 * line[:, :, begin : begin + frames].transpose(1, 2)
    return total.reshape(batch, frames, sensors, axes)


def normal(generator: Generator, deviation: float, *shape: int) -> Tensor:
    """Normal numbers as a tensor."""
    return tensor((deviation * generator.standard_normal(shape, dtype=np.float32)).astype(np.float32))


def uniform(generator: Generator, low: float, high: float, *shape: int) -> Tensor:
    """Evenly drawn numbers as a tensor."""
    return tensor(generator.uniform(low, high, shape).astype(np.float32))
