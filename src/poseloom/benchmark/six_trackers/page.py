"""The six-sensor experiments' figures in Markdown, the paper's beside ours, and the same for the sweep of settings."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from poseloom.benchmark.six_trackers.plan import CONTESTANTS, OURS, PAPERS
from poseloom.benchmark.tables import figure_of, markdown_table
from poseloom.evaluation.rows import Results, Row
from poseloom.formats.atomic import atomic_file

BEGIN, END = "<!-- figures: written by the command -->", "<!-- end of figures -->"

_PAPERS_TABLE = {
    "inverse-kinematics": (4.76, 4.76),
    "local-pca": (1.97, 1.42),
    "local-pcr": (1.75, 1.19),
    "local-regression": (1.43, 0.87),
}
"""Degrees with 65,609 and 1.1 million poses."""

_FAULT_COLUMNS = (
    ("error_over_no_fault", "error during, over the same frames without the fault"),
    ("settled_after_s", "back to normal after, s"),
    ("share_settled_in_half_a_second", "within 0.5 s, share"),
    ("largest_jump_cm", "largest jump, cm"),
    ("worst_jump_cm", "worst of all, cm"),
)


def write_figures(path: Path, figures: str, title: str) -> None:
    """Puts figures between the marks of a page, or makes the page; what people wrote around them stays."""
    old = path.read_text(encoding="utf-8") if path.is_file() else f"# {title}\n\n{BEGIN}\n{END}\n"
    before, _, rest = old.partition(BEGIN)
    after = rest.partition(END)[2] if END in rest else "\n"
    with atomic_file(path) as part:
        part.write_text(f"{before}{BEGIN}\n{figures.strip()}\n{END}{after}", encoding="utf-8")


def six_trackers_figures(results: Results, commit: str) -> str:
    """All tables of a run."""
    rows = results.rows
    seeds = sorted({row.seed for row in rows if row.seed is not None})
    parts = [
        f"poseloom {results.version or 'of this commit'}, commit `{commit}`, data digest `{results.data_digest[:16]}`, "
        f"seeds from {', '.join(map(str, seeds))} on (one more for each sequence). Errors are means over sequences ± "
        "their standard deviation, degrees a joint angle unless stated."
    ]
    builders: tuple[Callable[[Sequence[Row]], str], ...] = (
        _two,
        _five,
        _three,
        _faults,
        _rejections,
        _search,
        _speed,
        _one,
    )
    return "\n\n".join([*parts, *(text for build in builders if (text := build(rows)))])


def sweep_figures(results: Results, commit: str) -> str:
    """What was chosen, and all that was tried."""
    chosen = [row for row in results.rows if row.table == "chosen" and row.metric == "joint_angle_deg"]
    parts = [
        f"Commit `{commit}`, digest of the validation sequences `{results.data_digest[:16]}`, "
        f"{chosen[0].sequences} sequences, {chosen[0].frames} frames, seed {chosen[0].seed}.",
        "## Chosen\n\n" + _tried(results.rows, {"chosen"}),
        "## All that was tried\n\n" + _tried(results.rows, {"chosen", "tried"}),
    ]
    return "\n\n".join(parts)


def _tried(rows: Sequence[Row], tables: set[str]) -> str:
    metrics = ("joint_angle_deg", "jitter_over_truth", "joint_position_cm")
    found: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        if row.table in tables:
            found.setdefault((row.method, row.setting), {})[row.metric] = row
    order = list(dict.fromkeys(method for method, _ in found))
    ranked = sorted(found.items(), key=lambda item: (order.index(item[0][0]), item[1][metrics[0]].value))
    lines = [
        (method, setting, *(f"{some[metric].value:.2f}" for metric in metrics)) for (method, setting), some in ranked
    ]
    return markdown_table(
        ("method", "what differs from the settings before", "degrees", "jitter / truth's", "cm"), lines
    )


def _two(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "2" and row.metric == "joint_angle_deg"]
    if not mine:
        return ""
    sizes = list(dict.fromkeys(_size(row) for row in mine if "poses" in row.setting))
    heads = ["method", "paper, 65,609 / 1.1 M"]
    columns = [
        (size, split, subset)
        for subset in ("densely covered", "all sequences")
        for size in sizes
        for split in ("by-sequence", "by-subject")
        if any(_size(r) == size and r.split == split for r in mine)
    ]
    heads += [f"{size.removesuffix(' poses')}, {split}, {subset}" for size, split, subset in columns]
    lines: list[tuple[str, ...]] = []
    for contestant in CONTESTANTS:
        paper = _PAPERS_TABLE.get(contestant.label)
        cells = [contestant.label, "" if paper is None else f"{paper[0]:.2f} / {paper[1]:.2f}"]
        for size, split, subset in columns:
            own = [
                r
                for r in mine
                if r.method == contestant.label
                and r.setting.endswith(subset)
                and (_size(r) == "no library" or (_size(r) == size and r.split == split))
            ]
            cells.append(figure_of(own[0]) if own else "")
        lines.append(tuple(cells))
    counts = {row.setting.split(", ")[-1]: f"{row.sequences} sequences, {row.frames:,} frames" for row in mine}
    told = "; ".join(f"{subset}: {count}" for subset, count in counts.items())
    return (
        f"## Table 2: methods and library sizes\n\n{told}.\n\n{markdown_table(heads, lines)}\n\n{_ratios(mine, sizes)}"
        + (f"\n\n{_other_metrics(rows, sizes)}")
    )


def _other_metrics(rows: Sequence[Row], sizes: Sequence[str]) -> str:
    metrics = ("joint_rotation_deg", "joint_position_cm", "jitter_over_truth")
    lines: list[tuple[str, ...]] = []
    for contestant in CONTESTANTS:
        cells = [contestant.label]
        for metric in metrics:
            own = [
                r
                for r in rows
                if r.table == "2" and r.metric == metric and r.method == contestant.label
                and _size(r) in (sizes[0], "no library") and r.split == "by-sequence" and r.setting.endswith("covered")
            ]  # fmt: skip
            cells.append(figure_of(own[0]) if own else "")
        lines.append(tuple(cells))
    heads = ("method", "joint rotation, °", "joint position, cm", "jitter over the truth's")
    return f"Other measures, {sizes[0]}, by-sequence, densely covered:\n\n{markdown_table(heads, lines)}"


def _ratios(mine: Sequence[Row], sizes: Sequence[str]) -> str:
    targets = {"inverse-kinematics": (0.30, 0.18), "local-pca": (0.73, 0.61), "local-pcr": (0.82, 0.73)}
    lines: list[tuple[str, ...]] = []
    for number, size in enumerate(sizes[:2]):
        own = {
            r.method: r.value
            for r in mine
            if r.setting.endswith("densely covered") and r.split == "by-sequence" and _size(r) in (size, "no library")
        }
        for over, bounds in targets.items():
            if over in own and OURS in own and PAPERS in own:
                lines.append(
                    (
                        size,
                        over,
                        f"{own[OURS] / own[over]:.2f}",
                        f"{own[PAPERS] / own[over]:.2f}",
                        f"{bounds[number]:.2f}",
                    )
                )
    heads = ("library", "over", OURS, PAPERS, "to reach")
    return f"Ratios on the densely covered sequences, by-sequence:\n\n{markdown_table(heads, lines)}"


def _five(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "5"]
    if not mine:
        return ""
    channels = list(dict.fromkeys(row.setting.split(", ")[-2] for row in mine))
    lines: list[tuple[str, ...]] = []
    for method in dict.fromkeys(row.method for row in mine):
        for behaviour in dict.fromkeys(row.setting.split(", ")[-1] for row in mine):
            own = {
                row.setting.split(", ")[-2]: row
                for row in mine
                if row.method == method and row.setting.endswith(f", {behaviour}")
            }
            lines.append(
                (
                    method,
                    behaviour,
                    str(own[channels[0]].sequences),
                    *(figure_of(own[channel]) for channel in channels),
                )
            )
    title = f"## Figure 5: what the sensors tell ({_size(mine[0])}, by-sequence)"
    return f"{title}\n\n{markdown_table(('method', 'behaviour', 'sequences', *channels), lines)}"


def _three(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "three trackers"]
    if not mine:
        return ""
    settings = dict.fromkeys((row.method, row.setting) for row in mine)
    metrics = ("joint_angle_deg", "joint_rotation_deg", "joint_position_cm", "jitter_over_truth")
    lines = [(method, setting, *_cells(mine, method, setting, metrics)) for method, setting in settings]
    heads = ("method", "on", "joint angle, °", "joint rotation, °", "joint position, cm", "jitter over the truth's")
    return f"## Three trackers: head and hands alone, by-sequence\n\n{markdown_table(heads, lines)}"


def _faults(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "faults"]
    if not mine:
        return ""
    settings = list(dict.fromkeys(row.setting for row in mine))
    lines = [
        (_after_size(setting), *_cells(mine, OURS, setting, [metric for metric, _ in _FAULT_COLUMNS]))
        for setting in settings
    ]
    runs = {row.setting: row.sequences for row in mine}
    count = runs[settings[0]]
    told = (
        f"One sensor fails from second 1 to second 2, {count} sequences for each sensor and fault, {_size(mine[0])}. "
        "A jump is a joint's movement from one frame to the next that the truth does not make."
    )
    return f"## Recovery after faults\n\n{told}\n\n{markdown_table(('fault', *(n for _, n in _FAULT_COLUMNS)), lines)}"


def _rejections(rows: Sequence[Row]) -> str:
    mine = {(row.method, row.setting, row.metric): row for row in rows if row.table == "rejections"}
    lines = [
        (
            method, setting, f"{row.value:.3f}",
            f"{mine[method, setting, 'named_percent_from'].value:.3f} to "
            f"{mine[method, setting, 'named_percent_to'].value:.3f}",
            f"{mine[method, setting, 'sequences_with_one_named'].value:.0f} of {row.sequences}", f"{row.frames:,}",
            f"{mine[method, setting, 'joint_position_cm'].value:.2f}",
        )
        for (method, setting, metric), row in mine.items()
        if metric == "named_percent"
    ]  # fmt: skip
    if not lines:
        return ""
    told = (
        "No sensor fails, noise is within its sigma, and the library holds the other data set alone: CMU's recordings "
        "for sequences of HDM05, HDM05's for CMU's. Frames whose health names a sensor, with Wilson's 95 % interval, "
        "for which frames count as independent."
    )
    heads = ("method", "library", "frames with a sensor rejected, %", "interval, %", "sequences with one", "frames")
    return f"## Sound sensors rejected\n\n{told}\n\n{markdown_table((*heads, 'joint position, cm'), lines)}"


def _search(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "search"]
    if not mine:
        return ""
    lines = [(row.setting, row.metric.replace("_", " "), figure_of(row, 3)) for row in mine]
    return f"## Search against exact search\n\n{markdown_table(('library', 'what', 'value'), lines)}"


def _speed(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "speed"]
    if not mine:
        return ""
    lines = [
        (row.method, row.setting, row.metric.replace("_", " "), f"{row.value:.2f}", str(row.frames)) for row in mine
    ]
    heads = ("method", "library", "what", "value", "steps")
    return f"## Speed: one thread, nothing left out\n\n{markdown_table(heads, lines)}"


def _one(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "1"]
    if not mine:
        return ""
    metrics = (
        "bone_error_percent",
        "worst_bone_percent",
        "worst_bone_of_anyone_percent",
        "sensor_offset_cm",
        "sensor_turn_deg",
    )
    settings = dict.fromkeys((row.method, row.setting) for row in mine)
    lines = [(method, setting, *_cells(mine, method, setting, metrics)) for method, setting in settings]
    heads = ("body", "session", *(metric.replace("_", " ") for metric in metrics))
    told = (
        f"{mine[0].sequences} simulated people, each left out of the size model. The paper: 1.2 % and 1.6 % mean bone "
        "error for two people, worst bone 5.2 %; 13.8 % and 22.1 % uncalibrated."
    )
    return f"## Table 1: calibration\n\n{told}\n\n{markdown_table(heads, lines)}"


def _cells(rows: Iterable[Row], method: str, setting: str, metrics: Sequence[str]) -> list[str]:
    own = {row.metric: row for row in rows if row.method == method and row.setting == setting}
    return [figure_of(own[metric]) if metric in own else "" for metric in metrics]


def _size(row: Row) -> str:
    """The library that a setting begins with."""
    if row.setting.startswith("no library"):
        return "no library"
    return row.setting.partition(" poses")[0] + " poses"


def _after_size(setting: str) -> str:
    return setting.partition(" poses, ")[2] or setting
