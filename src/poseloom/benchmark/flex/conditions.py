"""What ageing, a failed channel and another sensor do to contestants that were fitted already."""

from collections.abc import Mapping, Sequence

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.flex.material import NEW_SUIT, PLAIN, Inputs, Material
from poseloom.benchmark.flex.scoring import PieceScore, Teller, pooled, score_pieces
from poseloom.evaluation.rows import Row
from poseloom.sensors import layout
from poseloom.sensors.flex_range import FlexRange
from poseloom.training.draws import draw_counts, hear
from poseloom.training.splits import Piece

MINUTES = (0.0, 15.0, 30.0, 60.0, 120.0)
"""Minutes of use before a session."""

SPOILT = ("silent", "stuck", "saturated", "noisy")
"""What becomes of a channel."""

_AFTER = ((0.0, 5.0), (5.0, 30.0), (30.0, float("inf")))
"""Seconds since another sensor was put on."""
_MINUTES_OF_FAULTS = 20.0
_NOISE_COUNTS = 300.0
_FAULTS_EVERY = 4
"""Faults are measured on every fourth tested take: there are seventeen runs over them."""


def ageing_rows(
    material: Material, split: str, tellers: Mapping[str, Teller], setting: str, at_first_range: bool = False
) -> list[Row]:
    """Error and jitter against minutes of use before the session; the same sensors and motions throughout.

    Use goes on through the session, so even 0 minutes are not quite new.
    """
    rows: list[Row] = []
    for minutes in MINUTES:
        heard = material.heard_at_first_range if at_first_range else material.heard
        inputs = heard(NEW_SUIT, minutes)
        for name, tell in tellers.items():
            scored = pooled(_test(material, split, tell, inputs))
            words = f"{setting}, {minutes:g} minutes"
            rows.append(_row("ageing", name, words, split, "error_deg", scored.error, scored.sequences, scored.frames))
            rows.append(
                _row("ageing", name, words, split, "jitter_deg_s3", scored.jitter, scored.sequences, scored.frames)
            )
    return rows


def fault_rows(material: Material, split: str, tellers: Mapping[str, Teller]) -> list[Row]:
    """Error with one channel spoilt throughout, mean over the four, beside that with all sound; every fourth take."""
    names = layout("flex-four").names
    rows: list[Row] = []
    pieces = material.divided(split).test[::_FAULTS_EVERY]
    counts = {index: _counts(material, index) for index in {piece.session for piece in pieces}}
    for fault in ("none", *SPOILT):
        channels = range(1) if fault == "none" else range(len(names))
        inputs = [_spoilt(material, counts, fault, channel) for channel in channels]
        for name, tell in tellers.items():
            scored = pooled([each for own in inputs for each in _test(material, split, tell, own, _FAULTS_EVERY)])
            rows.append(_row("faults", name, fault, split, "error_deg", scored.error, scored.sequences, scored.frames))
    return rows


def replacement_rows(material: Material, split: str, tellers: Mapping[str, Teller]) -> list[Row]:
    """Error by the time since both elbows' sensors were replaced, over the error of the same frames without that.

    In the middle of each tested person's session two sensors are exchanged for new ones drawn from the batch. Frames
    count by the time since; the network goes on as in a live session, within a take.
    """
    rows: list[Row] = []
    pieces = material.divided(split).test
    counts = {index: _counts(material, index) for index in {piece.session for piece in pieces}}
    middles = {index: len(each) // 2 for index, each in counts.items()}
    sound = {index: _hear(material, index, each) for index, each in counts.items()}
    changed = {
        index: _hear(material, index, _replaced(material, index, each, middles[index]))
        for index, each in counts.items()
    }
    for begin, end in _AFTER:
        parts = [part for piece in pieces if (part := _part(material, piece, middles[piece.session], begin, end))]
        if not parts:
            continue
        for name, tell in tellers.items():
            after, without = (
                pooled(score_pieces(material.sessions, parts, _by_session(material, each), tell))
                for each in (changed, sound)
            )
            words = f"{begin:g} to {end:g} s after" if np.isfinite(end) else f"more than {begin:g} s after"
            rows.append(_row("replaced", name, words, split, "error_deg", after.error, after.sequences, after.frames))
            ratio = after.error / without.error
            rows.append(_row("replaced", name, words, split, "error_over_none", ratio, after.sequences, after.frames))
    return rows


def _test(
    material: Material, split: str, tell: Teller, inputs: Sequence[Inputs], every: int = 1
) -> tuple[PieceScore, ...]:
    return score_pieces(material.sessions, material.divided(split).test[::every], inputs, tell)


def _counts(material: Material, index: int) -> Floats[Array, "frames channels"]:
    return draw_counts(material.sessions[index], NEW_SUIT, PLAIN.sensors, _MINUTES_OF_FAULTS)


def _hear(material: Material, index: int, counts: Floats[Array, "frames channels"]) -> Inputs:
    return hear(counts, material.sessions[index].rate, FlexRange())


def _by_session(material: Material, heard: Mapping[int, Inputs]) -> Sequence[Inputs]:
    empty = np.zeros((0, 8), dtype=np.float32)
    return [heard.get(index, empty) for index in range(len(material.sessions))]


def _spoilt(
    material: Material, counts: Mapping[int, Floats[Array, "_ channels"]], fault: str, channel: int
) -> Sequence[Inputs]:
    heard: dict[int, Inputs] = {}
    for index, sound in counts.items():
        spoilt = sound.copy()
        spoilt[:, channel] = _spoil(fault, sound[:, channel])
        heard[index] = _hear(material, index, spoilt)
    return _by_session(material, heard)


def _spoil(fault: str, counts: Floats[Array, "frames"]) -> Floats[Array, "frames"]:
    if fault == "silent":
        return np.full_like(counts, np.nan)
    if fault == "stuck":
        return np.full_like(counts, np.nanmedian(counts))
    if fault == "saturated":
        return np.full_like(counts, PLAIN.sensors.board.top)
    if fault == "noisy":
        noise = np.random.default_rng(0).standard_normal(len(counts))
        return np.clip(counts + _NOISE_COUNTS * noise, 1.0, PLAIN.sensors.board.top - 1)
    return counts


def _replaced(
    material: Material, index: int, counts: Floats[Array, "frames channels"], middle: int
) -> Floats[Array, "frames channels"]:
    other = draw_counts(material.sessions[index], NEW_SUIT + 500, PLAIN.sensors, 0.0)
    changed = counts.copy()
    changed[middle:, 2:] = other[middle:, 2:]
    return changed


def _part(material: Material, piece: Piece, middle: int, begin: float, end: float) -> Piece | None:
    """The frames of a piece that lie within that time after the replacement."""
    rate = material.sessions[piece.session].rate
    start = max(piece.start, middle + round(begin * rate))
    stop = piece.stop if not np.isfinite(end) else min(piece.stop, middle + round(end * rate))
    return Piece(piece.session, piece.take, piece.heard, start, stop) if stop > start else None


def _row(
    table: str, name: str, setting: str, split: str, metric: str, value: float, sequences: int, frames: int
) -> Row:
    return Row(table, name, setting, split, metric, value, None, sequences, frames)
