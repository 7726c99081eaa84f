"""Virtual sensors on batches: what orientations, accelerations, positions and bends a moving body's sensors give.

Acceleration at sample i is the second difference of positions over samples i + 1, i - 1 and i - 3. Of a real sensor it
is (f_i + 2 f_(i-1) + f_(i-2)) / 4 of its accelerations f: the same filter over 100 ms, and no look-ahead.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor
from torch.nn.functional import one_hot

from poseloom.methods.prior.channels import RATE, REFERENCE_ORDER, Channel, InputSpec, likeness
from poseloom.sensors.layout import SensorKind, SensorSpec, make_layout
from poseloom.sensors.placement import default_placements
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.training.prior.inputs import assemble
from poseloom.training.prior.kinematics import columns_from_matrix, lengths, matrix_from_rotvec, rotvec_from_matrix
from poseloom.training.prior.motions import LEAD
from poseloom.training.prior.scene import Scene, known_pose, sizes_of
from poseloom.training.prior.sensor_errors import SensorErrors, Wear, draw_dropouts, draw_wear, normal, varying, yaw
from poseloom.training.prior.sets import SensorMasks
from poseloom.training.tensors import tensor


@dataclass(frozen=True, eq=False)
class Batch:
    """What a network receives, and what it should estimate.

    Attributes:
        inputs: (batch, frames, inputs).
        base: (batch, frames, joints, 3, 3): what the network's rotations follow; see `channels`.
        rotations: (batch, frames, joints, 3, 3): bones in the reference's axes as measured.
        velocity: (batch, frames, 3): of the root, the reference's axes, m/s.
        contacts: (batch, frames, 4).
        weights: (batch, frames): 0 where a stretch is padded.
        offsets: (batch, joints, 3): rest offsets of the bodies.
        held: (batch, inputs): what the network receives in the calibration pose.
        held_base: (batch, joints, 3, 3): the base there.
        known: (batch, joints, 3, 3): bones in that pose as asked for, in the reference's axes as measured there.
        errors: (batch, frames, bones): turn of each sensor from its bone, radians; NaN where it does not measure.
        frame: (batch, frames, 3, 3): the reference's axes in the world.
    """

    inputs: Tensor
    base: Tensor
    rotations: Tensor
    velocity: Tensor
    contacts: Tensor
    weights: Tensor
    offsets: Tensor
    held: Tensor
    held_base: Tensor
    known: Tensor
    errors: Tensor
    frame: Tensor


@dataclass(frozen=True, eq=False)
class _Worn:
    """The sensors of a batch, by bone of the network's list.

    Attributes:
        true: (batch, all frames, bones, 3, 3): the bones' rotations.
        measured: The same as the sensors give them.
        places: (batch, all frames, bones, 3): where sensors are.
        there: (batch, frames, bones, channels): what is measured.
        frame: (batch, frames, 3, 3): the reference's axes in the world.
        reference: (batch,): the reference's position in the list.
        oriented: (batch,): whether there is one.
        order: (bones,): place of each bone in `REFERENCE_ORDER`.
        likest: (batch, joints): position in the list of the sensor that each body bone follows.
        last: (batch, frames, bones): the sample at which each was last measured.
    """

    true: Tensor
    measured: Tensor
    places: Tensor
    there: Tensor
    frame: Tensor
    reference: Tensor
    oriented: Tensor
    order: Tensor
    likest: Tensor
    last: Tensor


def measure(scene: Scene, masks: SensorMasks, spec: InputSpec, errors: SensorErrors, generator: Generator) -> Batch:
    """Lets the bodies wear sensors.

    Args:
        scene: What the bodies do.
        masks: What is measured.
        spec: What the network receives.
        errors: How sensors err.
        generator: Of all that is drawn.
    """
    bones = list(spec.indices)
    now = slice(LEAD, scene.positions.shape[1] - 1)
    wear = draw_wear(bones, scene.positions.shape[1], tensor(masks.trackers)[:, bones], errors, generator)
    worn = _put_on(scene, masks, spec, wear, errors, generator)
    back = worn.frame.transpose(-1, -2)
    values = {Channel.ROTATION: columns_from_matrix(back[:, :, None] @ worn.measured[:, now])}
    makers = {
        Channel.ACCELERATION: _accelerations,
        Channel.ANGULAR_RATE: _angular_rates,
        Channel.POSITION: _positions,
    }
    for channel, make in makers.items():
        if channel in spec.channels:
            values[channel] = turn(back[:, :, None], make(worn, wear, errors, generator))
    if Channel.BEND in spec.channels:
        values[Channel.BEND] = _bends(scene, bones, errors, generator)
    values[Channel.RESIDUAL] = wear.residuals[:, None].expand(*values[Channel.ROTATION].shape[:3], 3)
    there = worn.there.clone()
    there[..., Channel.RESIDUAL] = there[..., Channel.ROTATION] & wear.given[:, None, None]
    reference = torch.where(worn.oriented, worn.reference, -1)
    sizes = sizes_of(scene.offsets)
    inputs = assemble(values, there, back[..., 1], reference, sizes, torch.where(wear.given, wear.pose, 0), spec)
    held, held_base, known = _hold(scene, worn, wear, spec, sizes)
    off = lengths(rotvec_from_matrix(worn.true[:, now].transpose(-1, -2) @ worn.measured[:, now]))
    steps = scene.positions[:, now, 0] - scene.positions[:, LEAD - 1 : -2, 0]
    return Batch(
        inputs,
        _base(worn, worn.measured[:, now], back),
        back[:, :, None] @ scene.rotations[:, now],
        turn(back, steps * RATE),
        scene.contacts[:, now],
        scene.weights[:, now],
        scene.offsets,
        held,
        held_base,
        known,
        torch.where(there[..., Channel.ROTATION], off, math.nan),
        worn.frame,
    )


def turn(rotations: Tensor, vectors: Tensor) -> Tensor:
    """Vectors (..., 3) turned by rotations (..., 3, 3)."""
    return (rotations * vectors[..., None, :]).sum(-1)


def _put_on(
    scene: Scene, masks: SensorMasks, spec: InputSpec, wear: Wear, errors: SensorErrors, generator: Generator
) -> _Worn:
    bones = list(spec.indices)
    batch, total = scene.positions.shape[:2]
    frames = total - LEAD - 1
    true = scene.rotations[:, :, bones]
    measured = yaw(wear.heading) @ true @ wear.mounted[:, None] @ matrix_from_rotvec(wear.tissue)
    average = tensor(average_body().offsets.astype(np.float32))
    size = lengths(scene.offsets).sum(1) / lengths(average).sum()
    spots = _spots()[bones] * size[:, None, None]
    spots = spots + normal(generator, errors.place, batch, len(bones), 3) * wear.scale[:, 0]
    places = scene.positions[:, :, bones] + turn(true, spots[:, None].expand(-1, total, -1, -1))
    chosen = tensor(masks.measured)[:, bones]
    away = draw_dropouts(batch, frames, len(bones), errors.dropout, generator)
    there = chosen[:, None] & ~away[..., None]
    oriented = chosen[..., Channel.ROTATION]
    order = torch.tensor([REFERENCE_ORDER.index(bone) for bone in spec.bones])
    reference = torch.where(oriented, order, len(BODY_BONES)).argmin(1)
    last = torch.where(away, 0, torch.arange(frames)[:, None]).cummax(1).values
    frame = _reference_axes(measured[:, LEAD : LEAD + frames], scene, reference, oriented.any(1), last)
    unlike = tensor(likeness()[:, bones].astype(np.float32))
    likest = torch.where(oriented[:, None], unlike, torch.inf).argmin(-1)
    return _Worn(true, measured, places, there, frame, reference, oriented.any(1), order, likest, last)


def _reference_axes(measured: Tensor, scene: Scene, reference: Tensor, oriented: Tensor, last: Tensor) -> Tensor:
    """The reference as measured, the last one while it is missing; the hips' heading where there is none."""
    batch, frames = measured.shape[:2]
    rows = torch.arange(batch)
    held = measured[rows[:, None], last[rows, :, reference], reference[:, None]]
    hips = scene.rotations[:, LEAD : LEAD + frames, 0]
    level = yaw(torch.atan2(hips[..., 0, 2] - hips[..., 2, 0], hips[..., 0, 0] + hips[..., 2, 2]))
    return torch.where(oriented[:, None, None, None], held, level)


