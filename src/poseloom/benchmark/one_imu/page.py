"""The single-IMU experiments' figures in Markdown, the paper's beside ours."""

from collections.abc import Callable, Sequence

from poseloom.benchmark.one_imu.accuracy import ALL, COVERED
from poseloom.benchmark.one_imu.page_live import ERROR, LIVE_TABLES, cell
from poseloom.benchmark.one_imu.plan import FOOT, FOOT_AND_HAND, METHODS, OURS, PLACEMENTS
from poseloom.benchmark.one_imu.sequences import BEHAVIOURS
from poseloom.benchmark.tables import figure_of, markdown_table
from poseloom.evaluation.rows import Results, Row

_BEST_SHOWN = 3
_SWEPT = (
    ("mean_over_behaviours_cm", 2),
    ("one_sensor_cm", 2),
    ("two_sensors_cm", 2),
    (ERROR, 2),
    ("jitter_over_truth", 1),
)

_PAPERS_TABLE_THREE = {
    "walking": (2.74, 2.07, 3.54, 2.53, 2.26),
    "running": (2.79, 2.11, 4.15, 2.71, 2.35),
    "jumping": (4.17, 1.98, 4.98, 3.97, 3.62),
    "hopping": (2.46, 1.91, 4.42, 2.44, 2.19),
    "all": (4.53, 3.03, 7.33, 4.03, 3.77),
}
"""cm: its one sensor, its two, Eom et al., Riaz et al. (two), Min and Chai (two)."""

_PAPERS_COLUMNS = {
    (FOOT, OURS): 0,
    (FOOT_AND_HAND, OURS): 1,
    (FOOT, "phase-hmm-paper"): 0,
    (FOOT_AND_HAND, "phase-hmm-paper"): 1,
    (FOOT, "phase-regression"): 2,
    (FOOT_AND_HAND, "sparse-accelerometers"): 3,
    (FOOT_AND_HAND, "motion-primitives"): 4,
}

_SENSORS = {FOOT: "right foot", FOOT_AND_HAND: "right foot and hand"}


def one_imu_figures(results: Results, commit: str) -> str:
    """All tables of a run."""
    seeds = sorted({row.seed for row in results.rows if row.seed is not None})
    parts = [
        f"poseloom {results.version or 'of this commit'}, commit `{commit}`, data digest `{results.data_digest[:16]}`, "
        f"seed {', '.join(map(str, seeds))}. Errors in cm: mean distance of joints over frames, place and heading of "
        "the hips removed, ± the standard deviation over sequences."
    ]
    builders: tuple[Callable[[Sequence[Row]], str], ...] = (
        _three, _other, _subject, _ten, *LIVE_TABLES, _sweep,
    )  # fmt: skip
    return "\n\n".join([*parts, *(text for build in builders if (text := build(results.rows)))])


def _three(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "3" and row.split == "by-sequence"]
    return "\n\n".join(
        [
            f"## Table 3, {what}, by-sequence\n\n{_counts(mine, what)}\n\n{_accuracy(mine, what)}"
            for what in (COVERED, ALL)
        ]
        if mine
        else []
    )


def _accuracy(rows: Sequence[Row], what: str) -> str:
    """Methods by sensors; a column for each specialist, for the joint model on the same motions, and for all."""
    columns = [
        *((model, behaviour) for behaviour in BEHAVIOURS for model in ("specialist", "joint")),
        ("joint", "all"),
    ]
    columns = [c for c in columns if any(row.setting.endswith(f"{c[0]}, {c[1]}, {what}") for row in rows)]
    lines: list[Sequence[str]] = []
    for sensors in (FOOT, FOOT_AND_HAND):
        for method in METHODS:
            cells = [cell(rows, method, f"{sensors}, {model}, {behaviour}, {what}") for model, behaviour in columns]
            if any(cells):
                lines.append((_SENSORS[sensors], method, *cells))
            paper = _PAPERS_COLUMNS.get((sensors, method))
            if paper is not None and any(cells) and method != "phase-hmm-paper":
                told = [_PAPERS_TABLE_THREE[b][paper] if m == "specialist" or b == "all" else None for m, b in columns]
                lines.append(("", f"*{method} in the paper*", *("" if t is None else f"*{t:.2f}*" for t in told)))
    return markdown_table(("sensors", "method", *(f"{behaviour}, {model}" for model, behaviour in columns)), lines)


