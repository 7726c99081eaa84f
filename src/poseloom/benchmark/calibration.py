"""The six-sensor paper's table 1: how well calibration finds people's sizes and the sensors' places.

People are simulated with the skeletons of real ones, each left out of the body-size model that calibrates it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.calibration.body_size import DEFAULT_COMPONENTS, fit_body_size
from poseloom.calibration.poses import guided_poses
from poseloom.calibration.session import ROUNDS_SETTING, calibrate
from poseloom.calibration.size_sources import training_bodies
from poseloom.calibration.unknowns import CalibrationSettings
from poseloom.errors import PoseloomError
from poseloom.evaluation.rows import Row
from poseloom.library.pool import in_order
from poseloom.rotations import rotvec_from_matrix
from poseloom.sensors import layout
from poseloom.skeleton.body import average_body
from poseloom.skeleton.skeleton import Skeleton
from poseloom.synthesis import true_placements
from poseloom.synthesis.holding import simulate_session

PAPER_BONES = ("femur", "tibia", "back", "neck", "head", "clavicle", "humerus", "radius")
"""Bones of the paper's table 1 that the body has; its wrist is part of our hand, which no recording measures."""

OTHER_BONES = ("hip", "foot")

_ONE_BONE = {
    "femur": "leftLowerLeg",
    "tibia": "leftFoot",
    "neck": "head",
    "clavicle": "leftUpperArm",
    "humerus": "leftLowerArm",
    "radius": "leftHand",
    "hip": "leftUpperLeg",
    "foot": "leftToes",
}


@dataclass(frozen=True, eq=False)
class CalibrationTrial:
    """One simulated person to calibrate.

    Attributes:
        body: The person's.
        others: Bodies to learn the size model from; the person's is not among them.
        rounds: How often the eight poses are held.
        components: Of the size model.
        floor: Whether calibration may use that soles stand on the floor.
        seed: Of all that is drawn.
    """

    body: Skeleton
    others: tuple[Skeleton, ...]
    rounds: int
    components: int
    floor: bool
    seed: int


class TrialErrors(NamedTuple):
    """How far a calibration is off.

    Attributes:
        bones: Length errors in percent of the true lengths, by `PAPER_BONES` and `OTHER_BONES`.
        standard: The same of the average body.
        offsets_cm: Of each sensor's place.
        turns_deg: Of each sensor's orientation.
        sigmas: Bone errors in units of the calibration's own standard deviations, over the body's single bones.
        holds: Held poses.
    """

    bones: Floats[Array, "bones"]
    standard: Floats[Array, "bones"]
    offsets_cm: Floats[Array, "sensors"]
    turns_deg: Floats[Array, "sensors"]
    sigmas: Floats[Array, "some"]
    holds: int


def bone_lengths(body: Skeleton) -> Floats[Array, "bones"]:
    """Lengths of the bones of `PAPER_BONES` and `OTHER_BONES`, metres; the back is the sum of its three segments."""

    def of(bone: str) -> float:
        return float(np.linalg.norm(body.offsets[body.index(bone)]))

    lengths = {name: of(bone) for name, bone in _ONE_BONE.items()}
    lengths["back"] = of("chest") + of("upperChest") + of("neck")
    lengths["head"] = float(np.linalg.norm(body.tips[body.index("head")]))
    return np.array([lengths[name] for name in (*PAPER_BONES, *OTHER_BONES)])


def run_trial(trial: CalibrationTrial) -> TrialErrors:
    """Simulates a guided session and calibrates from it."""
    poses = np.stack([pose.q for pose in guided_poses()] * trial.rounds)
    recording = simulate_session(
        trial.body, poses, layout("six-trackers"), seed=trial.seed, settings={ROUNDS_SETTING: str(trial.rounds)}
    )
    settings = CalibrationSettings(components=trial.components, floor_m=0.01 if trial.floor else np.inf)
    model = fit_body_size(trial.others, trial.components)
    found = calibrate(recording, settings, model)
    truth = bone_lengths(trial.body)
    worn = list(zip(found.placements, true_placements(recording), strict=True))
    true_lengths = np.linalg.norm(trial.body.offsets, axis=1)
    known = found.length_sigmas > 1e-6
    return TrialErrors(
        100 * (bone_lengths(found.skeleton) / truth - 1),
        100 * (bone_lengths(average_body()) / truth - 1),
        np.array([100 * np.linalg.norm(a.p_bone_sensor - b.p_bone_sensor) for a, b in worn]),
        np.array(
            [np.degrees(np.linalg.norm(rotvec_from_matrix(a.R_bone_sensor.T @ b.R_bone_sensor))) for a, b in worn]
        ),
        (found.lengths - true_lengths)[known] / found.length_sigmas[known],
        len(found.poses),
    )