def _accelerations(worn: _Worn, wear: Wear, errors: SensorErrors, generator: Generator) -> Tensor:
    """World axes, gravity taken out, headings as wrong as the sensors'."""
    places = worn.places
    felt = (places[:, 4:] - 2 * places[:, 2:-2] + places[:, :-4]) * (RATE / 2) ** 2
    now = slice(LEAD, LEAD + felt.shape[1])
    felt = turn(yaw(wear.heading[:, now]), felt)
    bias = normal(generator, errors.acceleration_bias, len(felt), 1, felt.shape[2], 3) * wear.scale
    felt = felt + turn(worn.measured[:, now], bias.expand_as(felt))
    return felt + normal(generator, errors.acceleration, *felt.shape) * wear.scale


def _angular_rates(worn: _Worn, wear: Wear, errors: SensorErrors, generator: Generator) -> Tensor:
    """Over the last step, world axes."""
    steps = worn.measured[:, LEAD:-1] @ worn.measured[:, LEAD - 1 : -2].transpose(-1, -2)
    turning = rotvec_from_matrix(steps) * RATE
    return turning + normal(generator, errors.rate, *turning.shape) * wear.scale


def _positions(worn: _Worn, wear: Wear, errors: SensorErrors, generator: Generator) -> Tensor:
    """Relative to the anchor, the first bone with a position in the reference's order; the anchor's is its height."""
    places = worn.places[:, LEAD:-1]
    places = places + normal(generator, errors.position, *places.shape) * wear.scale
    first = torch.where(worn.there[..., Channel.POSITION], worn.order, len(BODY_BONES)).argmin(-1)
    anchor = places.gather(2, first[..., None, None].expand(*first.shape, 1, 3))
    floor = anchor.clone()
    floor[..., 1] = (normal(generator, errors.floor, len(places), 1, 1, 1) * wear.scale)[..., 0]
    return places - torch.where(one_hot(first, places.shape[2]).bool()[..., None], floor, anchor)


