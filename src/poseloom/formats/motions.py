"""Motion files of any known kind: which reader and writer serve which file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from poseloom.errors import FormatError
from poseloom.formats._files import beginning, reading
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices
from poseloom.formats.table import FORMATS, HEAD, NO_OPTIONS, OPTIONS, Format, ReadOptions
from poseloom.skeleton.motion import Motion


def motion_suffixes() -> tuple[str, ...]:
    """Suffixes of files that `read_motions` reads. Files with `.txt`, `.csv`, `.json`, `.npz` and `.glb` may hold other
    things too: `is_motion_file` looks inside."""
    return _suffixes([each for each in FORMATS.values() if each.read is not None])


def writable_suffixes() -> tuple[str, ...]:
    """Suffixes of files that `write_motion` writes."""
    return _suffixes([each for each in FORMATS.values() if each.write is not None])


def is_motion_file(path: Path) -> bool:
    """Whether a file is meant to hold a motion: by its suffix, and where that says too little by its beginning.

    A damaged motion file is one still, so that reading it tells what is wrong; a text of labels or a skeleton's JSON is
    none. Never raises.
    """
    formats = _formats(path)
    if not formats or not path.is_file():
        return False
    head = beginning(path, HEAD)
    return any(each.likelihood(head) >= 1.0 for each in formats if each.read is not None)


def read_motions(
    path: str | Path,
    skeleton: str | Path | None = None,
    *,
    metres_per_unit: float | None = None,
    rate: float | None = None,
    up: str | None = None,
    choices: MotionChoices = NOTHING_SAID,
) -> list[Motion]:
    """All motions of a file, in metres, Y up, named after the file. Nothing is dropped or smoothed.

    Args:
        path: A BVH, AMC, exponential-map, DeepMimic or NPZ file, a GLB file that poseloom wrote, or one of a format
            that an installed package adds.
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
    formats = [each for each in _formats(path) if each.read is not None]
    if not formats:
        alone = path.suffix.lower() == ".asf"
        raise FormatError(
            f"{_kind(path)} hold no motion that poseloom reads",
            cause="an ASF file holds a skeleton only" if alone else "",
            remedy="Name the AMC file that moves it" if alone else f"Use one of: {', '.join(motion_suffixes())}",
            file=path,
        )
    given = {"metres_per_unit": metres_per_unit, "rate": rate, "up": up}
    choices = replace(choices, **{name: value for name, value in given.items() if value is not None})
    return read_as(_likeliest(formats, path), path, ReadOptions(None if skeleton is None else Path(skeleton), choices))


def read_as(kind: Format, path: Path, options: ReadOptions = NO_OPTIONS) -> list[Motion]:
    """All motions of a file of a known format.

    Raises:
        FormatError: for a damaged file, or an option that has no meaning for this format.
        SkeletonError: for an impossible hierarchy.
    """
    if kind.read is None:
        raise FormatError(f"poseloom writes {kind.name} and does not read it", file=path)
    given = {name: getattr(options.choices, name) for name in OPTIONS if name != "skeleton"}
    for name, value in {"skeleton": options.skeleton, **given}.items():
        if value is not None and name not in kind.takes:  # it must not be ignored in silence
            raise FormatError(
                f"a {OPTIONS[name]} was given, but files of kind {path.suffix.lower()} state their own",
                remedy=f"Leave the {OPTIONS[name]} out",
                file=path,
            )
    with reading(path):
        made = kind.read(path, options)
        return [made] if isinstance(made, Motion) else list(made)


def read_motion(
    path: str | Path,
    skeleton: str | Path | None = None,
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


def write_motion(motion: Motion, path: str | Path) -> None:
    """Writes a motion as its file's suffix says (BVH, GLB, NPZ, or what a package adds), whole or not at all.

    Raises:
        FormatError: for another suffix, or where nothing can be written there.
    """
    path = Path(path)
    writer = next((each.write for each in _formats(path) if each.write is not None), None)
    if writer is None:
        raise FormatError(
            f"poseloom does not write {_kind(path)}",
            remedy=f"Use one of: {', '.join(writable_suffixes())}",
            file=path,
        )
    writer(motion, path)


def format_name(path: Path) -> str:
    """What a person calls the kind of a motion file; empty where it is unknown."""
    formats = _formats(path)
    return _likeliest(formats, path).name if formats else ""


def _formats(path: Path) -> list[Format]:
    """Formats of a file's suffix, poseloom's own first."""
    suffix = path.suffix.lower()
    return [each for each in FORMATS.values() if suffix in each.suffixes]


def _likeliest(formats: Sequence[Format], path: Path) -> Format:
    """The format that a file has by its beginning; of equally likely ones the first."""
    if len(formats) == 1:
        return formats[0]
    head = beginning(path, HEAD)
    return max(formats, key=lambda each: each.likelihood(head))


def _suffixes(formats: Sequence[Format]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(suffix for each in formats for suffix in each.suffixes))


def _kind(path: Path) -> str:
    return f"files of kind {path.suffix.lower()}" if path.suffix else "files without suffix"
