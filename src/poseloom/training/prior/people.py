"""Which people the prior learns from, which it is chosen by and which it is measured on: a split by person."""

import enum
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import PoseloomError
from poseloom.library.sources import Selection, Source, find_sources

FOLDERS: tuple[str, ...] = (
    "mocap/cmu_asfamc", "mocap/cmu_bvh", "mocap/hdm05",
    "people/cmu_asfamc2", "people/cmu_bvh2", "people/cmu_rhymes",
)  # fmt: skip
"""Folders of recordings. CMU's exponential maps stay out: they hold nameless parts of people who are left out."""


_SKELETONS: tuple[tuple[str, str], ...] = (
    ("cmu_asfamc/13", "people/cmu_asfamc2/13/13.asf"),
    ("cmu_asfamc/14", "people/cmu_asfamc2/14/14.asf"),
    ("cmu_asfamc2/91", "mocap/cmu_asfamc/35/35.asf"),
)
"""Skeletons of recordings that come without one. Subject 91's own is not to be had: they wear subject 35's."""


class Role(enum.StrEnum):
    """What a person's motions serve for."""

    TRAIN = "train"
    VALIDATE = "validate"
    TEST = "test"
    UNUSED = "unused"


LEFT_OUT: Mapping[str, Role] = {
    "cmu02": Role.TEST,
    "cmu13": Role.TEST,
    "cmu35": Role.TEST,
    "hdm05:bd": Role.TEST,
    "cmu14": Role.VALIDATE,
    "hdm05:mm": Role.VALIDATE,
}
"""People who are not trained on."""

_WEIGHTS: Mapping[str, float] = {"cmu29": 0.5, "cmu14": 0.6, "cmu01": 0.6}
"""People who are drawn less often than the root of their frames says: much of one kind, or climbing and swinging."""


def role_of(person: str) -> Role:
    """A person's role: every CMU person who is not left out trains, nobody of another laboratory does."""
    if person in LEFT_OUT:
        return LEFT_OUT[person]
    return Role.TRAIN if re.fullmatch(r"cmu\d+", person) else Role.UNUSED


def person_sources(data: Path) -> dict[str, tuple[Source, ...]]:
    """Recordings by person, in a fixed order; a trial that stands in two folders is taken once.

    Args:
        data: The folder of recordings.

    Raises:
        PoseloomError: if the folder lacks one of `FOLDERS`.
    """
    missing = [name for name in FOLDERS if not (data / name).is_dir()]
    if missing:
        raise PoseloomError(
            f"{data} has no folder {missing[0]}", remedy="Name the folder that holds mocap/ and people/", file=data
        )
    skeletons = tuple((pattern, data / name) for pattern, name in _SKELETONS)
    found = find_sources([data / name for name in FOLDERS], Selection(skeletons=skeletons))
    people: dict[str, dict[str, Source]] = {}
    for source in found.sources:
        trial = Path(source.name).stem
        people.setdefault(source.subject, {}).setdefault(trial, source)
    return {person: tuple(people[person].values()) for person in sorted(people)}


def person_weights(frames: Mapping[str, int]) -> Floats[Array, "people"]:
    """How often each person is drawn: by the root of their frames, those of whom there is most less often.

    Args:
        frames: Frames by person.
    """
    raw = np.array([_WEIGHTS.get(person, 1.0) * np.sqrt(count) for person, count in frames.items()])
    return raw / raw.sum()


def check_split(trained: Sequence[str]) -> None:
    """Refuses to train on people who are left out.

    Raises:
        PoseloomError: naming them.
    """
    wrong = [person for person in trained if role_of(person) is not Role.TRAIN]
    if wrong:
        raise PoseloomError(
            f"{', '.join(wrong)} would be trained on",
            cause="they are left out for validation or test, or their licence forbids it",
            remedy="Take them out of the training part",
        )
