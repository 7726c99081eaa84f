"""The flex paper's tables: every contestant, both splits, several seeds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from poseloom.benchmark.flex.conditions import ageing_rows, fault_rows, replacement_rows
from poseloom.benchmark.flex.material import BY_SUBJECT, WITHIN, Inputs, Material, prepare
from poseloom.benchmark.flex.scoring import PieceScore, Teller, pooled
from poseloom.benchmark.flex.speed import speed_rows
from poseloom.benchmark.flex.tables import (
    by_joint,
    by_motion,
    by_person,
    paired,
    summarised,
)
from poseloom.benchmark.flex.trials import (
    NETWORKS,
    OURS,
    PLAIN,
    Effort,
    Trial,
    fit_trial,
    plain_comparator,
    score,
    tellers,
)
from poseloom.evaluation.rows import Results, Row
from poseloom.training.fitting import Fitted, TrainingSets

Progress = Callable[[str, int, int], None]

LENGTHS = (40, 60, 80, 100, 120)
"""Samples that the calibrator hears, table 6."""


@dataclass(frozen=True)
class Plan:
    """What to run.

    Attributes:
        data: Folder of the recordings.
        work: Folder for the library and for checkpoints; a run that was killed goes on from there.
        seeds: Number of seeds, for each split.
        effort: What training may cost.
        draws: Sets of training sensors.
        thin: Keep every so many clips only.
        lengths: Calibration lengths of table 6.
        length_seeds: Number of seeds for those.
        full: Whether the paper's network is fitted at its full size, too.
    """

    data: Path
    work: Path
    seeds: Mapping[str, int] = field(default_factory=lambda: {WITHIN: 3, BY_SUBJECT: 2})
    effort: Effort = field(default=Effort())
    draws: int = 4
    thin: int = 1
    lengths: tuple[int, ...] = LENGTHS
    length_seeds: int = 1
    full: bool = False


def quick_plan(data: Path, work: Path) -> Plan:
    """A look at everything, at small size: figures mean little."""
    effort = Effort(epochs=2, stride=32, hidden=64, our_epochs=3, our_hidden=64)
    return Plan(data, work, {WITHIN: 2, BY_SUBJECT: 1}, effort, 2, 3, (40, 100), 1, False)


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
    suits = [material.heard(suit) for suit in material.suits(split)]
    found: dict[str, list[tuple[PieceScore, ...]]] = {}
    first: dict[str, Teller] = {}
    rows: list[Row] = []
    for name in PLAIN:
        chosen = plain_comparator(material, split, name)
        found[name] = [_scores(material, split, chosen.tell, suits)]
        first[name] = chosen.tell
    networks: dict[str, Fitted] = {}
    for seed in range(plan.seeds[split]):
        for contestant in (OURS, *NETWORKS):
            fitted = _fit(material, plan, Trial(contestant, split, seed), progress)
            networks.setdefault(contestant, fitted)
            for output, tell in tellers(fitted).items():
                name = labelled(contestant, output)
                found.setdefault(name, []).append(_scores(material, split, tell, suits))
                first.setdefault(name, tell)
    if plan.full and split == WITHIN:
        for contestant in ("Bi-LSTM", "Bi-LSTM-C"):
            fitted = _fit(material, plan, Trial(contestant, split, 0, hidden=512), progress)
            for output, tell in tellers(fitted).items():
                found[f"{labelled(contestant, output)}, 512 units"] = [_scores(material, split, tell, suits)]
    rows += summarised("5", split, found)
    rows += paired(split, found)
    shown = {name: found[name] for name in ("Bi-LSTM-CM", OURS, "nearest windows", "mean pose")}
    rows += by_motion(split, shown) + by_joint(split, shown) + by_person(split, shown)
    live = {name: first[name] for name in ("Bi-LSTM", "Bi-LSTM-CM", OURS, "nearest windows")}
    if split == WITHIN:
        rows += _new_suit_rows(material, split, first)
        rows += ageing_rows(material, split, live, "range learnt on line")
        rows += speed_rows(networks)
    else:
        rows += fault_rows(material, split, live) + replacement_rows(material, split, live)
    return rows


def labelled(contestant: str, output: str) -> str:
    """What tables call a network's output."""
    if contestant == OURS:
        return OURS if output == "smoothed" else f"{OURS}, not smoothed"
    if output == "plain":
        return contestant
    name = f"{contestant}M" if contestant.endswith("-C") else f"{contestant}-M"
    return name if output == "median" else f"{name}, centred"


def _scores(material: Material, split: str, tell: Teller, suits: Sequence[Sequence[Inputs]]) -> tuple[PieceScore, ...]:
    return tuple(each for inputs in suits for each in score(material, split, tell, inputs))


def _new_suit_rows(material: Material, split: str, first: Mapping[str, Teller]) -> list[Row]:
    """The same motions in sensors that nobody has trained on."""
    inputs = [material.heard(1000)]
    names = ("nearest windows", "Bi-LSTM", "Bi-LSTM-CM", OURS)
    found = {name: [_scores(material, split, first[name], inputs)] for name in names}
    return summarised("other sensors", split, found)


def _length_rows(material: Material, plan: Plan, progress: Progress) -> list[Row]:
    suits = [material.heard(suit) for suit in material.suits(WITHIN)]
    found: dict[str, list[tuple[PieceScore, ...]]] = {}
    for length in plan.lengths:
        for seed in range(plan.length_seeds):
            fitted = _fit(material, plan, Trial("Bi-LSTM-C", WITHIN, seed, length), progress)
            told = _scores(material, WITHIN, tellers(fitted)["median"], suits)
            found.setdefault(str(length), []).append(told)
    rows = summarised("6", WITHIN, found)
    return [replace(row, method="Bi-LSTM-CM", setting=f"{row.method} samples") for row in rows]


def _first_range_rows(material: Material, plan: Plan, progress: Progress) -> list[Row]:
    """The ablation of C where it is needed: ranges found once, when the sensors were new."""
    sets = material.sets_at_first_range()
    suits = [material.heard_at_first_range(suit) for suit in material.suits(WITHIN)]
    found: dict[str, list[tuple[PieceScore, ...]]] = {}
    first: dict[str, Teller] = {}
    for seed in range(plan.seeds[WITHIN]):
        for contestant in ("Bi-LSTM", "Bi-LSTM-C"):
            fitted = _fit(material, plan, Trial(contestant, WITHIN, seed, fixed=True), progress, sets)
            for output, tell in tellers(fitted).items():
                name = labelled(contestant, output)
                found.setdefault(name, []).append(_scores(material, WITHIN, tell, suits))
                first.setdefault(name, tell)
    rows = summarised("5, first range", WITHIN, found) + paired(WITHIN, found, "range of new sensors")
    live = {name: first[name] for name in ("Bi-LSTM-M", "Bi-LSTM-CM")}
    return rows + ageing_rows(material, WITHIN, live, "range of new sensors", at_first_range=True)


def best_error(rows: Sequence[Row], split: str) -> float:
    """Least error of table 5."""
    own = [row.value for row in rows if row.table == "5" and row.split == split and row.metric == "error_deg"]
    return float(np.min(own))


__all__ = ["Plan", "best_error", "labelled", "pooled", "quick_plan", "run_flex"]
