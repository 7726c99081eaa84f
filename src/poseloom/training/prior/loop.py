"""The training loop: steps drawn from a seed and their number alone, checkpoints, a loss curve as JSON."""

import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor, nn

from poseloom.errors import FormatError
from poseloom.formats.atomic import atomic_file
from poseloom.methods.prior.channels import ANY, SIX, InputSpec
from poseloom.training.prior.losses import LossWeights, loss_parts, total_loss
from poseloom.training.prior.motions import MotionPool, MotionSettings
from poseloom.training.prior.network import NetworkShape, PriorGru, split
from poseloom.training.prior.scene import make_scene
from poseloom.training.prior.sensor_errors import SensorErrors
from poseloom.training.prior.sets import SIX_IMUS, draw_masks, fixed_masks
from poseloom.training.prior.virtual_sensors import Batch, measure
from poseloom.training.tensors import seed_torch

SPECS: Mapping[str, InputSpec] = {"six": SIX, "any": ANY}
"""The networks that ship: which numbers each receives."""


@dataclass(frozen=True)
class PriorSettings:
    """How a prior is trained.

    Attributes:
        kind: "six" or "any".
        shape: Sizes of the network.
        motions: How motions are varied.
        errors: How sensors err.
        losses: Weights of the loss' parts.
        size: Stretches a batch.
        steps: Batches.
        rate: AdamW's greatest rate, after `warm` steps.
        warm: Steps of the rise.
        tail: Share of the steps, the last ones, in which half a cosine leads from there to nil.
        weight_decay: AdamW's.
        clip: Largest norm of the gradient.
        average: Share of the running mean of weights that stays at each step; the mean is what is judged and kept.
    """

    kind: str = "six"
    shape: NetworkShape = field(default=NetworkShape())
    motions: MotionSettings = field(default=MotionSettings())
    errors: SensorErrors = field(default=SensorErrors())
    losses: LossWeights = field(default=LossWeights())
    size: int = 24
    steps: int = 4000
    rate: float = 2e-3
    warm: int = 100
    tail: float = 1.0
    weight_decay: float = 1e-2
    clip: float = 1.0
    average: float = 0.997


Judge = Callable[[nn.Module], Mapping[str, float]]
"""Measures of a network on people who are left out."""


@dataclass(frozen=True, eq=False)
class Trained:
    """What came of training.

    Attributes:
        network: With the running mean of the weights.
        curve: One entry each time the network was judged: step, seconds, mean losses since the last, measures.
    """

    network: PriorGru
    curve: tuple[Mapping[str, float], ...]


def draw_batch(pool: MotionPool, settings: PriorSettings, generator: Generator) -> Batch:
    """A batch of varied motions and sensors."""
    scene = make_scene(pool.draw(settings.size, settings.motions, generator), settings.motions, generator)
    masks = fixed_masks(settings.size, SIX_IMUS) if settings.kind == "six" else draw_masks(settings.size, generator)
    return measure(scene, masks, SPECS[settings.kind], settings.errors, generator)


def rate_at(step: int, settings: PriorSettings) -> float:
    """The optimiser's rate at a step."""
    if step < settings.warm:
        return settings.rate * (step + 1) / settings.warm
    first = settings.steps * (1 - settings.tail)
    if step <= first:
        return settings.rate
    return settings.rate * 0.5 * (1 + math.cos(math.pi * (step - first) / (settings.steps - first)))


