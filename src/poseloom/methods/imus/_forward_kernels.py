"""The forward step of the two-level HMM, in compiled code."""

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints, compiled

_FIRST_COLUMNS = 12
"""Columns that are compared before it is asked whether a state can still be in the beam; the first vary most."""


@compiled
def predict(
    log_alpha: Floats[Array, "states"],
    first: Ints[Array, "segments"],
    stop: Ints[Array, "segments"],
    phase: Ints[Array, "segments"],
    successor: Ints[Array, "segments"],
    entry: Floats[Array, "phases phases"],
    phase_sizes: Ints[Array, "phases"],
    steps: Floats[Array, "3"],
    continuity: float,
    predicted: Floats[Array, "states"],
) -> None:
    """Fills the probabilities of the states before the new signal is looked at.

    Within a segment a frame keeps itself, goes on by one, or by two, with the probabilities `steps`. What goes beyond
    the segment's end enters other segments at their first frame: the share `continuity` the segment that followed it in
    the recording (`successor`, -1 where none did), the rest each phase by `entry[phase, other]`, equally over that
    phase's segments. Zero stands for states out of the beam.
    """
    inflow = np.zeros(phase_sizes.shape[0])
    leaving = np.zeros(phase_sizes.shape[0])
    predicted[:] = 0.0
    for s in range(first.shape[0]):
        begin, end = first[s], stop[s]
        left = 0.0
        for i in range(begin, end):
            if log_alpha[i] == -np.inf:
                continue
            mass = np.exp(log_alpha[i])
            predicted[i] += steps[0] * mass
            if i + 1 < end:
                predicted[i + 1] += steps[1] * mass
            else:
                left += steps[1] * mass
            if i + 2 < end:
                predicted[i + 2] += steps[2] * mass
            else:
                left += steps[2] * mass
        if left > 0.0:
            if successor[s] >= 0:
                predicted[first[successor[s]]] += continuity * left
                left *= 1.0 - continuity
            leaving[phase[s]] += left
    for a in range(leaving.shape[0]):
        if leaving[a] > 0.0:
            for b in range(leaving.shape[0]):
                inflow[b] += leaving[a] * entry[a, b]
    for s in range(first.shape[0]):
        if inflow[phase[s]] > 0.0:
            predicted[first[s]] += inflow[phase[s]] / phase_sizes[phase[s]]


@compiled
def update(
    predicted: Floats[Array, "states"],
    features: Floats32[Array, "states columns"],
    precision: Floats32[Array, "phases columns"],
    log_norm: Floats[Array, "phases"],
    log_weight: Floats[Array, "segments"],
    first: Ints[Array, "segments"],
    stop: Ints[Array, "segments"],
    phase: Ints[Array, "segments"],
    seen: Floats32[Array, "columns"],
    restart: float,
    stride: int,
    turn: int,
    beam: float,
    log_alpha: Floats[Array, "states"],
) -> float:
    """Weighs predicted states by what was seen, prunes, and normalises; fills `log_alpha`.

    The emission is a diagonal Gaussian of the features with the precisions of the state's phase, whose normalising
    terms are `log_norm`; `log_weight` is added for each segment: how well who moved there fits the wearer. Every
    `stride`-th state, beginning at `turn`, is also entered from nowhere with its share of the probability `restart`: so
    a state that had left the beam is looked at anew every `stride` samples, at a `stride`-th of the price.

    Returns:
        The logarithm of the probability of what was seen, given all before.
    """
    states, columns = features.shape
    some, whole = min(_FIRST_COLUMNS, columns - columns % 4), columns - columns % 4
    share = restart * stride / states
    log_share = np.log(share) if share > 0.0 else -np.inf
    best = -np.inf
    # The likeliest prediction goes first: most others then fall out of the beam before all their columns are read.
    # What is dropped here would be dropped at the end, for the best can only rise.
    ahead = int(np.argmax(predicted))
    for s in range(-1, first.shape[0]):
        begin, end = (ahead, ahead + 1) if s < 0 else (first[s], stop[s])
        owner = np.searchsorted(first, ahead, side="right") - 1 if s < 0 else s
        h = phase[owner]
        fixed = log_norm[h] + log_weight[owner]
        for i in range(begin, end):
            mass = (1.0 - restart) * predicted[i]
            entered = restart > 0.0 and i % stride == turn
            log_alpha[i] = -np.inf
            if mass > 0.0:
                value = fixed + np.log(mass + share if entered else mass)
            elif entered:
                value = fixed + log_share
            else:
                continue
            if value < best - beam:
                continue
            # Four sums: one would wait for itself at each addition.
            a0 = a1 = a2 = a3 = np.float32(0.0)
            for k in range(0, some, 4):
                d0, d1 = seen[k] - features[i, k], seen[k + 1] - features[i, k + 1]
                d2, d3 = seen[k + 2] - features[i, k + 2], seen[k + 3] - features[i, k + 3]
                a0 += precision[h, k] * d0 * d0
                a1 += precision[h, k + 1] * d1 * d1
                a2 += precision[h, k + 2] * d2 * d2
                a3 += precision[h, k + 3] * d3 * d3
            if value - 0.5 * (a0 + a1 + a2 + a3) < best - beam:
                continue
            for k in range(some, whole, 4):
                d0, d1 = seen[k] - features[i, k], seen[k + 1] - features[i, k + 1]
                d2, d3 = seen[k + 2] - features[i, k + 2], seen[k + 3] - features[i, k + 3]
                a0 += precision[h, k] * d0 * d0
                a1 += precision[h, k + 1] * d1 * d1
                a2 += precision[h, k + 2] * d2 * d2
                a3 += precision[h, k + 3] * d3 * d3
            for k in range(whole, columns):
                d0 = seen[k] - features[i, k]
                a0 += precision[h, k] * d0 * d0
            value -= 0.5 * (a0 + a1 + a2 + a3)
            log_alpha[i] = value
            if value > best:
                best = value
    total = 0.0
    for i in range(states):
        if log_alpha[i] < best - beam:
            log_alpha[i] = -np.inf
        else:
            total += np.exp(log_alpha[i] - best)
    shift = best + np.log(total)
    for i in range(states):
        if log_alpha[i] != -np.inf:
            log_alpha[i] -= shift
    return shift


