"""What the HTML report holds, packed for the browser: poses as scaled 16-bit integers, errors as 32-bit numbers."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.evaluation import profiles
from poseloom.evaluation.metrics import METRIC_LABELS
from poseloom.evaluation.results import MethodResult, SequenceResult, mean_over_sequences, truth_of
from poseloom.skeleton.body import BODY_BONES, moving_dofs
from poseloom.skeleton.mannequin import limbs
from poseloom.skeleton.motion import Motion

TRUTH_COLOUR = "#8a8f9c"
METHOD_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#6b5b95")
"""Distinct for the colour-blind too (Okabe and Ito 2008; yellow, faint on white, left out)."""

BUDGET = 12_000
"""Poses, of truth and estimates together, that a page holds as moving figures: about 2.5 MB."""

SHORTEST_FIGURE = 20
"""Frames below which a cut-off figure is not worth showing."""

_MOST_STEPS = 20_000

_MEASURES = (
    {"key": "angle", "label": "joint angle", "unit": "°", "metric": "joint_angle_deg"},
    {"key": "position", "label": "joint position", "unit": "cm", "metric": "joint_position_cm"},
    {"key": "direction", "label": "bone direction", "unit": "°", "metric": "global_rotation_deg"},
)


def page_data(sequences: Sequence[SequenceResult]) -> dict[str, Any]:
    """All figures of a report as JSON knows them; `page/page.js` is their reader."""
    means = mean_over_sequences(sequences)
    names = list(means)
    left = BUDGET
    packed: list[dict[str, Any]] = []
    for sequence in sequences:
        frames = min(len(sequence.truth), left // (1 + len(sequence.results)))
        if frames < min(SHORTEST_FIGURE, len(sequence.truth)):
            frames = 0
        left -= frames * (1 + len(sequence.results))
        packed.append(_sequence(sequence, names, frames))
    return {
        "bones": list(BODY_BONES),
        "parents": [int(parent) for parent in sequences[0].truth.skeleton.parents],
        "joint_order": [BODY_BONES.index(name) for name in _joints_from_head_to_foot()],
        "measures": list(_MEASURES),
        "metrics": _metric_labels(),
        "truth": {"name": "truth", "colour": TRUTH_COLOUR},
        "methods": [
            {
                "name": name,
                "colour": method_colour(index),
                "metrics": {m: {"value": mean.value, "spread": mean.spread} for m, mean in means[name].items()},
            }
            for index, name in enumerate(names)
        ],
        "sequences": packed,
    }


def method_colour(index: int) -> str:
    """The colour of the method of this index."""
    return METHOD_COLOURS[index % len(METHOD_COLOURS)]


def _metric_labels() -> list[dict[str, Any]]:
    return [
        {"name": name, "label": label, "shared": name.startswith("truth_")} for name, label in METRIC_LABELS.items()
    ]


def _joints_from_head_to_foot() -> list[str]:
    limbs_ = ("Shoulder", "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")
    trunk = ["head", "neck", "upperChest", "chest", "spine", "hips"]
    return trunk + [f"{side}{bone}" for bone in limbs_ for side in ("left", "right")]


def _sequence(sequence: SequenceResult, names: Sequence[str], frames: int) -> dict[str, Any]:
    length, rate = len(sequence.truth), sequence.truth.rate
    name = sequence.name if frames in (0, length) else f"{sequence.name} (the first {frames / rate:.0f} s)"
    everywhere = np.ones(frames, dtype=np.bool_)
    return {
        "name": name,
        "rate": rate,
        "frames": frames or length,
        "truth": _track(sequence.truth.cut(0, frames), everywhere) if frames else None,
        "results": [_result(sequence.truth, result, names.index(result.name), frames) for result in sequence.results],
    }


def _result(truth: Motion, result: MethodResult, method: int, frames: int) -> dict[str, Any]:
    own = truth_of(truth, result.samples)
    errors = _errors(own, result.pose_motion(own))
    packed: dict[str, Any] = {
        "method": method,
        "metrics": {name: value for name, value in result.metrics.items() if np.isfinite(value)},
        "joints": {key: [round(float(value), 4) for value in joints] for key, (_, joints) in errors.items()},
    }
    if frames == 0:
        return packed
    shown = result.samples < frames
    present = np.zeros(frames, dtype=np.bool_)
    present[result.samples[shown]] = True
    # A frame that the method did not speak of holds the nearest one before it, and says that it is absent.
    source = np.maximum(np.searchsorted(result.samples, np.arange(frames), side="right") - 1, 0)
    steps = 1000 * result.step_seconds[np.isfinite(result.step_seconds)]
    if len(steps) > _MOST_STEPS:
        steps = steps[np.linspace(0, len(steps) - 1, _MOST_STEPS).astype(np.int64)]
    motion = Motion(result.motion.skeleton, result.motion.q[source], truth.rate)
    return packed | {
        "track": _track(motion, present),
        "errors": {
            key: _base64(_spread_out(series, result.samples, frames), "<f4") for key, (series, _) in errors.items()
        },
        "steps": _base64(steps, "<f4"),
    }


def _spread_out(
    series: Floats[Array, "frames"], samples: Ints[Array, "frames"], length: int
) -> Floats[Array, "length"]:
    out = np.full(length, np.nan)
    shown = samples < length
    out[samples[shown]] = series[shown]
    return out


def _errors(truth: Motion, estimate: Motion) -> Mapping[str, tuple[Floats[Array, "frames"], Floats[Array, "joints"]]]:
    """For each measure the error by frame and by joint."""
    moving = moving_dofs()[3:].reshape(-1, 3)
    angles = profiles.angle_errors(truth, estimate)
    by_joint = (angles.mean(axis=0) * moving).sum(axis=1) / np.maximum(moving.sum(axis=1), 1)
    places = profiles.position_errors(truth, estimate)
    turns = profiles.global_rotation_errors(truth, estimate)
    placed = [i for i, name in enumerate(BODY_BONES) if name not in ("hips", "spine")]
    return {
        "angle": (angles[:, moving].mean(axis=1), by_joint),
        "position": (places[:, placed].mean(axis=1), places.mean(axis=0)),
        "direction": (turns.mean(axis=1), turns.mean(axis=0)),
    }


def _track(motion: Motion, present: Bools[Array, "frames"]) -> dict[str, Any]:
    rotvecs = motion.q[:, 3:]
    scale = max(float(np.abs(rotvecs).max(initial=0.0)), 1e-6) / 32767
    return {
        "offsets": [[round(float(value), 5) for value in offset] for offset in motion.skeleton.offsets],
        "limbs": [
            [limb.bone, *(round(float(v), 5) for v in (*limb.start, *limb.end, *limb.side, *limb.radii))]
            for limb in limbs(motion.skeleton)
        ],
        "root": _base64(motion.root_positions, "<f4"),
        "rotvecs": _base64(np.round(rotvecs / scale), "<i2"),
        "scale": scale,
        "present": _base64(present, "u1"),
    }


def _base64(values: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=dtype).tobytes()).decode("ascii")
