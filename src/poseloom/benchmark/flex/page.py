"""The flex benchmark's figures in Markdown, the paper's beside ours."""

from collections.abc import Callable, Iterable, Mapping, Sequence

from poseloom.benchmark.flex.material import BY_SUBJECT, WITHIN
from poseloom.benchmark.flex.trials import OURS
from poseloom.benchmark.tables import markdown_table
from poseloom.evaluation.rows import Results, Row
from poseloom.methods.flex.angles import FLEX_JOINTS

PAPERS_ABLATION: Mapping[str, tuple[float, float]] = {
    "Bi-LSTM": (4.75, 3.168),
    "Transformer": (5.11, 0.713),
    "FCN": (5.23, 1.51),
    "TCN": (5.02, 0.691),
    "Bi-LSTM-C": (4.58, 3.157),
    "Bi-LSTM-M": (4.69, 2.443),
    "Bi-LSTM-CM": (4.51, 2.452),
}
"""Degrees, and ten thousand degrees a cubic second: the paper's table 5."""

_PAPERS_JOINTS: Mapping[str, float] = {
    "rightShoulder": 1.83, "leftShoulder": 1.65, "rightUpperLeg": 6.68, "rightLowerLeg": 5.28, "leftUpperLeg": 5.69,
    "leftLowerLeg": 4.78, "spine": 0.79, "chest": 1.07, "upperChest": 1.07, "rightUpperArm": 8.88,
    "rightLowerArm": 6.58, "leftUpperArm": 8.22, "leftLowerArm": 5.91,
}  # fmt: skip
_PAPERS_MOTIONS: Mapping[str, str] = {
    "climb, swing (playground)": "climb 6.96, swing 2.40",
    "bend over": "5.92",
    "basketball, dribble": "5.07",
    "walk": "forward 3.67, backward 3.89, stride 4.09",
    "throw": "4.15",
    "kick": "3.80",
    "punch": "5.34",
}
_PAPERS_LENGTHS: Mapping[str, float] = {"40": 5.6, "60": 4.56, "80": 4.58, "100": 4.51, "120": 4.58}
_SHOWN = ("Bi-LSTM-CM", OURS, "nearest windows", "mean pose")


def flex_figures(results: Results, commit: str) -> str:
    """All tables of a run."""
    rows = results.rows
    told = (
        f"poseloom {results.version or 'of this commit'}, commit `{commit}`, data digest `{results.data_digest[:16]}`. "
        "Errors are means over all frames and angles, degrees; ± is half the 95 % interval of the mean over seeds "
        "(Student's). Jitter in 10⁴ °/s³."
    )
    builders: tuple[Callable[[Sequence[Row]], str], ...] = (
        *(_ablation, _paired, _first_range, _other_sensors, _motions, _people, _joints, _lengths),
        *(_ageing, _replaced, _faults, _speed),
    )
    return "\n\n".join([told, *(text for build in builders if (text := build(rows)))])


def figure(rows: Iterable[Row], table: str, method: str, split: str, metric: str, setting: str = "") -> Row | None:
    """The one row that is asked for."""
    for row in rows:
        if (row.table, row.method, row.split, row.metric, row.setting) == (table, method, split, metric, setting):
            return row
    return None


def _cell(
    rows: Sequence[Row], table: str, method: str, split: str, metric: str, setting: str = "", scale: float = 1.0
) -> str:
    row = figure(rows, table, method, split, metric, setting)
    if row is None:
        return ""
    interval = figure(rows, table, method, split, f"{metric}_ci95", setting)
    return f"{row.value / scale:.2f}" + ("" if interval is None else f" ± {interval.value / scale:.2f}")


def _ablation(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "5"]
    if not mine:
        return ""
    methods = list(dict.fromkeys(row.method for row in mine))
    lines: list[tuple[str, ...]] = []
    for method in methods:
        paper = PAPERS_ABLATION.get(method)
        cells = [method, "" if paper is None else f"{paper[0]:.2f} / {paper[1]:.2f}"]
        for split in (BY_SUBJECT, WITHIN):
            cells += [
                _cell(mine, "5", method, split, "error_deg"),
                _cell(mine, "5", method, split, "moving_error_deg"),
                _cell(mine, "5", method, split, "jitter_deg_s3", scale=1e4),
                _seeds(mine, method, split),
            ]
        lines.append(tuple(cells))
    heads = ["network", "paper: error / jitter"]
    for split in (BY_SUBJECT, WITHIN):
        heads += [f"{split}: error, 39 angles", "error, moving angles", "jitter", "seeds"]
    counts = [
        f"{split}: {row.sequences} sequences, {row.frames:,} frames"
        for split in (BY_SUBJECT, WITHIN)
        if (row := next((each for each in mine if each.split == split), None)) is not None
    ]
    return f"## Table 5: networks and ablation\n\n{'; '.join(counts)}.\n\n{markdown_table(heads, lines)}"


