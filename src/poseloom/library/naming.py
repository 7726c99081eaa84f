"""Who moves and what happens, as far as file names tell: each family of recordings has its own habit."""

import re
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import NamedTuple


class Description(NamedTuple):
    """What a name says.

    Attributes:
        subject: Who moves; the family's name stands in where the person is not known.
        tags: Words for what happens.
    """

    subject: str
    tags: tuple[str, ...]


# What the CMU Graphics Lab Motion Capture Database says of its subjects and, where a subject does many things, trials.
_CMU_TAGS: Mapping[str, str] = {
    "01": "playground climb swing jump",
    "02_01": "walk",
    "02_02": "walk",
    "02_03": "run jog",
    "02_04": "jump balance",
    "02_05": "punch strike",
    "02_06": "bend scoop rise lift arm",
    "02_07": "swordplay",
    "02_08": "swordplay",
    "02_09": "swordplay",
    "02_10": "wash self",
    "05": "modern dance",
    "06": "basketball",
    "10": "kick soccer",
    "11": "walk",
    "13": "exercise",
    "14": "exercise",
    "16_15": "walk",
    "35": "walk",
    "131": "start walk stop hop",
}

_CMU = re.compile(r"(\d{2,3})_(\d{2})")
_HDM05 = re.compile(r"HDM_([a-z]{2})_(.+?)(?:_\d+)*", re.IGNORECASE)
_BANDAI = re.compile(r"dataset-(\d+)_([^_]+)_([^_]+)_\d+", re.IGNORECASE)
_DEEPMIMIC = re.compile(r"humanoid3d_(.+)", re.IGNORECASE)
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_NO_ACTION = frozenset({"reps", "rep", "start", "steps", "hops", "short", "long", "and", "the", "of", "mirror"})


def describe(source: str, exponential_maps: bool = False) -> Description:
    """Subject and tags from a source's name.

    Args:
        source: Path with forward slashes, from the name of the given folder on.
        exponential_maps: Whether the file is one of exponential maps (clips of many people, by action, unnamed).
    """
    path = PurePosixPath(source)
    stem = path.stem
    if path.parts[0] == "samples" and path.suffix == "":
        return Description("deepmimic", words(stem))  # the built-in motions are DeepMimic's
    if match := _CMU.fullmatch(stem):
        subject, trial = int(match[1]), int(match[2])
        known = _CMU_TAGS.get(f"{subject:02d}_{trial:02d}", _CMU_TAGS.get(f"{subject:02d}", ""))
        return Description(f"cmu{subject:02d}", tuple(known.split()))
    if match := _HDM05.fullmatch(stem):
        return Description(f"hdm05:{match[1].lower()}", words(match[2]))
    if match := _BANDAI.fullmatch(stem):
        return Description(f"bandai{match[1]}", (*words(match[2]), *words(match[3])))
    if match := _DEEPMIMIC.fullmatch(stem):
        return Description("deepmimic", words(match[1]))
    if exponential_maps:
        action = path.parent.name
        return Description(f"cmu_expmap:{action}", words(action))
    return Description(path.parent.name or stem, words(stem))


def words(text: str) -> tuple[str, ...]:
    """Words of a name in camel case or with separators, lower case, each once; no numbers or single letters."""
    found = (word.lower() for word in _WORD.findall(text))
    return tuple(dict.fromkeys(word for word in found if len(word) > 1 and word not in _NO_ACTION))
