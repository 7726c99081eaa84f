"""Ten minutes of input: whether a step takes longer, or the state and the memory grow, as time goes on."""

import gc
import sys
from time import perf_counter
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.memory import peak_memory
from poseloom.benchmark.one_imu.plan import FOOT, OURS, Plan, Progress
from poseloom.benchmark.one_imu.trials import Question, fit_method, pooled, sequence, training_pairs
from poseloom.evaluation.rows import Row
from poseloom.methods.imus.phase_hmm import PhaseHmm, PhaseHmmState
from poseloom.sensors import Recording

MINUTES = 10
"""How long it hears one sequence, over and over."""

_TAKES = 4


def ten_minutes(plan: Plan, tell: Progress) -> list[Row]:
    """Rows of the table "long": a step's time in the first and in the last minute, the state's size, memory gained.

    The model is small (four walks), for what could grow with time does not depend on what was learnt. Memory is the
    blocks that the interpreter holds, and the peak of all the process took, after the last minute beyond the first.
    """
    pool = pooled(plan.data)
    walks = [take for take in pool.without(pool.tables) if take.behaviour == "walking"][:_TAKES]
    method = fit_method(OURS, training_pairs(walks, FOOT, plan.seed, False), FOOT, None, plan.seed)
    assert isinstance(method, PhaseHmm)
    asked = next(take for take in pool.tables if take.behaviour == "walking")
    heard = sequence(Question(plan.data, OURS, FOOT, (), limit=plan.limit, seed=plan.seed), asked)
    minutes = 2 if plan.quick else MINUTES
    tell("ten minutes", 0, 1)
    run = _run(method, heard, minutes)
    tell("ten minutes", 1, 1)
    values = [
        ("first_minute_ms_p50", 1000 * float(np.median(run.seconds[0]))),
        ("last_minute_ms_p50", 1000 * float(np.median(run.seconds[-1]))),
        ("state_bytes_after_first_minute", float(run.state[0])),
        ("state_bytes_after_last_minute", float(run.state[-1])),
        ("blocks_gained", float(run.blocks[-1] - run.blocks[0])),
        ("peak_gained_kb", float(run.peak[-1] - run.peak[0])),
    ]
    setting = f"{FOOT}, {minutes} minutes"
    return [
        Row("long", OURS, setting, "none", name, value, None, 1, run.seconds.size, plan.seed) for name, value in values
    ]


def state_bytes(state: PhaseHmmState) -> int:
    """Bytes of the arrays in a state, those of its parts included; what belongs to the wearer alone left out."""
    values: list[object] = [*vars(state).values(), *state.mounting]
    values += [] if state.guess is None else vars(state.guess).values()
    values += [] if state.ground is None else state.ground
    return sum(value.nbytes for value in values if isinstance(value, np.ndarray))


class _Run(NamedTuple):
    """Of each minute: the seconds of its steps, and the state, the objects and the peak of memory at its end."""

    seconds: Floats[Array, "minutes steps"]
    state: list[int]
    blocks: list[int]
    peak: list[int]


def _run(method: PhaseHmm, heard: Recording, minutes: int) -> _Run:
    count = round(60 * method.layout.rate)
    run = _Run(np.empty((minutes, count)), [], [], [])
    samples = [heard.sample(index) for index in range(len(heard))]
    state = method.start(heard.skeleton, heard.placements)
    for minute in range(minutes):
        for index in range(count):
            begun = perf_counter()
            state, _ = method.step(state, samples[(minute * count + index) % len(samples)])
            run.seconds[minute, index] = perf_counter() - begun
        gc.collect()
        run.state.append(state_bytes(state))
        run.blocks.append(sys.getallocatedblocks())
        run.peak.append(round(1024 * peak_memory()))
    return run
