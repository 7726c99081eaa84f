"""Fitted flex sensors as a page: counts beside fit on recordings held back, real sensors beside simulated ones."""

import html
import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.formats.atomic import atomic_file
from poseloom.formats.bend_tables import BendTable
from poseloom.report.charts import chart_script
from poseloom.synthesis.flex_figures import batch_shape
from poseloom.synthesis.flex_fit import ChannelFit, curve, delayed, fit_scale
from poseloom.synthesis.flex_readings import flex_counts
from poseloom.synthesis.flex_sensors import FULL_BEND, draw_channels
from poseloom.synthesis.flex_study import FlexStudy, Judgement

_STYLE = """
:root { color-scheme: light; } * { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1100px; padding: 16px; background: #eef1f5; color: #1d2330;
  font: 15px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 22px; } h2 { font-size: 16px; margin: 0 0 6px; }
section { background: #fff; border: 1px solid #dde2ea; border-radius: 10px; padding: 12px 16px; margin-bottom: 12px; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 8px; border-bottom: 1px solid #e9edf2; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; font-weight: 400; } p { color: #566074; font-size: 13px; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(420px, 1fr)); gap: 8px; }
.plot { height: 300px; } section { overflow-x: auto; }
"""
_DRAW = """
for (const [name, plot] of Object.entries(plots)) Plotly.newPlot(name, plot.traces, Object.assign({
  margin: {l: 50, r: 10, t: 30, b: 40}, showlegend: plot.legend, legend: {orientation: 'h', y: 1.15},
  xaxis: {title: {text: plot.x}}, yaxis: {title: {text: plot.y}}, font: {size: 12}}, {}),
  {responsive: true, displayModeBar: false});
"""
_REAL, _FIT, _SIMULATED = "#2166ac", "#b2182b", "#e08214"
_SECONDS = 12.0
_SHOWN = 2
"""Sensors of each held-back recording that are drawn: those with the widest range."""


