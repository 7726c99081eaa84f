"""All live measurements, one after the other."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from poseloom.benchmark.live.endurance import measure_endurance, measure_fast_input, measure_two_sessions
from poseloom.benchmark.live.faults import measure_faults
from poseloom.benchmark.live.fuzzing import measure_flood, measure_parsers
from poseloom.benchmark.live.session_time import measure_session_time
from poseloom.benchmark.live.stage import stage
from poseloom.evaluation.rows import Results, Row, motions_digest
from poseloom.samples import sample_motion

PARTS = ("endurance", "fast", "two", "faults", "hostile", "time")


@dataclass(frozen=True)
class LivePlan:
    """How long to measure.

    Attributes:
        endurance: Seconds of the long session.
        short: Seconds of the others.
        packets: Hostile inputs into the parsers.
        flood: Hostile packets into ports.
        session: Simulated seconds of each session whose time is compared with arrival.
        seed: Of all that is drawn.
        parts: Which parts.
    """

    endurance: float = 1800.0
    short: float = 30.0
    packets: int = 100_000
    flood: int = 12_000
    session: float = 60.0
    seed: int = 0
    parts: tuple[str, ...] = PARTS


QUICK = LivePlan(endurance=45.0, short=8.0, packets=10_000, flood=3_000, session=15.0)


def measure_live(plan: LivePlan, show: Callable[[str, int, int], None]) -> Results:
    """Measures; `show` is told how far it is."""
    rows: list[Row] = []
    if "time" in plan.parts:
        rows += measure_session_time(plan.session, plan.seed, show)
    if plan.parts == ("time",):
        return _results(rows)  # it needs no library and no devices
    with stage(plan.seed) as here:
        if "hostile" in plan.parts:
            rows += measure_parsers(plan.packets, plan.seed, show)
            rows += measure_flood(here, plan.flood, plan.seed, show)
        if "faults" in plan.parts:
            rows += measure_faults(here, show)
        if "two" in plan.parts:
            rows += measure_two_sessions(here, plan.short, show)
        if "fast" in plan.parts:
            rows += measure_fast_input(here, plan.short, show)
        if "endurance" in plan.parts:
            rows += measure_endurance(here, plan.endurance, show)
    return _results(rows)


def _results(rows: list[Row]) -> Results:
    return Results("live", motions_digest([sample_motion("walk")]), tuple(rows))


def with_rows_of(results: Results, before: Results) -> Results:
    """The results, and those of an earlier run for the parts that were not measured now."""
    measured = {row.table for row in results.rows}
    return replace(results, rows=(*results.rows, *(row for row in before.rows if row.table not in measured)))
