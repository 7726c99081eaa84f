"""One contestant, one split, one seed: fitted, or gone on with from its checkpoint, and scored."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.flex.comparators import Chosen, choose
from poseloom.benchmark.flex.material import DRAW, OWN_SUIT, Material
from poseloom.benchmark.flex.scoring import Output, Teller
from poseloom.training.examples import heard_pieces
from poseloom.training.fitting import (
    FitSettings,
    Fitted,
    TrainingSets,
    fit,
    median,
    paper_settings,
    scales_settings,
    smoothed,
)
from poseloom.training.networks import Kind
from poseloom.training.splits import Part

PLAIN = ("nearest windows", "ridge", "mean pose")
"""Comparators that are no networks."""

NETWORKS = {
    "Bi-LSTM": Kind.BILSTM,
    "Bi-LSTM-C": Kind.BILSTM_C,
    "Transformer": Kind.TRANSFORMER,
    "FCN": Kind.FCN,
    "TCN": Kind.TCN,
}
"""The paper's network and its comparators."""

PAPERS = ("Bi-LSTM", "Bi-LSTM-C")
"""The paper's network, without and with its calibrator."""

OURS = "flex-scales"


@dataclass(frozen=True)
class Effort:
    """What training may cost, the same for all of the paper's networks.

    Attributes:
        epochs: The most epochs of the paper's networks.
        stride: Frames from one of their windows to the next.
        hidden: Units of their LSTM in each direction.
        our_epochs: Epochs of ours.
        our_hidden: Units of its LSTM.
    """

    epochs: int = 12
    stride: int = 8
    hidden: int = 128
    our_epochs: int = 16
    our_hidden: int = 192


@dataclass(frozen=True)
class Trial:
    """What is to be fitted.

    Attributes:
        contestant: Name in `NETWORKS`, or `OURS`.
        split: "within-sequence" or "by-subject".
        seed: Of the first weights and of the order of examples.
        window: Samples that the calibrator hears.
        hidden: Units of the LSTM in place of the effort's.
        fixed: Whether ranges are found once, when the sensors are new, in place of on line.
    """

    contestant: str
    split: str
    seed: int = 0
    window: int = 100
    hidden: int | None = None
    fixed: bool = False

    @property
    def name(self) -> str:
        """For files and bars."""
        words = f"{self.contestant}-{self.split}-{self.seed}-{self.window}"
        words += "" if self.hidden is None else f"-{self.hidden}"
        return (words + ("-fixed" if self.fixed else "")).replace(" ", "-")


def settings_of(trial: Trial, effort: Effort) -> FitSettings:
    """How a trial is fitted."""
    if trial.contestant == OURS:
        return replace(scales_settings(effort.our_epochs, effort.our_hidden), draw=DRAW)
    settings = paper_settings(NETWORKS[trial.contestant], trial.hidden or effort.hidden, trial.window)
    loop = replace(settings.loop, epochs=effort.epochs)
    return replace(settings, loop=loop, stride=effort.stride, draw=DRAW)


def fit_trial(
    material: Material,
    trial: Trial,
    effort: Effort,
    work: Path,
    progress: Callable[[int, int, float], None] | None = None,
    sets: TrainingSets | None = None,
) -> Fitted:
    """Fits a trial, or takes it from its checkpoint.

    Args:
        material: What is learnt from.
        trial: Which.
        effort: What it may cost.
        work: Folder of the checkpoints.
        progress: Told after each epoch.
        sets: What is heard in place of the material's sets.
    """
    settings = settings_of(trial, effort)
    mark = f"{zlib.crc32(repr((settings, material.library.digest, len(material.sessions))).encode()):08x}"
    work.mkdir(parents=True, exist_ok=True)
    return fit(
        material.sessions, material.divided(trial.split), settings, trial.seed,
        checkpoint=work / f"{trial.name}-{mark}.pt", progress=progress,
        sets=material.sets if sets is None else sets,
    )  # fmt: skip


def outputs_of(fitted: Fitted) -> dict[str, Output]:
    """What of a fitted network is scored: its plain outputs, and what its smoothing makes of them.

    The paper's median pads both ends and so looks a sample ahead: "centred" is that one, for offline use; "median" is
    the causal one, for live use.
    """
    if fitted.settings.network.kind is Kind.SCALES:
        return {"plain": lambda told: told, "smoothed": partial(smoothed, fitted)}
    return {"plain": lambda told: told, "median": median, "centred": centred_median}


def live(fitted: Fitted) -> Teller:
    """What a fitted network tells in live use."""
    return lambda heard: smoothed(fitted, fitted.tell(heard))


def centred_median(told: Floats[Array, "frames angles"]) -> Floats[Array, "frames angles"]:
    """The median of each output and its two neighbours in time; the ends are repeated (the paper pads zeros)."""
    padded = np.concatenate([told[:1], told, told[-1:]])
    return np.median(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0)


def plain_comparator(material: Material, split: str, name: str) -> Chosen:
    """A comparator that is no network, its setting chosen on the validation part."""
    divided = material.divided(split)
    heard = [
        each
        for sessions, inputs in material.sets
        for each in heard_pieces(sessions, divided.train, inputs)
    ]  # fmt: skip
    return choose(name, heard, material.sessions, divided.part(Part.VALIDATE), material.heard(OWN_SUIT))
