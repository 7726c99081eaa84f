"""A calibration as a page: the body found, every size and placement with its uncertainty, and the findings."""

import html
import math
import re
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from poseloom.calibration.calibration import Calibration, Level
from poseloom.calibration.poses import guided_pose
from poseloom.formats.atomic import atomic_file
from poseloom.report.guide import pose_picture
from poseloom.report.strip import StripRow, strip_svg
from poseloom.rotations import rotvec_from_matrix
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import make_motion

SIZES: tuple[tuple[str, str], ...] = (
    ("thigh", "leftLowerLeg"),
    ("shank", "leftFoot"),
    ("foot, ankle to ball", "leftToes"),
    ("hips to hip joint", "leftUpperLeg"),
    ("back, lower", "chest"),
    ("back, middle", "upperChest"),
    ("back, upper", "neck"),
    ("neck", "head"),
    ("collar to shoulder", "leftUpperArm"),
    ("upper arm", "leftLowerArm"),
    ("forearm", "leftHand"),
)
"""What people call the bones whose length is found, and the joint at each one's end; both sides are alike."""

_STYLE = """
:root { color-scheme: light; } * { box-sizing: border-box; }
body { margin: 0 auto; max-width: 980px; padding: 16px; background: #eef1f5; color: #1d2330;
  font: 15px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 22px; margin: 0 0 10px; } h2 { font-size: 16px; margin: 0 0 6px; }
section { background: #fff; border: 1px solid #dde2ea; border-radius: 10px; padding: 12px 16px; margin-bottom: 12px; }
section { overflow-x: auto; } .two section { margin: 0; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(300px, 1fr)); gap: 12px; }
.two { margin-bottom: 12px; } .good { border-left: 6px solid #1c7c54; } .warning { border-left: 6px solid #c77700; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 4px 8px; border-bottom: 1px solid #e9edf2; text-align: right; white-space: nowrap; }
th:first-child { text-align: left; font-weight: 400; } thead th { color: #566074; font-size: 13px; font-weight: 400; }
small, p.note { color: #566074; font-size: 13px; margin: 6px 0 0; } td.high { background: #fdebd2; }
img.pose { height: 54px; vertical-align: middle; transform: scaleX(-1); } svg { max-width: 100%; height: auto; }
"""


def write_calibration_report(path: str | Path, calibration: Calibration, title: str = "Calibration") -> None:
    """Writes the page, whole or not at all. It needs nothing but a browser, and no network.

    Args:
        path: The HTML file.
        calibration: What to show.
        title: The page's heading.

    Raises:
        OSError: where the file cannot be written.
    """
    verdicts = "".join(
        f'<section class="{"good" if v.level is Level.GOOD else "warning"}"><b>{html.escape(v.fact)}.</b> '
        f"{html.escape(' '.join(text.rstrip('.') + '.' for text in (v.cause, v.remedy) if text))}</section>"
        for v in calibration.verdicts
    )
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    text = (
        f'<!DOCTYPE html><html lang="en"><head>{head}<title>{html.escape(title)}</title><style>{_STYLE}</style></head>'
        f"<body><h1>{html.escape(title)}</h1>{verdicts}"
        f'<div class="two"><section><h2>The body found</h2>{_figures(calibration)}</section>'
        f"<section><h2>Sizes</h2>{_sizes(calibration)}</section></div>"
        f"<section><h2>Placements</h2>{_placements(calibration)}</section>"
        f"<section><h2>What is left over, for each held pose and sensor</h2>{_residuals(calibration)}</section>"
        f"<small>poseloom {html.escape(version('poseloom'))}</small></body></html>\n"
    )
    with atomic_file(path) as part:
        part.write_text(text, encoding="utf-8")


def size_rows(calibration: Calibration) -> list[tuple[str, float, float, float]]:
    """Name, length, standard deviation and the average body's length of each bone, metres."""
    average = average_body()
    return [
        (
            name,
            float(calibration.lengths[average.index(bone)]),
            float(calibration.length_sigmas[average.index(bone)]),
            float(np.linalg.norm(average.offsets[average.index(bone)])),
        )
        for name, bone in SIZES
    ]


