"""The flex paper's tables: every contestant, both splits, several seeds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from poseloom.benchmark.flex.conditions import ageing_rows, fault_rows, replacement_rows
from poseloom.benchmark.flex.material import BY_SUBJECT, NEW_SUIT, WITHIN, Inputs, Material, prepare
from poseloom.benchmark.flex.scoring import PieceScore, Teller, score_outputs, score_pieces
from poseloom.benchmark.flex.speed import speed_rows
from poseloom.benchmark.flex.tables import by_joint, by_motion, by_person, paired, summarised
from poseloom.benchmark.flex.trials import (
    NETWORKS,
    OURS,
    PAPERS,
    PLAIN,
    Effort,
    Trial,
    fit_trial,
    live,
    outputs_of,
    plain_comparator,
)
from poseloom.evaluation.rows import Results, Row
from poseloom.training.fitting import Fitted, TrainingSets

Runs = dict[str, list[tuple[PieceScore, ...]]]
"""By contestant: for each seed the scores of all pieces."""

Progress = Callable[[str, int, int], None]

LENGTHS = (40, 60, 80, 100, 120)
"""Samples that the calibrator hears, table 6."""


FULL_SIZE = 512
"""Units in each direction of the paper's network as it was built there."""


@dataclass(frozen=True)
class Plan:
    """What to run.

    Attributes:
        data: Folder of the recordings.
        work: Folder for the library and for checkpoints; a run that was killed goes on from there.
        seeds: Number of seeds of ours and of the paper's network, for each split.
        other_seeds: Number of seeds of the paper's other networks, at most that.
        effort: What training may cost.
        draws: Sets of training sensors.
        thin: Keep every so many clips only.
        lengths: Calibration lengths of table 6.
        length_seeds: Number of seeds for those, and for ranges that are found once.
        full: Whether the paper's network is fitted at its full size, too.
    """

    data: Path
    work: Path
    seeds: Mapping[str, int] = field(default_factory=lambda: {WITHIN: 3, BY_SUBJECT: 2})
    other_seeds: int = 2
    effort: Effort = field(default=Effort())
    draws: int = 4
    thin: int = 1
    lengths: tuple[int, ...] = LENGTHS
    length_seeds: int = 1
    full: bool = False


def quick_plan(data: Path, work: Path) -> Plan:
    """A look at everything, at small size: figures mean little."""
    effort = Effort(epochs=2, stride=32, hidden=64, our_epochs=3, our_hidden=64)
    return Plan(data, work, {WITHIN: 2, BY_SUBJECT: 1}, 1, effort, 2, 3, (40, 100), 1, False)


def run_flex(plan: Plan, progress: Progress) -> Results:
    """Runs everything that a plan names.

    Args:
        plan: What.
        progress: Told the name of what is being done, and how many of how many are.
    """
    material = prepare(plan.data, plan.work, plan.draws, plan.thin, progress)
    rows: list[Row] = []
    for split in (WITHIN, BY_SUBJECT):
        rows += _split_rows(material, plan, split, progress)
    rows += _length_rows(material, plan, progress)
    rows += _first_range_rows(material, plan, progress)
    return Results("flex", material.library.digest, tuple(rows))


def _fit(
    material: Material,
    plan: Plan,
    trial: Trial,
    progress: Progress,
    sets: TrainingSets | None = None,
) -> Fitted:  # fmt: skip
    return fit_trial(
        material, trial, plan.effort, plan.work / "trials",
        lambda done, most, error: progress(trial.name, done, most), sets,
    )  # fmt: skip


