"""Which frames train, which validate and which are measured on: never the same, nor near enough to share a window."""

import enum
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from poseloom.errors import PoseloomError
from poseloom.training.sessions import Session, Take


class Part(enum.StrEnum):
    """What frames are for."""

    TRAIN = "train"
    VALIDATE = "validate"
    TEST = "test"


@dataclass(frozen=True)
class Piece:
    """Frames of one take that a network is asked about, and what it may hear before.

    Attributes:
        session: Index of the session.
        take: The take.
        heard: First frame that a network may hear; it begins there with an empty memory.
        start: First frame that counts.
        stop: Frame after the last.
    """

    session: int
    take: Take
    heard: int
    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True)
class Divided:
    """Pieces by purpose."""

    train: tuple[Piece, ...]
    validate: tuple[Piece, ...]
    test: tuple[Piece, ...]

    def part(self, part: Part) -> tuple[Piece, ...]:
        """The pieces of one purpose."""
        return {Part.TRAIN: self.train, Part.VALIDATE: self.validate, Part.TEST: self.test}[part]

    def frames(self, part: Part) -> int:
        """Frames that count."""
        return sum(len(piece) for piece in self.part(part))


def by_person(sessions: Sequence[Session], part_of: Callable[[str], Part]) -> Divided:
    """Whole people: all takes of a person are for one purpose.

    Raises:
        PoseloomError: if nobody is left to train on, or one recorded take is on both sides.
    """
    parts: dict[Part, list[Piece]] = {part: [] for part in Part}
    for index, session in enumerate(sessions):
        part = part_of(session.person)
        parts[part] += [Piece(index, take, take.start, take.start, take.stop) for take in session.takes]
    return _divided(parts)


def within_takes(sessions: Sequence[Session], gap: int, least: int = 25) -> Divided:
    """A tenth of every take to test, a tenth to validate, the rest to train, as the flex paper divides; with gaps.

    The paper tests on the last tenth; here it is the first. The order is: a gap that is heard only, test, gap,
    training, gap, validation. A gap is as long as a window, so a window that ends in one part shares no frame with
    another; what is heard in the gap before a part warms a memory up. Takes too short for that train only.

    Args:
        sessions: The sessions.
        gap: Frames that count for nothing before each part; at least the longest window.
        least: Frames that test and validation must have, or the take trains only.
    """
    parts: dict[Part, list[Piece]] = {part: [] for part in Part}
    for index, session in enumerate(sessions):
        for take in session.takes:
            tenth = (len(take) - 3 * gap) // 10
            if tenth < least:
                parts[Part.TRAIN].append(Piece(index, take, take.start, take.start, take.stop))
                continue
            tested = take.start + gap
            trained, validated = tested + tenth + gap, take.stop - tenth
            parts[Part.TEST].append(Piece(index, take, take.start, tested, tested + tenth))
            parts[Part.TRAIN].append(Piece(index, take, trained - gap + 1, trained, validated - gap))
            parts[Part.VALIDATE].append(Piece(index, take, validated - gap + 1, validated, take.stop))
    return _divided(parts)


def _divided(parts: dict[Part, list[Piece]]) -> Divided:
    divided = Divided(tuple(parts[Part.TRAIN]), tuple(parts[Part.VALIDATE]), tuple(parts[Part.TEST]))
    if not divided.train:
        raise PoseloomError("nothing is left to train on", remedy="Leave at least one person in the training part")
    check_disjoint(divided)
    return divided


def check_disjoint(divided: Divided) -> None:
    """Refuses a division in which what one part hears or is asked about is heard or asked by another.

    Raises:
        PoseloomError: naming the take.
    """
    claims: dict[tuple[int, str], list[tuple[int, int, Part]]] = {}
    copies: dict[str, set[tuple[int, str]]] = {}
    for part in Part:
        for piece in divided.part(part):
            key = (piece.session, piece.take.name)
            claims.setdefault(key, []).append((piece.heard, piece.stop, part))
            copies.setdefault(piece.take.take, set()).add(key)
    for (_, name), spans in claims.items():
        ordered = sorted(spans)
        for (_, stop, first), (heard, _, second) in pairwise(ordered):
            if heard < stop and first is not second:
                raise PoseloomError(f"frames of the take {name!r} stand on both sides of the split")
    for take, clips in copies.items():
        if len(clips) > 1 and len(_parts_of(divided, clips)) > 1:
            raise PoseloomError(f"copies of the take {take!r} stand on both sides of the split")


def _parts_of(divided: Divided, clips: Iterable[tuple[int, str]]) -> set[Part]:
    wanted = set(clips)
    return {part for part in Part for piece in divided.part(part) if (piece.session, piece.take.name) in wanted}
