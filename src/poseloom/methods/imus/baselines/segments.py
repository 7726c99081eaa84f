"""Segments of motion between foot strikes and take-offs, on one canonical time: what motion primitives are made of."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.methods.imus.baselines.examples import Examples

_SHORTEST, _LONGEST = 0.12, 1.0
"""Seconds of a segment: events that follow faster are one, longer stretches (a stand) are cut into equal parts."""

_FEWEST = 8
"""Kinds with fewer segments join their behaviour's other segments."""


class Segment(NamedTuple):
    """One stretch of a clip.

    Attributes:
        start: Its first example.
        stop: The example after its last.
        event: What it begins with: "left" or "right" strikes the floor, "both" leave it, or "none".
    """

    start: int
    stop: int
    event: str


@dataclass(frozen=True, eq=False)
class Segments:
    """All segments of the examples, clip by clip in order of time.

    Attributes:
        starts: First example of each.
        lengths: Their numbers of frames.
        kinds: Their kinds: behaviour and event.
        continues: Whether a segment follows the one before it in the same clip.
        count: How many kinds there are.
    """

    starts: Ints[Array, "segments"]
    lengths: Ints[Array, "segments"]
    kinds: Ints[Array, "segments"]
    continues: Bools[Array, "segments"]
    count: int


def segments_of(examples: Examples) -> Segments:
    """Cuts all clips at foot strikes and take-offs."""
    found: list[Segment] = []
    names: list[tuple[str, str]] = []
    continues: list[bool] = []
    bounds = zip(examples.starts.tolist(), examples.stops.tolist(), examples.behaviours, strict=True)
    for start, stop, behaviour in bounds:
        for number, segment in enumerate(_cut(examples.standing[start:stop], start, examples.layout.rate)):
            found.append(segment)
            names.append((behaviour, segment.event))
            continues.append(number > 0)
    counts = {name: names.count(name) for name in dict.fromkeys(names)}
    merged = [name if counts[name] >= _FEWEST else (name[0], "few") for name in names]
    order = {name: index for index, name in enumerate(dict.fromkeys(merged))}
    return Segments(
        np.array([segment.start for segment in found]),
        np.array([segment.stop - segment.start for segment in found]),
        np.array([order[name] for name in merged]),
        np.array(continues),
        len(order),
    )


def canonical(
    values: Floats[Array, "frames columns"], start: int, length: int, samples: int
) -> Floats[Array, "samples columns"]:
    """A segment's values at equal shares of its time, its first frame first and its end's next frame just beyond."""
    where = start + np.arange(samples) * length / samples
    last = start + length - 1
    low = np.minimum(where.astype(np.int64), last)
    high = np.minimum(low + 1, last)
    share = (where - low)[:, None]
    return (1 - share) * values[low] + share * values[high]


def _cut(standing: Bools[Array, "frames 2"], start: int, rate: float) -> list[Segment]:
    """Segments of one clip."""
    shortest = max(round(_SHORTEST * rate), 2)
    events = _events(standing)
    cuts: list[tuple[int, str]] = [(0, "none")]
    for frame, event in events:
        if frame - cuts[-1][0] >= shortest:
            cuts.append((frame, event))
        elif frame == cuts[-1][0] == 0:
            cuts[-1] = (frame, event)
    if len(standing) - cuts[-1][0] < shortest and len(cuts) > 1:
        cuts.pop()
    ends = [frame for frame, _ in cuts[1:]] + [len(standing)]
    segments: list[Segment] = []
    for (begin, event), end in zip(cuts, ends, strict=True):
        parts = max(int(np.ceil((end - begin) / (_LONGEST * rate))), 1)
        edges = np.linspace(begin, end, parts + 1).round().astype(int)
        for number, (first, last) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
            segments.append(Segment(start + first, start + last, event if number == 0 else "none"))
    return segments


def _events(standing: Bools[Array, "frames 2"]) -> list[tuple[int, str]]:
    """Frames at which a foot strikes the floor, or both have left it, in order of time."""
    change = np.diff(standing.astype(np.int8), axis=0)
    aloft = np.asarray(~standing[:, 0] & ~standing[:, 1])
    found: list[tuple[int, str]] = []
    for frame in range(1, len(standing)):
        left, right = change[frame - 1]
        if aloft[frame] and not aloft[frame - 1]:
            found.append((frame, "both"))
        elif left == 1 or right == 1:
            found.append((frame, "left" if left == 1 else "right"))
    return found
