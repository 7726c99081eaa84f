"""The indexes beside a library's poses: one folder for each way to describe moments, made when first needed."""

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from poseloom.arrays import Array, Floats32
from poseloom.library import folders, store
from poseloom.library.catalogue import Clip
from poseloom.library.features import FeatureSettings
from poseloom.library.index import MomentIndex, build_index, load_index, moment_rows
from poseloom.library.opened import OpenArray

_PREFIX = "moments-2-"
_REMEDY = "Delete its folder: it is made again when it is next needed"


def moments_folder(generation: Path, settings: FeatureSettings) -> Path:
    """Where the index for these features belongs."""
    return generation / f"{_PREFIX}{settings.digest()}"


def make_moments(
    generation: Path, poses: Floats32[Array, "poses dofs"], clips: Sequence[Clip], settings: FeatureSettings
) -> None:
    """Indexes a library's moments; the folder appears whole or not at all."""
    target = moments_folder(generation, settings)
    try:
        with folders.new_folder(target) as part:
            build_index(poses, clips, settings, part)
            store.write_seal(part)
    except OSError:
        if not target.is_dir():  # else another process was quicker
            raise


def open_moments(generation: Path, poses: OpenArray, clips: Sequence[Clip], settings: FeatureSettings) -> MomentIndex:
    """The index for these features; made now if there is none yet.

    Where nothing can be written, because the folder is read-only or full or was replaced since the library was opened,
    the index is made for this process alone. A search ends in a LibraryError once the poses' file is cut off.

    Raises:
        LibraryError: naming the damaged file of an index that is there, or where no clip is long enough.
    """
    target = moments_folder(generation, settings)
    if not target.is_dir() and generation.is_dir():
        with suppress(OSError):
            make_moments(generation, poses.values, clips, settings)
    rows = moment_rows(clips, settings.reach)
    if target.is_dir():
        store.check_seal(target, _REMEDY)
        return load_index(target, settings, rows, (poses,))
    with tempfile.TemporaryDirectory(prefix="poseloom-moments-", ignore_cleanup_errors=True) as scratch:
        build_index(poses.values, clips, settings, Path(scratch))
        return load_index(Path(scratch), settings, rows, (poses,))


def check_moments(generation: Path) -> None:
    """Digests all indexes in full. Raises LibraryError naming the first damaged file."""
    for folder in sorted(generation.glob("moments-*")):
        store.check_seal(folder, _REMEDY, full=True)
