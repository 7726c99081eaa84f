"""The single-IMU experiments' figures in Markdown, the paper's beside ours."""

from collections.abc import Callable, Iterable, Sequence

from poseloom.benchmark.one_imu.accuracy import ALL, COVERED
from poseloom.benchmark.one_imu.plan import FOOT, FOOT_AND_HAND, METHODS, OURS, PLACEMENTS
from poseloom.benchmark.one_imu.sequences import BEHAVIOURS
from poseloom.benchmark.tables import figure_of, markdown_table
from poseloom.evaluation.rows import Results, Row

ERROR = "joint_position_cm"

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

_PAPERS_RATES = {500: 65, 1000: 62, 2000: 57, 4000: 49, 5000: 38, 10_000: 12}
"""Frames a second by frames of the library."""

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
        _three, _other, _subject, _ten, _two, _long, _transitions, _phases, _dropouts, _walk, _sweep,
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
            cells = [_cell(rows, method, f"{sensors}, {model}, {behaviour}, {what}") for model, behaviour in columns]
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
        (_SENSORS[sensors], method, *(_cell(mine, method, setting, metric, digits) for metric, _, digits in metrics))
        for sensors in (FOOT, FOOT_AND_HAND)
        for method in METHODS
        if _cell(mine, method, setting := f"{sensors}, joint, all, {COVERED}")
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
            *(_cell(mine, method, f"{sensors}, joint, {b}, {ALL}") for b in (*BEHAVIOURS, "all")),
        )
        for sensors in (FOOT, FOOT_AND_HAND)
        for method in METHODS
        if _cell(mine, method, f"{sensors}, joint, all, {ALL}")
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
            *(_cell(mine, method, f"{placement}-imu, joint, {b}, {COVERED}") for b in (*BEHAVIOURS, "all")),
        )
        for placement in PLACEMENTS
        for method in (OURS, "nearest-window")
        if _cell(mine, method, f"{placement}-imu, joint, all, {COVERED}")
    ]
    return f"## Figure 10: where the sensor is worn ({COVERED}, by-sequence)\n\n" + markdown_table(
        ("place", "method", *BEHAVIOURS, "all"), lines
    )


def _two(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "2"]
    if not mine:
        return ""
    lines: list[Sequence[str]] = []
    for setting in dict.fromkeys(row.setting for row in mine):
        frames = int(setting.split(", ")[1].removesuffix(" frames").replace(",", ""))
        paper = _PAPERS_RATES.get(frames)
        cells = [
            _cell(mine, method, setting, metric, digits)
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
        *(_cell(mine, OURS, mine[0].setting, f"state_bytes_after_{each}_minute", 0) for each in ("first", "last")),
        *(_cell(mine, OURS, mine[0].setting, each, 0) for each in ("blocks_gained", "peak_gained_kb")),
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
            *(_cell(mine, method, kind, metric, digits) for metric, digits in metrics),
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
        (setting.split(", ")[-1], *(_cell(mine, OURS, setting, metric, 0) for metric in metrics))
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
        (setting, method, *(_cell(mine, method, setting, metric) for metric, _ in metrics))
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


def _first(rows: Iterable[Row], method: str, metric: str) -> str:
    return next((figure_of(r) for r in rows if r.method == method and r.metric == metric), "")


def _cell(rows: Iterable[Row], method: str, setting: str, metric: str = ERROR, digits: int = 2) -> str:
    own = (r for r in rows if r.method == method and r.setting == setting and r.metric == metric)
    return next((figure_of(row, digits) for row in own), "")