def _seeds(rows: Iterable[Row], method: str, split: str) -> str:
    if figure(rows, "5", method, split, "error_deg") is None:
        return ""
    row = figure(rows, "5", method, split, "error_deg_seeds")
    return "1" if row is None else f"{row.value:.0f}"


def _paired(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "paired"]
    keys = dict.fromkeys((row.method, row.setting, row.split) for row in mine)
    if not keys:
        return ""
    lines = [
        (
            *(method, setting, split),
            _cell(mine, "paired", method, split, "error_less_deg", setting),
            _cell(mine, "paired", method, split, "error_less_deg_per_sequence", setting),
            _cell(mine, "paired", method, split, "jitter_less_deg_s3", setting, 1e4),
            _cell(mine, "paired", method, split, "jitter_less_deg_s3_per_sequence", setting, 1e4),
        )
        for method, setting, split in keys
    ]
    heads = (
        *("what is added", "normalised by", "split", "less error, °", "a sequence, ± over sequences"),
        *("less jitter", "a sequence, ± over sequences"),
    )
    title = "## What the calibrator (C) and the median (M) bring, seed by seed and take by take"
    return (
        f"{title}\n\nPositive helps. M is causal; centred, as in the paper, it looks a sample ahead.\n\n"
        + markdown_table(heads, lines)
    )


def _first_range(rows: Sequence[Row]) -> str:
    return _plain(
        rows, "5, first range", "## Ranges found once, when the sensors were new",
        "The paper's normalisation: one range for all time. Sensors worn 0 to 60 minutes since.",
    )  # fmt: skip


def _other_sensors(rows: Sequence[Row]) -> str:
    return _plain(
        rows, "other sensors", "## The within-sequence split in sensors that nobody trained on",
        "The same motions as table 5, within-sequence; another set of sensors. First seed.",
    )  # fmt: skip


def _plain(rows: Sequence[Row], table: str, title: str, told: str) -> str:
    mine = [row for row in rows if row.table == table]
    if not mine:
        return ""
    lines = [
        (
            method,
            _cell(mine, table, method, split, "error_deg"),
            _cell(mine, table, method, split, "jitter_deg_s3", "", 1e4),
        )
        for method, split in dict.fromkeys((row.method, row.split) for row in mine)
    ]  # fmt: skip
    return f"{title}\n\n{told}\n\n{markdown_table(('network', 'error, °', 'jitter'), lines)}"


def _motions(rows: Sequence[Row]) -> str:
    return _grouped(rows, "2", "## Table 2: by motion", "motion", _PAPERS_MOTIONS)


def _people(rows: Sequence[Row]) -> str:
    return _grouped(rows, "people", "## By person", "person", {})


def _grouped(rows: Sequence[Row], table: str, title: str, what: str, papers: Mapping[str, str]) -> str:
    parts = [title]
    for split in (BY_SUBJECT, WITHIN):
        mine = [row for row in rows if row.table == table and row.split == split]
        if not mine:
            continue
        groups = dict.fromkeys((row.setting, row.sequences, row.frames) for row in mine)
        lines = [
            (
                *(group, *((papers.get(group, ""),) if papers else ())),
                *(str(sequences), f"{frames:,}"),
                *(_cell(mine, table, method, split, "error_deg", group) for method in _SHOWN),
            )
            for group, sequences, frames in groups
        ]
        heads = (what, *(("paper",) if papers else ()), "sequences", "frames", *_SHOWN)
        parts.append(f"{split.capitalize()}:\n\n{markdown_table(heads, lines)}")
    return "\n\n".join(parts) if len(parts) > 1 else ""


