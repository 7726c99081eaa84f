"""Figures 5 and 7 of the six-sensor paper, of our methods: an offline page, and a picture for documents."""

import html
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from poseloom.benchmark.six_trackers.accuracy import Curve
from poseloom.benchmark.six_trackers.run import SixTrackers
from poseloom.evaluation.rows import Row
from poseloom.formats.atomic import atomic_file
from poseloom.report.charts import chart_script
from poseloom.report.page_data import method_colour

_WIDTH, _HEIGHT, _LEFT, _GAP = 960.0, 210.0, 46.0, 34.0
_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2rem auto; padding: 0 1rem; color: #1c2030; }
table { border-collapse: collapse; margin: 1rem 0; } td, th { padding: .2rem .7rem; border-bottom: 1px solid #d8dae2; }
td.figure { text-align: right; font-variant-numeric: tabular-nums; } .plot { height: 340px; }
"""


def write_six_trackers_page(path: str | Path, outcome: SixTrackers) -> None:
    """Writes an HTML page with both figures and all rows; it needs nothing but a browser.

    Raises:
        OSError: where the file cannot be written.
    """
    plots = [_channels_plot(outcome.results.rows), *_curve_plots(outcome.curves)]
    places = "".join(
        f'<h2>{html.escape(p["title"])}</h2><div class="plot" id="p{i}"></div>' for i, p in enumerate(plots)
    )
    data = json.dumps(plots, allow_nan=False).replace("<", "\\u003c")
    draw = "plots.forEach((p, i) => Plotly.newPlot('p' + i, p.data, p.layout, {responsive: true}));"
    text = f"""<!doctype html><html lang="en"><meta charset="utf-8"><title>Six trackers</title><style>{_STYLE}</style>
<h1>Six trackers</h1><p>poseloom {version("poseloom")}, data {outcome.results.data_digest[:16]}</p>
{places}<h2>All figures</h2>{_table(outcome.results.rows)}
<script>{chart_script()}</script><script>const plots = {data}; {draw}</script></html>
"""
    with atomic_file(path) as part:
        part.write_text(text, encoding="utf-8")


def error_curves_svg(curves: Sequence[Curve]) -> str:
    """Figure 7 as an SVG picture: errors frame by frame, one panel a sequence."""
    colours = _colours(curves)
    panels: list[str] = []
    sequences = list(dict.fromkeys(curve.sequence for curve in curves))
    for row, sequence in enumerate(sequences):
        panels.append(_panel([c for c in curves if c.sequence == sequence], colours, row * (_HEIGHT + _GAP) + _GAP))
    below = len(sequences) * (_HEIGHT + _GAP) + _GAP
    legend = "".join(
        f'<rect x="{_LEFT + 130 * i}" y="{below}" width="12" height="3" fill="{colour}"/>'
        f'<text x="{_LEFT + 130 * i + 17}" y="{below + 5}">{html.escape(method.removeprefix("local-"))}</text>'
        for i, (method, colour) in enumerate(colours.items())
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {below + 16:g}" '
        f'font-family="{_FONT}" font-size="11" fill="#444a5a"><rect width="100%" height="100%" fill="#ffffff"/>'
        f"{''.join(panels)}{legend}</svg>\n"
    )


def _panel(curves: Sequence[Curve], colours: Mapping[str, str], top: float) -> str:
    highest = max(5.0, max(float(curve.errors.max()) for curve in curves))
    seconds = max(float(curve.samples[-1]) / curve.rate for curve in curves)
    across, down = (_WIDTH - _LEFT - 10) / seconds, _HEIGHT / highest
    parts = [f'<text x="{_LEFT}" y="{top - 8:g}" font-weight="600">{html.escape(curves[0].sequence)}, degrees</text>']
    step = 5 if highest <= 25 else 10
    for value in range(0, int(highest) + 1, step):
        y = top + _HEIGHT - value * down
        parts.append(f'<path d="M{_LEFT} {y:.1f}H{_WIDTH - 10:g}" stroke="#e3e5ec"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value}</text>')
    parts += [
        f'<text x="{_LEFT + second * across:.1f}" y="{top + _HEIGHT + 13:g}" text-anchor="middle">{second} s</text>'
        for second in range(int(seconds) + 1)
    ]
    for curve in curves:
        points = " ".join(
            f"{_LEFT + across * float(sample) / curve.rate:.1f},{top + _HEIGHT - down * float(error):.1f}"
            for sample, error in zip(curve.samples, curve.errors, strict=True)
        )
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colours[curve.method]}" stroke-width="1.4"/>')
    return "".join(parts)


def _colours(curves: Sequence[Curve]) -> dict[str, str]:
    return {name: method_colour(i) for i, name in enumerate(dict.fromkeys(curve.method for curve in curves))}


def _curve_plots(curves: Sequence[Curve]) -> list[dict[str, Any]]:
    colours = _colours(curves)
    return [
        {
            "title": f"Frame by frame: {sequence}",
            "data": [
                {
                    "x": [round(float(s) / c.rate, 4) for s in c.samples],
                    "y": [round(float(e), 4) for e in c.errors],
                    "name": c.method,
                    "line": {"color": colours[c.method], "width": 1.5},
                }
                for c in curves
                if c.sequence == sequence
            ],
            "layout": _layout("seconds", "joint angle error, degrees"),
        }
        for sequence in dict.fromkeys(curve.sequence for curve in curves)
    ]


def _channels_plot(rows: Sequence[Row]) -> dict[str, Any]:
    chosen = [row for row in rows if row.table == "5" and row.metric == "joint_angle_deg"]
    methods = list(dict.fromkeys(row.method for row in chosen))[:1]
    bars: dict[str, list[Row]] = {}
    for row in chosen:
        if row.method in methods:
            bars.setdefault(row.setting.split(", ")[-2], []).append(row)
    return {
        "title": f"What the sensors tell: {', '.join(methods)}",
        "data": [
            {
                "type": "bar",
                "name": channels,
                "x": [row.setting.split(", ")[-1] for row in some],
                "y": [row.value for row in some],
                "error_y": {"type": "data", "array": [row.spread or 0 for row in some]},
                "marker": {"color": method_colour(index)},
            }
            for index, (channels, some) in enumerate(bars.items())
        ],
        "layout": _layout("", "joint angle error, degrees"),
    }


def _layout(across: str, up: str) -> dict[str, Any]:
    return {
        "margin": {"l": 50, "r": 10, "t": 10, "b": 40},
        "xaxis": {"title": {"text": across}},
        "yaxis": {"title": {"text": up}, "rangemode": "tozero"},
        "legend": {"orientation": "h"},
    }


def _table(rows: Sequence[Row]) -> str:
    head = "".join(
        f"<th>{name}</th>" for name in ("table", "method", "setting", "split", "metric", "value", "spread", "n")
    )
    lines: list[str] = []
    for row in rows:
        cells = (row.table, row.method, row.setting, row.split, row.metric)
        spread = "" if row.spread is None else f"{row.spread:.3g}"
        lines.append(
            "<tr>"
            + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells)
            + "".join(f'<td class="figure">{cell}</td>' for cell in (f"{row.value:.4g}", spread, row.sequences))
            + "</tr>"
        )
    return f"<table><tr>{head}</tr>{''.join(lines)}</table>"
