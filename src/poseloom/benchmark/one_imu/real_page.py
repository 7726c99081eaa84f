"""The figures of real inertial sensors in Markdown."""

from collections.abc import Iterable, Sequence

from poseloom.benchmark.one_imu.alignment_check import PLACES
from poseloom.benchmark.one_imu.bands import BANDS_HZ
from poseloom.benchmark.tables import figure_of, markdown_table
from poseloom.evaluation.rows import Results, Row

_LEG_METRICS = (
    ("leg_position_cm", "legs, cm"),
    ("knee_position_cm", "knees, cm"),
    ("ankle_position_cm", "ankles, cm"),
)
_WAY_METRICS = (("turned_path_error_percent", "way's end, %"), ("way_length_error_percent", "its length, %"))
_ANGLES = tuple((f"{side}_{joint}", f"{side} {joint}") for side in ("left", "right") for joint in ("hip", "knee"))


def real_imus_figures(results: Results, commit: str) -> str:
    """All tables of a run of `measure_real_imus`."""
    seeds = sorted({row.seed for row in results.rows if row.seed is not None})
    told = (
        f"poseloom {results.version or 'of this commit'}, commit `{commit}`, digest of the motions that methods were "
        f"fitted to `{results.data_digest[:16]}`, seed {', '.join(map(str, seeds))}."
    )
    parts = (
        told,
        _bands(results.rows),
        _simulated(results.rows),
        _real(results.rows),
        _walk(results.rows),
        _cadence(results.rows),
    )
    return "\n\n".join(part for part in parts if part)


def _bands(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "bands"]
    if not mine:
        return ""
    lines = [
        (
            place,
            label,
            *(_cell([row for row in mine if row.method == label], place, metric) for metric in _metrics(mine)),
        )
        for place in dict.fromkeys(row.setting for row in mine)
        for label in dict.fromkeys(row.method for row in mine)
    ]
    heads = ("sensor", "of", *(f"{low:g} to {high:g} Hz" for low, high in BANDS_HZ))
    return (
        "## Where the signal lies\n\nRoot mean square of the specific force in walking, m/s², by frequency: of a real "
        f"sensor, and of virtual ones on {mine[-1].sequences} recorded walks.\n\n{markdown_table(heads, lines)}"
    )


def _metrics(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row.metric for row in rows))


def _simulated(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "alignment-simulated"]
    if not mine:
        return ""
    lines = [
        (
            place,
            _cell(mine, place, "tilt_deg"),
            _cell(mine, place, "heading_deg"),
            _cell(mine, place, "heading_most_deg"),
            _cell(mine, place, "backwards", 0),
            _cell(mine, place, "refused", 0),
        )
        for place in PLACES
    ]
    walks = max((row.sequences for row in mine), default=0)
    heads = ("sensor", "tilt, degrees", "heading, degrees", "most", "backwards", "refused")
    return (
        f"## Alignment of virtual sensors, turned anyhow\n\n{walks} walks, mean ± standard deviation of the error of "
        f"`R_bone_sensor`; headings of those that are not backwards.\n\n{markdown_table(heads, lines)}"
    )


def _real(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "alignment-real"]
    if not mine:
        return ""
    lines = [
        (
            place,
            _cell(mine, place, "tilt_deg", 1),
            _cell(mine, place, "heading_deg", 1),
            _cell(mine, place, "turning_axis_deg", 1),
            _cell(mine, place, "residual_deg", 1),
        )
        for place in PLACES
    ]
    heads = (
        *("sensor", "tilt, degrees", "heading, degrees", "heading of the axis of turning, by cameras alone"),
        "what cameras and sensor disagree by",
    )
    return f"## Alignment of real sensors, against cameras\n\n{markdown_table(heads, lines)}"


def _walk(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "real-walk"]
    if not mine:
        return ""
    cases = dict.fromkeys((row.setting, row.method) for row in mine)
    lines: list[tuple[str, ...]] = []
    for setting, method in cases:
        own = {row.metric: row.value for row in mine if (row.setting, row.method) == (setting, method)}
        angles = [
            f"{own[f'{name}_deg']:.1f} ({own[f'{name}_deg_without_offset']:.1f}, r {own[f'{name}_correlation']:.2f})"
            for name, _ in _ANGLES
        ]
        lengths = [f"{own[metric]:.1f}" if metric in own else "" for metric, _ in (*_LEG_METRICS, *_WAY_METRICS)]
        lines.append((setting, method, *lengths, *angles))
    heads = ("sensors", "method", *(label for _, label in (*_LEG_METRICS, *_WAY_METRICS, *_ANGLES)))
    return (
        f"## A real walk, legs against cameras\n\n{mine[0].frames} frames at 60 Hz. Distances of joints from the "
        "cameras', place and heading of the hips removed; how far off the hips' way ends, turned so as to fit best, "
        "and its length is, in percent of it; flexions in degrees: mean difference (without its mean, correlation).\n\n"
        f"{markdown_table(heads, lines)}"
    )


def _cadence(rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.table == "cadence"]
    if not mine:
        return ""
    lines = [
        (
            name,
            _cell(mine, name, "windows", 0),
            _cell(mine, name, "signal_steps_min", 0),
            _cell(mine, name, "agreeing_share"),
            _cell(mine, name, "median_difference_steps_min", 1),
        )
        for name in dict.fromkeys(row.setting for row in mine)
    ]
    heads = ("recording", "windows that walk", "signal, steps/min", "within 5 %, share", "median difference, steps/min")
    return (
        f"## Cadence of other recordings\n\nOf `{mine[0].method}`, one sensor on a foot; windows of five seconds in "
        f"which the signal repeats itself.\n\n{markdown_table(heads, lines)}"
    )


def _cell(rows: Iterable[Row], setting: str, metric: str, digits: int = 2) -> str:
    found = next((row for row in rows if (row.setting, row.metric) == (setting, metric)), None)
    return "" if found is None else figure_of(found, digits)