def _split_rows(material: Material, plan: Plan, split: str, progress: Progress) -> list[Row]:
    """Tables 2, 3 and 5 of one split, and what becomes of its networks under ageing, faults and replacement."""
    inputs = material.heard(material.suit(split))
    pieces = material.divided(split).test
    found: Runs = {}
    spoken: dict[str, Teller] = {}
    for name in PLAIN:
        chosen = plain_comparator(material, split, name)
        found[name] = [score_pieces(material.sessions, pieces, inputs, chosen.tell)]
        spoken[name] = chosen.tell
    networks: dict[str, Fitted] = {}
    for trial in trials_of(plan, split):
        fitted = _fit(material, plan, trial, progress)
        _score_into(found, material, split, inputs, trial, fitted)
        if trial.seed == 0 and trial.hidden is None:
            networks[trial.contestant] = fitted
    rows = summarised("5", split, found) + paired(split, found)
    shown = {name: found[name] for name in ("Bi-LSTM-CM", OURS, "nearest windows", "mean pose")}
    rows += by_motion(split, shown) + by_joint(split, shown) + by_person(split, shown)
    spoken = {
        "Bi-LSTM-M": live(networks["Bi-LSTM"]),
        "Bi-LSTM-CM": live(networks["Bi-LSTM-C"]),
        OURS: live(networks[OURS]),
        "nearest windows": spoken["nearest windows"],
    }
    if split == WITHIN:
        rows += _new_suit_rows(material, spoken)
        rows += ageing_rows(material, split, spoken, "range learnt on line")
        return rows + speed_rows(networks)
    return rows + fault_rows(material, split, spoken) + replacement_rows(material, split, spoken)


def trials_of(plan: Plan, split: str) -> list[Trial]:
    """What is fitted for the tables of one split."""
    trials: list[Trial] = []
    for seed in range(plan.seeds[split]):
        names = (OURS, *(NETWORKS if seed < plan.other_seeds else PAPERS))
        trials += [Trial(name, split, seed) for name in names]
        if plan.full and split == WITHIN:
            trials.append(Trial("Bi-LSTM-C", split, seed, hidden=FULL_SIZE))
    return trials


def labelled(contestant: str, output: str) -> str:
    """What tables call a network's output."""
    if contestant == OURS:
        return OURS if output == "smoothed" else f"{OURS}, not smoothed"
    if output == "plain":
        return contestant
    name = f"{contestant}M" if contestant.endswith("-C") else f"{contestant}-M"
    return name if output == "median" else f"{name}, centred"


def _score_into(
    found: Runs, material: Material, split: str, inputs: Sequence[Inputs], trial: Trial, fitted: Fitted
) -> None:
    pieces = material.divided(split).test
    scores = score_outputs(material.sessions, pieces, inputs, fitted.tell, outputs_of(fitted))
    for output, own in scores.items():
        size = "" if trial.hidden is None else f", {trial.hidden} units"
        found.setdefault(labelled(trial.contestant, output) + size, []).append(own)


def _new_suit_rows(material: Material, spoken: Mapping[str, Teller]) -> list[Row]:
    """The same motions in sensors that nobody has trained on."""
    inputs = material.heard(NEW_SUIT)
    pieces = material.within.test
    found = {name: [score_pieces(material.sessions, pieces, inputs, tell)] for name, tell in spoken.items()}
    return summarised("other sensors", WITHIN, found)


def _length_rows(material: Material, plan: Plan, progress: Progress) -> list[Row]:
    inputs = material.heard(material.suit(WITHIN))
    found: Runs = {}
    for length in plan.lengths:
        for seed in range(plan.length_seeds):
            fitted = _fit(material, plan, Trial("Bi-LSTM-C", WITHIN, seed, length), progress)
            own = score_pieces(material.sessions, material.within.test, inputs, live(fitted))
            found.setdefault(str(length), []).append(own)
    rows = summarised("6", WITHIN, found)
    return [replace(row, method="Bi-LSTM-CM", setting=f"{row.method} samples") for row in rows]


def _first_range_rows(material: Material, plan: Plan, progress: Progress) -> list[Row]:
    """The ablation of C where it is needed: ranges found once, when the sensors were new."""
    sets = material.sets_at_first_range()
    inputs = material.heard_at_first_range(material.suit(WITHIN))
    found: Runs = {}
    spoken: dict[str, Teller] = {}
    for seed in range(plan.length_seeds):
        for contestant, name in (("Bi-LSTM", "Bi-LSTM-M"), ("Bi-LSTM-C", "Bi-LSTM-CM")):
            trial = Trial(contestant, WITHIN, seed, fixed=True)
            fitted = _fit(material, plan, trial, progress, sets)
            _score_into(found, material, WITHIN, inputs, trial, fitted)
            spoken.setdefault(name, live(fitted))
    rows = summarised("5, first range", WITHIN, found) + paired(WITHIN, found, "range of new sensors")
    return rows + ageing_rows(material, WITHIN, spoken, "range of new sensors", at_first_range=True)


__all__ = ["LENGTHS", "Plan", "labelled", "quick_plan", "run_flex"]
