"""A motion as a table of plain numbers, for spreadsheets and other programs."""

import csv
import io
from pathlib import Path

import numpy as np

from poseloom.formats._files import write_bytes
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion


def write_pose_table(motion: Motion, path: str | Path) -> None:
    """Writes a CSV file, whole or not at all: one line a frame below one line of names.

    Columns: `time` in seconds; for each joint its place in the world `NAME.x`, `.y`, `.z` in metres, and its rotation
    vector relative to its parent `NAME.rx`, `.ry`, `.rz` in radians (the root's relative to the world).

    Raises:
        FormatError: where the file cannot be written.
    """
    names = [f"{joint}.{axis}" for joint in motion.skeleton.names for axis in ("x", "y", "z", "rx", "ry", "rz")]
    places = motion_frames(motion).positions
    rows = np.concatenate([places, motion.rotvecs], axis=-1).reshape(len(motion), -1)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time", *names])
    for frame, row in enumerate(rows.tolist()):
        writer.writerow([f"{frame / motion.rate:.6f}", *(f"{value:.6f}" for value in row)])
    write_bytes(Path(path), text.getvalue().encode())