def train_prior(
    pool: MotionPool,
    settings: PriorSettings,
    judge: Judge,
    seed: int,
    checkpoint: Path,
    every: int = 50,
    progress: Callable[[Mapping[str, float]], None] | None = None,
    start: Mapping[str, Tensor] | None = None,
) -> Trained:
    """Trains a prior; a killed run goes on from its checkpoint and gives what an unbroken one would.

    Args:
        pool: Motions of people who may be trained on.
        settings: How.
        judge: Measures of people who are left out.
        seed: Of all that is drawn.
        checkpoint: The file to go on from; the curve is written beside it, with suffix `.json`.
        every: Steps from one judging, and checkpoint, to the next.
        progress: Told each new entry of the curve.
        start: Weights to begin with, from another training.

    Raises:
        FormatError: if the checkpoint is another training's, or damaged.
    """
    seed_torch(seed)
    network = PriorGru(SPECS[settings.kind], settings.shape)
    if start is not None:
        network.load_state_dict(dict(start))
    mean = PriorGru(SPECS[settings.kind], settings.shape)
    mean.load_state_dict(network.state_dict())
    optimiser = torch.optim.AdamW(network.parameters(), settings.rate, weight_decay=settings.weight_decay)
    step, curve = 0, cast("list[dict[str, float]]", [])
    if checkpoint.is_file():
        step, curve = _resume(checkpoint, network, mean, optimiser, settings, seed)
    losses: list[dict[str, float]] = []
    begin = time.monotonic() - (curve[-1]["seconds"] if curve else 0.0)
    while step < settings.steps:
        for group in optimiser.param_groups:
            group["lr"] = rate_at(step, settings)
        batch = draw_batch(pool, settings, np.random.default_rng([seed, step]))
        losses.append(_step(network, batch, optimiser, settings))
        _follow(mean, network, min(settings.average, (1 + step) / (10 + step)))
        step += 1
        if step % every == 0 or step == settings.steps:
            told = {name: float(np.mean([entry[name] for entry in losses])) for name in losses[0]}
            curve.append({"step": float(step), "seconds": time.monotonic() - begin, **told, **judge(mean)})
            losses = []
            _save(checkpoint, network, mean, optimiser, settings, seed, step, curve)
            if progress is not None:
                progress(curve[-1])
    mean.eval()
    return Trained(mean, tuple(curve))


def _step(
    network: PriorGru, batch: Batch, optimiser: torch.optim.Optimizer, settings: PriorSettings
) -> dict[str, float]:
    parts = loss_parts(split(network(batch.inputs), batch.base), batch)
    cost = total_loss(parts, settings.losses)
    optimiser.zero_grad()
    cost.backward()  # pyright: ignore[reportUnknownMemberType]
    nn.utils.clip_grad_norm_(network.parameters(), settings.clip)
    optimiser.step()  # pyright: ignore[reportUnknownMemberType]
    return {"loss": float(cost.detach()), **{f"loss_{name}": float(part.detach()) for name, part in parts.items()}}


def _follow(mean: nn.Module, network: nn.Module, stays: float) -> None:
    with torch.no_grad():
        for kept, newest in zip(mean.parameters(), network.parameters(), strict=True):
            kept.lerp_(newest, 1 - stays)


def _save(
    path: Path,
    network: nn.Module,
    mean: nn.Module,
    optimiser: torch.optim.Optimizer,
    settings: PriorSettings,
    seed: int,
    step: int,
    curve: list[dict[str, float]],
) -> None:
    content = {
        "settings": json.dumps(asdict(settings)),
        "seed": seed,
        "step": step,
        "curve": curve,
        "network": network.state_dict(),
        "mean": mean.state_dict(),
        "optimiser": optimiser.state_dict(),
    }
    with atomic_file(path) as part, part.open("wb") as stream:
        torch.save(content, stream)  # pyright: ignore[reportUnknownMemberType]
    with atomic_file(path.with_suffix(".json")) as part:
        part.write_text(
            json.dumps({"settings": asdict(settings), "seed": seed, "curve": curve}, indent=1) + "\n", encoding="utf-8"
        )


def _resume(
    path: Path,
    network: nn.Module,
    mean: nn.Module,
    optimiser: torch.optim.Optimizer,
    settings: PriorSettings,
    seed: int,
) -> tuple[int, list[dict[str, float]]]:
    content = read_checkpoint(path)
    if content["settings"] != json.dumps(asdict(settings)) or content["seed"] != seed:
        raise FormatError(
            "this checkpoint is of a training with other settings",
            remedy="Give the same settings and seed as before, or remove it to begin again",
            file=path,
        )
    network.load_state_dict(content["network"])
    mean.load_state_dict(content["mean"])
    optimiser.load_state_dict(content["optimiser"])
    return int(content["step"]), list(content["curve"])


def read_checkpoint(path: Path) -> dict[str, Any]:
    """A checkpoint's content.

    Raises:
        FormatError: if it is damaged.
    """
    try:
        return cast("dict[str, Any]", torch.load(path, weights_only=True))
    except Exception as error:  # torch raises many kinds for a damaged file
        raise FormatError(
            "this checkpoint cannot be read",
            cause=str(error).partition("\n")[0],
            remedy="Remove it to begin again",
            file=path,
        ) from None
