"""A motion library, opened."""

from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseloom.arrays import Array, Bools, Floats32
from poseloom.errors import LibraryError, unknown_name
from poseloom.library import store
from poseloom.library.catalogue import CATALOGUE_FILE, Clip, Skipped, read_catalogue
from poseloom.library.features import FeatureSettings
from poseloom.library.index import MomentIndex
from poseloom.library.moments import check_moments, open_moments
from poseloom.library.opened import OpenArray
from poseloom.library.poses import POSES_FILE, body_digest, open_poses
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton

_TRIES = 5


@dataclass(frozen=True, eq=False)
class MotionLibrary:
    """Poses of many motions, all on the average body and at one rate. Open one with `open_library`.

    Attributes:
        path: Its folder.
        rate: Frames a second.
        poses: Pose vectors, in memory and read only; the rows of a clip follow each other in time.
        clips: What the rows are, in their order.
        skipped: What could not be taken in, with reasons.
        mirror: Whether it holds mirror images.
        digest: SHA-256 of the poses, for tables of results.
        history: How it was built and added to.
        allowed: Mask over the poses, False for those that a method must not use; None: all may be used.
    """

    path: Path
    rate: float
    poses: Floats32[Array, "poses dofs"]
    clips: tuple[Clip, ...]
    skipped: tuple[Skipped, ...]
    mirror: bool
    digest: str
    history: tuple[Mapping[str, Any], ...]
    _generation: Path
    _opened: OpenArray = field(repr=False)
    allowed: Bools[Array, "poses"] | None = None
    _indexes: dict[FeatureSettings, MomentIndex] = field(default_factory=dict[FeatureSettings, MomentIndex], repr=False)

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def skeleton(self) -> Skeleton:
        """The body that all poses belong to."""
        return average_body()

    def clip(self, name: str) -> Clip:
        """The clip of this name. Raises LibraryError, with the nearest name, for an unknown one."""
        for clip in self.clips:
            if clip.name == name:
                return clip
        raise unknown_name("clip", name, [clip.name for clip in self.clips], LibraryError)

    def clip_of(self, row: int) -> Clip:
        """The clip that a row of the poses belongs to. Raises IndexError for a row that is not there."""
        if not 0 <= row < len(self.poses):
            raise IndexError(f"row {row} of {len(self.poses)}")
        return self.clips[bisect_right(self.clips, row, key=lambda clip: clip.start) - 1]

    def motion(self, clip: Clip) -> Motion:
        """A clip as a motion of the average body."""
        return make_motion(self.skeleton, self.poses[clip.rows].astype(np.float64), self.rate, clip.name)

    def find(self, text: str) -> tuple[Clip, ...]:
        """Clips whose name, subject, tags, take or source contain every word of a text, capitals or not."""
        words = text.lower().split()

        def haystack(clip: Clip) -> str:
            return " ".join((clip.name, clip.subject, clip.take, clip.source, *clip.tags)).lower()

        return tuple(clip for clip in self.clips if all(word in haystack(clip) for word in words))

    def rows_excluding(self, takes: Iterable[str] = (), subjects: Iterable[str] = ()) -> Bools[Array, "poses"]:
        """Mask over the poses, False for those that an evaluation must not see.

        Args:
            takes: Takes to leave out: with their mirror images and all copies.
            subjects: People to leave out: with every take that one of them is known to be in.

        Raises:
            LibraryError: for a take or subject that no clip has.
        """
        out_takes, out_subjects = set(takes), set(subjects)
        self._require("take", out_takes, {clip.take for clip in self.clips})
        self._require("subject", out_subjects, {clip.subject for clip in self.clips})
        out_takes |= {clip.take for clip in self.clips if clip.subject in out_subjects}
        mask = np.ones(len(self.poses), dtype=np.bool_)
        for clip in self.clips:
            if clip.take in out_takes:
                mask[clip.rows] = False
        return mask

    def restricted(self, allowed: Bools[Array, "poses"] | None) -> "MotionLibrary":
        """The same library, of whose poses a method may use only the allowed ones; None: all."""
        return replace(self, allowed=allowed)

    def moments(self, settings: FeatureSettings) -> MomentIndex:
        """The searchable moments, described by these features; indexed on first request, then kept beside the poses.

        Raises:
            LibraryError: if no clip is long enough to have a moment, or the index is damaged.
        """
        if settings not in self._indexes:
            self._indexes[settings] = open_moments(self._generation, self._opened, self.clips, settings)
        return self._indexes[settings]

    @staticmethod
    def _require(what: str, wanted: set[str], valid: set[str]) -> None:
        for name in sorted(wanted - valid):
            raise unknown_name(what, name, sorted(valid), LibraryError)


def open_library(folder: str | Path, verify: bool = False) -> MotionLibrary:
    """Opens a motion library and checks that it is whole.

    Sizes, the header and the catalogue are checked in full; of files above 128 MiB blocks spread over them are
    digested, smaller files wholly. What is opened stays as it is, even if another process adds to the library.

    Args:
        folder: The library.
        verify: Digest every byte, indexes included.

    Raises:
        LibraryError: if there is none, it is of another version or another body, or a file was changed or damaged.
    """
    path = Path(folder)
    for _ in range(_TRIES):
        header = store.read_header(path)
        try:
            return _open(path, header, verify)
        except (LibraryError, FileNotFoundError):
            # Another process may have put a new generation in place since the header was read; if not, it is damage.
            if store.read_header(path).generation == header.generation:
                raise
    raise LibraryError("the library is replaced faster than it can be opened", remedy="Try again later", file=path)


def _open(path: Path, header: store.Header, verify: bool) -> MotionLibrary:
    if header.body != body_digest():
        raise LibraryError(
            "this library holds poses of another body than this poseloom's",
            remedy="Build the library again with this poseloom",
            file=path,
        )
    generation = path / header.generation
    store.check_files(generation, header.files, full=verify)
    if verify:
        check_moments(generation)
    poses = open_poses(generation / POSES_FILE)
    clips, skipped = read_catalogue(generation / CATALOGUE_FILE)
    if (
        len(poses.values) != header.poses
        or len(clips) != header.clips
        or [clip.id for clip in clips] != list(range(len(clips)))
        or [clip.start for clip in clips] != [0, *(clip.stop for clip in clips)][:-1]
        or any(clip.start >= clip.stop for clip in clips)
        or (clips[-1].stop if clips else 0) != header.poses
    ):
        raise LibraryError(
            f"the header tells of {header.poses} poses and {header.clips} clips, "
            f"but there are {len(poses.values)} poses and {len(clips)} clips, or these do not follow each other",
            remedy=store.REBUILD,
            file=path,
        )
    digest = next((file.sha256 for file in header.files if file.name == POSES_FILE), None)
    if digest is None:
        raise LibraryError("the header lists no file of poses", remedy=store.REBUILD, file=path)
    return MotionLibrary(
        path, header.rate, poses.values, clips, skipped, header.mirror, digest, header.history, generation, poses
    )
