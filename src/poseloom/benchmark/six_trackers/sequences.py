"""Which sequences are for choosing settings and which for tables: fixed here once, by rules that know no error."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from poseloom.errors import PoseloomError
from poseloom.evaluation.cases import Case, Conditions, case_of_motion
from poseloom.formats import drop_rest_frame, read_motion
from poseloom.library import Clip, MotionLibrary
from poseloom.library.sources import Selection, Source, find_sources
from poseloom.library.store import file_digest

BORROWED_SKELETONS = {"cmu_asfamc/1[34]": "cmu_asfamc/35/35.asf"}
"""For CMU's subjects 13 and 14, whose own skeletons are missing from the recordings."""

ANONYMOUS = "cmu_expmap"
"""A data set whose people are not named: all of them count as one."""

COVERING_TAKES = 4
COVERING_POSES = 500
"""A sequence is densely covered if the library holds so many other takes, of so many poses together (12.5 s), of the
same action by the same person (or data set, where people are not named)."""

_TABLE_ACTIONS = (
    *(("walking", index, "walking") for index in (1, 2, 3, 4, 5)),
    *(("running", index, "running") for index in (1, 2, 3)),
    *(("basketball", index, "basketball") for index in (1, 2, 3)),
    *(("soccer", index, "soccer") for index in (1, 2, 3)),
    *(("jumping", index, "jumping") for index in (1, 2, 3)),
    *(("basketball_signal", index, "signals") for index in (1, 2)),
    ("directing_traffic", 1, "signals"),
)
_TABLE_ASF = (
    ("02/02_02", "walking"),
    ("02/02_03", "running"),
    ("02/02_05", "boxing"),
    ("13/13_29", "exercises"),
    ("14/14_14", "exercises"),
    ("35/35_01", "walking"),
)
_VALIDATION_ACTIONS = (
    *(
        (action, index)
        for action in ("basketball", "basketball_signal", "jumping", "running", "soccer")
        for index in (4, 5)
    ),
    ("directing_traffic", 4),
)
_VALIDATION_WALKS = (13, 14, 15, 16)
_HDM05_BEHAVIOURS: Mapping[str, str] = MappingProxyType(
    {
        "depositFloorR": "reaching",
        "elbowToKnee1RepsLelbowStart": "exercises",
        "grabHighR": "reaching",
        "hopBothLegs1hops": "jumping",
        "jogLeftCircle4StepsRstart": "running",
        "kickLFront1Reps": "kicking",
        "lieDownFloor": "lying down",
        "rotateArmsBothBackward1Reps": "exercises",
        "sneak2StepsLStart": "walking",
        "squat1Reps": "exercises",
        "throwBasketball": "basketball",
    }
)
_TABLE_ACTORS = ("bd", "dg")
_VALIDATION_ACTORS = ("bk", "mm")


@dataclass(frozen=True)
class BenchmarkSequence:
    """A sequence by its file.

    Attributes:
        source: The file, from the folder of motions on, without its suffix.
        behaviour: What happens in it, in the words of the figures.
    """

    source: str
    behaviour: str


def table_sequences(motions: Path) -> tuple[BenchmarkSequence, ...]:
    """The sequences of every table and figure; no setting was ever chosen by one of them."""
    return (
        *(BenchmarkSequence(_action_file(action, index), what) for action, index, what in _TABLE_ACTIONS),
        *(BenchmarkSequence(f"cmu_asfamc/{name}", what) for name, what in _TABLE_ASF),
        *_hdm05(motions, _TABLE_ACTORS),
    )


def validation_sequences(motions: Path) -> tuple[BenchmarkSequence, ...]:
    """The sequences by which settings are chosen; none is in a table."""
    walks = (f"cmu_expmap/train/walking_extra/walking_{index}" for index in _VALIDATION_WALKS)
    return (
        *(BenchmarkSequence(_action_file(action, index), action) for action, index in _VALIDATION_ACTIONS),
        *(BenchmarkSequence(source, "walking") for source in walks),
        *_hdm05(motions, _VALIDATION_ACTORS),
    )


def motions_folder(data: Path) -> Path:
    """The folder of motions in the folder of recordings. Raises PoseloomError where these are not the ones needed."""
    motions = data / "mocap" if (data / "mocap").is_dir() else data
    for needed in ("cmu_expmap/train", "hdm05", "cmu_asfamc"):
        if not (motions / needed).is_dir():
            raise PoseloomError(
                f"there is no folder {needed} in {motions.name}",
                remedy="Give --data (or POSELOOM_DATA) the folder of the recordings that the benchmark is defined on",
                file=motions,
            )
    return motions


def all_sources(motions: Path) -> tuple[Source, ...]:
    """Every motion file of the folder, with the skeletons that some borrow."""
    rules = tuple((pattern, motions / file) for pattern, file in BORROWED_SKELETONS.items())
    return find_sources([motions], Selection(skeletons=rules)).sources


