"""What of a library a method may not see when a sequence is evaluated: the sequence itself, in whatever guise."""

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Bools, Floats32
from poseloom.errors import PoseloomError, unknown_name
from poseloom.evaluation.cases import Case, TooShort
from poseloom.library import MotionLibrary
from poseloom.library.postures import postures
from poseloom.library.takes import CopyCriteria, CopyFinder
from poseloom.skeleton.body import average_body
from poseloom.skeleton.resample import resample
from poseloom.skeleton.retarget import retarget

_LEAST_WINDOWS = 1.1
"""Lengths of a compared window that a motion must have: windows are rounded to whole frames."""
_MOST_PEOPLE = 8
"""People of a library that an error names."""


class Split(enum.StrEnum):
    """How much of the library is left out."""

    BY_SEQUENCE = "by-sequence"
    BY_SUBJECT = "by-subject"
    NONE = "none"


@dataclass(frozen=True)
class LeftOut:
    """What a method may not see.

    Attributes:
        takes: Takes of the library, with all their clips.
        poses: How many poses those have.
    """

    takes: tuple[str, ...] = ()
    poses: int = 0


def split_named(name: str) -> Split:
    """The split of this name. Raises PoseloomError, with the valid names, for an unknown one."""
    if name not in set(Split):
        raise unknown_name("split", name, list(Split))
    return Split(name)


def left_out(
    library: MotionLibrary,
    cases: Sequence[Case],
    split: Split,
    progress: Callable[[int, int], object] | None = None,
) -> tuple[LeftOut, ...]:
    """For each case the takes of the library that the split forbids.

    A case that comes from a file of the library belongs to that file's take; of any other, the takes of all clips that
    share movement with it (see `library.takes`). With a take go its mirror images, its copies in other formats and its
    overlapping cuts. `by-subject` forbids all takes of those people too.

    Args:
        library: The library.
        cases: What is to be evaluated.
        split: How much is left out.
        progress: Told how many of how many are done.

    Raises:
        TooShort: for a case of an unknown file that is too short to be compared.
        PoseloomError: for a case of nobody knows whom, where all takes of a person are to be left out.
    """
    if split is Split.NONE:
        return tuple(LeftOut() for _ in cases)
    takes_of_file: dict[str, set[str]] = {}
    for clip in library.clips:
        takes_of_file.setdefault(clip.digest, set()).add(clip.take)
    unknown = [case for case in cases if case.digest not in takes_of_file]
    finder = CopyFinder(library.poses, library.clips, library.rate) if unknown else None
    found: list[LeftOut] = []
    for done, case in enumerate(cases, 1):
        takes = set(takes_of_file.get(case.digest, ()))
        if finder is not None and not takes:
            takes = {finder.clips[index].take for index in finder.holders(_places(case, library), family=case.family)}
        if split is Split.BY_SUBJECT and not takes and not case.subject:
            raise PoseloomError(
                f"nobody says who moves in {case.name!r}, so that no take of that person can be left out",
                cause="the recording names no subject, and the library holds no copy of its movement",
                remedy=f"Name the person with --subject, as the library does ({_people(library)}), "
                "or choose --split by-sequence",
            )
        found.append(_forbidden(library, takes, case.subject, split))
        if progress is not None:
            progress(done, len(cases))
    return tuple(found)


def allowed_poses(library: MotionLibrary, forbidden: LeftOut) -> Bools[Array, "poses"] | None:
    """Mask over the library's poses, False for those left out; None where all are allowed."""
    return library.rows_excluding(forbidden.takes) if forbidden.takes else None


def _places(case: Case, library: MotionLibrary) -> Floats32[Array, "poses coordinates"]:
    if case.truth.duration < _LEAST_WINDOWS * CopyCriteria().seconds:
        raise TooShort(
            f"{case.name!r} is too short to tell whether the library holds it",
            cause=f"it lasts {case.truth.duration:.2f} s, and movement is compared over {CopyCriteria().seconds:g} s",
            remedy="Give the file that the library was built from, a longer motion, or --split none",
        )
    on_average = resample(retarget(case.truth, average_body()), library.rate)
    return postures(on_average.q.astype(np.float32))


def findable(case: Case, library: MotionLibrary) -> bool:
    """Whether it can be told which takes of a library a case belongs to."""
    known = any(clip.digest == case.digest for clip in library.clips)
    return known or case.truth.duration >= _LEAST_WINDOWS * CopyCriteria().seconds


def _people(library: MotionLibrary) -> str:
    people = sorted({clip.subject for clip in library.clips})
    return ", ".join(people[:_MOST_PEOPLE]) + (" ..." if len(people) > _MOST_PEOPLE else "")


def _forbidden(library: MotionLibrary, takes: set[str], subject: str, split: Split) -> LeftOut:
    chosen = set(takes)
    if split is Split.BY_SUBJECT:
        people = {clip.subject for clip in library.clips if clip.take in takes} | {subject}
        chosen |= {clip.take for clip in library.clips if clip.subject in people}
    poses = sum(len(clip) for clip in library.clips if clip.take in chosen)
    return LeftOut(tuple(sorted(chosen)), poses)
