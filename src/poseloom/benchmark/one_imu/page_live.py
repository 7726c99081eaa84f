"""The single-IMU experiments' figures of live use in Markdown: time, transitions, phases, drop-outs, a real walk."""

from collections.abc import Callable, Iterable, Sequence

from poseloom.benchmark.one_imu.plan import OURS
from poseloom.benchmark.tables import figure_of, markdown_table
from poseloom.evaluation.rows import Row

ERROR = "joint_position_cm"

_PAPERS_RATES = {500: 65, 1000: 62, 2000: 57, 4000: 49, 5000: 38, 10_000: 12}
"""Frames a second by frames of the library."""


def _two(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "2"]
    if not mine:
        return ""
    lines: list[Sequence[str]] = []
    for setting in dict.fromkeys(row.setting for row in mine):
        frames = int(setting.split(", ")[1].removesuffix(" frames").replace(",", ""))
        paper = _PAPERS_RATES.get(frames)
        cells = [
            cell(mine, method, setting, metric, digits)
            for method, metric, digits in (
                (OURS, "segments", 0),
                (OURS, "step_ms_p50", 2),
                (OURS, "step_ms_p99", 2),
                (OURS, "frames_a_second", 0),
                ("nearest-window", "step_ms_p99", 2),
            )
        ]
        lines.append((setting, "" if paper is None else str(paper), *cells))
    heads = ("motions", "paper, frames/s", "segments", "p50, ms", "p99, ms", "frames/s", "nearest window p99, ms")
    told = "One thread; of each step the least of nine runs, so that other work on the machine does not count."
    return f"## Table 2: a step by the size of the library\n\n{told}\n\n{markdown_table(heads, lines)}"


def _long(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "long"]
    if not mine:
        return ""
    heads = ("input", "p50 in the first minute, ms", "in the last", "state after the first, bytes", "after the last",
             "blocks of memory gained", "peak of memory gained, kB")  # fmt: skip
    cells = [
        _first(mine, OURS, "first_minute_ms_p50"), _first(mine, OURS, "last_minute_ms_p50"),
        *(cell(mine, OURS, mine[0].setting, f"state_bytes_after_{each}_minute", 0) for each in ("first", "last")),
        *(cell(mine, OURS, mine[0].setting, each, 0) for each in ("blocks_gained", "peak_gained_kb")),
    ]  # fmt: skip
    return f"## A long session\n\n{markdown_table(heads, [(mine[0].setting, *cells)])}"


def _transitions(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "transitions"]
    if not mine:
        return ""
    metrics = (
        ("largest_velocity_jump_m_s", 2),
        ("jerk_km_s3", 2),
        ("foot_skate_cm_s", 1),
        ("joint_position_cm", 2),
        ("recognised_after_s", 2),
        ("worst_recognised_after_s", 2),
    )
    counts = {row.setting: row.sequences for row in mine if row.metric == "jerk_km_s3"}
    lines = [
        (
            kind,
            str(counts.get(kind, "")),
            method,
            *(cell(mine, method, kind, metric, digits) for metric, digits in metrics),
        )
        for kind in dict.fromkeys(row.setting for row in mine)
        for method in dict.fromkeys(row.method for row in mine)
    ]
    heads = ("transition", "count", "method", "velocity jump, m/s", "jerk, km/s³", "foot skate, cm/s", "error, cm",
             "recognised after, s", "worst, s")  # fmt: skip
    told = (
        "Half a second before and after. idle-walk and walk-idle as recorded, the others put together from two takes "
        "by a motion graph's blend, which is their truth. One sensor on the right foot."
    )
    return f"## Transitions\n\n{told}\n\n{markdown_table(heads, lines)}"


def _phases(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "phases"]
    if not mine:
        return ""
    metrics = list(dict.fromkeys(row.metric for row in mine))
    lines = [
        (setting.split(", ")[-1], *(cell(mine, OURS, setting, metric, 0) for metric in metrics))
        for setting in dict.fromkeys(row.setting for row in mine)
    ]
    return "## Phases told live, against those of the true motion\n\n" + markdown_table(
        (
            "motions",
            *(metric.replace("_", " ").replace(" percent", ", %").replace(" ms", ", ms") for metric in metrics),
        ),
        lines,
    )


def _dropouts(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "drop-outs"]
    if not mine:
        return ""
    metrics = (
        ("joint_position_cm_during", "error during, cm"),
        ("joint_position_cm_without", "without"),
        ("largest_jump_cm", "largest jump, cm"),
        ("worst_jump_cm", "worst of all"),
        ("largest_jump_cm_without", "largest jump without"),
        ("settled_after_s", "back to normal after, s"),
    )
    lines = [
        (setting, method, *(cell(mine, method, setting, metric) for metric, _ in metrics))
        for setting in dict.fromkeys(row.setting for row in mine)
        for method in dict.fromkeys(row.method for row in mine)
    ]
    told = (
        "Silence from 0.8 s to 1.8 s. A jump is a joint's movement from frame to frame, seen from the hips, that the "
        "truth does not make."
    )
    heads = ("sensors", "method", *(name for _, name in metrics))
    return f"## Drop-outs of one second\n\n{told}\n\n{markdown_table(heads, lines)}"


def _walk(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "real-walk"]
    if not mine:
        return ""
    metrics = list(dict.fromkeys(row.metric for row in mine))
    methods = list(dict.fromkeys(row.method for row in mine))
    lines = [(metric.replace("_", " "), *(_first(mine, method, metric) for method in methods)) for metric in metrics]
    return "## The real walk: the right foot's sensor alone\n\n" + markdown_table(("figure", *methods), lines)


def _first(rows: Iterable[Row], method: str, metric: str) -> str:
    return next((figure_of(r) for r in rows if r.method == method and r.metric == metric), "")


def cell(rows: Iterable[Row], method: str, setting: str, metric: str = ERROR, digits: int = 2) -> str:
    """A figure with its spread, or nothing where there is no such row."""
    own = (r for r in rows if r.method == method and r.setting == setting and r.metric == metric)
    return next((figure_of(row, digits) for row in own), "")


LIVE_TABLES: tuple[Callable[[Sequence[Row]], str], ...] = (_two, _long, _transitions, _phases, _dropouts, _walk)
"""What makes each of these tables of a run's rows; an empty text where the run lacks it."""
