"""Still pictures of motions as SVG: moments of truth and estimates in a row each, drawn without a browser."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull  # pyright: ignore[reportMissingTypeStubs]

from poseloom.arrays import Array, Floats
from poseloom.evaluation.results import SequenceResult
from poseloom.report.page_data import TRUTH_COLOUR, method_colour
from poseloom.rotations import heading_angle, quat_from_rotvec
from poseloom.skeleton.kinematics import BoneFrames, motion_frames
from poseloom.skeleton.mannequin import Limb, limbs
from poseloom.skeleton.motion import Motion

_LIGHT = np.array([0.35, 0.86, 0.38]) / np.linalg.norm([0.35, 0.86, 0.38])
_CELL_WIDTH, _CELL_HEIGHT = 150.0, 216.0
_LABEL_HEIGHT, _FOOT_HEIGHT = 24.0, 26.0
_METRES_HIGH = 2.05
_DISTANCE = 5.0
"""Metres from the camera to the body."""
_AROUND = 16
_LATITUDES = np.radians([0.0, 30.0, 60.0, 85.0])
_CAPS = np.tile(np.repeat(_LATITUDES, _AROUND), 2)
"""Latitude on its round end of each point that `_surface` returns."""
_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


@dataclass(frozen=True, eq=False)
class StripRow:
    """One row of figures.

    Attributes:
        label: What it shows.
        motion: The motion; all rows of a picture have the same length and rate.
        colour: As #rrggbb.
    """

    label: str
    motion: Motion
    colour: str


@dataclass(frozen=True, eq=False)
class _View:
    """A camera that looks at `target`; `across`, `up` and `back` are its axes in the world."""

    target: Floats[Array, "3"]
    across: Floats[Array, "3"]
    up: Floats[Array, "3"]
    back: Floats[Array, "3"]
    scale: float

    def project(self, points: Floats[Array, "*batch 3"]) -> Floats[Array, "*batch 3"]:
        """Right and down in picture units from the target, and metres in front of the camera."""
        apart = points - self.target
        ahead = _DISTANCE - apart @ self.back
        return np.stack(
            [
                self.scale * _DISTANCE * (apart @ self.across) / ahead,
                -self.scale * _DISTANCE * (apart @ self.up) / ahead,
                ahead,
            ],
            axis=-1,
        )


def strip_svg(rows: Sequence[StripRow], moments: int = 8, turn_deg: float = 40.0, pitch_deg: float = 8.0) -> str:
    """Draws motions as rows of body figures at evenly spaced moments, the first row's root in the middle of each cell.

    Args:
        rows: The truth first, then the estimates.
        moments: Figures in a row.
        turn_deg: How far the camera stands to the side of the first motion's front.
        pitch_deg: How far it looks down.

    Returns:
        The text of an SVG file.
    """
    first = rows[0].motion
    moments = min(moments, len(first))
    frames = np.linspace(0, len(first) - 1, moments).round().astype(np.int64)
    width = _CELL_WIDTH * moments
    row_height = _LABEL_HEIGHT + _CELL_HEIGHT
    height = row_height * len(rows) + _FOOT_HEIGHT
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" '
        f'height="{height:.0f}" font-family="{_FONT}" font-size="14">',
        f'<rect width="{width:.0f}" height="{height:.0f}" rx="12" fill="#f4f6f8"/>',
    ]
    kinematics = [motion_frames(row.motion) for row in rows]
    for row_index, row in enumerate(rows):
        top = row_height * row_index
        body = limbs(row.motion.skeleton)
        parts.append(
            f'<circle cx="20" cy="{top + 19:.0f}" r="6" fill="{row.colour}"/>'
            f'<text x="33" y="{top + 24:.0f}" fill="#1d2330" font-weight="600">{html.escape(row.label)}</text>'
        )
        for column, frame in enumerate(frames):
            view = _view(first, int(frame), turn_deg, pitch_deg)
            x, y = _CELL_WIDTH * (column + 0.5), top + _LABEL_HEIGHT + 0.53 * _CELL_HEIGHT
            parts.append(f'<g transform="translate({x:.1f} {y:.1f})">')
            key = f"f{row_index}-{column}"
            parts.extend(_figure(body, kinematics[row_index], int(frame), view, row.colour, key))
            parts.append("</g>")
    for column, frame in enumerate(frames):
        parts.append(
            f'<text x="{_CELL_WIDTH * (column + 0.5):.1f}" y="{height - 9:.0f}" fill="#566074" font-size="12" '
            f'text-anchor="middle">{frame / first.rate:.1f} s</text>'
        )
    return "\n".join([*parts, "</svg>"]) + "\n"


def sequence_strip(sequence: SequenceResult, moments: int = 8) -> str:
    """An evaluated sequence as a strip: the truth's row, then one a method, in the report's colours.

    Shown is the time of which every method has something to say.
    """
    start = max((int(result.samples[0]) for result in sequence.results), default=0)
    stop = 1 + min((int(result.samples[-1]) for result in sequence.results), default=len(sequence.truth) - 1)
    rows = [StripRow("truth", sequence.truth.cut(start, stop), TRUTH_COLOUR)]
    for index, result in enumerate(sequence.results):
        held = np.maximum(np.searchsorted(result.samples, np.arange(start, stop), side="right") - 1, 0)
        motion = Motion(result.motion.skeleton, result.motion.q[held], sequence.truth.rate, result.name)
        rows.append(StripRow(result.name, motion, method_colour(index)))
    return strip_svg(rows, moments)


def _view(motion: Motion, frame: int, turn_deg: float, pitch_deg: float) -> _View:
    middle = motion.rotvecs[len(motion) // 2, 0]
    yaw = float(heading_angle(quat_from_rotvec(middle))) + np.radians(turn_deg)
    pitch = np.radians(pitch_deg)
    back = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    across = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    target = np.array([motion.q[frame, 0], 0.9, motion.q[frame, 2]])
    return _View(target, across, np.cross(back, across), back, _CELL_HEIGHT / _METRES_HIGH)


def _figure(body: Sequence[Limb], kinematics: BoneFrames, frame: int, view: _View, colour: str, key: str) -> list[str]:
    """The shadow, then the limbs as outlines filled with their light and dark side, far ones first."""
    drawn: list[tuple[float, str]] = []
    shadow: list[str] = []
    for index, limb in enumerate(body):
        position, rotation = kinematics.positions[frame, limb.bone], kinematics.rotations[frame, limb.bone]
        skin, normals = _surface(limb)
        skin, normals = position + skin @ rotation.T, normals @ rotation.T
        shadow.append(_path(view.project(skin - _LIGHT * (skin[:, 1:2] / _LIGHT[1]))))
        places = view.project(skin)
        tube = np.abs(_CAPS) <= np.radians(30)  # the tips' light would run along the limb, not around it
        gradient = _gradient(places[tube], normals[tube], view, colour, f"{key}-{index}")
        drawn.append((float(places[:, 2].mean()), f'{gradient}<path d="{_path(places)}" fill="url(#{key}-{index})"/>'))
    far_first = [path for _, path in sorted(drawn, key=lambda entry: -entry[0])]
    return [f'<path d="{"".join(shadow)}" fill="#1d2330" opacity="0.13"/>', *far_first]


def _path(places: Floats[Array, "points 3"]) -> str:
    """The outline of a projected limb, which is convex; always in the same sense, so that overlaps stay filled."""
    corners = ConvexHull(places[:, :2]).vertices
    outline = (10 * places[corners, :2]).round().astype(np.int64)
    steps = np.diff(outline, axis=0)
    steps = steps[(steps != 0).any(axis=1)]
    return (
        f"M{outline[0, 0] / 10:g} {outline[0, 1] / 10:g}l" + " ".join(f"{x / 10:g} {y / 10:g}" for x, y in steps) + "z"
    )


def _gradient(
    places: Floats[Array, "points 3"], normals: Floats[Array, "points 3"], view: _View, colour: str, key: str
) -> str:
    """The linear change of brightness over the picture that comes nearest to the light on the limb's visible side."""
    seen = normals @ view.back > 0.05
    light = 0.48 + 0.22 * normals[seen, 1] + 0.62 * (0.5 + 0.5 * (normals[seen] @ _LIGHT)) ** 1.6
    middle, mean = places[seen, :2].mean(axis=0), float(light.mean())
    flat = places[seen, :2] - middle
    # Normal equations with a touch of ridge: a limb seen end on has next to no extent one way.
    normal_matrix = flat.T @ flat + 1e-3 * np.eye(2)
    slope = cast(NDArray[np.float64], np.linalg.solve(normal_matrix, flat.T @ (light - mean)))
    steep = float(np.linalg.norm(slope))
    direction = slope / max(steep, 1e-9)
    along = cast(NDArray[np.float64], flat @ direction)
    low, high = float(along.min()), float(along.max())
    (x1, y1), (x2, y2) = middle + low * direction, middle + high * direction
    dark, bright = _shade(colour, mean + steep * low), _shade(colour, mean + steep * high)
    line = f'x1="{x1:.0f}" y1="{y1:.0f}" x2="{x2:.0f}" y2="{y2:.0f}"'
    stops = f'<stop stop-color="{dark}"/><stop offset="1" stop-color="{bright}"/>'
    return f'<linearGradient id="{key}" gradientUnits="userSpaceOnUse" {line}>{stops}</linearGradient>'


