"""Table 2: compute of a step by the size of what the model has learnt."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.one_imu.plan import FOOT, OURS, Plan, Progress
from poseloom.benchmark.one_imu.sequences import Take
from poseloom.benchmark.one_imu.trials import Question, fit_method, pooled, seed_of, sequence
from poseloom.evaluation.rows import Row
from poseloom.methods import Reconstructor, reconstruct
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.pairs import WELL_MOUNTED, SignalPair, pair_of_recording
from poseloom.methods.imus.phase_hmm import PhaseHmm
from poseloom.sensors import Recording, layout
from poseloom.skeleton.mirror import mirror_motion
from poseloom.skeleton.motion import make_motion
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_imus

SIZES: tuple[tuple[str, tuple[str, ...], int], ...] = (
    ("W", ("walking",), 500),
    ("W", ("walking",), 1000),
    ("W", ("walking",), 2000),
    ("W", ("walking",), 4000),
    ("W-R", ("walking", "running"), 5000),
    ("W-R-J-H", ("walking", "running", "jumping", "hopping"), 10_000),
    ("W-R-J-H", ("walking", "running", "jumping", "hopping"), 100_000),
)
"""Motions and frames as in the paper, and ten times as many."""

_TEMPI = (1.0, 0.9, 1.1, 0.95, 1.05)
"""Where the recordings are too few, they are taken again, mirrored and at other tempi. For speed alone."""

_REPEATS = 9
_STEPS = 600


def table_two(plan: Plan, tell: Progress) -> list[Row]:
    """Percentiles of a step's time, and frames a second, by size; each step's time is the least of nine runs."""
    pool = pooled(plan.data)
    sizes = SIZES[:-1] if plan.quick else SIZES
    asked = _heard(plan)
    rows: list[Row] = []
    for number, (motions, behaviours, frames) in enumerate(sizes):
        tell("table 2", number, len(sizes))
        # The sequences that are heard are left out, as everywhere.
        takes = [t for t in pool.without(pool.tables) if t.behaviour in behaviours]
        pairs = _pairs(takes, behaviours, frames, plan.seed)
        for method in plan.chosen((OURS, "nearest-window")):
            rows += _row_set(plan, fit_method(method, pairs, FOOT, None, plan.seed), method, motions, frames, asked)
    tell("table 2", len(sizes), len(sizes))
    return rows


def _row_set(
    plan: Plan, method: Reconstructor[Any], name: str, motions: str, frames: int, asked: Sequence[Recording]
) -> list[Row]:
    seconds = np.concatenate([least_of(method, recording) for recording in asked])
    values = [
        ("step_ms_p50", 1000 * float(np.percentile(seconds, 50))),
        ("step_ms_p99", 1000 * float(np.percentile(seconds, 99))),
        ("frames_a_second", float(1 / seconds.mean())),
    ]
    if isinstance(method, PhaseHmm):
        values.append(("segments", float(len(method.model.first))))
    setting = f"{motions}, {frames:,} frames"
    return [
        Row("2", name, setting, "none", metric, value, None, len(asked), len(seconds), plan.seed)
        for metric, value in values
    ]


def least_of(method: Reconstructor[Any], recording: Recording) -> Floats[Array, "steps"]:
    """Of each step the least time of some runs, seconds: what else the machine does is not the method's."""
    runs = [reconstruct(method, recording).step_seconds for _ in range(_REPEATS + 1)]
    return np.min(runs[1:], axis=0)


def _heard(plan: Plan) -> list[Recording]:
    """Sequences of the tables of every behaviour, `_STEPS` samples in all."""
    pool = pooled(plan.data)
    question = Question(plan.data, OURS, FOOT, (), limit=_STEPS // 4, seed=plan.seed)
    chosen = [next(t for t in pool.tables if t.behaviour == b) for b in ("walking", "running", "jumping")]
    return [sequence(question, take) for take in (chosen[0], chosen[2], *chosen[1:2])] + [
        sequence(question, take) for take in pool.tables[1:2]
    ]


def _pairs(takes: Sequence[Take], behaviours: Sequence[str], frames: int, seed: int) -> list[SignalPair]:
    """So many frames, all behaviours in turn so that each has its share."""
    queues = {b: [t for t in takes if t.behaviour == b] for b in behaviours}
    order = [t for group in in_turn(list(queues.values())) for t in group]
    pairs: list[SignalPair] = []
    left = frames
    for round_ in range(2 * len(_TEMPI)):
        for take in order:
            pair = _pair(take, _TEMPI[round_ // 2], bool(round_ % 2), seed, left)
            if pair is not None:
                pairs.append(pair)
                left -= len(pair)
            if left < 24:
                return pairs
    return pairs


def in_turn(queues: Sequence[Sequence[Take]]) -> list[list[Take]]:
    """One take of each queue, then the next of each, until all queues are through; those that end early leave out."""
    longest = max(len(queue) for queue in queues)
    return [[queue[i] for queue in queues if i < len(queue)] for i in range(longest)]


def _pair(take: Take, tempo: float, mirrored: bool, seed: int, most: int) -> SignalPair | None:
    motion = mirror_motion(take.motion) if mirrored else take.motion
    if tempo != 1.0:
        played = make_motion(motion.skeleton, motion.q, tempo * motion.rate, motion.name)
        motion = resample(played, motion.rate)
    motion = motion.cut(0, min(len(motion), most))
    if len(motion) < 24:
        return None
    drawn = seed_of(take.source, seed, f"speed {tempo} {mirrored}")
    recording = simulate_imus(motion, layout(FOOT), WELL_MOUNTED, seed=drawn)
    name = f"{take.take} {tempo} {mirrored}"
    return pair_of_recording(recording, Behaviour(take.behaviour), take.person, name)
