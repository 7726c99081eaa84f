"""The sample motions as one small file: DeepMimic's figures as 16-bit numbers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.formats.deepmimic import DeepMimicMotion, deepmimic_skeleton
from poseloom.skeleton.motion import make_motion

_KIND = "sample-motions"
_VERSION = 1
_METRES = 1e-4
_RADIANS = 2e-4
"""Steps of the 16-bit numbers: a tenth of a millimetre over 6.5 m, and a hundredth of a degree over two turns."""


def encode_samples(motions: Mapping[str, DeepMimicMotion], path: Path, source: str) -> None:
    """Writes motions of DeepMimic's humanoid as one artefact of 16-bit pose vectors.

    Args:
        motions: By name.
        path: The file.
        source: The archive that they come from, for the header.

    Raises:
        FormatError: if a place or angle is too large for 16 bits.
    """
    steps = _steps()
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    for name, (motion, _) in motions.items():
        counts = np.rint(motion.q / steps)
        if np.abs(counts).max() > np.iinfo(np.int16).max:
            raise FormatError(f"motion {name!r} moves too far for 16 bits", remedy="Make the steps coarser", file=path)
        arrays[name] = counts.astype(np.int16)
    header = {
        "source": source,
        "metres_per_step": _METRES,
        "radians_per_step": _RADIANS,
        "clips": [{"name": name, "rate": motion.rate, "cyclic": cyclic} for name, (motion, cyclic) in motions.items()],
    }
    write_artefact(path, _KIND, _VERSION, header, arrays)


def decode_samples(path: Path) -> dict[str, DeepMimicMotion]:
    """The motions of a file that `encode_samples` wrote, on DeepMimic's humanoid.

    Raises:
        FormatError: if the file is missing, damaged or of another version.
    """
    artefact = read_artefact(path, _KIND, _VERSION)
    skeleton, steps = deepmimic_skeleton(), _steps()
    motions: dict[str, DeepMimicMotion] = {}
    for clip in cast(list[dict[str, Any]], artefact.header["clips"]):
        name = str(clip["name"])
        motion = make_motion(skeleton, artefact.arrays[name] * steps, float(clip["rate"]), name)
        motions[name] = DeepMimicMotion(motion, bool(clip["cyclic"]))
    return motions


def _steps() -> Floats[Array, "dofs"]:
    steps = np.full(deepmimic_skeleton().size, _RADIANS)
    steps[:3] = _METRES
    return steps
