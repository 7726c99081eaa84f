"""Which motions train, which choose settings, which are in the tables: fixed here once, by rules that know no error.

Everything is named by the file, from the folder of motions on, without its suffix.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from types import MappingProxyType

import numpy as np

from poseloom.benchmark.six_trackers.sequences import all_sources
from poseloom.errors import PoseloomError
from poseloom.formats import drop_rest_frame, read_motion
from poseloom.library.sources import Source, matches
from poseloom.library.takes import find_takes
from poseloom.skeleton.body import average_body
from poseloom.skeleton.families import recognise
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import resample
from poseloom.skeleton.retarget import retarget

BEHAVIOURS = ("walking", "running", "jumping", "hopping")
"""The paper's four, in the order of its table 3."""

RATE = 60.0
"""Frames a second of all sequences."""

FOLDS = 4
"""Parts into which the sequences of the tables fall; what is asked of one part is fitted to all the rest."""

CMU = "cmu"
"""CMU's people all count as one, for `cmu_expmap` is drawn from them and names nobody."""

COVERING_TAKES = 4
"""A sequence is covered if so many other takes of its behaviour by the same person may be trained on."""

_POOL: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "walking": (
            *("cmu_expmap/train/walking/*", "cmu_expmap/train/walking_extra/*", "cmu_asfamc/02/02_0[12]"),
            *("cmu_asfamc/16/*", "cmu_asfamc/35/*", "cmu_bvh/131/131_0[13]"),
            *("deepmimic/humanoid3d_walk", "deepmimic/humanoid3d_long_walk[123]"),
        ),
        "running": (
            *("cmu_expmap/train/running/*", "cmu_asfamc/02/02_03", "hdm05/HDM_*_jogLeftCircle4StepsRstart_*"),
            *("deepmimic/humanoid3d_run", "deepmimic/humanoid3d_jog"),
        ),
        "jumping": ("cmu_expmap/train/jumping/*", "cmu_asfamc/02/02_04", "deepmimic/humanoid3d_jump"),
        "hopping": ("hdm05/HDM_*_hopBothLegs1hops_*", "cmu_bvh/131/131_02"),
    }
)
"""The motions of each behaviour. Bandai's are for tests of scale only; styled walks (zombie, stealthy, sneaking) and
games, in which people do other things than walk, are left aside."""

_TABLES: tuple[str, ...] = (
    *(f"cmu_expmap/train/walking/walking_{i}" for i in (1, 2, 3, 4, 5)),
    *(f"cmu_expmap/train/walking_extra/walking_{i}" for i in (20, 24, 28, 32, 36, 40, 44, 48, 52)),
    *(f"cmu_expmap/train/running/running_{i}" for i in (1, 2, 3)),
    "cmu_asfamc/02/02_03",
    *(f"hdm05/HDM_bd_jogLeftCircle4StepsRstart_00{i}_120" for i in (1, 2)),
    *(f"hdm05/HDM_dg_jogLeftCircle4StepsRstart_0{i}_120" for i in ("08", "09", "10")),
    *(f"cmu_expmap/train/jumping/jumping_{i}" for i in (1, 2, 3)),
    "deepmimic/humanoid3d_jump",
    *(f"hdm05/HDM_bd_hopBothLegs1hops_00{i}_120" for i in (1, 2, 3, 4, 5, 6)),
    *(f"hdm05/HDM_dg_hopBothLegs1hops_0{i}_120" for i in (22, 23, 24, 25, 26, 27)),
)
"""The paper has 2,000, 2,000, 1,000 and 1,000 frames of one person; so much running and hopping is not there."""

_TRANSITIONS: tuple[str, ...] = tuple(f"cmu_expmap/train/walking_extra/walking_{i}" for i in (18, 22, 31))
"""Walks from a stand, and to one, that are in the experiment on transitions beside those of the tables."""

_VALIDATION: tuple[str, ...] = (
    *(f"cmu_expmap/train/walking_extra/walking_{i}" for i in (13, 14, 15, 16, 19, 23, 30, 34, 38, 42, 46, 51)),
    *(f"cmu_expmap/train/running/running_{i}" for i in (4, 5)),
    *(f"hdm05/HDM_bk_jogLeftCircle4StepsRstart_00{i}_120" for i in (3, 4)),
    *(f"cmu_expmap/train/jumping/jumping_{i}" for i in (4, 5)),
    "cmu_asfamc/02/02_04",
    *(f"hdm05/HDM_bk_hopBothLegs1hops_0{i}_120" for i in (13, 14, 15, 16, 17)),
    *(f"hdm05/HDM_mm_hopBothLegs1hops_0{i}_120" for i in (31, 32)),
)


@dataclass(frozen=True, eq=False)
class Take:
    """One motion of the pool.

    Attributes:
        source: Its file.
        behaviour: One of `BEHAVIOURS`.
        take: Name of the take: the same for copies of one recording in other formats.
        person: Who moves; CMU's people are one.
        motion: The motion on the body with its own bones, at `RATE`.
    """

    source: str
    behaviour: str
    take: str
    person: str
    motion: Motion


