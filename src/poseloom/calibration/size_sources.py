"""People's bodies for the body-size model, from a table of CMU's skeletons and from ASF files."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.calibration.body_size import size_vectors
from poseloom.errors import FormatError
from poseloom.formats._files import read_bytes, reading
from poseloom.formats.asf_amc import read_asf
from poseloom.skeleton.body import MIRROR, average_body
from poseloom.skeleton.motion import make_motion
from poseloom.skeleton.retarget import retarget
from poseloom.skeleton.skeleton import Skeleton

METRES_PER_UNIT = 0.0254 / 0.45
"""CMU's unit of length."""

_MIDDLE = ("Spine", "Spine1", "Neck1", "Head", "Head_end")
_SIDED = ("UpLeg", "Leg", "Foot", "ToeBase", "ToeBase_end", "Arm", "ForeArm", "Hand")
_JOINTS = (*_MIDDLE, *(f"{side}{joint}" for side in ("Left", "Right") for joint in _SIDED))

_STRAIGHT = {
    "leftLowerArm": "ForeArm",
    "leftHand": "Hand",
    "leftLowerLeg": "Leg",
    "leftFoot": "Foot",
    "leftToes": "ToeBase",
}
"""The joint of the table at which a straight bone of the body ends, by the body bone that begins there."""

_THORAX_RATIO = 1.04
"""Length of the thorax by the mean of the two segments below it, where no ASF file tells it: as on the average body."""

_SAME = 1e-3
"""Metres: two bodies of which no bone vector differs by more are one person's."""


def read_cmu_sizes(path: Path, thorax_ratio: float = _THORAX_RATIO) -> dict[str, Skeleton]:
    """Bodies by subject from a table of CMU's BVH skeletons (`subject,clip,joint,x,y,z`, one joint a row, CMU's unit).

    What the BVH conversion did to them is mended: it dropped the thorax, so a segment of `thorax_ratio` times the mean
    of the two segments below is put in under neck and shoulders. Left and right are averaged. As in retargeting, bones
    lie as in the body's T-pose and only their lengths are taken, but for collar bones and hips, whose ends lie where
    they lie. Hands, whose rows are not sizes, are the average body's, scaled with the forearm.

    Raises:
        FormatError: with the line, where the table has another form or a subject lacks a joint.
    """
    rows = _read_rows(path)
    bodies: dict[str, Skeleton] = {}
    for subject, joints in rows.items():
        missing = [joint for joint in _JOINTS if joint not in joints]
        if missing:
            raise FormatError(f"subject {subject} lacks {', '.join(missing)}", remedy="Give one row a joint", file=path)
        bodies[subject] = _body(joints, thorax_ratio)
    return bodies


def read_asf_size(path: Path) -> Skeleton:
    """The body of an ASF file.

    Raises:
        FormatError: for a file that is not ASF.
        RetargetError: for a skeleton of other bones than CMU's.
    """
    source = read_asf(path).skeleton
    return retarget(make_motion(source, np.zeros((1, source.size)), 120.0, path.stem)).skeleton


def thorax_ratio(bodies: Iterable[Skeleton]) -> float:
    """Mean length of the thorax by the mean of the two segments below it; of bodies that have their own."""
    ratios: list[float] = []
    for body in bodies:
        lower, upper, thorax = (
            float(np.linalg.norm(body.offsets[body.index(bone)])) for bone in ("chest", "upperChest", "neck")
        )
        ratios.append(2 * thorax / (lower + upper))
    return float(np.mean(ratios)) if ratios else _THORAX_RATIO


def distinct_bodies(bodies: Iterable[Skeleton]) -> list[Skeleton]:
    """The bodies without those that repeat an earlier one to within a millimetre; the thorax does not count."""
    kept: list[Skeleton] = []
    seen: list[Floats[Array, "joints 3"]] = []
    for body in bodies:
        vectors = size_vectors(body)[0].copy()
        vectors[[body.index(bone) for bone in ("neck", "leftShoulder", "rightShoulder")]] = 0.0
        if all(np.abs(vectors - other).max() > _SAME for other in seen):
            kept.append(body)
            seen.append(vectors)
    return kept


