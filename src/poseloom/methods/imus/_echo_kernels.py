"""Running distances of recent signals to those of every frame of the examples, in compiled code."""

import numpy as np

from poseloom.arrays import Array, Bools, Floats32, Ints, compiled


@compiled
def follow(
    last: Floats32[Array, "states"],
    signals: Floats32[Array, "states channels"],
    begins: Bools[Array, "states"],
    said: Floats32[Array, "channels"],
    weights: Floats32[Array, "channels"],
    kept: float,
    out: Floats32[Array, "states"],
) -> None:
    """Fills the squared distances a sample later: those of the frame before, faded, and the new sample's own.

    Distance (i, t) is the sum over k of `kept`^k times the weighted squared difference of the signal at t - k and that
    of frame i - k: a window with an exponential end, for the price of one sample. Where a clip begins (`begins`), what
    would have been before is taken to be as far off as the frame itself was.
    """
    for i in range(signals.shape[0]):
        total = np.float32(0.0)
        for c in range(signals.shape[1]):
            away = said[c] - signals[i, c]
            total += weights[c] * away * away
        out[i] = np.float32(kept) * (last[i] if begins[i] else last[i - 1]) + total


@compiled
def nearest(
    distances: Floats32[Array, "states"],
    share: float,
    strangeness: Floats32[Array, "segments"],
    first: Ints[Array, "segments"],
    stop: Ints[Array, "segments"],
    rows: Ints[Array, "best"],
    owners: Ints[Array, "best"],
) -> int:
    """Fills the frames of the least `share` times distance plus their segment's strangeness, and their segments.

    Returns how many there are.
    """
    count = 0
    costs = np.empty(rows.shape[0], dtype=np.float32)
    for s in range(first.shape[0]):
        for i in range(first[s], stop[s]):
            cost = np.float32(share) * distances[i] + strangeness[s]
            if count == rows.shape[0] and cost >= costs[count - 1]:
                continue
            at = min(count, rows.shape[0] - 1)
            while at > 0 and costs[at - 1] > cost:
                costs[at], rows[at], owners[at] = costs[at - 1], rows[at - 1], owners[at - 1]
                at -= 1
            costs[at], rows[at], owners[at] = cost, i, s
            count = min(count + 1, rows.shape[0])
    return count
