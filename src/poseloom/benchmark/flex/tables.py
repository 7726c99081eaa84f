"""Scores as rows: over seeds, by motion, by joint, by person, and paired differences with their intervals."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from poseloom.benchmark.flex.scoring import PieceScore, pooled, pooled_errors
from poseloom.evaluation.rows import Row
from poseloom.methods.flex.angles import FLEX_JOINTS

Found = Mapping[str, Sequence[Sequence[PieceScore]]]
"""By contestant: for each seed the scores of all pieces."""

_MOTIONS: tuple[tuple[str, str], ...] = (
    *(("climb", "climb, swing (playground)"), ("scoop", "bend over"), ("punch", "punch"), ("swordplay", "swordplay")),
    *(("wash", "wash"), ("kick", "kick"), ("soccer", "soccer"), ("dance", "dance"), ("exercise", "exercise")),
    *(("signal", "basketball signals"), ("traffic", "directing traffic"), ("throw", "throw"), ("grab", "grab")),
    *(("basketball", "basketball, dribble"), ("squat", "squat"), ("lie", "lie down"), ("rotate", "rotate arms")),
    *(("elbow", "elbow to knee"), ("deposit", "put down"), ("sneak", "sneak"), ("jog", "jog, run")),
    *(("run", "jog, run"), ("hop", "hop, jump"), ("jump", "hop, jump"), ("jumping", "hop, jump")),
    *(("running", "jog, run"), ("walking", "walk"), ("walk", "walk")),
)  # fmt: skip
"""Words of a take's tags, the telling ones first, and the motion that they mean."""

# Two-sided 95 % quantiles of Student's distribution by degrees of freedom.
_STUDENT = {1: 12.71, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365, 8: 2.306, 9: 2.262}


def motion_of(tags: Sequence[str]) -> str:
    """The motion that a take's tags mean."""
    return next((motion for word, motion in _MOTIONS if word in tags), "other")


def half_interval(values: Sequence[float]) -> float:
    """Half the width of the 95 % interval of a mean (Student's); NaN for fewer than two values."""
    if len(values) < 2:
        return float("nan")
    return _STUDENT.get(len(values) - 1, 1.96) * float(np.std(values, ddof=1)) / math.sqrt(len(values))


def summarised(table: str, split: str, found: Found) -> list[Row]:
    """Error, moving error and jitter of each contestant: mean over seeds, spread over seeds, half the 95 % interval."""
    rows: list[Row] = []
    for name, runs in found.items():
        scores = [pooled(run) for run in runs]
        for metric, values in (
            ("error_deg", [score.error for score in scores]),
            ("moving_error_deg", [score.moving for score in scores]),
            ("jitter_deg_s3", [score.jitter for score in scores]),
        ):
            rows += _rows(table, name, "", split, metric, values, scores[0].sequences, scores[0].frames)
    return rows


def paired(split: str, found: Found, setting: str = "range learnt on line") -> list[Row]:
    """What the calibrator and the median bring, seed by seed and take by take: positive where they help."""
    pairs = (
        ("C", "Bi-LSTM", "Bi-LSTM-C"),
        ("C with M", "Bi-LSTM-M", "Bi-LSTM-CM"),
        ("M", "Bi-LSTM", "Bi-LSTM-M"),
        ("M centred", "Bi-LSTM", "Bi-LSTM-M, centred"),
        ("M with C", "Bi-LSTM-C", "Bi-LSTM-CM"),
        ("M centred with C", "Bi-LSTM-C", "Bi-LSTM-CM, centred"),
    )
    rows: list[Row] = []
    for name, without, with_it in pairs:
        for metric, of in (("error_less_deg", _error), ("jitter_less_deg_s3", _jitter)):
            pieces = np.array(
                [
                    [of([a]) - of([b]) for a, b in zip(first, second, strict=True)]
                    for first, second in zip(found[without], found[with_it], strict=True)
                ]
            )
            seeds = [of(first) - of(second) for first, second in zip(found[without], found[with_it], strict=True)]
            total = pooled(found[without][0])
            own = _rows("paired", name, setting, split, metric, seeds, total.sequences, total.frames)
            over_pieces = [float(value) for value in np.asarray(pieces.mean(axis=0)) if np.isfinite(value)]
            rows += own
            for what, value in (
                ("per_sequence", float(np.mean(over_pieces))),
                ("per_sequence_ci95", half_interval(over_pieces)),
            ):
                if np.isfinite(value):
                    rows.append(Row("paired", name, setting, split, f"{metric}_{what}", value, None, total.sequences))
    return rows


def by_motion(split: str, found: Found) -> list[Row]:
    """Table 2."""
    return _grouped("2", split, found, lambda score: motion_of(score.tags))


def by_person(split: str, found: Found) -> list[Row]:
    """The same by who moves."""
    return _grouped("people", split, found, lambda score: score.person)


def by_joint(split: str, found: Found) -> list[Row]:
    """Table 3: mean over a joint's three angles."""
    rows: list[Row] = []
    for name, runs in found.items():
        errors = np.stack([pooled_errors(run).reshape(-1, 3).mean(axis=1) for run in runs])
        total = pooled(runs[0])
        for joint, values in zip(FLEX_JOINTS, errors.T, strict=True):
            rows += _rows("3", name, joint, split, "error_deg", values.tolist(), total.sequences, total.frames)[:1]
    return rows


def _grouped(table: str, split: str, found: Found, key: Callable[[PieceScore], str]) -> list[Row]:
    rows: list[Row] = []
    for name, runs in found.items():
        for group in dict.fromkeys(key(score) for score in runs[0]):
            scores = [pooled([each for each in run if key(each) == group]) for run in runs]
            rows += _rows(
                table, name, group, split, "error_deg", [score.error for score in scores],
                scores[0].sequences, scores[0].frames,
            )[:1]  # fmt: skip
    return rows


def _rows(
    table: str, name: str, setting: str, split: str, metric: str, values: Sequence[float], sequences: int, frames: int
) -> list[Row]:
    """The mean over seeds with its spread, and half the 95 % interval where there are several seeds."""
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    rows = [Row(table, name, setting, split, metric, float(np.mean(values)), spread, sequences, frames)]
    if len(values) > 1:
        rows.append(Row(table, name, setting, split, f"{metric}_ci95", half_interval(values), None, sequences, frames))
        rows.append(Row(table, name, setting, split, f"{metric}_seeds", float(len(values)), None, sequences, frames))
    return rows


def _error(scores: Sequence[PieceScore]) -> float:
    return pooled(scores).error


def _jitter(scores: Sequence[PieceScore]) -> float:
    return pooled(scores).jitter