@dataclass(frozen=True, eq=False)
class Pool:
    """All motions of the benchmark, copies left out.

    Attributes:
        takes: What may train, each recording once.
        tables: Sequences of the tables.
        transitions: Sequences of the experiment on transitions.
        validation: Sequences that choose settings.
    """

    takes: tuple[Take, ...]
    tables: tuple[Take, ...]
    transitions: tuple[Take, ...]
    validation: tuple[Take, ...]

    @property
    def folds(self) -> tuple[tuple[Take, ...], ...]:
        """The sequences of the tables and transitions in `FOLDS` parts; the next sequence belongs to the next part."""
        asked = (*self.tables, *self.transitions)
        return tuple(asked[part::FOLDS] for part in range(FOLDS))

    def fold_of(self, take: Take) -> tuple[Take, ...]:
        """The sequences that are left out together with this one; of the validation sequences, every other."""
        for part in (*self.folds, self.validation[::2], self.validation[1::2]):
            if take.take in {each.take for each in part}:
                return part
        return (take,)

    def without(self, left_out: Iterable[Take], by_subject: bool = False) -> tuple[Take, ...]:
        """What may train where these sequences are asked: all other takes, by subject only other people's."""
        asked = tuple(left_out)
        takes, people = {each.take for each in asked}, {each.person for each in asked}
        return tuple(t for t in self.takes if t.take not in takes and not (by_subject and t.person in people))

    def is_covered(self, take: Take) -> bool:
        """Whether enough of the same behaviour by the same person is left to train on once its fold is left out."""
        rest = self.without(self.fold_of(take))
        return sum(t.behaviour == take.behaviour and t.person == take.person for t in rest) >= COVERING_TAKES


def read_pool(motions: Path) -> Pool:
    """Reads all motions of the benchmark.

    Raises:
        PoseloomError: for a sequence that is missing, or a take that is among the sequences that choose settings and
            among those of the tables, in whatever format.
    """
    takes = _read(motions)
    by_source = {take.source: take for take in takes}

    def named(sources: Sequence[str]) -> tuple[Take, ...]:
        missing = [source for source in sources if source not in by_source]
        if missing:
            raise PoseloomError(
                f"the sequence {missing[0]} is missing",
                remedy="Unpack all recordings that the benchmark is defined on",
                file=motions,
            )
        return tuple(by_source[source] for source in sources)

    tables, transitions, validation = named(_TABLES), named(_TRANSITIONS), named(_VALIDATION)
    both = {take.take for take in (*tables, *transitions)} & {take.take for take in validation}
    if both:
        raise PoseloomError(f"{min(both)} is among the sequences that choose settings and among those of the tables")
    asked = {take.source for take in (*tables, *transitions, *validation)}
    return Pool(_each_once(takes, asked), tables, transitions, validation)


def behaviour_of(source: str) -> str | None:
    """The behaviour of a file of the recordings, by its name; None where it is not in the pool."""
    name = str(PurePosixPath(source).with_suffix("")) if PurePosixPath(source).suffix else source
    return next((what for what, patterns in _POOL.items() if any(matches(p, name) for p in patterns)), None)


def _read(motions: Path) -> tuple[Take, ...]:
    found: list[tuple[str, str, Source, Motion, str]] = []
    for source in all_sources(motions):
        name = str(PurePosixPath(*PurePosixPath(source.name).parts[1:]).with_suffix(""))
        behaviour = behaviour_of(name)
        if behaviour is None or source.path is None:
            continue
        motion = drop_rest_frame(read_motion(source.path, skeleton=source.skeleton))
        found.append((name, behaviour, source, retarget(motion), recognise(motion.skeleton).name))
    names = _take_names([(name, motion, family) for name, _, _, motion, family in found])
    return tuple(
        Take(name, behaviour, names[name], _person(source.subject), resample(motion, RATE))
        for name, behaviour, source, motion, _ in found
    )


@dataclass(frozen=True)
class _Stretch:
    """A clip, as the search for copies wants it."""

    start: int
    stop: int
    take: str
    mirrored: bool
    family: str


def _take_names(motions: Sequence[tuple[str, Motion, str]]) -> dict[str, str]:
    """For each motion the name of its take, the same for all copies of one recording."""
    rate, count = 40.0, 0
    stretches: list[_Stretch] = []
    poses: list[np.ndarray] = []
    for name, motion, family in motions:
        q = resample(retarget(motion, average_body()), rate).q.astype(np.float32)
        stretches.append(_Stretch(count, count + len(q), name, False, family))
        poses.append(q)
        count += len(q)
    return find_takes(np.concatenate(poses), stretches, rate)


def _each_once(takes: Sequence[Take], asked: set[str]) -> tuple[Take, ...]:
    """One motion of each take: the one that is asked somewhere, else the first."""
    chosen: dict[str, Take] = {}
    for take in takes:
        if take.take not in chosen or take.source in asked:
            chosen[take.take] = take
    return tuple(chosen.values())


def _person(subject: str) -> str:
    return CMU if subject.startswith(CMU) else subject
