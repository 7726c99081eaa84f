"""Motion files of any known kind: which reader and writer serve which file."""

import json
from collections.abc import Callable
from pathlib import Path

from poseloom.errors import FormatError
from poseloom.formats._files import read_bytes
from poseloom.skeleton.motion import Motion

_HEAD = 4096


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
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    if suffix == ".npz":
        return head[:2] == b"PK" and b'"kind": "motion"' in head
    if suffix in (".txt", ".json") and head.lstrip().startswith(b"{"):
        return b'"Frames"' in head
    if suffix in (".txt", ".csv"):
        fields = head.split(b"\n")[0].split(b",")
        return len(fields) >= 6 and all(_is_number(field) for field in fields[:6])
    return False


def read_motions(path: Path, skeleton: Path | None = None) -> list[Motion]:
    """All motions of a file, in metres, Y up, named after the file. Nothing is dropped or smoothed.

    Args:
        path: A BVH, AMC, exponential-map, DeepMimic or NPZ file.
        skeleton: The file that holds the skeleton, for the kinds that keep it apart (AMC, exponential maps), where it
            does not stand beside the motion.

    Raises:
        FormatError: for a file of an unknown kind, a damaged one, or one whose skeleton is missing.
        SkeletonError: for an impossible hierarchy.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FormatError(
            f"files of kind {path.suffix.lower() or 'without suffix'} hold no motion that poseloom reads",
            cause="a skeleton needs its motion" if path.suffix.lower() == ".asf" else "",
            remedy="Name the .amc file" if path.suffix.lower() == ".asf" else f"Use one of: {', '.join(_READERS)}",
            file=path,
        )
    return [reader(path, skeleton)]


def read_motion(path: Path, skeleton: Path | None = None) -> Motion:
    """The one motion of a file; see `read_motions`.

    Raises:
        FormatError: also where there are several.
    """
    motions = read_motions(path, skeleton)
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
            f"poseloom does not write files of kind {path.suffix.lower() or 'without suffix'}",
            remedy=f"Use one of: {', '.join(_WRITERS)}",
            file=path,
        )
    writer(motion, path)


def format_name(path: Path) -> str:
    """What a person calls the kind of a motion file; empty where it is unknown."""
    suffix = path.suffix.lower()
    if suffix in (".txt", ".csv", ".json"):
        return "DeepMimic JSON" if _is_json(path) else "exponential maps"
    return {".bvh": "BVH", ".amc": "ASF/AMC", ".npz": "NPZ", ".glb": "GLB"}.get(suffix, "")


def _is_json(path: Path) -> bool:
    return read_bytes(path)[:_HEAD].lstrip().startswith(b"{")


def _is_number(field: bytes) -> bool:
    try:
        json.loads(field)
    except ValueError:
        return False
    return True


# Readers and writers are imported when needed: a command that reads one kind should not wait for the others.


def _read_bvh(path: Path, skeleton: Path | None) -> Motion:
    from poseloom.formats.bvh import read_bvh

    _refuse(path, skeleton)
    return read_bvh(path)


def _read_amc(path: Path, skeleton: Path | None) -> Motion:
    from poseloom.formats.asf_amc import read_amc

    return read_amc(path, skeleton)


def _read_table(path: Path, skeleton: Path | None) -> Motion:
    if _is_json(path):
        from poseloom.formats.deepmimic import read_deepmimic

        _refuse(path, skeleton)
        return read_deepmimic(path).motion
    from poseloom.formats.expmap_csv import read_expmap

    return read_expmap(path, skeleton)


def _read_npz(path: Path, skeleton: Path | None) -> Motion:
    from poseloom.formats.npz import read_npz

    _refuse(path, skeleton)
    return read_npz(path)


def _refuse(path: Path, skeleton: Path | None) -> None:
    if skeleton is not None:
        raise FormatError("this file holds its own skeleton", remedy=f"Leave out {skeleton.name}", file=path)


def _write_bvh(motion: Motion, path: Path) -> None:
    from poseloom.formats.bvh import write_bvh

    write_bvh(motion, path)


def _write_glb(motion: Motion, path: Path) -> None:
    from poseloom.formats.glb import write_glb

    write_glb(motion, path)


def _write_npz(motion: Motion, path: Path) -> None:
    from poseloom.formats.npz import write_npz

    write_npz(motion, path)


_READERS: dict[str, Callable[[Path, Path | None], Motion]] = {
    ".bvh": _read_bvh,
    ".amc": _read_amc,
    ".txt": _read_table,
    ".csv": _read_table,
    ".json": _read_table,
    ".npz": _read_npz,
}
_WRITERS: dict[str, Callable[[Motion, Path], None]] = {".bvh": _write_bvh, ".glb": _write_glb, ".npz": _write_npz}
