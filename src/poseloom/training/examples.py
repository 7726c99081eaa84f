"""What networks learn from, drawn batch by batch: windows with one answer each, or stretches with an answer a frame."""

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Floats32, Ints
from poseloom.training.sessions import Session
from poseloom.training.splits import Piece


@dataclass(frozen=True, eq=False)
class Batch:
    """A few examples.

    Attributes:
        inputs: What is heard: windows of samples, or stretches of features.
        angles: What should be told, radians; one frame for a window.
        weights: 1 where that counts, 0 where a stretch has ended.
    """

    inputs: Floats32[Array, "batch frames inputs"]
    angles: Floats32[Array, "batch answers angles"]
    weights: Floats32[Array, "batch answers 1"]


@dataclass(frozen=True, eq=False)
class Heard:
    """A piece as one draw of sensors tells of it.

    Attributes:
        inputs: From the piece's first heard frame on.
        angles: Of the frames that count.
        before: Frames heard before the first that counts.
    """

    inputs: Floats32[Array, "frames inputs"]
    angles: Floats32[Array, "counted angles"]
    before: int


class Examples(abc.ABC):
    """Examples of a training part."""

    @property
    @abc.abstractmethod
    def batches(self) -> int:
        """Batches in an epoch."""

    @abc.abstractmethod
    def batch(self, generator: Generator, index: int, order: Ints[Array, " examples"]) -> Batch:
        """Batch number `index` of an epoch whose examples stand in this order."""

    @abc.abstractmethod
    def order(self, generator: Generator) -> Ints[Array, " examples"]:
        """The order of an epoch."""


def heard_pieces(
    sessions: Sequence[Session],
    pieces: Sequence[Piece],
    inputs: Sequence[Floats32[Array, "_ inputs"]],
    make: Callable[[Floats32[Array, "frames inputs"]], Floats32[Array, "frames features"]] = lambda heard: heard,
) -> tuple[Heard, ...]:
    """What each piece sounds like.

    Args:
        sessions: The sessions.
        pieces: Which parts of them.
        inputs: What is heard of each session.
        make: Turns what is heard of a piece into what a network takes, from an empty memory.
    """
    return tuple(
        Heard(
            make(inputs[piece.session][piece.heard : piece.stop]),
            sessions[piece.session].angles[piece.start : piece.stop],
            piece.start - piece.heard,
        )
        for piece in pieces
    )


class Windows(Examples):
    """Windows that end at every `stride`-th frame; before a piece's first frame that frame is repeated, as live.

    Args:
        heard: The pieces.
        window: Samples of a window.
        stride: Frames from one window to the next; the paper's is 2.
        size: Windows a batch.
    """

    def __init__(self, heard: Sequence[Heard], window: int, stride: int, size: int) -> None:
        rows: list[Ints[Array, "windows frames"]] = []
        answers: list[Ints[Array, " windows"]] = []
        begin = counted = 0
        for piece in heard:
            ends = np.arange(0, len(piece.angles), stride, dtype=np.int64)
            within = ends[:, None] + piece.before + np.arange(1 - window, 1)
            rows.append(begin + np.maximum(within, 0))
            answers.append(counted + ends)
            begin += len(piece.inputs)
            counted += len(piece.angles)
        self._inputs = np.concatenate([piece.inputs for piece in heard])
        self._angles = np.concatenate([piece.angles for piece in heard])
        self._rows, self._answers = np.concatenate(rows), np.concatenate(answers)
        self._size = size

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def batches(self) -> int:
        return max(1, len(self) // self._size)

    def order(self, generator: Generator) -> Ints[Array, " examples"]:
        return generator.permutation(len(self))

    def batch(self, generator: Generator, index: int, order: Ints[Array, " examples"]) -> Batch:
        chosen = order[index * self._size : (index + 1) * self._size]
        weights = np.ones((len(chosen), 1, 1), dtype=np.float32)
        return Batch(self._inputs[self._rows[chosen]], self._angles[self._answers[chosen]][:, None], weights)


class Stretches(Examples):
    """Stretches that begin anywhere in a piece, longer pieces oftener.

    Args:
        heard: The pieces, with features.
        length: Frames of a stretch.
        size: Stretches a batch.
        share: Of all frames that an epoch has: one over the number of draws, so that an epoch is a session's length.
    """

    def __init__(self, heard: Sequence[Heard], length: int, size: int, share: float = 1.0) -> None:
        self._heard = tuple(heard)
        self._length, self._size = length, size
        counts = np.array([len(piece.angles) for piece in heard], dtype=np.float64)
        self._frames = int(share * counts.sum())
        self._shares = counts / counts.sum()

    @property
    def batches(self) -> int:
        return max(1, self._frames // (self._length * self._size))

    def order(self, generator: Generator) -> Ints[Array, " examples"]:
        return generator.choice(len(self._heard), size=self.batches * self._size, p=self._shares)

    def batch(self, generator: Generator, index: int, order: Ints[Array, " examples"]) -> Batch:
        chosen = order[index * self._size : (index + 1) * self._size]
        features, angles = self._heard[0].inputs.shape[1], self._heard[0].angles.shape[1]
        inputs = np.zeros((len(chosen), self._length, features), dtype=np.float32)
        answers = np.zeros((len(chosen), self._length, angles), dtype=np.float32)
        weights = np.zeros((len(chosen), self._length, 1), dtype=np.float32)
        for row, number in enumerate(chosen):
            piece: Heard = self._heard[int(number)]
            first = int(generator.integers(max(1, len(piece.angles) - self._length + 1)))
            part = slice(first, first + self._length)
            count = len(piece.angles[part])
            inputs[row, :count] = piece.inputs[piece.before :][part]
            answers[row, :count] = piece.angles[part]
            weights[row, :count] = 1
        return Batch(inputs, answers, weights)