def placement_rows(calibration: Calibration) -> list[tuple[str, str, list[float], float, list[float], float]]:
    """Sensor, bone, place (m) and its standard deviation, rotation vector (rad) and its standard deviation.

    The standard deviations are of the whole vectors: the root of the sum over their three parts.
    """
    rows: list[tuple[str, str, list[float], float, list[float], float]] = []
    for index, (name, placement) in enumerate(zip(calibration.sensors, calibration.placements, strict=True)):
        place = [float(value) for value in placement.p_bone_sensor]
        turn = [float(value) for value in rotvec_from_matrix(placement.R_bone_sensor)]
        offset = float(np.linalg.norm(calibration.offset_sigmas[index]))
        angle = float(np.linalg.norm(calibration.turn_sigmas[index]))
        rows.append((name, placement.bone, place, offset, turn, angle))
    return rows


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Cells are HTML already."""
    body = "".join(f"<tr><th>{row[0]}</th>{''.join(_cell(cell) for cell in row[1:])}</tr>" for row in rows)
    return f"<table><thead><tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr></thead><tbody>{body}</tbody></table>"


def _cell(cell: str) -> str:
    return cell if cell.startswith("<td") else f"<td>{cell}</td>"


def _sizes(calibration: Calibration) -> str:
    rows = [
        (name, f"{100 * length:.1f}", f"± {100 * sigma:.1f}", f"{100 * usual:.1f}")
        for name, length, sigma, usual in size_rows(calibration)
    ]
    return _table(("bone", "cm", "sd", "average"), rows) + '<p class="note">Left and right are taken to be alike.</p>'


def _placements(calibration: Calibration) -> str:
    rows = [
        (
            f"{html.escape(name)}",
            html.escape(bone),
            *(f"{100 * value:.1f}" for value in place),
            f"± {100 * offset:.1f}",
            *(f"{math.degrees(value):.0f}" for value in turn),
            f"± {math.degrees(angle):.1f}",
        )
        for name, bone, place, offset, turn, angle in placement_rows(calibration)
    ]
    head = ("sensor", "bone", "x cm", "y", "z", "sd", "turn x °", "y", "z", "sd")
    return _table(head, rows)


def _residuals(calibration: Calibration) -> str:
    rows: list[list[str]] = []
    for pose, residuals, deviation in zip(
        calibration.poses, calibration.residuals, calibration.deviations, strict=True
    ):
        guided = guided_pose(pose)
        picture = f'<img class="pose" alt="" src="{pose_picture(guided.q, 8.0)}"> {html.escape(guided.title)}'
        cells = [_residual(float(metres), float(angle)) for metres, angle in residuals]
        rows.append([picture, *cells, f"{math.degrees(deviation):.1f}°"])
    head = ("pose", *(f"{html.escape(name)}, mm and °" for name in calibration.sensors), "joints from the guide")
    return _table(head, rows)


def _residual(metres: float, angle: float) -> str:
    if math.isnan(metres):
        return "silent"
    high = ' class="high"' if metres > 0.015 or math.degrees(angle) > 2.5 else ""
    return f"<td{high}>{1000 * metres:.1f}, {math.degrees(angle):.1f}</td>"


def _figures(calibration: Calibration) -> str:
    body = calibration.skeleton
    height = float(np.abs(body.rest_positions()[:, 1]).max()) + 0.075
    q = np.zeros((3, body.size))
    q[:, 1] = height
    q[:, 4] = np.radians([0.0, -35.0, -90.0])
    for side, down in (("left", -65.0), ("right", 65.0)):
        q[:, 5 + 3 * body.index(f"{side}UpperArm")] = np.radians(down)
    motion = make_motion(body, q, 1.0)
    average = q.copy()
    average[:, 1] = float(np.abs(average_body().rest_positions()[:, 1]).max()) + 0.075
    rows = [
        StripRow("found", motion, "#5b8ac4"),
        StripRow("average body", make_motion(average_body(), average, 1.0), "#a8b0bd"),
    ]
    # The three frames are three sides of one pose: their times mean nothing.
    return re.sub(r"<text [^>]*>[^<]* s</text>", "", strip_svg(rows, moments=3, turn_deg=35.0))