def _other(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "3" and row.split == "by-sequence"]
    metrics = (
        ("joint_position_cm_first_two_seconds", "error in the first 2 s, cm", 2),
        ("joint_position_cm_after_half_a_second", "after the first 0.5 s", 2),
        ("jitter_over_truth", "jitter over the truth's", 1),
        ("foot_skate_cm_s", "foot skate, cm/s", 1),
        ("foot_skate_over_truth", "over the truth's", 1),
        ("path_error_percent", "path, % of the way", 1),
        ("turned_path_error_percent", "heading aligned", 1),
        ("way_length_error_percent", "its length", 1),
        ("step_ms_p50", "step p50, ms", 2),
        ("step_ms_p99", "p99, ms", 2),
    )
    lines = [
        (_SENSORS[sensors], method, *(cell(mine, method, setting, metric, digits) for metric, _, digits in metrics))
        for sensors in (FOOT, FOOT_AND_HAND)
        for method in METHODS
        if cell(mine, method, setting := f"{sensors}, joint, all, {COVERED}")
    ]
    if not lines:
        return ""
    return f"Other measures of the joint model, {COVERED}:\n\n" + markdown_table(
        ("sensors", "method", *(label for _, label, _ in metrics)), lines
    )


def _subject(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "3" and row.split == "by-subject"]
    if not mine:
        return ""
    lines = [
        (
            _SENSORS[sensors],
            method,
            *(cell(mine, method, f"{sensors}, joint, {b}, {ALL}") for b in (*BEHAVIOURS, "all")),
        )
        for sensors in (FOOT, FOOT_AND_HAND)
        for method in METHODS
        if cell(mine, method, f"{sensors}, joint, all, {ALL}")
    ]
    return f"## Table 3 by-subject: the joint model\n\n{_counts(mine, ALL)}\n\n" + markdown_table(
        ("sensors", "method", *BEHAVIOURS, "all"), lines
    )


def _ten(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "10"]
    if not mine:
        return ""
    lines = [
        (
            placement,
            method,
            *(cell(mine, method, f"{placement}-imu, joint, {b}, {COVERED}") for b in (*BEHAVIOURS, "all")),
        )
        for placement in PLACEMENTS
        for method in (OURS, "nearest-window")
        if cell(mine, method, f"{placement}-imu, joint, all, {COVERED}")
    ]
    return f"## Figure 10: where the sensor is worn ({COVERED}, by-sequence)\n\n" + markdown_table(
        ("place", "method", *BEHAVIOURS, "all"), lines
    )


def _sweep(rows: Sequence[Row]) -> str:
    found: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        if row.table == "tried":
            found.setdefault((row.method, row.setting), {})[row.metric] = row
    if not found:
        return ""
    lines: list[Sequence[str]] = []
    for method in dict.fromkeys(name for name, _ in found):
        tried = [(setting, some) for (name, setting), some in found.items() if name == method]
        ranked = sorted(tried, key=lambda one: one[1]["mean_over_behaviours_cm"].value)
        told = [("before", *tried[0]), *((str(place + 1), *one) for place, one in enumerate(ranked[:_BEST_SHOWN]))]
        told.append((f"{len(ranked)}, the last", *ranked[-1]))
        lines += [
            (method, place, setting, *(figure_of(some[m], digits) for m, digits in _SWEPT))
            for place, setting, some in told
        ]
    heads = (
        "method",
        "rank",
        "settings",
        "mean",
        "one sensor",
        "two sensors",
        "mean of frames",
        "jitter over the truth's",
    )
    return (
        "## Choosing settings\n\nOn the validation sequences, cm: mean over one and two sensors of the mean over "
        f"behaviours. The first {_BEST_SHOWN} of each method and its last.\n\n{markdown_table(heads, lines)}"
    )


def _counts(rows: Sequence[Row], what: str) -> str:
    """How many sequences and frames are behind a table."""
    told: list[str] = []
    for behaviour in (*BEHAVIOURS, "all"):
        own = next((r for r in rows if r.metric == ERROR and r.setting.endswith(f"joint, {behaviour}, {what}")), None)
        if own is not None:
            told.append(f"{behaviour} {own.sequences} sequences, {own.frames:,} frames")
    return "; ".join(told) + "."