def _shade(colour: str, brightness: float) -> str:
    channels = (int(colour[i : i + 2], 16) * brightness for i in (1, 3, 5))
    return "#" + "".join(f"{min(255, max(0, round(channel))):02x}" for channel in channels)


def _surface(limb: Limb) -> tuple[Floats[Array, "points 3"], Floats[Array, "points 3"]]:
    """Points on a limb's skin and their outward normals, in the bone's frame."""
    axis = (limb.end - limb.start) / np.linalg.norm(limb.end - limb.start)
    depth = np.cross(axis, limb.side)
    angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    points: list[Floats[Array, "ring 3"]] = []
    normals: list[Floats[Array, "ring 3"]] = []
    for centre, (wide, deep), sign in ((limb.start, limb.radii[:2], -1.0), (limb.end, limb.radii[2:], 1.0)):
        cap = min(wide, deep)
        for latitude in _LATITUDES:
            ring, along = np.cos(latitude), sign * np.sin(latitude)
            side, back = ring * np.cos(angle)[:, None] * limb.side, ring * np.sin(angle)[:, None] * depth
            points.append(centre + axis * (along * cap) + side * wide + back * deep)
            normals.append(axis * (along / cap) + side / wide + back / deep)
    normal = np.concatenate(normals)
    return np.concatenate(points), normal / np.linalg.norm(normal, axis=1, keepdims=True)
