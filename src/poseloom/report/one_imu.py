"""Figure 10 of the single-IMU paper, of our method: the error by where the sensor is worn."""

import html
from collections.abc import Sequence

from poseloom.benchmark.one_imu.accuracy import COVERED
from poseloom.benchmark.one_imu.plan import OURS, PLACEMENTS
from poseloom.benchmark.one_imu.sequences import BEHAVIOURS
from poseloom.evaluation.rows import Row
from poseloom.report.page_data import method_colour

_WIDTH, _HEIGHT, _LEFT, _TOP = 960.0, 260.0, 46.0, 34.0
_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
_OTHER = "nearest-window"


def placements_svg(rows: Sequence[Row]) -> str:
    """Bars of the error of each placement and behaviour; a dash over each bar for the nearest signal windows."""
    mine = {
        (row.method, row.setting): row.value
        for row in rows
        if row.table == "10" and row.metric == "joint_position_cm" and row.setting.endswith(COVERED)
    }
    highest = max([1.0, *mine.values()])
    group = (_WIDTH - _LEFT - 10) / len(PLACEMENTS)
    bar = 0.8 * group / len(BEHAVIOURS)
    parts = [_grid(highest)]
    for number, placement in enumerate(PLACEMENTS):
        left = _LEFT + number * group + 0.1 * group
        parts.append(_text(left + 0.4 * group, _TOP + _HEIGHT + 18, placement.replace("-", " ")))
        for index, behaviour in enumerate(BEHAVIOURS):
            setting = f"{placement}-imu, joint, {behaviour}, {COVERED}"
            x = left + index * bar
            ours, other = mine.get((OURS, setting)), mine.get((_OTHER, setting))
            if ours is not None:
                size = _HEIGHT * ours / highest
                colour = method_colour(index)
                parts.append(
                    f'<rect x="{x + 1:.1f}" y="{_TOP + _HEIGHT - size:.1f}" width="{bar - 2:.1f}" '
                    f'height="{size:.1f}" fill="{colour}"/>'
                )
                parts.append(_text(x + bar / 2, _TOP + _HEIGHT - 5, f"{ours:.1f}", "#ffffff"))
            if other is not None:
                y = _TOP + _HEIGHT * (1 - other / highest)
                parts.append(f'<path d="M{x:.1f} {y:.1f}h{bar:.1f}" stroke="#1c2030" stroke-width="2"/>')
    below = _TOP + _HEIGHT + 44
    legend = "".join(
        f'<rect x="{_LEFT + 110 * i}" y="{below - 9}" width="12" height="9" fill="{method_colour(i)}"/>'
        f'<text x="{_LEFT + 110 * i + 17}" y="{below}">{html.escape(name)}</text>'
        for i, name in enumerate(BEHAVIOURS)
    )
    legend += (
        f'<path d="M{_LEFT + 460} {below - 4}h14" stroke="#1c2030" stroke-width="2"/>'
        f'<text x="{_LEFT + 480}" y="{below}">nearest signal windows</text>'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {below + 14:g}" font-family="{_FONT}" '
        f'font-size="11" fill="#444a5a"><rect width="100%" height="100%" fill="#ffffff"/>'
        f'<text x="{_LEFT}" y="16" font-weight="600">Mean joint error of {OURS}, cm, by where the sensor is worn</text>'
        f"{''.join(parts)}{legend}</svg>\n"
    )


def _grid(highest: float) -> str:
    step = 1 if highest <= 6 else 2 if highest <= 14 else 5
    parts: list[str] = []
    for value in range(0, int(highest) + 1, step):
        y = _TOP + _HEIGHT * (1 - value / highest)
        parts.append(f'<path d="M{_LEFT} {y:.1f}H{_WIDTH - 10:g}" stroke="#e3e5ec"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value}</text>')
    return "".join(parts)


def _text(x: float, y: float, text: str, colour: str = "#444a5a") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" fill="{colour}">{html.escape(text)}</text>'
