"""Motion files of any known kind: which reader and writer serve which file."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from poseloom.errors import FormatError
from poseloom.formats._files import beginning, read_bytes, reading
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, settle
from poseloom.skeleton.motion import Motion

_HEAD = 4096


@dataclass(frozen=True)
class _Options:
    """What some kinds of files do not say themselves; see `read_motions`."""

    skeleton: Path | None
    choices: MotionChoices


def motion_suffixes() -> tuple[str, ...]:
    """Suffixes of files that `read_motions` reads. Files with `.txt`, `.csv`, `.json` and `.npz` may hold other things
    too: `is_motion_file` looks inside."""
    return tuple(_READERS)


def writable_suffixes() -> tuple[str, ...]:
    """Suffixes of files that `write_motion` writes."""
    return tuple(_WRITERS)


def is_motion_file(path: Path) -> bool:
    """Whether a file is meant to hold a motion: by its suffix, and where that says too little by its beginning.

    A damaged motion file is one still, so that reading it tells what is wrong; a text of labels or a skeleton's JSON is
    none. Never raises.
    """
    suffix = path.suffix.lower()
    if suffix in (".bvh", ".amc"):
        return path.is_file()
    head = beginning(path, _HEAD)
    if suffix == ".npz":
        return head[:2] == b"PK" and b'"kind": "motion"' in head
    if suffix in (".txt", ".json") and head.lstrip().startswith(b"{"):
        return b'"Frames"' in head
    if suffix in (".txt", ".csv"):
        fields = head.split(b"\n")[0].split(b",")
        return len(fields) >= 6 and all(_is_number(field) for field in fields[:6])
    return False


def read_motions(
    path: Path,
    skeleton: Path | None = None,
    *,
    metres_per_unit: float | None = None,
    rate: float | None = None,
    up: str | None = None,
    choices: MotionChoices = NOTHING_SAID,
) -> list[Motion]:
    """All motions of a file, in metres, Y up, named after the file. Nothing is dropped or smoothed.

    Args:
        path: A BVH, AMC, exponential-map, DeepMimic or NPZ file.
        skeleton: The file that holds the skeleton, for the kinds that keep it apart (AMC, exponential maps), where it
            does not stand beside the motion.
        metres_per_unit: The file's unit of length, where what it states or what the body's size tells would be wrong.
        rate: Frames a second, where a BVH file's frame time is impossible or an AMC file's are not 120.
        up: The axis that points up (x, y, z, -x, -y or -z), where rest pose and motion would tell it wrong.
        choices: All of these at once.

    Raises:
        FormatError: for a file of an unknown kind, a damaged one, one whose skeleton is missing, a folder, or an
            argument that has no meaning for this kind.
        SkeletonError: for an impossible hierarchy.
    """
    path = Path(path)
    if path.is_dir():
        raise FormatError("this is a folder, not a file", remedy="Name one motion file in it", file=path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        alone = path.suffix.lower() == ".asf"
        raise FormatError(
            f"{_kind(path)} hold no motion that poseloom reads",
            cause="an ASF file holds a skeleton only" if alone else "",
            remedy="Name the AMC file that moves it" if alone else f"Use one of: {', '.join(_READERS)}",
            file=path,
        )
    given = {"metres_per_unit": metres_per_unit, "rate": rate, "up": up}
    choices = replace(choices, **{name: value for name, value in given.items() if value is not None})
    with reading(path):
        return [reader(path, _Options(skeleton, choices))]


def read_motion(
    path: Path,
    skeleton: Path | None = None,
    *,
    metres_per_unit: float | None = None,
    rate: float | None = None,
    up: str | None = None,
    choices: MotionChoices = NOTHING_SAID,
) -> Motion:
    """The one motion of a file; see `read_motions`.

    Raises:
        FormatError: also where there are several.
    """
    motions = read_motions(path, skeleton, metres_per_unit=metres_per_unit, rate=rate, up=up, choices=choices)
    if len(motions) != 1:
        raise FormatError(
            f"this file holds {len(motions)} motions, not one", remedy="Use a file with one motion", file=path
        )
    return motions[0]


def write_motion(motion: Motion, path: Path) -> None:
    """Writes a motion as its file's suffix says (BVH, GLB or NPZ), whole or not at all.

    Raises:
        FormatError: for another suffix, or where nothing can be written there.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FormatError(
            f"poseloom does not write {_kind(path)}",
            remedy=f"Use one of: {', '.join(_WRITERS)}",
            file=path,
        )
    writer(motion, path)


