"""The training loop: epochs, early stopping, and checkpoints from which a killed run goes on.

What is drawn in an epoch depends on the seed and the epoch's number alone, so a resumed run repeats an unbroken one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from poseloom.arrays import Array, Floats, Floats32
from poseloom.errors import FormatError
from poseloom.formats.atomic import atomic_file
from poseloom.training.examples import Batch, Examples
from poseloom.training.tensors import seed_torch, tensor

Loss = Callable[[nn.Module, Batch], Tensor]
"""What a batch costs."""
Judge = Callable[[nn.Module], float]
"""The validation error in degrees."""
Weights = dict[str, Tensor]
"""A network's weights by name."""
Progress = Callable[[int, int, float], None]
"""Called with the epochs done, how many there may be, and the validation error in degrees."""


@dataclass(frozen=True)
class LoopSettings:
    """How to train. What is not ours to choose is the flex paper's, section 3.4.1.

    Attributes:
        epochs: The most epochs.
        rate: Adam's first rate.
        decay: The rate is multiplied by this ...
        decay_every: ... after so many epochs; 0 for half a cosine from the first rate to nil instead.
        weight_decay: AdamW's; 0 is Adam.
        clip: Largest norm of the gradient.
        patience: Training stops when in so many epochs ...
        gain: ... the validation error has not fallen by this many degrees.
        half: Whether matrices are multiplied in bfloat16, where the processor does that in hardware.
        average: Judged, kept and used is a running mean of the weights, of which this share stays at every batch; 0 for
            the weights themselves.
    """

    epochs: int = 60
    rate: float = 1e-3
    decay: float = 0.1
    decay_every: int = 10
    weight_decay: float = 0.0
    clip: float = 1.0
    patience: int = 10
    gain: float = 0.1
    half: bool = False
    average: float = 0.0


@dataclass(frozen=True)
class History:
    """What came of training.

    Attributes:
        losses: Mean loss of each epoch.
        errors: Validation error after each, degrees.
        best: The epoch whose network was kept.
    """

    losses: tuple[float, ...]
    errors: tuple[float, ...]
    best: int


def train(
    network: nn.Module,
    examples: Examples,
    loss: Loss,
    judge: Judge,
    settings: LoopSettings,
    seed: int,
    checkpoint: Path | None = None,
    progress: Progress | None = None,
) -> History:
    """Trains a network in place, and leaves in it the weights of the epoch with the least validation error.

    Args:
        network: What to train; its first weights must come from the same seed for a run to repeat.
        examples: What from.
        loss: What a batch costs.
        judge: The validation error.
        settings: How.
        seed: Of all that is drawn.
        checkpoint: A file to go on from, written after each epoch; not removed at the end.
        progress: Told after each epoch.

    Raises:
        FormatError: if the checkpoint is another training's, or damaged.
    """
    optimiser = torch.optim.AdamW(network.parameters(), settings.rate, weight_decay=settings.weight_decay, fused=True)
    losses: list[float] = []
    errors: list[float] = []
    best: Weights = {}
    mean = _copied(network)
    if checkpoint is not None and checkpoint.is_file():
        losses, errors, best, mean = _resume(checkpoint, network, optimiser, settings, seed)
    while len(errors) < settings.epochs and not stalled(errors, settings.patience, settings.gain):
        for group in optimiser.param_groups:
            group["lr"] = rate_in(len(errors), settings)
        losses.append(_epoch(network, examples, loss, optimiser, settings, [seed, len(losses)], mean))
        network.eval()
        newest = _copied(network)
        if settings.average > 0:
            network.load_state_dict(mean)
        errors.append(judge(network))
        if errors[-1] <= min(errors):
            best = _copied(network)
        network.load_state_dict(newest)
        if checkpoint is not None:
            _save(checkpoint, network, optimiser, settings, seed, (losses, errors, best, mean))
        if progress is not None:
            progress(len(errors), settings.epochs, errors[-1])
    network.load_state_dict(best)
    network.eval()
    return History(tuple(losses), tuple(errors), int(np.argmin(errors)))


