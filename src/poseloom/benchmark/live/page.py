"""The live figures in Markdown, each target beside what was reached."""

from collections.abc import Iterable, Sequence

from poseloom.benchmark.tables import markdown_table
from poseloom.evaluation.rows import Results, Row


def live_figures(results: Results, commit: str) -> str:
    """All tables of a run."""
    rows = results.rows
    parts = [
        f"poseloom {results.version or 'of this commit'}, commit `{commit}`, digest of the motion "
        f"`{results.data_digest[:16]}`. Delays are milliseconds from the system's receipt of a sample's last datagram "
        "to its pose handed to the system for sending.",
        *(_long(rows, name) for name in dict.fromkeys(row.method for row in rows if row.table == "endurance")),
        _wide(rows, "fast input", "240 Hz input"),
        _wide(rows, "session time", "Session time beside arrival, in sessions at 40 Hz"),
        _wide(rows, "two sessions", "Two sessions in one process"),
        _faults(rows),
        _hostile(rows),
    ]
    return "\n\n".join(part for part in parts if part)


def _long(rows: Sequence[Row], name: str) -> str:
    get = {row.metric: row.value for row in rows if row.table == "endurance" and row.method == name}
    growth = get["memory_mb_at_the_end"] - get["memory_mb_after_a_fifth"]
    lines = [
        ("arrival to pose sent, p50", "", f"{get['p50_ms']:.2f} ms", ""),
        ("arrival to pose sent, p95", "<= 10 ms", f"{get['p95_ms']:.2f} ms", _met(get["p95_ms"] <= 10.0)),
        ("arrival to pose sent, p99", "", f"{get['p99_ms']:.2f} ms", ""),
        ("datagrams lost", "0", f"{get['lost']:.0f} of {get['sent']:,.0f}", _met(get["lost"] == 0)),
        ("samples passed over for newer ones", "", f"{get['passed_over']:.0f}", ""),
        ("samples missing in the recording", "0", f"{get['samples_not_recorded']:.0f}",
         _met(get["samples_not_recorded"] == 0)),
        ("memory, after a fifth and at the end", "flat",
         f"{get['memory_mb_after_a_fifth']:.0f} and {get['memory_mb_at_the_end']:.0f} MB", _met(growth < 10.0)),
        *([("of one core used", "", f"{get['share_of_a_core']:.0%}", "")] if "share_of_a_core" in get else []),
        ("load of the machine by others and us", "", f"{get['load_mean']:.1f}, at most {get['load_most']:.1f}", ""),
    ]  # fmt: skip
    by_time = [row for row in rows if row.table == "endurance by time" and row.method == name]
    settings = list(dict.fromkeys(row.setting for row in by_time))
    metrics = ("p50_ms", "p95_ms", "p99_ms", "memory_mb", "load")
    told = [(setting, *_cells(by_time, setting, metrics)) for setting in settings]
    return (
        f"## {name[0].upper() + name[1:]}\n\n{markdown_table(('what', 'target', 'reached', ''), lines)}\n\n"
        f"{markdown_table(('stretch', 'p50, ms', 'p95, ms', 'p99, ms', 'memory, MB', 'load'), told)}"
    )


def _wide(rows: Sequence[Row], table: str, title: str) -> str:
    mine = [row for row in rows if row.table == table]
    if not mine:
        return ""
    metrics = list(dict.fromkeys(row.metric for row in mine))
    lines: list[tuple[str, ...]] = []
    for method in dict.fromkeys(row.method for row in mine):
        own = {row.metric: row.value for row in mine if row.method == method}
        lines.append((method, *(_number(own[metric]) if metric in own else "" for metric in metrics)))
    return f"## {title}\n\n{markdown_table(('what', *(m.replace('_', ' ') for m in metrics)), lines)}"


def _faults(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "faults"]
    lines: list[tuple[str, str]] = []
    for method in dict.fromkeys(row.method for row in mine):
        told = ", ".join(
            f"{row.metric.replace('_', ' ')} {_number(row.value)}"
            + (f" of {row.frames}" if row.frames and row.metric != "failures" else "")
            for row in mine
            if row.method == method
        )
        lines.append((method, told))
    return f"## Faults\n\n{markdown_table(('fault', 'what became of it'), lines)}" if lines else ""


def _hostile(rows: Sequence[Row]) -> str:
    """Inputs tried by kind, and what escaped; then the floods."""
    mine = [row for row in rows if row.table == "hostile"]
    if not mine:
        return ""
    total = {metric: sum(row.value for row in mine if row.metric == metric) for metric in ("tried", "escapes")}
    columns = ("tried", "understood", "refused", "escapes", "us_each")
    lines: list[tuple[str, ...]] = []
    floods: list[tuple[str, str]] = []
    for method, kind in dict.fromkeys((row.method, row.setting) for row in mine):
        own = {row.metric: row.value for row in mine if (row.method, row.setting) == (method, kind)}
        if kind == "flood":
            told = ", ".join(f"{metric.replace('_', ' ')} {_number(value)}" for metric, value in own.items())
            floods.append((method, told))
        else:
            lines.append((method, kind, *(_number(own[column]) for column in columns)))
    return (
        f"## Hostile inputs\n\nInputs tried: {_number(total['tried'])}. Escapes: {_number(total['escapes'])} "
        f"({_met(total['escapes'] == 0)}).\n\n"
        f"{markdown_table(('into', 'kind', 'tried', 'understood', 'refused', 'escapes', 'us each'), lines)}\n\n"
        f"{markdown_table(('into', 'what became of them'), floods)}"
    )


def _cells(rows: Iterable[Row], setting: str, metrics: Sequence[str]) -> list[str]:
    own = {row.metric: row.value for row in rows if row.setting == setting}
    return [f"{own[metric]:.2f}" if metric.endswith("_ms") else f"{own[metric]:.1f}" for metric in metrics]


def _met(met: bool) -> str:
    return "met" if met else "**missed**"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value == int(value) else f"{value:,.2f}"
