"""Accuracy and jitter of all contestants as one picture."""

from collections.abc import Sequence
from html import escape

from poseloom.benchmark.flex.material import BY_SUBJECT, WITHIN
from poseloom.benchmark.flex.page import PAPERS_ABLATION, figure
from poseloom.benchmark.flex.trials import OURS
from poseloom.evaluation.rows import Row

_WIDTH, _HEIGHT, _MARGIN = 460.0, 360.0, 56.0
_INK, _QUIET, _OURS = "#1b1f24", "#8a929c", "#0b6e4f"


def accuracy_and_jitter_svg(rows: Sequence[Row]) -> str:
    """One panel a split: error to the right, jitter upwards on a logarithmic scale; left and low is good."""
    panels = "".join(
        f'<g transform="translate({number * _WIDTH},0)">{_panel(rows, split)}</g>'
        for number, split in enumerate((BY_SUBJECT, WITHIN))
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * _WIDTH:g} {_HEIGHT:g}" '
        'font-family="system-ui, sans-serif" font-size="11"><rect width="100%" height="100%" fill="white"/>'
        f"{panels}</svg>\n"
    )


def _panel(rows: Sequence[Row], split: str) -> str:
    points = _points(rows, split)
    if not points:
        return ""
    errors, jitters = [error for _, error, _ in points], [jitter for _, _, jitter in points]
    left, right = min(errors) - 0.5, max(errors) + 1.5
    low, high = 0.1, max(max(jitters) * 1.6, 1.0)
    parts = [_text(_MARGIN, 22.0, split, _INK, 14), _axes(left, right, low, high)]
    taken: list[tuple[float, float]] = []
    for name, error, jitter in sorted(points, key=lambda point: -point[2]):
        x, y = _across(error, left, right), _up(jitter, low, high)
        label = y + 4
        while any(abs(label - other) < 12 and abs(x - beside) < 130 for beside, other in taken):
            label += 12
        taken.append((x, label))
        colour = _OURS if name.startswith(OURS) else _INK
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>')
        parts.append(_text(x + 7, label, name, colour))
    return "".join(parts)


def _points(rows: Sequence[Row], split: str) -> list[tuple[str, float, float]]:
    points: list[tuple[str, float, float]] = []
    for name in (*PAPERS_ABLATION, "nearest windows", "ridge", OURS, f"{OURS}, not smoothed"):
        error = figure(rows, "5", name, split, "error_deg")
        jitter = figure(rows, "5", name, split, "jitter_deg_s3")
        if error is not None and jitter is not None:
            points.append((name, error.value, max(jitter.value / 1e4, 0.1)))
    return points


def _axes(left: float, right: float, low: float, high: float) -> str:
    bottom = _HEIGHT - _MARGIN
    parts = [
        f'<path d="M{_MARGIN} 34V{bottom}H{_WIDTH - 10}" fill="none" stroke="{_QUIET}"/>',
        _text(_WIDTH / 2 - 40, _HEIGHT - 18, "error, degrees", _QUIET),
        f'<g transform="translate(16,{_HEIGHT / 2 + 50}) rotate(-90)">',
        _text(0.0, 0.0, "jitter, 10⁴ °/s³", _QUIET) + "</g>",
    ]
    for whole in range(int(left) + 1, int(right) + 1):
        x = _across(float(whole), left, right)
        parts.append(
            f'<path d="M{x:.1f} {bottom}v4" stroke="{_QUIET}"/>' + _text(x - 4, bottom + 16, str(whole), _QUIET)
        )
    for tick in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0):
        if low <= tick <= high:
            y = _up(tick, low, high)
            parts.append(
                f'<path d="M{_MARGIN} {y:.1f}h-4" stroke="{_QUIET}"/>' + _text(26.0, y + 4, f"{tick:g}", _QUIET)
            )
    return "".join(parts)


def _across(error: float, left: float, right: float) -> float:
    return _MARGIN + (error - left) / (right - left) * (_WIDTH - _MARGIN - 20)


def _up(jitter: float, low: float, high: float) -> float:
    from math import log

    share = log(max(jitter, low) / low) / log(high / low)
    return _HEIGHT - _MARGIN - share * (_HEIGHT - _MARGIN - 40)


def _text(x: float, y: float, words: str, colour: str, size: int = 11) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" font-size="{size}">{escape(words)}</text>'