def rate_in(epoch: int, settings: LoopSettings) -> float:
    """The optimiser's rate in an epoch, counted from 0."""
    if settings.decay_every > 0:
        return settings.rate * settings.decay ** (epoch // settings.decay_every)
    return settings.rate * 0.5 * (1 + math.cos(math.pi * epoch / settings.epochs))


def stalled(errors: Sequence[float], patience: int, gain: float) -> bool:
    """Whether the last `patience` errors brought less than `gain` over the best before them."""
    return len(errors) > patience and min(errors[-patience:]) > min(errors[:-patience]) - gain


def squared_loss(network: nn.Module, batch: Batch) -> Tensor:
    """Mean squared error of the angles (equation 3, with the prediction where it names the sensor reading)."""
    told = network(tensor(batch.inputs))
    return (told.float() - tensor(batch.angles)[:, 0]).square().mean()


def laplace_loss(network: nn.Module, batch: Batch, speed: float = 0.0) -> Tensor:
    """Mean absolute error of the angles, which is what is reported, and how well the network doubts them.

    The second part is the negative log-likelihood of a Laplace density; it teaches the doubt only.

    Args:
        network: Gives angles and the logarithms of their mean absolute errors.
        batch: Stretches.
        speed: Weight of the errors of the angles' differences from frame to frame.
    """
    told, doubt = network(tensor(batch.inputs))
    truth, weights = tensor(batch.angles), tensor(batch.weights)
    off = (told - truth).abs()
    cost = off + 0.1 * (off.detach() * torch.exp(-doubt) + doubt)
    count = weights.sum() * truth.shape[-1]
    total = (cost * weights).sum() / count
    if speed > 0:
        steps = (told.diff(dim=1) - truth.diff(dim=1)).abs() * weights[:, 1:]
        total = total + speed * steps.sum() / count
    return total


def tell(network: nn.Module, inputs: Floats32[Array, "batch frames inputs"]) -> Floats[Array, "batch angles"]:
    """What a network of windows tells of many."""
    with torch.inference_mode():
        parts = [network(tensor(part)).float().numpy() for part in np.array_split(inputs, len(inputs) // 4096 + 1)]
    return np.concatenate(parts).astype(np.float64)


def _epoch(
    network: nn.Module,
    examples: Examples,
    loss: Loss,
    optimiser: torch.optim.Optimizer,
    settings: LoopSettings,
    seed: Sequence[int],
    mean: Weights,
) -> float:
    generator = np.random.default_rng(seed)
    seed_torch(int(generator.integers(2**31)))
    network.train()
    order = examples.order(generator)
    total = 0.0
    for index in range(examples.batches):
        batch = examples.batch(generator, index, order)
        with torch.autocast("cpu", torch.bfloat16, enabled=settings.half):
            cost = loss(network, batch)
        optimiser.zero_grad()
        cost.backward()  # pyright: ignore[reportUnknownMemberType]
        nn.utils.clip_grad_norm_(network.parameters(), settings.clip)
        optimiser.step()  # pyright: ignore[reportUnknownMemberType]
        total += float(cost.detach())
        if settings.average > 0:
            _follow(mean, network, settings.average, seed[-1] * examples.batches + index)
    return total / examples.batches


def _copied(network: nn.Module) -> Weights:
    return {name: value.clone() for name, value in network.state_dict().items()}


def _follow(mean: Weights, network: nn.Module, stays: float, batches: int) -> None:
    """Lets a running mean follow the weights; it forgets faster at first, when they run."""
    taken = 1 - min(stays, (1 + batches) / (10 + batches))
    for name, value in network.state_dict().items():
        mean[name].lerp_(value, taken)


def _save(
    path: Path,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    settings: LoopSettings,
    seed: int,
    so_far: tuple[list[float], list[float], Weights, Weights],
) -> None:
    losses, errors, best, mean = so_far
    content = {
        "settings": asdict(settings),
        "seed": seed,
        "losses": losses,
        "errors": errors,
        "best": best,
        "mean": mean,
        "network": network.state_dict(),
        "optimiser": optimiser.state_dict(),
    }
    with atomic_file(path) as part, part.open("wb") as stream:
        torch.save(content, stream)  # pyright: ignore[reportUnknownMemberType]


def _resume(
    path: Path, network: nn.Module, optimiser: torch.optim.Optimizer, settings: LoopSettings, seed: int
) -> tuple[list[float], list[float], Weights, Weights]:
    try:
        content = cast("dict[str, Any]", torch.load(path, weights_only=True))
        same = content["settings"] == asdict(settings) and content["seed"] == seed
        if same:
            network.load_state_dict(content["network"])
            optimiser.load_state_dict(content["optimiser"])
            return content["losses"], content["errors"], content["best"], content["mean"]
    except Exception as error:  # torch raises many kinds for a damaged file
        raise FormatError(
            "this checkpoint cannot be gone on from",
            cause=str(error).partition("\n")[0],
            remedy="Remove it to begin anew",
            file=path,
        ) from None
    raise FormatError(
        "this checkpoint is of a training with other settings",
        remedy="Give the same settings and seed as before, or remove it to begin anew",
        file=path,
    )
