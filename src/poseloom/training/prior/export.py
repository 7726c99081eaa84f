"""From a trained prior to the file that runs without torch, with sigma set by people who were not trained on."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import nn

from poseloom.methods.prior.channels import RATE
from poseloom.methods.prior.model_file import write_prior
from poseloom.methods.prior.network import PriorNetwork
from poseloom.training.prior.judging import Conditions, judge, judging_batch, sigma_factors
from poseloom.training.prior.loop import SPECS
from poseloom.training.prior.network import PriorGru
from poseloom.training.prior.people import Role, role_of
from poseloom.training.prior.sets import NAMED_SETS
from poseloom.training.prior.shards import Shard

CONDITIONS: Mapping[str, tuple[Conditions, float]] = {
    "noisy": (Conditions(), 0.0),
    "clean": (Conditions(scale=0.0), 0.0),
    "pose shown": (Conditions(calibrated=True), 0.0),
    "pose shown, half corrected": (Conditions(calibrated=True), 0.5),
    "aligned in the pose": (Conditions(calibrated=True, taken_out=True), 0.0),
    "aligned in the pose, half corrected": (Conditions(calibrated=True, taken_out=True), 0.5),
    "pose hit exactly, half corrected": (Conditions(calibrated=True, pose_scale=0.0), 0.5),
}
"""Under what networks are measured, and the share of the network's own error at the pose that is corrected."""


_MEASURED: Mapping[str, tuple[str, ...]] = {
    "six": ("six-imus",),
    "any": ("six-imus", "six-trackers", "three-trackers", "pelvis-wrists", "wrist-pocket", "slimevr-6", "flex-four"),
}
"""Sets by which sigma is set and which the card tells of."""


def export_prior(
    network: PriorGru, kind: str, shards: Sequence[Shard], path: Path, seed: int, curve: Sequence[Mapping[str, float]]
) -> PriorNetwork:
    """Writes the file of a trained prior.

    Args:
        network: The network.
        kind: Its kind: "six" or "any".
        shards: Everybody's; those who validate set sigma, those who were trained on are told in the card.
        path: The file.
        seed: Of its training.
        curve: How training went.
    """
    validating = [shard for shard in shards if role_of(shard.person) is Role.VALIDATE]
    trained = [shard for shard in shards if role_of(shard.person) is Role.TRAIN]
    batches = [
        judging_batch(shard, SPECS[kind], NAMED_SETS[name][1], Conditions(calibrated=calibrated), most=8, seed=5)
        for name in _MEASURED[kind]
        for shard in validating
        for calibrated in (False, True)
    ]
    factors = sigma_factors(network, batches)
    card = model_card(network, kind, trained, validating, curve)
    held = PriorNetwork(SPECS[kind], weights_of(network), factors, card)
    write_prior(held, path, seed, data_digest(trained))
    return held


def weights_of(network: nn.Module) -> dict[str, NDArray[Any]]:
    """A network's weights as arrays."""
    return {name: value.detach().numpy() for name, value in network.state_dict().items()}


def model_card(
    network: PriorGru,
    kind: str,
    trained: Sequence[Shard],
    validating: Sequence[Shard],
    curve: Sequence[Mapping[str, float]],
) -> dict[str, Any]:
    """What one should know of a trained prior."""
    minutes = {shard.person: round(len(shard.q) / RATE / 60, 2) for shard in trained if len(shard.q)}
    return {
        "purpose": "a Gaussian over the pose from body-worn sensors, for poseloom's solve; not for judging people",
        "data": "CMU Graphics Lab Motion Capture Database (mocap.cs.cmu.edu), NSF EIA-0196217",
        "licence": "the data is free for all uses, not to be resold as data; the weights come under poseloom's licence",
        "people": minutes,
        "minutes": round(sum(minutes.values()), 1),
        "who is missing": (
            "children, old people, people with impaired gait, wheelchair users; sitting, lying and working with "
            "tools are rare; subject 91 moves on subject 35's skeleton"
        ),
        "left out": "CMU 02, 13, 35 and HDM05 bd (test), CMU 14 and HDM05 mm (validation), cmu_expmap (nameless parts)",
        "parameters": sum(each.numel() for each in network.parameters()),
        "training": {"steps": int(curve[-1]["step"]), "hours": round(curve[-1]["seconds"] / 3600, 2)} if curve else {},
        "validation": {name: measure_people(network, kind, validating, [name], most=12) for name in _MEASURED[kind]},
    }


def measure_people(
    network: nn.Module,
    kind: str,
    shards: Sequence[Shard],
    sets: Sequence[str],
    conditions: Conditions | None = None,
    share: float = 0.0,
    most: int = 24,
) -> dict[str, dict[str, float]]:
    """A network's measures by person, mean over sets of sensors."""
    told: dict[str, dict[str, float]] = {}
    for shard in shards:
        each = [
            judge(
                network,
                judging_batch(shard, SPECS[kind], NAMED_SETS[name][1], conditions or Conditions(), most, seed=11),
                share,
            )
            for name in sets
        ]
        told[shard.person] = {what: round(float(np.mean([one[what] for one in each])), 3) for what in each[0]}
    return told


def data_digest(shards: Sequence[Shard]) -> str:
    """A digest of what was trained on."""
    digest = hashlib.sha256()
    for shard in shards:
        digest.update(shard.person.encode())
        digest.update(shard.q.tobytes())
    return digest.hexdigest()
