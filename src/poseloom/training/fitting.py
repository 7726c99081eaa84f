"""Fits a flex network to sessions: draws sensors, trains, judges."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import nn

from poseloom.arrays import Array, Floats, Floats32
from poseloom.methods.flex.angles import ANGLES, angle_errors
from poseloom.methods.flex.filter_bank import BankSettings
from poseloom.training.draws import DrawSettings, draw_inputs
from poseloom.training.examples import Examples, Heard, Stretches, Windows, heard_pieces
from poseloom.training.loop import History, LoopSettings, Progress, laplace_loss, squared_loss, tell, train
from poseloom.training.networks import (
    BiLstm,
    Fcn,
    Kind,
    NetworkSettings,
    Tcn,
    Transformer,
    median_of_three,
)
from poseloom.training.scales import Scales, bank_series, exponential_mean
from poseloom.training.sessions import Session, mirrored
from poseloom.training.splits import Divided, Part, Piece
from poseloom.training.tensors import seed_torch, tensor

Inputs = Floats32[Array, "_ inputs"]
TrainingSets = Sequence[tuple[Sequence[Session], Sequence[Inputs]]]
"""For each set of sensors, who wears it and what is heard of them."""


@dataclass(frozen=True)
class FitSettings:
    """How a network is fitted.

    Attributes:
        network: Which network.
        loop: How it is trained.
        draw: How sensors are drawn.
        draws: Sets of sensors drawn for each session; every second one wears the session's mirror image.
        stride: Frames from one window to the next, over all draws together.
        size: Windows, or stretches, a batch.
        stretch: Frames of a stretch.
        part: Half of the draws hear takes cut into parts of so many frames, each from an empty memory, so that a
            network with a long memory learns to do without; 0 for none.
        speed: Weight of the errors of differences from frame to frame.
    """

    network: NetworkSettings = field(default=NetworkSettings())
    loop: LoopSettings = field(default=LoopSettings())
    draw: DrawSettings = field(default=DrawSettings())
    draws: int = 4
    stride: int = 2
    size: int = 64
    stretch: int = 128
    part: int = 0
    speed: float = 0.0


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fitted network.

    Attributes:
        network: Its weights.
        settings: How it was fitted.
        seed: Of the fit.
        history: How training went.
        spread: Standard deviation of each angle, radians, on the validation part.
    """

    network: nn.Module
    settings: FitSettings
    seed: int
    history: History
    spread: Floats[Array, "angles"]

    def tell(self, heard: Inputs) -> Floats[Array, "frames angles"]:
        """What it tells of a series from an empty memory, before the median or the smoothing, radians."""
        return tell_series(self.network, self.settings, heard)


def paper_settings(kind: Kind = Kind.BILSTM_C, hidden: int = 512, window: int = 100) -> FitSettings:
    """The flex paper's network, or one of its comparators, with the paper's training."""
    return FitSettings(NetworkSettings(kind, window, hidden), LoopSettings(half=True))


def scales_settings(epochs: int = 16, hidden: int = 192) -> FitSettings:
    """Our network."""
    return FitSettings(
        NetworkSettings(Kind.SCALES, window=0, hidden=hidden),
        LoopSettings(
            epochs=epochs, rate=3e-3, decay_every=0, weight_decay=1e-3, patience=epochs, gain=0.0, average=0.99
        ),
        draw=DrawSettings(drop_outs=0.3),
        size=32,
        part=200,
    )  # fmt: skip


def make_network(settings: NetworkSettings, seed: int) -> nn.Module:
    """A network with first weights from a seed."""
    seed_torch(seed)
    makers: Mapping[Kind, Callable[[], nn.Module]] = {
        Kind.BILSTM: partial(BiLstm, settings, ANGLES),
        Kind.BILSTM_C: partial(BiLstm, settings, ANGLES),
        Kind.TRANSFORMER: partial(Transformer, ANGLES),
        Kind.FCN: partial(Fcn, ANGLES),
        Kind.TCN: partial(Tcn, ANGLES),
        Kind.SCALES: partial(Scales, BankSettings(), settings.hidden, ANGLES),
    }
    return makers[settings.kind]()


def draw_sets(
    sessions: Sequence[Session], settings: FitSettings, seed: int
) -> tuple[tuple[Sequence[Session], tuple[Inputs, ...]], ...]:
    """What is heard of all sessions by each set of drawn sensors; every second set is worn by the mirror images."""
    mirrors = [mirrored(session) for session in sessions]
    sets: list[tuple[Sequence[Session], tuple[Inputs, ...]]] = []
    for number in range(settings.draws):
        wearers = mirrors if number % 2 else sessions
        sets.append((wearers, tuple(draw_inputs(each, seed + number, settings.draw) for each in wearers)))
    return tuple(sets)


