"""What the flex benchmark is measured on: sessions from recordings, two ways of dividing them, drawn sensors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from poseloom.arrays import Array, Floats32
from poseloom.benchmark.six_trackers.sequences import ANONYMOUS, BORROWED_SKELETONS, motions_folder
from poseloom.library import Clip, MotionLibrary, build_library, open_library
from poseloom.methods.flex.network_method import RATE
from poseloom.training.draws import DrawSettings, draw_inputs, draw_inputs_at_first_range
from poseloom.training.fitting import FitSettings, draw_sets
from poseloom.training.sessions import Session, chosen_clips, make_sessions, mean_angles
from poseloom.training.splits import Divided, Part, by_person, within_takes

SOURCES = ("cmu_asfamc", "cmu_bvh", "cmu_expmap", "hdm05")
"""Folders of motions that people made: DeepMimic's acrobatics are copies of such on a robot's body, Bandai's are for
tests of scale."""

TESTED = frozenset({"hdm05:bd", "cmu02", "cmu13", "cmu35", "cmu49"})
"""People that the by-subject split is measured on: chosen by name before anything was measured on them."""
VALIDATING = frozenset({"hdm05:dg", "hdm05:mm", "cmu14", "cmu131"})
"""People that stop its training and choose settings; an earlier version's figures were measured on them."""

GAP = 120
"""Frames between the parts of a take: the longest window of table 6."""

WITHIN, BY_SUBJECT = "within-sequence", "by-subject"
OWN_SUIT = 0
"""Seed of the sensors that the within-sequence split is trained and measured on, as the paper's are."""
NEW_SUIT = 1000
"""Seed of sensors that nobody has trained on."""

DRAW = DrawSettings(drop_outs=0.2)
"""How training sensors are drawn, for everybody alike: 0 to 60 minutes of use, a channel silent 1.7 % of the time."""

PLAIN = DrawSettings(most_minutes=DRAW.most_minutes)
"""How sensors are drawn to measure on: without further silences."""

Inputs = Floats32[Array, "_ inputs"]


@dataclass(frozen=True, eq=False)
class Material:
    """All that is measured on.

    Attributes:
        library: The motions at the networks' rate.
        sessions: One a person.
        within: The paper's split of each take, with a guard gap.
        by_subject: Whole people apart.
        sets: What the sets of training sensors tell of all sessions.
    """

    library: MotionLibrary
    sessions: tuple[Session, ...]
    within: Divided
    by_subject: Divided
    sets: tuple[tuple[Sequence[Session], tuple[Inputs, ...]], ...]

    def divided(self, split: str) -> Divided:
        """The split of this name."""
        return self.within if split == WITHIN else self.by_subject

    def suit(self, split: str) -> int:
        """Seed of the sensors that a split is measured on."""
        return OWN_SUIT if split == WITHIN else NEW_SUIT

    def heard(self, suit: int, minutes: float | None = None) -> tuple[Inputs, ...]:
        """What one set of sensors tells of all sessions, without further silences.

        Args:
            suit: Seed of the sensors.
            minutes: Minutes of use before each session; drawn from 0 to 60 if left out.
        """
        return tuple(draw_inputs(session, suit, PLAIN, minutes=minutes) for session in self.sessions)

    def heard_at_first_range(self, suit: int, minutes: float | None = None) -> tuple[Inputs, ...]:
        """The same, by the range that the sensors had in their first minute when they were new."""
        return tuple(draw_inputs_at_first_range(session, suit, PLAIN, minutes=minutes) for session in self.sessions)

    def sets_at_first_range(self) -> tuple[tuple[Sequence[Session], tuple[Inputs, ...]], ...]:
        """The training sets, heard by the ranges of new sensors."""
        return tuple(
            (wearers, tuple(draw_inputs_at_first_range(each, OWN_SUIT + number, DRAW) for each in wearers))
            for number, (wearers, _) in enumerate(self.sets)
        )


def person_of(clip: Clip) -> str:
    """Who moves; the exponential maps do not name their people, who count as one."""
    return ANONYMOUS if clip.subject.startswith(ANONYMOUS) else clip.subject


def part_of(person: str) -> Part:
    """What a person is for in the by-subject split."""
    return Part.TEST if person in TESTED else Part.VALIDATE if person in VALIDATING else Part.TRAIN


def prepare(
    data: Path, work: Path, draws: int = 4, thin: int = 1, progress: Callable[[str, int, int], None] | None = None
) -> Material:
    """Builds the library in `work` unless it is there, and all that follows from it.

    Args:
        data: Folder of the recordings.
        work: Folder for the library and the checkpoints of training.
        draws: Sets of training sensors.
        thin: Keep every so many clips only, for a quick look.
        progress: Told how far it is.
    """
    folder = work / "library"
    if not folder.exists():
        motions = motions_folder(data)
        skeletons = {pattern: motions / file for pattern, file in BORROWED_SKELETONS.items()}
        work.mkdir(parents=True, exist_ok=True)
        build_library(
            [motions / source for source in SOURCES], folder, rate=RATE, skeletons=skeletons, workers=1,
            progress=progress,
        )  # fmt: skip
    library = open_library(folder)
    clips = chosen_clips(library)[::thin]
    sessions = make_sessions(library, clips, mean_angles(library, clips), person_of)
    settings = FitSettings(draw=DRAW, draws=draws)
    return Material(
        library,
        sessions,
        within_takes(sessions, GAP),
        by_person(sessions, part_of),
        draw_sets(sessions, settings, OWN_SUIT),
    )
