"""The whole of the six-sensor paper's experiments, as rows."""

import hashlib
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from poseloom.benchmark.calibration import calibration_rows
from poseloom.benchmark.six_trackers.accuracy import Curve, Sequences, figure_five, table_two, three_trackers
from poseloom.benchmark.six_trackers.plan import OURS, Plan, Progress
from poseloom.benchmark.six_trackers.quality import search_quality, speed
from poseloom.benchmark.six_trackers.recovery import recovery
from poseloom.benchmark.six_trackers.rejections import rejections
from poseloom.benchmark.six_trackers.sequences import (
    check_apart,
    forbidden_takes,
    motions_folder,
    read_sequences,
    table_sequences,
    validation_sequences,
)
from poseloom.benchmark.six_trackers.trials import Trial, opened, recording_of
from poseloom.errors import PoseloomError
from poseloom.evaluation.rows import Results, Row, motions_digest
from poseloom.formats.recording import write_recording

SIZES_FILE = "sizes/cmu_skeletons.csv"

_EVERY = 6
"""In a quick run one sequence of so many, over all behaviours."""


@dataclass(frozen=True, eq=False)
class SixTrackers:
    """What came out.

    Attributes:
        results: All figures.
        curves: Figure 7.
    """

    results: Results
    curves: tuple[Curve, ...]


def run_six_trackers(
    plan: Plan,
    progress: Progress | None = None,
    sizes: Path | None = None,
    found: Callable[[list[Row]], object] | None = None,
) -> SixTrackers:
    """Runs the parts of a plan one after the other.

    Args:
        plan: What to run.
        progress: Told how far it is.
        sizes: Table of skeletons for table 1; left out where it is None and the data have none.
        found: Told the rows of each part as it ends.

    Raises:
        PoseloomError: for missing recordings, or a library that does not hold the sequences.
    """
    tell, show = progress or _silent, found or _ignore
    sequences = read_table(plan, tell)
    rows: list[Row] = []
    curves: list[Curve] = []

    def take(some: list[Row]) -> None:
        rows.extend(some)
        show(some)

    if {"2", "7"} & set(plan.parts):
        some, curves = table_two(plan, sequences, tell)
        take(some)
    if "5" in plan.parts:
        take(figure_five(plan, sequences, tell))
    if "three" in plan.parts:
        take(three_trackers(plan, sequences, tell))
    if "faults" in plan.parts:
        take(recovery(plan, sequences, tell))
    if "rejections" in plan.parts:
        take(rejections(plan, sequences, tell))
    if "search" in plan.parts:
        take(search_quality(plan, sequences, tell))
    if "speed" in plan.parts:
        take(_speed(plan, sequences, tell))
    table = sizes or plan.data / SIZES_FILE
    if "1" in plan.parts and plan.people and table.is_file():
        asf = sorted(motions_folder(plan.data).glob("**/*.[aA][sS][fF]"))
        take(calibration_rows(table, asf, plan.people, plan.conditions.seed, workers=plan.workers, progress=tell))
    truths = motions_digest(case.truth for case in sequences.cases)
    digests = " ".join([truths, *(opened(folder).digest for folder in plan.libraries)])
    return SixTrackers(
        Results("six-trackers", hashlib.sha256(digests.encode()).hexdigest(), tuple(rows)), tuple(curves)
    )


def read_table(plan: Plan, tell: Progress) -> Sequences:
    """The sequences of the tables, after making sure that every library can leave them out.

    Raises:
        PoseloomError: where a sequence chose settings, or a library does not know it.
    """
    motions = motions_folder(plan.data)
    named = table_sequences(motions)
    cases = read_sequences(motions, named, plan.conditions, tell)
    chosen = read_sequences(motions, validation_sequences(motions), plan.conditions)
    if not plan.libraries:
        raise PoseloomError("no library was given", remedy="Build them with `poseloom benchmark libraries`")
    for folder in plan.libraries:
        check_apart(opened(folder), cases, chosen)
        for case in cases:
            forbidden_takes(opened(folder), case, False)
    indices = range(0, len(cases), _EVERY) if plan.quick else range(len(cases))
    seeds = tuple(plan.conditions.seed + index for index in indices)
    return Sequences(tuple(cases[i] for i in indices), tuple(named[i] for i in indices), seeds)


def _speed(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    case = max(sequences.cases, key=lambda case: min(len(case.truth), plan.limit))
    with tempfile.TemporaryDirectory(prefix="poseloom-benchmark-") as scratch:
        file = Path(scratch) / "sequence.mcap"
        recording = recording_of(
            Trial(OURS, case, plan.conditions.seed, plan.conditions, plan.libraries[0], limit=plan.limit)
        )
        write_recording(recording, file)
        return speed(plan, file, tell)


def _silent(what: str, done: int, total: int) -> None:
    pass


def _ignore(rows: list[Row]) -> None:
    pass