def format_name(path: Path) -> str:
    """What a person calls the kind of a motion file; empty where it is unknown."""
    suffix = path.suffix.lower()
    if suffix in (".txt", ".csv", ".json"):
        return "DeepMimic JSON" if _is_json(path) else "exponential-map CSV"
    return {".bvh": "BVH", ".amc": "ASF/AMC", ".npz": "NPZ", ".glb": "GLB"}.get(suffix, "")


def _kind(path: Path) -> str:
    return f"files of kind {path.suffix.lower()}" if path.suffix else "files without suffix"


def _is_json(path: Path) -> bool:
    return path.suffix.lower() == ".json" or read_bytes(path)[:_HEAD].lstrip().startswith(b"{")


def _is_number(field: bytes) -> bool:
    try:
        return isinstance(json.loads(field), int | float)
    except (ValueError, RecursionError):
        return False


# Readers and writers are imported when needed: a command that reads one kind should not wait for the others.


def _read_bvh(path: Path, options: _Options) -> Motion:
    from poseloom.formats.bvh import read_bvh

    _refuse(path, skeleton=options.skeleton)
    return read_bvh(path, choices=options.choices)


def _read_amc(path: Path, options: _Options) -> Motion:
    from poseloom.formats.asf_amc import RATE, read_amc

    rate = options.choices.rate
    return read_amc(path, options.skeleton, RATE if rate is None else rate, options.choices)


def _read_table(path: Path, options: _Options) -> Motion:
    _refuse(path, rate=options.choices.rate)
    if _is_json(path):
        from poseloom.formats.deepmimic import read_deepmimic

        _refuse(path, skeleton=options.skeleton)
        return settle(read_deepmimic(path).motion, path, options.choices, 1.0, "y")
    from poseloom.formats.expmap_csv import read_expmap

    return read_expmap(path, options.skeleton, options.choices)


def _read_npz(path: Path, options: _Options) -> Motion:
    from poseloom.formats.npz import read_npz

    choices = options.choices
    _refuse(path, skeleton=options.skeleton, metres_per_unit=choices.metres_per_unit, rate=choices.rate)
    return settle(read_npz(path), path, choices, 1.0, "y")


def _refuse(path: Path, **given: object) -> None:
    """Raises where something was given that files of this kind say themselves: it must not be ignored in silence."""
    words = {"skeleton": "skeleton", "metres_per_unit": "unit of length", "rate": "rate"}
    for name, value in given.items():
        if value is not None:
            raise FormatError(
                f"a {words[name]} was given, but files of kind {path.suffix.lower()} state their own",
                remedy=f"Leave the {words[name]} out",
                file=path,
            )


def _write_bvh(motion: Motion, path: Path) -> None:
    from poseloom.formats.bvh import write_bvh

    write_bvh(motion, path)


def _write_glb(motion: Motion, path: Path) -> None:
    from poseloom.formats.glb import write_glb

    write_glb(motion, path)


def _write_npz(motion: Motion, path: Path) -> None:
    from poseloom.formats.npz import write_npz

    write_npz(motion, path)


_READERS: dict[str, Callable[[Path, _Options], Motion]] = {
    ".bvh": _read_bvh,
    ".amc": _read_amc,
    ".txt": _read_table,
    ".csv": _read_table,
    ".json": _read_table,
    ".npz": _read_npz,
}
_WRITERS: dict[str, Callable[[Motion, Path], None]] = {".bvh": _write_bvh, ".glb": _write_glb, ".npz": _write_npz}