@compiled
def settle(predicted: Floats[Array, "states"], beam: float, log_alpha: Floats[Array, "states"]) -> None:
    """The step without a signal: the prediction itself, pruned and normalised."""
    best = 0.0
    for i in range(predicted.shape[0]):
        if predicted[i] > best:
            best = predicted[i]
    least = best * np.exp(-beam)
    total = 0.0
    for i in range(predicted.shape[0]):
        if predicted[i] >= least:
            total += predicted[i]
    for i in range(predicted.shape[0]):
        log_alpha[i] = np.log(predicted[i] / total) if predicted[i] >= least else -np.inf


@compiled
def best_segments(
    log_alpha: Floats[Array, "states"],
    first: Ints[Array, "segments"],
    stop: Ints[Array, "segments"],
    phase: Ints[Array, "segments"],
    allowed: Bools[Array, "phases"],
    reach: int,
    chosen: Ints[Array, "best"],
    mass: Floats[Array, "best"],
    place: Floats[Array, "best"],
) -> int:
    """The segments of the largest probabilities in the allowed phases, and where in them one is.

    Only the states up to `reach` from a segment's likeliest one count: between two places that are both likely lies
    one that is not. Fills, best first, the segments' indices, these probabilities and the expected states
    (fractional). Returns how many were found.
    """
    count = 0
    for s in range(first.shape[0]):
        if not allowed[phase[s]]:
            continue
        peak = -1
        for i in range(first[s], stop[s]):
            if log_alpha[i] != -np.inf and (peak < 0 or log_alpha[i] > log_alpha[peak]):
                peak = i
        if peak < 0:
            continue
        total, moment = 0.0, 0.0
        for i in range(max(first[s], peak - reach), min(stop[s], peak + reach + 1)):
            if log_alpha[i] != -np.inf:
                p = np.exp(log_alpha[i])
                total += p
                moment += p * i
        at = count
        while at > 0 and mass[at - 1] < total:
            at -= 1
        if at >= chosen.shape[0]:
            continue
        count = min(count + 1, chosen.shape[0])
        for k in range(count - 1, at, -1):
            chosen[k], mass[k], place[k] = chosen[k - 1], mass[k - 1], place[k - 1]
        chosen[at], mass[at], place[at] = s, total, moment / total
    return count


@compiled
def even_out(mass: Floats[Array, "best"], least: float, weights: Floats[Array, "best"]) -> float:
    """Fills weights that sum to one: the probabilities, raised to the power that leaves at least so many in effect.

    The effective number of weights is 1 / sum of their squares; it grows as the power falls from 1 to 0. `mass` is
    ordered, the largest first. Returns the power.
    """
    low, high = 0.0, 1.0
    power = 1.0
    for _ in range(16):
        total, squares = 0.0, 0.0
        for k in range(mass.shape[0]):
            weights[k] = (mass[k] / mass[0]) ** power
            total += weights[k]
            squares += weights[k] * weights[k]
        if total * total < least * squares:
            high = power
        elif power == 1.0:
            break
        else:
            low = power
        power = 0.5 * (low + high)
    total = 0.0
    for k in range(mass.shape[0]):
        weights[k] = (mass[k] / mass[0]) ** power
        total += weights[k]
    for k in range(mass.shape[0]):
        weights[k] /= total
    return power
