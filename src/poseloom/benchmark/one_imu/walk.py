"""The real walk: a model of all recordings hears the sensors of somebody who is in none of them."""

from collections.abc import Callable, Mapping
from typing import Any

from poseloom.benchmark.one_imu.plan import FOOT, OURS, Plan, Progress
from poseloom.benchmark.one_imu.real_walk import real_walk
from poseloom.benchmark.one_imu.trials import Question, fitted
from poseloom.evaluation.rows import Row
from poseloom.methods import Reconstruction, Reconstructor
from poseloom.skeleton.skeleton import Skeleton

METHODS = (OURS, "nearest-window", "motion-graph")

_NEEDED = "imu/neura_walk"


def real_walk_rows(plan: Plan, tell: Progress) -> tuple[list[Row], Mapping[str, Reconstruction]]:
    """Legs against the cameras, by the right foot's sensor alone; nothing where the recording is not there."""
    if not (plan.data / _NEEDED).is_dir():
        return [], {}

    def maker(method: str) -> Callable[[Skeleton], Reconstructor[Any]]:
        return lambda _skeleton: fitted(Question(plan.data, method, FOOT, (), seed=plan.seed, mirrored=plan.mirrored))

    tell("real walk", 0, 1)
    methods = (OURS,) if plan.quick else METHODS
    rows, made = real_walk(plan.data, {method: maker(method) for method in methods})
    tell("real walk", 1, 1)
    return list(rows), made
