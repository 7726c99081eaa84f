"""The page that leads a person through the calibration poses: pictures, a countdown, and nothing to install."""

import base64
import html
import json
import re
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.calibration.poses import guided_poses
from poseloom.calibration.session import DEFAULT_ROUNDS
from poseloom.errors import PoseloomError
from poseloom.formats.atomic import atomic_file
from poseloom.report.strip import StripRow, strip_svg
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import make_motion

_COLOUR = "#5b8ac4"
_FRONT_DEG, _LEFT_DEG = 8.0, 82.0
_MOST_ROUNDS = 8


def write_guide(path: str | Path, rounds: int = DEFAULT_ROUNDS, hold_s: float = 3.0, move_s: float = 3.0) -> None:
    """Writes the guide, whole or not at all. It needs nothing but a browser, and no network.

    Args:
        path: The HTML file.
        rounds: How often it leads through the eight poses unless the person chooses otherwise.
        hold_s: Seconds of a hold.
        move_s: Seconds to get into the next pose.

    Raises:
        PoseloomError: for a number of rounds from which the page offers no choice.
        OSError: where the file cannot be written.
    """
    if not 1 <= rounds <= _MOST_ROUNDS:
        raise PoseloomError(f"{rounds} rounds cannot be guided", remedy=f"Choose 1 to {_MOST_ROUNDS}")
    poses = [
        {
            "name": pose.name,
            "title": pose.title,
            "instruction": pose.instruction,
            "front": pose_picture(pose.q, _FRONT_DEG),
            "left": pose_picture(pose.q, _LEFT_DEG),
        }
        for pose in guided_poses()
    ]
    parts = {
        "poses": json.dumps(poses).replace("<", "\\u003c"),
        "rounds": str(rounds),
        "hold": f"{hold_s:g}",
        "move": f"{move_s:g}",
        "version": html.escape(version("poseloom")),
    }
    page = files("poseloom.report").joinpath("page", "guide.html").read_text(encoding="utf-8")
    text = re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], page)
    with atomic_file(path) as part:
        part.write_text(text, encoding="utf-8")


def pose_picture(q: Floats[Array, "dofs"], turn_deg: float) -> str:
    """A picture of the average body in a pose, from a camera that many degrees to its left, as a data URL.

    An image of its own keeps the names of its gradients to itself.
    """
    motion = make_motion(average_body(), np.asarray(q)[None], 1.0)
    svg = strip_svg([StripRow("", motion, _COLOUR)], moments=1, turn_deg=turn_deg, pitch_deg=5.0)
    # Only the figure's cell: neither the row's label above it nor the time below.
    cell = 'viewBox="-14 25 178 216" width="712" height="864"'
    svg = re.sub(r'viewBox="[^"]*" width="\d+" height="\d+"', cell, svg, count=1)
    svg = re.sub(r'<rect [^>]*fill="#f4f6f8"/>', "", svg, count=1)
    svg = re.sub(r"<circle [^>]*/><text [^>]*></text>", "", svg, count=1)
    svg = re.sub(r"<text [^>]*>[^<]* s</text>", "", svg)
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()
