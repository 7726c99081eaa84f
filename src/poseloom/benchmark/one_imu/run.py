"""The whole of the single-IMU paper's experiments, as rows."""

import hashlib
from collections.abc import Callable

from poseloom.benchmark.one_imu.accuracy import by_subject, figure_ten, specialists, table_three
from poseloom.benchmark.one_imu.dropouts import dropouts
from poseloom.benchmark.one_imu.endurance import ten_minutes
from poseloom.benchmark.one_imu.labels import phase_labels
from poseloom.benchmark.one_imu.plan import Plan, Progress
from poseloom.benchmark.one_imu.speed import table_two
from poseloom.benchmark.one_imu.sweep import sweep
from poseloom.benchmark.one_imu.transitions import transitions
from poseloom.benchmark.one_imu.trials import pooled
from poseloom.benchmark.one_imu.walk import real_walk_rows
from poseloom.errors import unknown_name
from poseloom.evaluation.rows import Results, Row, motions_digest

_RUNS: dict[str, Callable[[Plan, Progress], list[Row]]] = {
    "sweep": sweep,
    "3": table_three,
    "specialists": specialists,
    "subject": by_subject,
    "10": figure_ten,
    "2": table_two,
    "long": ten_minutes,
    "transitions": transitions,
    "phases": phase_labels,
    "dropouts": dropouts,
    "real": lambda plan, tell: real_walk_rows(plan, tell)[0],
}


def run_one_imu(
    plan: Plan, progress: Progress | None = None, found: Callable[[list[Row]], object] | None = None
) -> Results:
    """Runs the parts of a plan one after the other.

    Args:
        plan: What to run.
        progress: Told how far it is.
        found: Told the rows of each part as it ends.

    Raises:
        PoseloomError: for missing recordings, an unknown part, or a take both tabled and used to choose settings.
    """
    tell, show = progress or _silent, found or _ignore
    for part in plan.parts:
        if part not in _RUNS:
            raise unknown_name("part", part, _RUNS)
    pool = pooled(plan.data)
    rows: list[Row] = []
    for part in (part for part in _RUNS if part in plan.parts):
        some = _RUNS[part](plan, tell)
        rows += some
        show(some)
    truths = motions_digest(take.motion for take in pool.takes)
    asked = " ".join(take.source for take in (*pool.tables, *pool.transitions, *pool.validation))
    return Results("one-imu", hashlib.sha256(f"{truths} {asked}".encode()).hexdigest(), tuple(rows))


def _silent(what: str, done: int, total: int) -> None:
    pass


def _ignore(rows: list[Row]) -> None:
    pass