def read_sequences(
    motions: Path,
    sequences: Sequence[BenchmarkSequence],
    conditions: Conditions,
    progress: Callable[[str, int, int], object] | None = None,
) -> tuple[Case, ...]:
    """Reads sequences as cases, each on the body with its own bones.

    Raises:
        PoseloomError: for one that is not there.
    """
    sources = {_short(source.name): source for source in all_sources(motions)}
    cases: list[Case] = []
    for done, sequence in enumerate(sequences, 1):
        source = sources.get(sequence.source)
        if source is None or source.path is None:
            raise PoseloomError(
                f"the sequence {sequence.source} is missing",
                remedy="Unpack all recordings that the benchmark is defined on",
                file=motions,
            )
        motion = drop_rest_frame(read_motion(source.path, skeleton=source.skeleton))
        name = Path(sequence.source).name
        cases.append(case_of_motion(motion, conditions, name, file_digest(source.path), source.subject))
        if progress is not None:
            progress("reading sequences", done, len(sequences))
    return tuple(cases)


def takes_by_digest(library: MotionLibrary) -> dict[str, str]:
    """The take of each file, mirror images left aside."""
    return {clip.digest: clip.take for clip in library.clips if not clip.mirrored}


def people_of(library: MotionLibrary) -> dict[str, frozenset[str]]:
    """Who moves in each take, by all names that its clips give; an anonymous data set counts as one person."""
    people: dict[str, set[str]] = {}
    for clip in library.clips:
        people.setdefault(clip.take, set()).add(_person(clip))
    return {take: frozenset(names) for take, names in people.items()}


def covering_takes(library: MotionLibrary, case: Case) -> dict[str, int]:
    """Other takes of the same action by the same people: their poses by take, mirror images and copies not counted."""
    take = takes_by_digest(library).get(case.digest)
    own = next((clip for clip in library.clips if clip.digest == case.digest), None)
    if take is None or own is None:
        return {}
    people = people_of(library)
    found: dict[str, int] = {}
    for clip in library.clips:
        same = clip.take != take and _action(clip) == _action(own) and people[clip.take] & people[take]
        if same and not clip.mirrored:
            found[clip.take] = max(found.get(clip.take, 0), len(clip))
    return found


def is_covered(library: MotionLibrary, case: Case) -> bool:
    """Whether the library covers a sequence densely, by `COVERING_TAKES` and `COVERING_POSES`."""
    others = covering_takes(library, case)
    return len(others) >= COVERING_TAKES and sum(others.values()) >= COVERING_POSES


def forbidden_takes(library: MotionLibrary, case: Case, by_subject: bool) -> frozenset[str]:
    """Takes that a method may not see: the case's own, and if by subject all of its people's.

    Raises:
        PoseloomError: where the library does not know the case's file: what to leave out would be a guess.
    """
    take = takes_by_digest(library).get(case.digest)
    if take is None:
        raise PoseloomError(
            f"the library does not hold {case.name!r}, so it cannot be left out of it",
            remedy="Build the library from the same recordings: poseloom benchmark libraries",
            file=library.path,
        )
    if not by_subject:
        return frozenset({take})
    people = people_of(library)
    return frozenset(other for other, names in people.items() if names & people[take]) | {take}


def check_apart(library: MotionLibrary, first: Iterable[Case], second: Iterable[Case]) -> None:
    """Raises PoseloomError if a take, in whatever format, is among both."""
    takes = takes_by_digest(library)
    both = {takes.get(case.digest) for case in first} & {takes.get(case.digest) for case in second} - {None}
    if both:
        raise PoseloomError(
            f"{sorted(map(str, both))[0]} is among the sequences that choose settings and among those of the tables"
        )


def _person(clip: Clip) -> str:
    return ANONYMOUS if clip.subject.startswith(f"{ANONYMOUS}:") else clip.subject


def _action(clip: Clip) -> frozenset[str]:
    return frozenset(clip.tags) - {"extra"}


def _short(source: str) -> str:
    """A source's name without the given folder and the suffix."""
    parts = source.split("/")
    return str(Path(*parts[1:]).with_suffix(""))


def _action_file(action: str, index: int) -> str:
    return f"cmu_expmap/train/{action}/{action}_{index}"


def _hdm05(motions: Path, actors: Sequence[str]) -> list[BenchmarkSequence]:
    """The first file of each action of these actors."""
    found: list[BenchmarkSequence] = []
    for actor in actors:
        for action, behaviour in _HDM05_BEHAVIOURS.items():
            files = sorted((motions / "hdm05").glob(f"HDM_{actor}_{action}_*.[aA][mM][cC]"))
            if files:
                found.append(BenchmarkSequence(f"hdm05/{files[0].stem}", behaviour))
    return found