def _bends(scene: Scene, bones: list[int], errors: SensorErrors, generator: Generator) -> Tensor:
    """Angle by which each bone is bent against its parent, as flex sensors give it."""
    rotations = scene.rotations[:, LEAD:-1]
    parent = [max(int(average_body().parents[bone]), 0) for bone in bones]
    apart = rotations[:, :, parent].transpose(-1, -2) @ rotations[:, :, bones]
    angle = lengths(rotvec_from_matrix(apart), keepdim=True)
    gain = 1 + normal(generator, errors.bend_gain, len(angle), 1, len(bones), 1)
    return gain * angle + errors.bend * varying(len(angle), angle.shape[1], len(bones), 1, generator)


def _hold(scene: Scene, worn: _Worn, wear: Wear, spec: InputSpec, sizes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What a network receives while the calibration pose is held, its base, and the pose in the reference's axes."""
    rows = torch.arange(len(sizes))
    frame = torch.where(worn.oriented[:, None, None], wear.held[rows, worn.reference], torch.eye(3))
    back = frame.transpose(-1, -2)
    chosen = worn.there.any(1)[:, None].clone()
    chosen[..., [Channel.POSITION, Channel.BEND]] = False
    chosen[..., Channel.RESIDUAL] = chosen[..., Channel.ROTATION]
    count = (len(sizes), 1, len(spec.bones))
    still = torch.zeros(*count, 3)
    values = {
        Channel.ROTATION: columns_from_matrix(back[:, None] @ wear.held)[:, None],
        Channel.ACCELERATION: still,
        Channel.ANGULAR_RATE: still,
        Channel.POSITION: still,
        Channel.BEND: still[..., :1],
        Channel.RESIDUAL: wear.residuals[:, None],
    }
    reference = torch.where(worn.oriented, worn.reference, -1)
    inputs = assemble(values, chosen, back[:, None, :, 1], reference, sizes, wear.pose, spec)[:, 0]
    base = torch.where(
        worn.oriented[:, None, None, None], back[:, None] @ wear.held[rows[:, None], worn.likest], torch.eye(3)
    )
    return inputs, base, back[:, None] @ known_pose(wear.pose)


def _base(worn: _Worn, measured: Tensor, back: Tensor) -> Tensor:
    """For each body bone the likest sensor's rotation as last measured, in the reference's axes."""
    batch, frames = measured.shape[:2]
    rows, sensors = torch.arange(batch)[:, None, None], worn.likest[:, None].expand(-1, frames, -1)
    held = measured[rows, worn.last.gather(2, sensors), sensors]
    return torch.where(worn.oriented[:, None, None, None, None], back[:, :, None] @ held, torch.eye(3))


def _spots() -> Tensor:
    """Where sensors sit on the average body's bones, by body bone."""
    layout = make_layout("all", [SensorSpec(bone, SensorKind.IMU, bone) for bone in BODY_BONES], RATE)
    places = np.stack([placement.p_bone_sensor for placement in default_placements(layout, average_body())])
    return tensor(places.astype(np.float32))
