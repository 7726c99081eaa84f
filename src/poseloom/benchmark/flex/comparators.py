"""Comparators that are no networks: nearest windows, ridge regression on the window, the mean pose."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from poseloom.arrays import Array, Floats, Floats32
from poseloom.benchmark.flex.scoring import Teller, pooled, score_pieces
from poseloom.training.examples import Heard
from poseloom.training.sessions import Session
from poseloom.training.splits import Piece

CHANNELS = 4
LAGS: tuple[tuple[int, ...], ...] = (
    (0, 1, 2, 3, 4),
    (0, 4, 8, 12, 16, 20, 24),
    (0, 3, 6, 12, 24, 48, 96),
)
"""Which samples back from now a window holds: the networks' five; half a second; two seconds, coarser the older."""
NEIGHBOURS = (8, 32, 128)
PENALTIES = (1.0, 100.0, 10000.0)
_STRIDE = 8


@dataclass(frozen=True)
class Chosen:
    """A comparator with the setting that did best on the validation part.

    Attributes:
        name: Which comparator.
        setting: The setting, in words.
        tell: What it makes of a series.
    """

    name: str
    setting: str
    tell: Teller


def lagged(inputs: Floats32[Array, "frames inputs"], lags: Sequence[int]) -> Floats32[Array, "frames lagged"]:
    """Windows of values that end at each frame; before the first frame, the first."""
    rows = np.maximum(np.arange(len(inputs))[:, None] - np.array(lags), 0)
    return np.ascontiguousarray(inputs[rows][..., :CHANNELS].reshape(len(inputs), -1))


def nearest_windows(heard: Sequence[Heard], lags: Sequence[int], neighbours: int) -> Teller:
    """The mean answer of the nearest windows of the training part, by exact search."""
    import faiss

    windows, answers = _pairs(heard, lags)
    index = faiss.IndexFlatL2(windows.shape[1])
    index.add(windows)

    def tell(inputs: Floats32[Array, "frames inputs"]) -> Floats[Array, "frames angles"]:
        _, found = index.search(lagged(inputs, lags), neighbours)
        return answers[found].mean(axis=1).astype(np.float64)

    return tell


def ridge(heard: Sequence[Heard], lags: Sequence[int], penalty: float) -> Teller:
    """Ridge regression of the angles on the window, with a constant."""
    windows, answers = _pairs(heard, lags)
    design = np.column_stack([windows.astype(np.float64), np.ones(len(windows))])
    gram = design.T @ design + penalty * np.eye(design.shape[1])
    weights = np.linalg.solve(gram, design.T @ answers.astype(np.float64))

    def tell(inputs: Floats32[Array, "frames inputs"]) -> Floats[Array, "frames angles"]:
        told = lagged(inputs, lags).astype(np.float64)
        return np.column_stack([told, np.ones(len(told))]) @ weights

    return tell


def mean_pose(heard: Sequence[Heard]) -> Teller:
    """The training part's mean angles, whatever is heard."""
    mean = np.concatenate([each.angles for each in heard]).mean(axis=0).astype(np.float64)
    return lambda inputs: np.repeat(mean[None], len(inputs), axis=0)


def choose(
    name: str,
    heard: Sequence[Heard],
    sessions: Sequence[Session],
    validation: Sequence[Piece],
    inputs: Sequence[Floats32[Array, "_ inputs"]],
) -> Chosen:
    """A comparator by name, with the best of nine settings on the validation part.

    Args:
        name: "nearest windows", "ridge" or "mean pose".
        heard: The training part, as heard by all training sensors.
        sessions: The sessions of the validation part.
        validation: Its pieces.
        inputs: What is heard of them.
    """
    if name == "mean pose":
        return Chosen(name, "", mean_pose(heard))
    tried: list[tuple[float, Chosen]] = []
    for lags in LAGS:
        for figure in NEIGHBOURS if name == "nearest windows" else PENALTIES:
            tell = (
                nearest_windows(heard, lags, int(figure)) if name == "nearest windows" else ridge(heard, lags, figure)
            )
            scored = pooled(score_pieces(sessions, validation, inputs, tell))
            words = f"{len(lags)} samples of the last {lags[-1] + 1}, "
            words += f"{figure:g} neighbours" if name == "nearest windows" else f"penalty {figure:g}"
            tried.append((scored.error, Chosen(name, words, tell)))
    return min(tried, key=lambda each: each[0])[1]


def _pairs(
    heard: Sequence[Heard], lags: Sequence[int]
) -> tuple[Floats32[Array, "windows lagged"], Floats32[Array, "windows angles"]]:
    window = partial(lagged, lags=lags)
    windows = [window(each.inputs)[each.before :][::_STRIDE] for each in heard]
    answers = [each.angles[::_STRIDE] for each in heard]
    return np.ascontiguousarray(np.concatenate(windows)), np.concatenate(answers)
