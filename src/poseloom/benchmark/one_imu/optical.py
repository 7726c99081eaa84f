"""The optical truth of the one real walk that has it: joints and bones of hips and legs, seen by cameras.

Of subject S02 of `neura_walk`: joint centres in metres and orientations of segments, 100 Hz, world z up. The segments'
axes are forwards, left and up for pelvis, thighs and shanks, and down, left and along the foot for feet.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats.text_tables import Table, read_table
from poseloom.rotations import matrix_from_quat, matrix_from_rotvec

RATE = 100.0
FIRST_ROW = 1119
"""Packet of the raw inertial files, counted from 0, at which the cameras' recording begins (its file says 1120)."""

_JOINTS: Mapping[str, str] = MappingProxyType(
    {
        "hips": "PELV",
        **{
            f"{side}{bone}": f"{letter}{name}"
            for side, letter in (("left", "L"), ("right", "R"))
            for bone, name in (("UpperLeg", "FEP"), ("LowerLeg", "FEO"), ("Foot", "TIO"), ("Toes", "TOE"))
        },
    }
)
_SEGMENTS: Mapping[str, str] = MappingProxyType(
    {
        "hips": "qRPV",
        **{
            f"{side}{bone}": f"q{letter}{name}"
            for side, letter in (("left", "L"), ("right", "R"))
            for bone, name in (("UpperLeg", "TH"), ("LowerLeg", "SK"), ("Foot", "FT"))
        },
    }
)
_R_YUP_ZUP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
_R_SEGMENT_BONE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_R_FOOT_BONE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_STANDING_ROWS = 10
"""The person stands in the first tenth of a second: what is flat on the floor then is flat."""


@dataclass(frozen=True, eq=False)
class OpticalWalk:
    """What the cameras saw, in a world whose y points up.

    Attributes:
        joints: Place of each joint by its name on the body, metres: hips, and UpperLeg to Toes of both sides.
        bones: `R_world_bone` of hips, thighs, shanks and feet; a foot that stands flat is level.
    """

    joints: Mapping[str, Floats[Array, "frames 3"]]
    bones: Mapping[str, Floats[Array, "frames 3 3"]]

    def __len__(self) -> int:
        return len(self.joints["hips"])

    def length(self, upper: str, lower: str) -> float:
        """Median distance of two joints, metres."""
        return float(np.median(np.linalg.norm(self.joints[upper] - self.joints[lower], axis=1)))


def read_optical_walk(folder: Path) -> OpticalWalk:
    """Reads the walk in a folder `neura_walk`.

    Raises:
        FormatError: where it is missing or damaged.
    """
    table = read_table(folder / "vicon" / "S02-Trial-Walk-1.csv")
    joints = {name: _columns(table, column, 3) @ _R_YUP_ZUP.T for name, column in _JOINTS.items()}
    bones: dict[str, Floats[Array, "frames 3 3"]] = {}
    for name, column in _SEGMENTS.items():
        seen = _R_YUP_ZUP @ matrix_from_quat(_columns(table, column, 4))
        bones[name] = _levelled(seen @ _R_FOOT_BONE) if name.endswith("Foot") else seen @ _R_SEGMENT_BONE
    return OpticalWalk(MappingProxyType(joints), MappingProxyType(bones))


def _columns(table: Table, name: str, count: int) -> Floats[Array, "frames _"]:
    values = table.columns(table.find(*(f"{name}_{i + 1}" for i in range(count))))
    if np.isnan(values).any():
        raise FormatError(f"{name} is not known in every frame", remedy="Get the recording again", file=table.file)
    return values


def _levelled(feet: Floats[Array, "frames 3 3"]) -> Floats[Array, "frames 3 3"]:
    """Feet whose z axis is level while they stand: the segment's own goes down from ankle to toes."""
    ahead = feet[:_STANDING_ROWS, :, 2].mean(axis=0)
    pitch = float(np.arctan2(ahead[1], np.hypot(ahead[0], ahead[2])))
    return feet @ matrix_from_rotvec(np.array([pitch, 0.0, 0.0]))
