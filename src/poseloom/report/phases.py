"""A picture of the phases over a motion: figures, contacts, ankle crossings and phases on one line of time."""

import html
from importlib.metadata import version
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.formats.atomic import atomic_file
from poseloom.methods.imus.phases import Phase, PhaseTrack
from poseloom.report.strip import StripRow, strip_svg
from poseloom.skeleton.motion import Motion

PHASE_COLOURS = (
    *("#0b4f8a", "#2f7fc1", "#6fb1e4", "#b5d8f2"),
    *("#8a3b0b", "#c9702b", "#e5a46d", "#f4d3b5"),
    *("#c9ced6", "#2e8b57", "#8fd3a8", "#f0c75e"),
)
"""One a phase: the right leg's stance in blue, its swing in orange, rest in grey, leaps in green and yellow."""

_SECOND = 220.0
"""Width of a second."""

_LEFT = 150.0
_ROW = 22.0
_CURVE = 90.0
_FONT = "font-family=\"system-ui, 'Segoe UI', Roboto, Arial, sans-serif\""


def write_phases(path: str | Path, motion: Motion, track: PhaseTrack, behaviour: str) -> None:
    """Writes the picture as one HTML file that needs no network, whole or not at all.

    Args:
        path: The HTML file.
        motion: What happens.
        track: Its phases.
        behaviour: What it was taken for.

    Raises:
        OSError: where the file cannot be written.
    """
    with atomic_file(path) as part:
        part.write_text(phases_page(motion, track, behaviour), encoding="utf-8")


def phases_page(motion: Motion, track: PhaseTrack, behaviour: str) -> str:
    """The text of the HTML file."""
    name = html.escape(motion.name or "a motion")
    facts = f"{len(motion)} frames at {motion.rate:g} Hz, {motion.duration:.2f} s, taken for {html.escape(behaviour)}"
    figures = strip_svg([StripRow("", motion, "#5b8ac4")], moments=10)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Phases of {name}</title>
<style>
body {{ font: 15px/1.5 system-ui, 'Segoe UI', Roboto, Arial, sans-serif; margin: 2rem auto; max-width: 1500px;
  padding: 0 1.2rem; color: #1d2330; background: #fff; }}
h1 {{ font-size: 1.5rem; margin: 0; }} .facts {{ color: #5a6372; margin: 0 0 1rem; }}
.scroll {{ overflow-x: auto; border: 1px solid #dde1e8; border-radius: 8px; padding: .6rem; margin: 1rem 0; }}
.figures svg {{ max-width: 100%; height: auto; }}
table {{ border-collapse: collapse; }} td, th {{ padding: .2rem .9rem .2rem 0; text-align: left; }}
td.number {{ text-align: right; font-variant-numeric: tabular-nums; }}
i {{ display: inline-block; width: 1em; height: 1em; border-radius: 3px; vertical-align: -.12em; margin-right: .5em; }}
</style></head><body>
<h1>Phases of {name}</h1>
<p class="facts">{facts}. poseloom {version("poseloom")}</p>
<div class="figures">{figures}</div>
<div class="scroll">{timeline_svg(motion, track)}</div>
{_table(motion, track)}
<p>The eight phases of gait are the right leg's cycle: its stance in blue, its swing in orange. Solid bars show when a
heel's or toes' underside stands; the curve shows how far the right ankle is before the left, and crosses zero where
the ankles pass each other.</p>
</body></html>
"""


def timeline_svg(motion: Motion, track: PhaseTrack) -> str:
    """Phases, contacts, ankle lead and the hips' speed over time."""
    seconds = len(motion) / motion.rate
    width = _LEFT + _SECOND * seconds + 20
    parts: list[str] = []
    for segment in track.segments():
        x, w = _LEFT + _SECOND * segment.start / motion.rate, _SECOND * len(segment) / motion.rate
        title = f"{segment.phase.title}: {segment.start / motion.rate:.2f} s, {len(segment) / motion.rate:.2f} s long"
        colour = PHASE_COLOURS[segment.phase]
        parts.append(
            f'<rect x="{x:.1f}" y="8" width="{max(w - 1, 1):.1f}" height="30" rx="2" fill="{colour}">'
            f"<title>{title}</title></rect>"
        )
    parts.append(_label("phase", 28.0))
    top = 52.0
    stands = track.contacts
    feet = (
        ("left heel", stands.left_heel),
        ("left toes", stands.left_toe),
        ("right heel", stands.right_heel),
        ("right toes", stands.right_toe),
    )
    for name, on in feet:
        colour = "#0b4f8a" if name.startswith("right") else "#8a6d3b"
        parts += [_label(name, top + 11), *_bars(on, motion.rate, top, colour)]
        top += _ROW
    curves = (("ankle lead, cm", 100 * track.ahead, "#6b5b95"), ("hips' speed, m/s", track.speed, "#444b57"))
    for name, values, colour in curves:
        parts += [_label(name, top + _CURVE / 2), _curve(values, motion.rate, top + 8, colour, width)]
        top += _CURVE
    for second in range(int(seconds) + 1):
        x = _LEFT + _SECOND * second
        parts.append(f'<line x1="{x}" y1="4" x2="{x}" y2="{top}" stroke="#1d2330" stroke-opacity="0.12"/>')
        parts.append(f'<text x="{x}" y="{top + 16}" font-size="12" text-anchor="middle" {_FONT}>{second} s</text>')
    size = f'width="{width:.0f}" height="{top + 26:.0f}" viewBox="0 0 {width:.0f} {top + 26:.0f}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>'


def _bars(on: Bools[Array, "frames"], rate: float, top: float, colour: str) -> list[str]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    return [
        f'<rect x="{_LEFT + _SECOND * a / rate:.1f}" y="{top}" width="{_SECOND * (b - a) / rate:.1f}" height="14" '
        f'fill="{colour}" rx="2"/>'
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    ]


def _curve(values: Floats[Array, "frames"], rate: float, top: float, colour: str, width: float) -> str:
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 1e-3)
    scale = (_CURVE - 20) / (high - low)
    points = " ".join(
        f"{_LEFT + _SECOND * i / rate:.1f},{top + scale * (high - value):.1f}" for i, value in enumerate(values)
    )
    zero = top + scale * high
    return (
        f'<line x1="{_LEFT}" y1="{zero:.1f}" x2="{width:.0f}" y2="{zero:.1f}" stroke="#1d2330" stroke-opacity="0.25"/>'
        f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6"/>'
        f'<text x="{_LEFT - 6}" y="{top + 6:.1f}" font-size="11" text-anchor="end" fill="#5a6372" {_FONT}>'
        f"{high:.2g}</text>"
    )


def _label(text: str, y: float) -> str:
    return f'<text x="4" y="{y:.1f}" font-size="13" fill="#1d2330" {_FONT}>{html.escape(text)}</text>'


def _table(motion: Motion, track: PhaseTrack) -> str:
    segments = track.segments()
    rows: list[str] = []
    for phase in Phase:
        lengths = [len(s) / motion.rate for s in segments if s.phase is phase]
        if lengths:
            share = 100 * sum(lengths) * motion.rate / len(motion)
            rows.append(
                f'<tr><td><i style="background:{PHASE_COLOURS[phase]}"></i>{phase.title}</td>'
                f'<td class="number">{len(lengths)}</td><td class="number">{np.mean(lengths):.2f} s</td>'
                f'<td class="number">{share:.0f} %</td></tr>'
            )
    head = "<tr><th>phase</th><th>times</th><th>mean length</th><th>share of the motion</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"
