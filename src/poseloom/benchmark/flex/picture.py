"""Accuracy and jitter of all contestants as one picture."""

from collections.abc import Sequence
from html import escape

from poseloom.benchmark.flex.material import BY_SUBJECT, WITHIN
from poseloom.benchmark.flex.page import PAPERS_ABLATION, figure
from poseloom.benchmark.flex.trials import OURS
from poseloom.evaluation.rows import Row

_WIDTH, _HEIGHT, _MARGIN = 490.0, 360.0, 56.0
_LABELS, _LINE = 330.0, 14.0
"""Where the names stand, and how far apart at least."""
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
    left, right = min(errors) - 0.25, max(errors) + 0.25
    low, high = 0.1, max(max(jitters) * 1.6, 1.0)
    parts = [_text(_MARGIN, 22.0, split, _INK, 14), _axes(left, right, low, high)]
    placed = sorted(((_up(jitter, low, high), _across(error, left, right), name) for name, error, jitter in points))
    for (y, x, name), label in zip(placed, _spread_out([y for y, _, _ in placed]), strict=True):
        colour = _OURS if name.startswith(OURS) else _INK
        parts.append(
            f'<path d="M{x + 5:.1f} {y:.1f}L{_LABELS - 4} {label - 4:.1f}" stroke="{_QUIET}" stroke-width="0.5"/>'
        )
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>')
        parts.append(_text(_LABELS, label, name, colour))
    return "".join(parts)


def _spread_out(heights: Sequence[float]) -> list[float]:
    """Heights of labels, in order, as near to those given as lines of text allow."""
    labels: list[float] = []
    for height in heights:
        labels.append(max(height + 4, labels[-1] + _LINE) if labels else height + 4)
    below = _HEIGHT - _MARGIN
    for number in range(len(labels) - 1, -1, -1):
        labels[number] = min(labels[number], below - _LINE * (len(labels) - 1 - number))
    return labels


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
        f'<path d="M{_MARGIN} 34V{bottom}H{_LABELS - 20}" fill="none" stroke="{_QUIET}"/>',
        _text(_LABELS / 2 - 20, _HEIGHT - 18, "error, degrees", _QUIET),
        f'<g transform="translate(16,{_HEIGHT / 2 + 50}) rotate(-90)">',
        _text(0.0, 0.0, "jitter, 10⁴ °/s³", _QUIET) + "</g>",
    ]
    for halves in range(int(2 * left) + 1, int(2 * right) + 1):
        x = _across(halves / 2, left, right)
        parts.append(f'<path d="M{x:.1f} {bottom}v4" stroke="{_QUIET}"/>')
        parts.append(_text(x - 8, bottom + 16, f"{halves / 2:.1f}", _QUIET))
    for tick in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0):
        if low <= tick <= high:
            y = _up(tick, low, high)
            parts.append(
                f'<path d="M{_MARGIN} {y:.1f}h-4" stroke="{_QUIET}"/>' + _text(26.0, y + 4, f"{tick:g}", _QUIET)
            )
    return "".join(parts)


def _across(error: float, left: float, right: float) -> float:
    return _MARGIN + (error - left) / (right - left) * (_LABELS - _MARGIN - 30)


def _up(jitter: float, low: float, high: float) -> float:
    from math import log

    share = log(max(jitter, low) / low) / log(high / low)
    return _HEIGHT - _MARGIN - share * (_HEIGHT - _MARGIN - 40)


def _text(x: float, y: float, words: str, colour: str, size: int = 11) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" font-size="{size}">{escape(words)}</text>'
