"""The table of motion file formats: a format is one file and one row here, or a row of another package."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from poseloom.errors import FormatError
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, settle
from poseloom.plugins import FORMATS_GROUP, Registry
from poseloom.skeleton.motion import Motion

HEAD = 4096
"""Bytes from a file's beginning by which a format is recognised."""

OPTIONS = {
    "skeleton": "skeleton",
    "metres_per_unit": "unit of length",
    "rate": "rate",
    "up": "up axis",
}
"""What may be said about a file that does not say it itself, and how people call it."""


@dataclass(frozen=True)
class ReadOptions:
    """What a user says about a file. Only what the format takes (`Format.takes`) can be there.

    Attributes:
        skeleton: The file that holds the skeleton; None where the reader looks for it.
        choices: Unit, up axis, rate and rest pose.
    """

    skeleton: Path | None = None
    choices: MotionChoices = NOTHING_SAID


NO_OPTIONS = ReadOptions()

Read = Callable[[Path, ReadOptions], Motion | Sequence[Motion]]
Write = Callable[[Motion, Path], None]


@dataclass(frozen=True)
class Format:
    """One kind of motion files. A row that is incomplete is refused when it is made.

    Attributes:
        name: What people call it, such as "BVH".
        suffixes: Suffixes of its files, in small letters, such as ".bvh".
        recognise: How likely a file with such a suffix is one of these, by its first `HEAD` bytes: 1 (or True) if it
            holds a motion, less if it has this form and perhaps no motion, 0 (or False) if it has another.
        read: Motions in metres, Y up; None where it is only written. Raises FormatError.
        write: Writes one motion, whole or not at all (`poseloom.formats.atomic`); None where it is only read.
        takes: Of `OPTIONS`; others are refused before `read` is called.

    Raises:
        TypeError: for a row that lacks something.
    """

    name: str
    suffixes: tuple[str, ...]
    recognise: Callable[[bytes], float]
    read: Read | None = None
    write: Write | None = None
    takes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        faults = {
            "no name": not self.name,
            "no suffixes of the form '.abc'": not self.suffixes
            or not all(suffix.startswith(".") and suffix == suffix.lower() for suffix in self.suffixes),
            "nothing that recognises its files": not callable(self.recognise),
            "neither reader nor writer": not (callable(self.read) or callable(self.write)),
            f"options that are none of {', '.join(OPTIONS)}": not set(self.takes) <= set(OPTIONS),
        }
        found = [fault for fault, there in faults.items() if there]
        if found:
            raise TypeError(f"the format {self.name!r} has {', '.join(found)}")

    def likelihood(self, head: bytes) -> float:
        """What `recognise` says, and 0 where it fails: one format must not keep the others from their files."""
        try:
            return float(self.recognise(head))
        except Exception:
            return 0.0


def _anything(head: bytes) -> float:
    """The suffix says enough: a damaged file is one still, so that reading it tells what is wrong."""
    return 1.0


def _is_npz(head: bytes) -> float:
    return 1.0 if head[:2] == b"PK" and b'"kind": "motion"' in head else 0.5


def _is_glb(head: bytes) -> float:
    return 1.0 if head[:4] == b"glTF" and b'"poseloom"' in head else 0.5


def _is_deepmimic(head: bytes) -> float:
    if not head.lstrip().startswith(b"{"):
        return 0.0
    return 1.0 if b'"Frames"' in head else 0.5


def _is_expmap(head: bytes) -> float:
    fields = head.split(b"\n")[0].split(b",")
    return 1.0 if len(fields) >= 6 and all(_is_number(field) for field in fields[:6]) else 0.1


def _is_number(field: bytes) -> bool:
    try:
        return isinstance(json.loads(field), int | float)
    except (ValueError, RecursionError):
        return False


# Readers and writers are imported when needed: a command that reads one kind should not wait for the others.


def _read_bvh(path: Path, options: ReadOptions) -> Motion:
    from poseloom.formats.bvh import read_bvh

    return read_bvh(path, choices=options.choices)


def _write_bvh(motion: Motion, path: Path) -> None:
    from poseloom.formats.bvh import write_bvh

    write_bvh(motion, path)


def _read_amc(path: Path, options: ReadOptions) -> Motion:
    from poseloom.formats.asf_amc import RATE, read_amc

    rate = options.choices.rate
    return read_amc(path, options.skeleton, RATE if rate is None else rate, options.choices)


def _read_expmap(path: Path, options: ReadOptions) -> Motion:
    from poseloom.formats.expmap_csv import read_expmap

    return read_expmap(path, options.skeleton, options.choices)


def _read_deepmimic(path: Path, options: ReadOptions) -> Motion:
    from poseloom.formats.deepmimic import read_deepmimic

    return settle(read_deepmimic(path).motion, path, options.choices, 1.0, "y")


def _read_npz(path: Path, options: ReadOptions) -> Motion:
    from poseloom.formats.npz import read_npz

    return settle(read_npz(path), path, options.choices, 1.0, "y")


def _write_npz(motion: Motion, path: Path) -> None:
    from poseloom.formats.npz import write_npz

    write_npz(motion, path)


def _read_glb(path: Path, options: ReadOptions) -> Motion:
    from poseloom.formats.glb_reading import read_glb

    return settle(read_glb(path), path, options.choices, 1.0, "y")


def _write_glb(motion: Motion, path: Path) -> None:
    from poseloom.formats.glb import write_glb

    write_glb(motion, path)


_ALL = tuple(OPTIONS)

FORMATS = Registry(
    FORMATS_GROUP,
    "motion file format",
    Format,
    {
        "bvh": Format("BVH", (".bvh",), _anything, _read_bvh, _write_bvh, ("metres_per_unit", "rate", "up")),
        "amc": Format("ASF/AMC", (".amc",), _anything, _read_amc, None, _ALL),
        "expmap": Format(
            "exponential-map CSV", (".txt", ".csv"), _is_expmap, _read_expmap, None,
            ("skeleton", "metres_per_unit", "up"),
        ),
        "deepmimic": Format(
            "DeepMimic JSON", (".json", ".txt", ".csv"), _is_deepmimic, _read_deepmimic, None, ("metres_per_unit", "up")
        ),
        "npz": Format("NPZ", (".npz",), _is_npz, _read_npz, _write_npz, ("up",)),
        "glb": Format("GLB", (".glb",), _is_glb, _read_glb, _write_glb, ("up",)),
    },
    FormatError,
)  # fmt: skip
"""Every format, poseloom's own first; other packages add theirs through `poseloom.formats`."""
