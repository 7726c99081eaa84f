"""Sessions: everything one person did, in one piece, wearing the same four sensors.

A range is learnt over a session, not over a clip of two seconds; sensors creep through it. So the takes of a person
follow each other, joined by half a second in which the bends pass over. Nothing is learnt or judged in those joins.
"""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats, Floats32
from poseloom.errors import LibraryError
from poseloom.library import Clip, MotionLibrary
from poseloom.methods.flex.angles import flex_angles, mirrored_angles
from poseloom.sensors import layout
from poseloom.synthesis.flex import bend_angles

LAYOUT = "flex-four"
_JOIN_SECONDS = 0.5
_OTHER_SIDE = [1, 0, 3, 2]


@dataclass(frozen=True)
class Take:
    """One take within a session.

    Attributes:
        name: The clip's name.
        take: The recorded take that it belongs to, in whatever guise.
        tags: Words for what happens.
        start: Its first frame in the session.
        stop: The frame after its last.
    """

    name: str
    take: str
    tags: tuple[str, ...]
    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True, eq=False)
class Session:
    """What a person did while wearing the sensors.

    Attributes:
        person: Who.
        takes: What was done, in order.
        rate: Frames a second.
        bends: What the sensors' joints did, radians.
        angles: The 39 angles to be told, radians; nothing is meant by those of the joins.
    """

    person: str
    takes: tuple[Take, ...]
    rate: float
    bends: Floats[Array, "frames channels"]
    angles: Floats32[Array, "frames angles"]

    def __len__(self) -> int:
        return len(self.bends)


def chosen_clips(library: MotionLibrary, wanted: Callable[[Clip], bool] = lambda clip: True) -> tuple[Clip, ...]:
    """One clip of each take: the first that is wanted and no mirror image. Copies in other formats teach nothing."""
    chosen: dict[str, Clip] = {}
    for clip in library.clips:
        if not clip.mirrored and wanted(clip):
            chosen.setdefault(clip.take, clip)
    return tuple(chosen.values())


def mean_angles(library: MotionLibrary, clips: Sequence[Clip]) -> Floats[Array, "angles"]:
    """Mean of the angles, the point near which rotation vectors choose their branch."""
    total = sum(flex_angles(library.poses[clip.rows].astype(np.float64)).sum(axis=0) for clip in clips)
    return np.asarray(total) / sum(len(clip) for clip in clips)


def make_sessions(
    library: MotionLibrary,
    clips: Sequence[Clip],
    reference: Floats[Array, "angles"],
    person_of: Callable[[Clip], str] = lambda clip: clip.subject,
) -> tuple[Session, ...]:
    """One session a person, in the order in which the people first appear.

    Args:
        library: The library of the clips, at the rate of the networks.
        clips: What was done, see `chosen_clips`.
        reference: Angles near which branches are chosen, see `flex_angles`.
        person_of: Who did it.

    Raises:
        LibraryError: if there is no clip.
    """
    if not clips:
        raise LibraryError("there is no clip to learn from", remedy="Choose a library with motions")
    people: dict[str, list[Clip]] = {}
    for clip in clips:
        people.setdefault(person_of(clip), []).append(clip)
    return tuple(_session(library, person, own, reference) for person, own in people.items())


def mirrored(session: Session) -> Session:
    """The same session in a mirror: sides exchanged."""
    angles = mirrored_angles(session.angles.astype(np.float64)).astype(np.float32)
    return Session(f"{session.person}~mirror", session.takes, session.rate, session.bends[:, _OTHER_SIDE], angles)


def session_seed(session: Session, seed: int) -> Sequence[int]:
    """A seed of a session's own, the same whatever other sessions there are."""
    return (seed, zlib.crc32(session.person.encode()))


def _session(library: MotionLibrary, person: str, clips: Sequence[Clip], reference: Floats[Array, "angles"]) -> Session:
    worn = layout(LAYOUT)
    join = round(_JOIN_SECONDS * library.rate)
    takes: list[Take] = []
    bends: list[Floats[Array, "frames channels"]] = []
    angles: list[Floats32[Array, "frames angles"]] = []
    length = 0
    for clip in clips:
        motion = library.motion(clip)
        own = bend_angles(motion, worn)
        if bends:
            way = np.linspace(0, 1, join + 2)[1:-1, None]
            bends.append((1 - way) * bends[-1][-1] + way * own[0])
            angles.append(np.zeros((join, angles[-1].shape[1]), dtype=np.float32))
            length += join
        takes.append(Take(clip.name, clip.take, clip.tags, length, length + len(own)))
        bends.append(own)
        angles.append(flex_angles(motion.q, reference).astype(np.float32))
        length += len(own)
    return Session(person, tuple(takes), library.rate, np.concatenate(bends), np.concatenate(angles))


def people_of(sessions: Sequence[Session]) -> Mapping[str, int]:
    """Frames by person."""
    return {session.person: sum(len(take) for take in session.takes) for session in sessions}
