"""`python -m poseloom.training.prior shards|train|export|measure`: makes the priors that ship."""

import argparse
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from poseloom.training.prior.export import CONDITIONS, export_prior, measure_people
from poseloom.training.prior.judging import Conditions, judge, judging_batch, mean_measures
from poseloom.training.prior.loop import SPECS, PriorSettings, read_checkpoint, train_prior
from poseloom.training.prior.motions import MotionPool
from poseloom.training.prior.network import NetworkShape, PriorGru, widened
from poseloom.training.prior.people import Role, role_of
from poseloom.training.prior.sets import NAMED_SETS
from poseloom.training.prior.shards import Shard, build_shards, read_shard

_JUDGED: Mapping[str, tuple[str, ...]] = {
    "six": ("six-imus",),
    "any": ("six-imus", "six-trackers", "three-trackers", "pelvis-wrists", "wrist-pocket", "slimevr-6", "flex-four"),
}


def shards_of(folder: Path, role: Role) -> list[Shard]:
    """All shards of a role, in a fixed order."""
    shards = [read_shard(path) for path in sorted(folder.glob("*.npz"))]
    return [shard for shard in shards if role_of(shard.person) is role]


class _Judge:
    """Measures on validation people: noisy sensors, no calibration pose."""

    def __init__(self, kind: str, sets: tuple[str, ...], shards: list[Shard]) -> None:
        self._batches = {
            (name, shard.person): judging_batch(shard, SPECS[kind], NAMED_SETS[name][1], Conditions(), most=16)
            for name in sets
            for shard in shards
        }

    def __call__(self, network: nn.Module) -> dict[str, float]:
        measures: dict[str, float] = {}
        for (name, person), batch in self._batches.items():
            for what, value in judge(network, batch).items():
                measures[f"{name} {person} {what}"] = round(value, 4)
        return measures


def _train(options: argparse.Namespace) -> None:
    torch.set_num_threads(options.threads)
    settings = PriorSettings(
        kind=options.kind, shape=NetworkShape(options.hidden), steps=options.steps, rate=options.rate,
        size=options.size, tail=options.tail,
    )  # fmt: skip
    settings = replace(settings, motions=replace(settings.motions, frames=options.frames))
    pool = MotionPool(shards_of(options.shards, Role.TRAIN))
    judge_all = _Judge(options.kind, _JUDGED[options.kind], shards_of(options.shards, Role.VALIDATE))
    start = _start(options) if options.start else None
    options.out.parent.mkdir(parents=True, exist_ok=True)
    train_prior(
        pool, settings, judge_all, options.seed, options.out, options.every,
        lambda entry: print(json.dumps({k: round(v, 3) for k, v in entry.items()}), flush=True), start,
    )  # fmt: skip


def _start(options: argparse.Namespace) -> Mapping[str, Tensor]:
    """Weights to begin with; those of a network that receives less are widened."""
    content = read_checkpoint(options.start)
    kind = json.loads(content["settings"])["kind"]
    weights: Mapping[str, Tensor] = content["mean"]
    return weights if kind == options.kind else widened(weights, SPECS[kind], SPECS[options.kind], options.seed)


def _loaded(options: argparse.Namespace) -> tuple[PriorGru, dict[str, Any]]:
    """A checkpoint's mean network, and the checkpoint."""
    content = read_checkpoint(options.checkpoint)
    settings = json.loads(content["settings"])
    network = PriorGru(SPECS[settings["kind"]], NetworkShape(**settings["shape"]))
    network.load_state_dict(content["mean"])
    return network.eval(), {**content, "kind": settings["kind"]}


def _export(options: argparse.Namespace) -> None:
    network, content = _loaded(options)
    shards = [read_shard(path) for path in sorted(options.shards.glob("*.npz"))]
    made = export_prior(network, content["kind"], shards, options.out, content["seed"], content["curve"])
    print(json.dumps({"card": made.card, "sigma factors": made.sigma_factors.round(3).tolist()}, indent=1))


def _measure(options: argparse.Namespace) -> None:
    network, content = _loaded(options)
    role = Role.TEST if options.test else Role.VALIDATE
    shards = shards_of(options.shards, role)
    sets = ("six-imus",) if content["kind"] == "six" else tuple(options.sets or NAMED_SETS)
    table = {
        name: {
            condition: measure_people(network, content["kind"], shards, [name], how, share, most=options.most)
            for condition, (how, share) in CONDITIONS.items()
        }
        for name in sets
    }
    text = json.dumps(
        {"people": role.value, "step": content["step"], "seed": content["seed"], "table": table}, indent=1
    )
    if options.out:
        options.out.write_text(text + "\n", encoding="utf-8")
    for name, conditions in table.items():
        for condition, people in conditions.items():
            mean = mean_measures(list(people.values()))
            print(f"{name:20s} {condition:38s}", " ".join(f"{what} {value:.2f}" for what, value in mean.items()))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m poseloom.training.prior", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    shards = commands.add_parser("shards", help="make shards of the recordings")
    shards.add_argument("--data", type=Path, required=True)
    shards.add_argument("--out", type=Path, required=True)
    train = commands.add_parser("train", help="train a prior, or go on with it")
    train.add_argument("kind", choices=tuple(SPECS))
    train.add_argument("--shards", type=Path, required=True)
    train.add_argument("--out", type=Path, required=True, help="the checkpoint; the loss curve goes beside it")
    train.add_argument("--steps", type=int, default=4000)
    train.add_argument("--rate", type=float, default=2e-3)
    train.add_argument("--tail", type=float, default=1.0, help="share of the steps in which the rate falls")
    train.add_argument("--size", type=int, default=24)
    train.add_argument("--frames", type=int, default=160)
    train.add_argument("--hidden", type=int, default=256)
    train.add_argument("--every", type=int, default=50)
    train.add_argument("--seed", type=int, default=1)
    train.add_argument("--threads", type=int, default=1)
    train.add_argument("--start", type=Path, help="a checkpoint whose weights to begin with")
    export = commands.add_parser("export", help="write the file that runs without torch")
    measured = commands.add_parser("measure", help="measure a checkpoint on people who are left out")
    for command in (export, measured):
        command.add_argument("checkpoint", type=Path)
        command.add_argument("--shards", type=Path, required=True)
        command.add_argument("--out", type=Path, required=command is export)
    measured.add_argument("--test", action="store_true", help="the test people; else those who validate")
    measured.add_argument("--sets", nargs="*", choices=tuple(NAMED_SETS))
    measured.add_argument("--most", type=int, default=24, help="stretches of ten seconds a person")
    options = parser.parse_args()
    if options.command == "shards":
        build_shards(options.data, options.out, progress=lambda person, frames: print(person, frames, flush=True))
    else:
        {"train": _train, "export": _export, "measure": _measure}[options.command](options)


if __name__ == "__main__":
    main()