def make_examples(sets: TrainingSets, pieces: Sequence[Piece], settings: FitSettings) -> Examples:
    """Training examples of the pieces, as heard by all sets of sensors."""
    make = features_of(settings)
    parted = [pieces, parts_of(pieces, settings.part)] if settings.part else [pieces]
    heard = [
        each
        for number, (sessions, inputs) in enumerate(sets)
        for each in heard_pieces(sessions, parted[number // 2 % len(parted)], inputs, make)
    ]
    if settings.network.kind is Kind.SCALES:
        return Stretches(heard, settings.stretch, settings.size, 1 / len(sets))
    return Windows(heard, _window(settings.network), settings.stride * len(sets), settings.size)


def parts_of(pieces: Sequence[Piece], frames: int) -> tuple[Piece, ...]:
    """Pieces cut into parts of about so many frames; nothing before a part is heard."""
    parts: list[Piece] = []
    for piece in pieces:
        count = max(1, round(len(piece) / frames))
        cuts = np.linspace(piece.start, piece.stop, count + 1).astype(int).tolist()
        parts += [replace(piece, heard=first, start=first, stop=stop) for first, stop in pairwise(cuts)]
    return tuple(parts)


def features_of(settings: FitSettings) -> Callable[[Inputs], Floats32[Array, "frames features"]]:
    """What a network takes of what is heard of a piece."""
    if settings.network.kind is Kind.SCALES:
        return partial(bank_series, settings=BankSettings())
    return lambda heard: heard


def fit(
    sessions: Sequence[Session],
    divided: Divided,
    settings: FitSettings,
    seed: int = 0,
    sensor_seed: int = 0,
    checkpoint: Path | None = None,
    progress: Progress | None = None,
    sets: TrainingSets | None = None,
) -> Fitted:
    """Fits a network to the training part, and stops by the validation part.

    Args:
        sessions: Everybody.
        divided: What trains and what validates; the test part is not looked at.
        settings: How.
        seed: Of the first weights and of the order of examples.
        sensor_seed: Of the sensors.
        checkpoint: A file to go on from.
        progress: Told after each epoch.
        sets: What is heard by sets of sensors drawn already, see `draw_sets`.
    """
    sets = draw_sets(sessions, settings, sensor_seed) if sets is None else sets
    examples = make_examples(sets, divided.train, settings)
    judged = divided.validate or divided.train
    validation = heard_pieces(*_first(sets, judged), features_of(settings))
    network = make_network(settings.network, seed)
    if isinstance(network, Scales):
        begun = heard_pieces(*_first(sets, divided.train), features_of(settings))
        network.begin_at(
            np.concatenate([each.inputs[each.before :] for each in begun]),
            np.concatenate([each.angles for each in begun]),
        )
    loss = partial(laplace_loss, speed=settings.speed) if isinstance(network, Scales) else squared_loss
    stride = max(1, sum(len(each.angles) for each in validation) // 2000)
    history = train(
        network,
        examples,
        loss,
        lambda judged_network: _error(judged_network, settings, validation, stride),
        settings.loop,
        seed,
        checkpoint,
        progress,
    )
    errors = np.concatenate([_errors(network, settings, each, stride) for each in validation])
    # Of a Laplace density the standard deviation is the mean absolute error times the root of two.
    return Fitted(network, settings, seed, history, np.radians(errors.mean(axis=0)) * np.sqrt(2))


def tell_series(network: nn.Module, settings: FitSettings, heard: Inputs) -> Floats[Array, "frames angles"]:
    """What a network tells of a series from an empty memory, radians."""
    return _told(network, settings, features_of(settings)(heard), 0, 1)


def smoothed(fitted: Fitted, told: Floats[Array, "frames angles"]) -> Floats[Array, "frames angles"]:
    """What live use makes of what a network told: our network's smoothing, the paper's causal median."""
    if not isinstance(fitted.network, Scales):
        return median(told)
    return exponential_mean(told, fitted.network.smoothing)


def median(told: Floats[Array, "frames angles"]) -> Floats[Array, "frames angles"]:
    """The paper's median of three, causal."""
    return median_of_three(tensor(told)).numpy()


def _window(settings: NetworkSettings) -> int:
    return settings.window if settings.kind is Kind.BILSTM_C else min(settings.window, 5)


def _first(sets: TrainingSets, pieces: Sequence[Piece]) -> tuple[Sequence[Session], Sequence[Piece], Sequence[Inputs]]:
    return sets[0][0], pieces, sets[0][1]


def _error(network: nn.Module, settings: FitSettings, validation: Sequence[Heard], stride: int) -> float:
    errors = [_errors(network, settings, each, stride) for each in validation]
    return float(np.concatenate(errors).mean())


def _errors(network: nn.Module, settings: FitSettings, heard: Heard, stride: int) -> Floats[Array, "frames angles"]:
    told = _told(network, settings, heard.inputs, heard.before, stride)
    return angle_errors(heard.angles[::stride].astype(np.float64), told)


def _told(
    network: nn.Module, settings: FitSettings, taken: Floats32[Array, "frames inputs"], before: int, stride: int
) -> Floats[Array, "answers angles"]:
    if isinstance(network, Scales):
        with torch.inference_mode():
            told = network(tensor(taken)[None])[0][0]
        return told[before::stride].numpy().astype(np.float64)
    ends = np.arange(before, len(taken), stride)
    rows = np.maximum(ends[:, None] + np.arange(1 - _window(settings.network), 1), 0)
    return tell(network, taken[rows])


def held_out_takes(sessions: Sequence[Session], share: float, seed: int) -> Divided:
    """Trains on all but a seeded share of the recorded takes, which validate; nothing is left for a test."""
    takes = sorted({take.take for session in sessions for take in session.takes})
    generator = np.random.default_rng([seed, 7])
    count = max(1, round(share * len(takes))) if len(takes) > 1 else 0
    chosen: set[str] = {takes[int(index)] for index in generator.permutation(len(takes))[:count]}
    whole = [
        (Piece(index, take, take.start, take.start, take.stop), take.take in chosen)
        for index, session in enumerate(sessions)
        for take in session.takes
    ]
    return Divided(tuple(piece for piece, out in whole if not out), tuple(piece for piece, out in whole if out), ())


def quick(settings: FitSettings, epochs: int, stride: int) -> FitSettings:
    """The same with fewer epochs and windows."""
    return replace(settings, loop=replace(settings.loop, epochs=epochs), stride=stride)


__all__ = [
    "FitSettings", "Fitted", "Part", "TrainingSets", "draw_sets", "fit", "held_out_takes", "make_network", "median",
    "paper_settings",    "quick", "scales_settings", "smoothed", "tell_series",
]  # fmt: skip