def _joints(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "3"]
    if not mine:
        return ""
    lines: list[tuple[str, ...]] = []
    for joint in FLEX_JOINTS:
        cells = [joint, f"{_PAPERS_JOINTS[joint]:.2f}"]
        for split in (BY_SUBJECT, WITHIN):
            cells += [_cell(mine, "3", method, split, "error_deg", joint) for method in _SHOWN]
        lines.append(tuple(cells))
    heads = ("joint", "paper", *(f"{split}: {method}" for split in (BY_SUBJECT, WITHIN) for method in _SHOWN))
    return f"## Table 3: by joint\n\nMean over a joint's three angles.\n\n{markdown_table(heads, lines)}"


def _lengths(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "6"]
    if not mine:
        return ""
    lines = [
        (length, f"{paper:.2f}", _cell(mine, "6", "Bi-LSTM-CM", WITHIN, "error_deg", f"{length} samples"))
        for length, paper in _PAPERS_LENGTHS.items()
        if figure(mine, "6", "Bi-LSTM-CM", WITHIN, "error_deg", f"{length} samples")
    ]
    heads = ("samples", "paper", "Bi-LSTM-CM, error, °")
    return f"## Table 6: calibration length (within-sequence)\n\n{markdown_table(heads, lines)}"


def _ageing(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "ageing"]
    if not mine:
        return ""
    minutes = list(dict.fromkeys(row.setting.rpartition(", ")[2] for row in mine))
    keys = dict.fromkeys((row.method, row.setting.rpartition(", ")[0], row.split) for row in mine)
    lines: list[tuple[str, ...]] = []
    for method, setting, split in keys:
        rowed = [figure(mine, "ageing", method, split, "error_deg", f"{setting}, {each}") for each in minutes]
        values = [row.value for row in rowed if row is not None]
        jitters = [_cell(mine, "ageing", method, split, "jitter_deg_s3", f"{setting}, {each}", 1e4) for each in minutes]
        shown = [f"{value:.2f} ({jitter})" for value, jitter in zip(values, jitters, strict=True)]
        sixty = values[minutes.index("60 minutes")] / values[0] if "60 minutes" in minutes else float("nan")
        lines.append((method, setting, *shown, f"{sixty:.2f}"))
    heads = ("network", "normalised by", *minutes, "60 minutes over new")
    told = "Minutes of use before the session; within-sequence test, sensors that nobody trained on. Error (jitter)."
    return f"## Ageing\n\n{told}\n\n{markdown_table(heads, lines)}"


def _replaced(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "replaced"]
    if not mine:
        return ""
    settings = list(dict.fromkeys(row.setting for row in mine))
    lines = [
        (method, *(
            f"{_cell(mine, 'replaced', method, BY_SUBJECT, 'error_deg', each)} "
            f"({_cell(mine, 'replaced', method, BY_SUBJECT, 'error_over_none', each)} x)"
            for each in settings
        ))
        for method in dict.fromkeys(row.method for row in mine)
    ]  # fmt: skip
    told = (
        "Both elbows' sensors exchanged for new ones in the middle of each tested person's session (by-subject). "
        "Error, and over the error of the same frames without that."
    )
    return f"## A sensor replaced in mid-recording\n\n{told}\n\n{markdown_table(('network', *settings), lines)}"


def _faults(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "faults"]
    if not mine:
        return ""
    settings = list(dict.fromkeys(row.setting for row in mine))
    lines = [
        (method, *(_cell(mine, "faults", method, BY_SUBJECT, "error_deg", each) for each in settings))
        for method in dict.fromkeys(row.method for row in mine)
    ]
    told = "By-subject; one channel spoilt from beginning to end, mean over the four."
    return f"## Channel faults\n\n{told}\n\n{markdown_table(('network', *settings), lines)}"


def _speed(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "speed"]
    if not mine:
        return ""
    metrics = ("step_ms_p50", "step_ms_p95", "step_ms_p99", "step_cpu_ms_p50", "step_cpu_ms_p99", "model_mb")
    lines = [
        (method, *(_cell(mine, "speed", method, "none", metric) for metric in metrics))
        for method in dict.fromkeys(row.method for row in mine)
    ]
    heads = ("network", "p50, ms", "p95, ms", "p99, ms", "its own p50, ms", "its own p99, ms", "model, MB")
    told = (
        "From counts to frame, one thread; `flex-scales` in NumPy, the others in onnxruntime. Wall time holds what "
        "other programs took of the processor; its own time is the thread's."
    )
    return f"## Time per step\n\n{told}\n\n{markdown_table(heads, lines)}"
