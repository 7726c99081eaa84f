"""NPZ: poseloom's own file of one motion, bit for bit, in the one artefact format (arrays and a JSON header)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseloom.errors import FormatError
from poseloom.formats._files import reading
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.formats.artefact_arrays import ArtefactArrays, rate
from poseloom.formats.skeleton_json import skeleton_from_json, skeleton_to_json
from poseloom.skeleton.motion import Motion, make_motion

KIND = "motion"
VERSION = 1


def write_npz(motion: Motion, path: Path) -> None:
    """Writes a motion without loss, whole or not at all.

    Raises:
        FormatError: where nothing can be written there.
    """
    header = {"name": motion.name, "rate": motion.rate, "skeleton": skeleton_to_json(motion.skeleton)}
    arrays: dict[str, NDArray[np.float64]] = {"q": motion.q}
    if motion.displacements is not None:
        arrays["displacements"] = motion.displacements
    try:
        write_artefact(path, KIND, VERSION, header, arrays)
    except OSError as error:
        raise FormatError(
            "the file cannot be written",
            cause=error.strerror or str(error),
            remedy="Name a file in an existing folder that you may write to",
            file=path,
        ) from None


def read_npz(path: Path) -> Motion:
    """Reads what `write_npz` wrote.

    Raises:
        FormatError: for a file that is damaged, of another kind or of another version.
    """
    artefact = read_artefact(path, KIND, VERSION)
    with reading(path, "a motion"):
        skeleton = skeleton_from_json(artefact.header["skeleton"])
        arrays = ArtefactArrays(artefact.arrays, dofs=skeleton.size, joints=len(skeleton))
        displacements = None
        q = arrays.floats("q", "frames dofs")
        if "displacements" in artefact.arrays:
            displacements = arrays.floats("displacements", "frames joints 3")
        return make_motion(skeleton, q, rate(artefact.header["rate"]), str(artefact.header["name"]), displacements)