def write_flex_report(path: str | Path, study: FlexStudy, tables: Sequence[BendTable], command: str) -> None:
    """Writes the page, whole or not at all. It needs nothing but a browser, and no network.

    Args:
        path: The HTML file.
        study: What the fit found.
        tables: The recordings it found it in.
        command: What made it, to be told.

    Raises:
        OSError: where the file cannot be written.
    """
    by_name = {table.name: table for table in tables}
    plots: dict[str, Any] = {}
    sections: list[str] = []
    for number, name in enumerate(study.held_back):
        fits = sorted((fit for fit in study.fits if fit.table == name), key=lambda fit: -fit.reach)[:_SHOWN]
        boxes: list[str] = []
        for at, fit in enumerate(fits):
            key = f"plot{number}{at}"
            plots |= _channel_plots(key, by_name[name], fit, study)
            boxes += [f'<div class="plot" id="{key}loop"></div>', f'<div class="plot" id="{key}time"></div>']
        title = html.escape(f"{name}, held back: " + " and ".join(fit.channel for fit in fits))
        sections.append(f'<section><h2>{title}</h2><div class="two">{"".join(boxes)}</div></section>')
    data = json.dumps(plots, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    text = (
        f'<!DOCTYPE html><html lang="en"><head>{head}<title>Flex sensors</title><style>{_STYLE}</style></head><body>'
        f"<h1>Flex sensors: fit and data</h1><p>{html.escape(command)}, poseloom {html.escape(version('poseloom'))}</p>"
        f"{_judged(study.judgements)}{''.join(sections)}{_figures(study)}{_measured(study)}"
        f"<script>{chart_script()}</script><script>const plots = {data}; {_DRAW}</script></body></html>\n"
    )
    with atomic_file(path) as part:
        part.write_text(text, encoding="utf-8")


def _channel_plots(key: str, table: BendTable, fit: ChannelFit, study: FlexStudy) -> dict[str, Any]:
    """Counts over bend, and over some seconds, of one sensor: real, as foretold, and of a drawn one."""
    counts = table.counts[:, table.channels.index(fit.channel)]
    bends = delayed(table.bends, fit.delay, table.rate)
    sound = fit.sound
    shares = curve(batch_shape(study.sensors), bends, table.rate)
    scale = fit_scale(shares[sound], counts[sound], np.zeros(int(sound.sum())), drifting=False)
    foretold = scale.offset + scale.range * shares
    simulated = _simulated(study, bends, table.rate, counts, sound, key)
    begin = int(len(counts) * 0.6)
    part = slice(begin, begin + round(_SECONDS * table.rate))
    seconds = np.arange(len(counts)) / table.rate
    degrees = np.degrees(bends)
    shown = np.flatnonzero(sound)[part]
    lines = (
        ("counts", counts, _REAL),
        ("curve of the batch", foretold, _FIT),
        ("a drawn sensor", simulated, _SIMULATED),
    )
    fit_line = np.arange(60) * (np.radians(130.0) / 59)
    straight = curve(batch_shape(study.sensors)._replace(hysteresis=0.0, lag_share=0.0), fit_line, table.rate)
    loop = [_trace(label, degrees[shown], values[shown], colour, 1.0) for label, values, colour in (lines[0], lines[2])]
    loop.append(_trace("curve of the batch", np.degrees(fit_line), scale.offset + scale.range * straight, _FIT, 2.5))
    time = [_trace(label, seconds[shown], values[shown], colour, 1.5) for label, values, colour in lines]
    return {
        f"{key}loop": {"traces": loop, "x": f"bend, degrees ({fit.channel})", "y": "counts", "legend": True},
        f"{key}time": {"traces": time, "x": f"seconds ({fit.channel})", "y": "counts", "legend": True},
    }


def _simulated(
    study: FlexStudy,
    bends: Floats[Array, "rows"],
    rate: float,
    counts: Floats[Array, "rows"],
    sound: Bools[Array, "rows"],
    key: str,
) -> Floats[Array, "rows"]:
    """A drawn sensor on the same bends, its counts laid over the real ones': boards differ in gain and offset."""
    generator = np.random.default_rng([ord(letter) for letter in key])
    drawn = flex_counts(np.minimum(bends, FULL_BEND)[:, None], rate, draw_channels(study.sensors, 1, generator), 0.0, 1)
    came = np.nan_to_num(drawn[:, 0], nan=float(np.nanmedian(drawn)))
    real_low, real_high = np.percentile(counts[sound], [2, 98])
    low, high = np.percentile(came, [2, 98])
    return real_low + (came - low) * (real_high - real_low) / max(high - low, 1e-9)


def _trace(
    name: str, x: Floats[Array, "points"], y: Floats[Array, "points"], colour: str, width: float
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": np.round(x, 2).tolist(),
        "y": np.round(y, 1).tolist(),
        "line": {"color": colour, "width": width},
    }


def _judged(judgements: Sequence[Judgement]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(f'{j.table} {j.channel}')}</td><td>{j.range_counts:.0f}</td><td>{j.counts:.1f}</td>"
        f"<td>{j.straight_counts:.1f}</td><td>{j.own_counts:.1f}</td><td>{j.degrees:.1f}</td>"
        f"<td>{j.straight_degrees:.1f}</td></tr>"
        for j in judgements
    )
    return (
        "<section><h2>Recordings held back</h2><p>Offset and range of each sensor are learnt from its first 30 seconds,"
        " the curve comes from other recordings; errors are of the rest. Counts: root mean square. Degrees: mean"
        " absolute error of the bend that the counts tell.</p><table><thead><tr><th>sensor</th><th>range, counts</th>"
        "<th>error, counts</th><th>of a straight line</th><th>of its own curve</th><th>error, degrees</th>"
        f"<th>of a straight line</th></tr></thead><tbody>{rows}</tbody></table></section>"
    )


def _figures(study: FlexStudy) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(name)}</td><td>{spread.median:g}</td><td>{spread.log_sd:g}</td>"
        f"<td>{'data' if name in study.fitted else 'assumed'}</td></tr>"
        for name, spread in study.sensors.spreads.items()
    )
    return (
        "<section><h2>Figures of the batch</h2><table><thead><tr><th>figure</th><th>median</th>"
        f"<th>sd of the logarithm</th><th>from</th></tr></thead><tbody>{rows}</tbody></table></section>"
    )


def _measured(study: FlexStudy) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(name)}</td><td>{value:.4g}</td></tr>" for name, value in study.measured.items()
    )
    return f"<section><h2>Measured besides</h2><table><tbody>{rows}</tbody></table></section>"
