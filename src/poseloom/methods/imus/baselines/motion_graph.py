"""Kovar et al. 2002: clips of the library played back, with blended transitions where they look alike."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.methods.imus.baselines.driving import Guess, SignalComparator, WindowSettings
from poseloom.methods.imus.baselines.examples import Examples
from poseloom.methods.imus.baselines.windows import index_windows
from poseloom.skeleton.skeleton import Skeleton

_APART = 0.25
"""Seconds that two frames of one clip must be apart to be joined by a transition."""


@dataclass(frozen=True)
class GraphSettings(WindowSettings):
    """Settings of `MotionGraph`.

    Attributes:
        samples: Length of the windows of signals that choose the way.
        branches: Transitions that each frame may take.
        blend: Seconds over which a transition is blended.
        gain: A transition is taken where the branch fits the signals so much better: the ratio of mean squared
            differences.
        build: Weight of a differing build (see `NearestWindowSettings`).
        lost: Mean squared difference, in squared standard deviations, from which on the best frame of all may be
            entered, transition or not.
    """

    samples: int = 45
    branches: int = 24
    blend: float = 0.1
    gain: float = 0.9
    build: float = 0.1
    lost: float = 0.1


class _Memory(NamedTuple):
    """Where the walk is.

    Attributes:
        strangeness: How strange the wearer is to each example.
        row: The frame that is played; -1 before the first.
        fading: The frame of the clip that is being left, or -1.
        left: Frames of blending that are left.
    """

    strangeness: Floats32[Array, "frames"]
    row: int
    fading: int
    left: int


class _Entry(NamedTuple):
    """A frame and how far its signals are from those heard."""

    row: int
    square: float


class MotionGraph(SignalComparator[GraphSettings]):
    """A walk on a motion graph that the signals steer.

    Source: Kovar, Gleicher, Pighin, Motion graphs, SIGGRAPH 2002. As there, frames that look alike are joined by
    transitions, over which poses are blended (there for 1/3 s) while the root goes on by the blended steps, and in
    between the recorded motion is played unchanged. The way through the graph, there searched for a user's path, is
    here chosen by the sensors: of all transitions out of a frame, and of staying, the one whose last signals fit best.
    Simplified: likeness of frames by joint rotations, height and step over a short window instead of a cloud of points,
    and every frame has its nearest others instead of the local minima below a threshold. More than there: where
    nothing fits any more the best frame of all is entered with the same blend. Through a silence the clip plays on.

    Args:
        examples: What it learns from.
        settings: Its settings; tuned ones unless given.
    """

    kind: ClassVar[str] = "motion-graph"

    def __init__(self, examples: Examples, settings: GraphSettings | None = None) -> None:
        super().__init__(examples, settings or GraphSettings())
        self._index = index_windows(examples, self.settings.samples)
        self._branches = _transitions(examples, self.settings.branches)
        self._blend = max(round(self.settings.blend * examples.layout.rate), 1)

    def _begin(self, skeleton: Skeleton) -> _Memory:
        return _Memory(self.examples.strangeness(skeleton, self.settings.build), -1, -1, 0)

    def _estimate(self, memory: _Memory, window: Floats[Array, "samples channels"]) -> tuple[_Memory, Guess]:
        if memory.row < 0:
            following = memory._replace(row=self._entered(memory, window).row)
        else:
            following = self._onward(memory, window)
        return following, self._played(following)

    def _onward(self, memory: _Memory, window: Floats[Array, "samples channels"]) -> _Memory:
        """Plays on by a frame, and takes a transition where one fits better."""
        both = self.examples.followers(np.array([memory.row, max(memory.fading, 0)]))
        ended = int(both[0]) == memory.row
        fading = int(both[1]) if memory.left > 1 else -1
        moved = _Memory(memory.strangeness, int(both[0]), fading, max(memory.left - 1, 0))
        if moved.left > 0 or not np.isfinite(window[0]).any():
            return self._branched(moved, int(self._branches[memory.row, 0])) if ended else moved
        choices = np.concatenate([[moved.row], self._branches[moved.row]])
        squares = self._misfits(choices, window) + memory.strangeness[choices]
        best = int(np.argmin(squares[1:])) + 1
        if squares[0] > self.settings.lost:
            entered = self._entered(memory, window)
            if entered.square < self.settings.gain * min(squares[0], squares[best]):
                return self._branched(moved, entered.row)
        if ended or squares[best] < self.settings.gain * squares[0]:
            return self._branched(moved, int(choices[best]))
        return moved

    def _entered(self, memory: _Memory, window: Floats[Array, "samples channels"]) -> _Entry:
        """The frame of all examples that fits the signals best."""
        found = self._index.nearest(window, 1, memory.strangeness)
        return _Entry(int(found.rows[0]), float(found.squares[0]))

    def _branched(self, memory: _Memory, target: int) -> _Memory:
        return _Memory(memory.strangeness, target, memory.row, self._blend)

    def _misfits(self, rows: Ints[Array, "rows"], window: Floats[Array, "samples channels"]) -> Floats[Array, "rows"]:
        """Mean squared differences of signals; moments and channels that did not come do not count."""
        wanted = window.reshape(-1)
        there = np.isfinite(wanted)
        return np.square(self._index.windows[rows][:, there] - wanted[there]).mean(axis=1)

    def _played(self, memory: _Memory) -> Guess:
        """The frame that is played, blended with the one that is left."""
        features = self.examples.features[memory.row].astype(np.float64)
        step = self.examples.steps[memory.row].astype(np.float64)
        if memory.fading < 0 or memory.left == 0:
            return Guess(features, step, np.zeros(len(features)))
        rest = memory.left / (self._blend + 1)
        # Kovar's weights: a cubic whose slope is zero at both ends.
        share = 3 * rest**2 - 2 * rest**3
        other = self.examples.features[memory.fading].astype(np.float64)
        other_step = self.examples.steps[memory.fading].astype(np.float64)
        mean = (1 - share) * features + share * other
        variances = (1 - share) * (features - mean) ** 2 + share * (other - mean) ** 2
        return Guess(mean, (1 - share) * step + share * other_step, variances)


def _transitions(examples: Examples, count: int) -> Ints[Array, "frames branches"]:
    """For each frame the frames that look most like it, not counting those just before and after it."""
    places = _likeness(examples)
    apart = round(_APART * examples.layout.rate)
    tree = cast(Any, import_module("scipy.spatial")).cKDTree(places)
    asked = min(count + 2 * apart + 1, len(examples))
    rows: Ints[Array, "frames asked"] = np.asarray(tree.query(places, asked)[1], dtype=np.int64).reshape(-1, asked)
    own = np.arange(len(examples))[:, None]
    near = (np.abs(rows - own) < apart) & (examples.clip_of_frame[rows] == examples.clip_of_frame[own])
    order = np.argsort(near, axis=1, kind="stable")[:, :count]
    return np.take_along_axis(rows, order, axis=1)


def _likeness(examples: Examples) -> Floats32[Array, "frames directions"]:
    """Poses and steps of now and a little before and after, in their principal directions."""
    rate = examples.layout.rate
    posed = np.concatenate([examples.features, 0.5 * rate * examples.steps], axis=1)
    frames, clips = np.arange(len(examples)), examples.clip_of_frame
    reach = max(round(rate / 12), 1)
    around = [
        posed[np.clip(frames + shift, examples.starts[clips], examples.stops[clips] - 1)]
        for shift in (-reach, 0, reach)
    ]
    rows = np.concatenate(around, axis=1)
    rows -= rows.mean(axis=0)
    scatter = rows.T.astype(np.float64) @ rows.astype(np.float64)
    directions = np.linalg.eigh(scatter)[1][:, :-13:-1].astype(np.float32)
    return rows @ directions