def training_bodies(table: Path, asf_files: Sequence[Path] = ()) -> list[Skeleton]:
    """The distinct bodies of a table and of ASF files; these also tell how long a thorax is."""
    from_asf = [read_asf_size(path) for path in asf_files]
    return distinct_bodies([*read_cmu_sizes(table, thorax_ratio(from_asf)).values(), *from_asf])


def _read_rows(path: Path) -> dict[str, dict[str, Floats[Array, "3"]]]:
    rows: dict[str, dict[str, Floats[Array, 3]]] = {}
    try:
        with reading(path, "a table of joints"):
            text = io.StringIO(read_bytes(path).decode("utf-8"), newline="")
            for line, row in enumerate(csv.DictReader(text), start=2):
                try:
                    place = METRES_PER_UNIT * np.array([float(row[axis]) for axis in "xyz"])
                    rows.setdefault(row["subject"], {})[row["joint"]] = place
                except (KeyError, TypeError, ValueError):
                    raise FormatError(
                        "this line is no joint of a skeleton",
                        remedy="Give subject,clip,joint,x,y,z under a line with these names",
                        file=path,
                        line=line,
                    ) from None
    except UnicodeDecodeError:
        raise FormatError("this is no table in UTF-8", remedy="Give a CSV file", file=path) from None
    if not rows:
        raise FormatError("the table is empty", remedy="Give one row a joint", file=path)
    return rows


def _body(joints: Mapping[str, Floats[Array, "3"]], thorax: float) -> Skeleton:
    body = average_body()

    def along(bone: str, *lengths: float) -> Floats[Array, "3"]:
        """The average body's bone vector at another length, the mean of those given."""
        vector = body.offsets[body.index(bone)]
        return np.asarray(vector * (np.mean(lengths) / np.linalg.norm(vector)))

    def length(joint: str) -> float:
        return float(np.linalg.norm(joints[joint]))

    def both(joint: str) -> Floats[Array, "3"]:
        return np.asarray(0.5 * (joints[f"Left{joint}"] + joints[f"Right{joint}"] * MIRROR))

    lost = thorax * 0.5 * (length("Spine") + length("Spine1"))
    places = {
        "chest": along("chest", length("Spine")),
        "upperChest": along("upperChest", length("Spine1")),
        "neck": along("neck", lost),
        "head": along("head", length("Neck1")),
        "leftShoulder": along("leftShoulder", lost),
        "leftUpperArm": both("Arm"),
        "leftUpperLeg": both("UpLeg"),
    }
    for bone, joint in _STRAIGHT.items():
        places[bone] = along(bone, length(f"Left{joint}"), length(f"Right{joint}"))
    places |= {bone.replace("left", "right"): place * MIRROR for bone, place in places.items() if "left" in bone}
    offsets, tips = body.offsets.copy(), body.tips.copy()
    for bone, place in places.items():
        offsets[body.index(bone)] = place
    # Head and toes end where their segments do; hands, whose rows are not sizes, grow with the forearm.
    head, toes = length("Head") + length("Head_end"), 0.5 * (length("LeftToeBase_end") + length("RightToeBase_end"))
    tips[body.index("head")] *= head / np.linalg.norm(tips[body.index("head")])
    forearm = np.linalg.norm(places["leftHand"]) / np.linalg.norm(body.offsets[body.index("leftHand")])
    for side in ("left", "right"):
        tips[body.index(f"{side}Hand")] *= forearm
        tips[body.index(f"{side}Toes")] *= toes / np.linalg.norm(tips[body.index(f"{side}Toes")])
    return body.with_offsets(offsets, tips)
