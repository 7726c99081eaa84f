"""Motions as arrays on disk: one file a person, made in a fixed order, kept when a killed run begins again."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.errors import FormatError
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.library.catalogue import SkipKind
from poseloom.library.conversion import Recipe, convert
from poseloom.library.sources import Source
from poseloom.methods.prior.channels import RATE
from poseloom.skeleton.body import average_body
from poseloom.skeleton.contacts import contacts, floor_height
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.training.prior.people import person_sources

KIND = "prior-shard"
VERSION = 2

_FASTEST = 20.0
"""Metres a second, relative to the hips, above which a joint jumps rather than moves: the capture's fault."""
_SHORTEST = 0.5
"""Seconds of the shortest piece that is kept."""


@dataclass(frozen=True, eq=False)
class Shard:
    """All motions of one person, on the average body at `RATE`.

    Attributes:
        person: Who.
        q: Pose vectors, the floor at height 0.
        contacts: 1 where left heel, left toe, right heel, right toe stand on the floor.
        bounds: Frames from which and up to which each clip goes.
        names: Each clip's source.
    """

    person: str
    q: Floats32[Array, "frames dofs"]
    contacts: Floats32[Array, "frames 4"]
    bounds: Ints[Array, "clips 2"]
    names: tuple[str, ...]

    def clip(self, index: int) -> Motion:
        """One clip as a motion."""
        start, stop = self.bounds[index]
        return make_motion(average_body(), self.q[start:stop].astype(np.float64), RATE, self.names[index])


def build_shards(
    data: Path, folder: Path, people: Sequence[str] | None = None, progress: Callable[[str, int], None] | None = None
) -> tuple[Path, ...]:
    """Makes the shards that are not there yet; the same recordings give the same bytes.

    Args:
        data: The folder of recordings.
        folder: Where shards go.
        people: Whose; everybody's if left out.
        progress: Told each person and their frames.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    for person, sources in person_sources(data).items():
        if people is not None and person not in people:
            continue
        path = folder / f"{person.replace(':', '-')}.npz"
        digest = _digest(sources)
        if not (path.is_file() and read_artefact(path, KIND).data_digest == digest):
            shard = make_shard(person, sources)
            arrays = {"q": shard.q, "contacts": shard.contacts, "bounds": shard.bounds}
            write_artefact(
                path, KIND, VERSION, {"person": person, "names": list(shard.names)}, arrays, data_digest=digest
            )
        paths.append(path)
        if progress is not None:
            progress(person, len(read_shard(path).q))
    return tuple(paths)


def read_shard(path: Path) -> Shard:
    """Reads a person's shard.

    Raises:
        FormatError: if the file is none, or damaged.
    """
    held = read_artefact(path, KIND, VERSION)
    return Shard(
        str(held.header["person"]), held.arrays["q"], held.arrays["contacts"], held.arrays["bounds"],
        tuple(held.header["names"]),
    )  # fmt: skip


def make_shard(person: str, sources: Sequence[Source]) -> Shard:
    """Converts a person's recordings.

    Raises:
        FormatError: for one that cannot be read: a training set must not shrink in silence.
    """
    q: list[Floats32[Array, "frames dofs"]] = []
    stands: list[Floats32[Array, "frames 4"]] = []
    names: list[str] = []
    for source in sources:
        made = convert(source, Recipe(RATE, mirror=False))
        unreadable = [entry for entry in made.skipped if entry.kind is SkipKind.UNREADABLE]
        if unreadable:
            raise FormatError(f"{source.name} cannot be read", cause=unreadable[0].reason, file=source.path)
        for clip in made.clips:
            whole = make_motion(average_body(), clip.poses.astype(np.float64), RATE, source.name)
            for piece in _sound_pieces(whole):
                down = piece.q.astype(np.float32)
                down[:, 1] -= floor_height(piece)
                touch = contacts(piece)
                q.append(down)
                stands.append(
                    np.stack([touch.left_heel, touch.left_toe, touch.right_heel, touch.right_toe], 1).astype(np.float32)
                )
                names.append(source.name)
    lengths = np.array([len(each) for each in q], dtype=np.int64)
    stops = np.cumsum(lengths)
    empty = np.empty((0, average_body().size), dtype=np.float32)
    return Shard(
        person,
        np.concatenate(q) if q else empty,
        np.concatenate(stands) if stands else np.empty((0, 4), dtype=np.float32),
        np.stack([stops - lengths, stops], axis=1),
        tuple(names),
    )


def _sound_pieces(motion: Motion) -> list[Motion]:
    """The motion cut where a joint jumps, short pieces left out."""
    places: Floats[Array, "frames joints 3"] = motion_frames(motion).positions
    relative = places - places[:, :1]
    speed = np.linalg.norm(np.diff(relative, axis=0), axis=-1).max(axis=1) * RATE
    cuts = [0, *(int(i) + 1 for i in np.flatnonzero(speed > _FASTEST)), len(motion)]
    spans = pairwise(cuts)
    return [motion.cut(start, stop) for start, stop in spans if stop - start >= _SHORTEST * RATE]


def _digest(sources: Sequence[Source]) -> str:
    told = [(source.name, source.path.stat().st_size if source.path else 0) for source in sources]
    return hashlib.sha256(
        json.dumps(
            [VERSION, RATE, told, [str(source.skeleton and source.skeleton.name) for source in sources]]
        ).encode()
    ).hexdigest()
