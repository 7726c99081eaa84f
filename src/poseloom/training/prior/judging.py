"""How good a network is on people who are left out: the field's measures by person and set of sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from poseloom.arrays import Array, Floats
from poseloom.evaluation.sparse_inertial import sparse_inertial_measures
from poseloom.methods.prior.channels import RATE, InputSpec
from poseloom.rotations import matrix_from_rotvec, rotvec_from_matrix
from poseloom.skeleton.body import average_body
from poseloom.training.prior.motions import LEAD, Motions, MotionSettings, cut_stretch
from poseloom.training.prior.network import split
from poseloom.training.prior.scene import make_scene
from poseloom.training.prior.sensor_errors import SensorErrors
from poseloom.training.prior.sets import SensorSet, fixed_masks
from poseloom.training.prior.shards import Shard
from poseloom.training.prior.virtual_sensors import Batch, measure
from poseloom.training.tensors import tensor

_SECONDS = 10.0
_SHORTEST = 2.0
_AS_RECORDED = MotionSettings(joint_rad=0.0)


@dataclass(frozen=True)
class Conditions:
    """Under what a network is judged.

    Attributes:
        scale: Of all sensor errors; 1.1 gives 8 degrees of mean error on six IMUs.
        calibrated: Whether people stood in a calibration pose.
        taken_out: Whether sensors' turns on the bones were found in that pose; else the pose is only shown.
        pose_scale: Of the degrees by which the pose is missed.
    """

    scale: float = 1.1
    calibrated: bool = False
    taken_out: bool = False
    pose_scale: float = 1.0

    def errors(self) -> SensorErrors:
        """As sensors err then."""
        usual = SensorErrors()
        return replace(
            usual, scales=(self.scale, self.scale), dropout=0.0, calibrated=float(self.calibrated),
            taken_out=float(self.taken_out), pose=usual.pose * self.pose_scale,
        )  # fmt: skip


def windows(shard: Shard, most: int) -> Motions:
    """Stretches of ten seconds, or shorter clips whole, evenly chosen among all of a person's, at most so many."""
    length = round(_SECONDS * RATE)
    spans = [
        (int(start), int(min(start + length + LEAD + 1, stop)))
        for first, stop in shard.bounds
        for start in range(int(first), int(stop), length)
    ]
    spans = [span for span in spans if span[1] - span[0] >= _SHORTEST * RATE]
    chosen = [spans[int(i)] for i in np.linspace(0, len(spans) - 1, min(most, len(spans)))]
    places = np.arange(length + LEAD + 1, dtype=np.float64)
    cut = [cut_stretch(shard.q[a:b], shard.contacts[a:b], places) for a, b in chosen]
    q, contacts, weights = (tensor(np.stack(parts)) for parts in zip(*cut, strict=True))
    return Motions(q[..., 3:].reshape(*q.shape[:2], -1, 3), q[..., :3], contacts, weights)


def judging_batch(
    shard: Shard, spec: InputSpec, worn: SensorSet, conditions: Conditions, most: int = 24, seed: int = 0
) -> Batch:
    """A left-out person's stretches with sensors, the same at each call; the average body."""
    generator = np.random.default_rng([seed, 77])
    motions = windows(shard, most)
    scene = make_scene(motions, _AS_RECORDED, generator, size_scale=0.0)
    return measure(scene, fixed_masks(len(motions.root), worn), spec, conditions.errors(), generator)


def half_correction(network: nn.Module, batch: Batch, share: float = 0.5) -> Tensor:
    """(batch, 1, joints, 3, 3): by how much to turn the network's bones, from what it estimates of a held pose."""
    with torch.inference_mode():
        still = split(
            network(batch.held[:, None].expand(-1, round(1.5 * RATE), -1))[:, -1:], batch.held_base[:, None]
        ).rotations[:, 0]
    off = rotvec_from_matrix((still.transpose(-1, -2) @ batch.known).numpy().astype(np.float64))
    return tensor(matrix_from_rotvec(share * off).astype(np.float32))[:, None]


def judge(network: nn.Module, batch: Batch, share: float = 0.0) -> dict[str, float]:
    """Mean measures over all frames of a batch.

    Args:
        network: Its raw outputs.
        batch: What it receives.
        share: Of the constant difference at the calibration pose by which bones are turned.
    """
    with torch.inference_mode():
        estimate = split(network(batch.inputs), batch.base)
        rotations = estimate.rotations
        if share > 0:
            rotations = rotations @ half_correction(network, batch, share)
    kept = batch.weights.numpy() > 0
    truth = batch.rotations.numpy()[kept].astype(np.float64)
    told = rotations.numpy()[kept].astype(np.float64)
    measures = sparse_inertial_measures(truth, told, average_body())
    off = rotvec_from_matrix(told.swapaxes(-1, -2) @ truth)
    sigma = np.exp(estimate.log_sigma.numpy()[kept])[..., None]
    speed = np.linalg.norm((estimate.velocity - batch.velocity).numpy()[kept], axis=-1)
    return {
        "sip_deg": float(measures.sip_deg.mean()),
        "angle_deg": float(measures.angle_deg.mean()),
        "position_cm": float(measures.position_cm.mean()),
        "root_speed_error": float(speed.mean()),
        "within_1_sigma": float((np.abs(off) < sigma).mean()),
        "within_2_sigma": float((np.abs(off) < 2 * sigma).mean()),
    }


def sigma_factors(network: nn.Module, batches: Sequence[Batch]) -> Floats[Array, "joints"]:
    """By how much to multiply each bone's sigma for the errors of left-out people to be as large as it says."""
    squares: list[Floats[Array, "frames joints"]] = []
    for batch in batches:
        with torch.inference_mode():
            estimate = split(network(batch.inputs), batch.base)
        kept = batch.weights.numpy() > 0
        truth, told = (each.numpy()[kept].astype(np.float64) for each in (batch.rotations, estimate.rotations))
        off = rotvec_from_matrix(told.swapaxes(-1, -2) @ truth)
        sigma = np.exp(estimate.log_sigma.numpy()[kept].astype(np.float64))
        squares.append((off**2).mean(axis=-1) / sigma**2)
    # The median would suit a normal distribution; the mean of what lies below four sigma is what a solver feels.
    return np.sqrt(np.minimum(np.concatenate(squares), 16.0).mean(axis=0))


def mean_measures(by_person: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The mean over people."""
    return {name: float(np.mean([measures[name] for measures in by_person])) for name in by_person[0]}