def calibration_rows(
    sizes: Path,
    asf_files: Sequence[Path] = (),
    people: int = 20,
    seed: int = 0,
    rounds: Sequence[int] = (1, 3, 5),
    workers: int = 2,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Row]:
    """Table 1: errors of bones and placements over simulated people, the uncalibrated standard body beside them.

    Args:
        sizes: The table of CMU's skeletons.
        asf_files: ASF files that tell how long a thorax is.
        people: How many, each with another skeleton, spread evenly over those there are.
        seed: Of placements, held poses and noise.
        rounds: How often the eight poses are held; one setting each.
        workers: Processes.
        progress: Called with what is being done, and how many of how many are.

    Raises:
        PoseloomError: if there are not so many skeletons.
    """
    bodies = training_bodies(sizes, asf_files)
    if not 1 <= people <= len(bodies):
        raise PoseloomError(
            f"{people} people cannot be simulated", cause=f"the table has {len(bodies)} distinct skeletons"
        )
    chosen = [int(i) for i in np.linspace(0, len(bodies) - 1, people).round()]
    settings = [(times, DEFAULT_COMPONENTS, True) for times in rounds]
    settings += [(max(rounds), 5, True), (max(rounds), DEFAULT_COMPONENTS, False)]
    rows: list[Row] = []
    for times, components, floor in settings:
        label = f"{times} x 8 poses, {components} components{'' if floor else ', no floor'}"
        trials = [
            CalibrationTrial(bodies[i], (*bodies[:i], *bodies[i + 1 :]), times, components, floor, 1000 * seed + i)
            for i in chosen
        ]
        errors: list[TrialErrors] = []
        for each in in_order(run_trial, trials, workers):
            errors.append(each)
            if progress is not None:
                progress(label, len(errors), len(trials))
        rows += _rows(label, errors, seed, standard=not rows)
    return rows


def _rows(label: str, errors: Sequence[TrialErrors], seed: int, standard: bool) -> list[Row]:
    holds = sum(each.holds for each in errors)

    def row(method: str, metric: str, per_person: Sequence[float], setting: str) -> Row:
        spread = float(np.std(per_person, ddof=1)) if len(per_person) > 1 else None
        return Row(
            "1", method, setting, "leave-one-out", metric, float(np.mean(per_person)), spread, len(errors), holds, seed
        )

    def table(method: str, bones: Floats[Array, "people bones"], setting: str) -> list[Row]:
        off = np.abs(bones)
        paper = off[:, : len(PAPER_BONES)]
        named = zip((*PAPER_BONES, *OTHER_BONES), off.T, strict=True)
        worst = row(method, "worst_bone_percent", paper.max(axis=1).tolist(), setting)
        return [
            row(method, "bone_error_percent", paper.mean(axis=1).tolist(), setting),
            worst,
            replace(worst, metric="worst_bone_of_anyone_percent", value=float(paper.max()), spread=None),
            *(row(method, f"{name}_error_percent", values.tolist(), setting) for name, values in named),
        ]

    rows = table("standard body", np.stack([each.standard for each in errors]), "uncalibrated") if standard else []
    rows += table("calibrated", np.stack([each.bones for each in errors]), label)
    rows.append(row("calibrated", "sensor_offset_cm", [float(e.offsets_cm.mean()) for e in errors], label))
    rows.append(row("calibrated", "sensor_turn_deg", [float(e.turns_deg.mean()) for e in errors], label))
    for index, name in enumerate(layout("six-trackers").names):
        rows.append(row("calibrated", f"{name}_offset_cm", [float(e.offsets_cm[index]) for e in errors], label))
        rows.append(row("calibrated", f"{name}_turn_deg", [float(e.turns_deg[index]) for e in errors], label))
    within = [float((np.abs(e.sigmas) < 2.0).mean()) for e in errors]
    rows.append(row("calibrated", "bones_within_two_sigmas", within, label))
    return rows
