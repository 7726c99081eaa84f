"""From one source to poses of the average body at the library's rate."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats32
from poseloom.errors import PoseloomError
from poseloom.formats import drop_rest_frame, read_motions
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, check_human, one_line
from poseloom.library.catalogue import SkipKind, Skipped
from poseloom.library.sources import Source
from poseloom.library.store import file_digest
from poseloom.samples import sample_motions
from poseloom.skeleton.body import average_body
from poseloom.skeleton.families import recognise
from poseloom.skeleton.mirror import mirror_motion
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import resample
from poseloom.skeleton.retarget import retarget

SHORTEST_SECONDS = 0.2
"""Shorter motions are not taken: too short to have a velocity worth the name."""


@dataclass(frozen=True)
class Recipe:
    """How motions become clips.

    Attributes:
        rate: Frames a second of the library.
        mirror: Whether each clip's mirror image is added too.
        choices: What the user says of files that do not say it themselves.
    """

    rate: float
    mirror: bool
    choices: MotionChoices = NOTHING_SAID


@dataclass(frozen=True, eq=False)
class NewClip:
    """A clip before it has its place in the library.

    Attributes:
        name: The motion's own name if the file holds several, else empty.
        poses: Pose vectors of the average body.
        mirrored: Whether it is the mirror image.
        source_rate: Frames a second in the file.
        family: To which family of skeletons the file's belongs.
        conventions: How the file was understood, in a few words; empty for built-in motions.
    """

    name: str
    poses: Floats32[Array, "frames dofs"]
    mirrored: bool
    source_rate: float
    family: str
    conventions: str = ""


@dataclass(frozen=True, eq=False)
class Conversion:
    """What came of one source: clips, each followed by its mirror image, and what was left out."""

    digest: str
    clips: tuple[NewClip, ...]
    skipped: tuple[Skipped, ...]


def convert(source: Source, recipe: Recipe) -> Conversion:
    """Reads a source and makes its clips. What cannot be read becomes an entry among the skipped, no exception."""
    try:
        digest, motions = _read(source, recipe.choices)
    except MemoryError:
        raise
    except Exception as error:  # one bad file must not end a build of thousands; it is listed with its reason
        return Conversion("", (), (Skipped(source.name, SkipKind.UNREADABLE, _reason(error, source)),))
    clips: list[NewClip] = []
    skipped: list[Skipped] = []
    for motion in motions:
        name = motion.name if len(motions) > 1 else ""
        if len(motion) / motion.rate < SHORTEST_SECONDS:
            told = f"{len(motion)} frames at {motion.rate:g} Hz are shorter than {SHORTEST_SECONDS:g} s"
            skipped.append(Skipped(source.name, SkipKind.SHORT, f"{name}: {told}" if name else told))
            continue
        try:
            clips += _clips(motion, name, recipe)
        except MemoryError:
            raise
        except Exception as error:
            skipped.append(Skipped(source.name, SkipKind.UNREADABLE, _reason(error, source)))
    return Conversion(digest, tuple(clips), tuple(skipped))


def _read(source: Source, choices: MotionChoices) -> tuple[str, Sequence[Motion]]:
    if source.path is None:
        motion = sample_motions()[source.name.partition("/")[2]]
        return hashlib.sha256(motion.q.tobytes()).hexdigest(), [motion]
    motions = read_motions(source.path, skeleton=source.skeleton, choices=choices)
    for motion in motions:
        check_human(motion, source.path)
    return file_digest(source.path), [drop_rest_frame(motion) for motion in motions]


def _clips(motion: Motion, name: str, recipe: Recipe) -> list[NewClip]:
    family = recognise(motion.skeleton).name
    moved = resample(retarget(motion, average_body()), recipe.rate)
    told = one_line(moved.conventions) if moved.conventions else ""
    clips = [NewClip(name, moved.q.astype(np.float32), False, motion.rate, family, told)]
    if recipe.mirror:
        clips.append(NewClip(name, mirror_motion(moved).q.astype(np.float32), True, motion.rate, family, told))
    return clips


def _reason(error: Exception, source: Source) -> str:
    """What was wrong, without the path that the entry names already."""
    if isinstance(error, PoseloomError):
        about = Path(error.file).name if error.file and Path(error.file) != source.path else ""
        place = about if error.line is None else f"{about}:{error.line}" if about else f"line {error.line}"
        told = str(PoseloomError(error.fact, cause=error.cause, remedy=error.remedy))
        return f"{place}: {told}" if place else told
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return f"{type(error).__name__}: {error} (a defect of poseloom: please report it with the file)"
