"""Transitions: how smoothly and how soon a method follows when the behaviour changes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.benchmark.one_imu.measures import (
    foot_skate_cm_s,
    jitter_km_s3,
    largest_velocity_jump_m_s,
    pose_errors_cm,
    standing_soles,
)
from poseloom.benchmark.one_imu.plan import FOOT, OURS, Plan, Progress
from poseloom.benchmark.one_imu.sequences import Take
from poseloom.benchmark.one_imu.splices import Splice, splice
from poseloom.benchmark.one_imu.trials import Question, Run, fitted, pooled, run_on, seed_of
from poseloom.evaluation.rows import Row
from poseloom.methods import Reconstructor
from poseloom.methods.imus.phase_hmm import PhaseHmm
from poseloom.sensors import Recording, layout
from poseloom.skeleton.motion import Motion
from poseloom.synthesis import simulate_imus

METHODS = (OURS, "nearest-window", "motion-graph")

_AROUND = 0.5
"""Seconds before and after a change that count."""

_STILL, _WALKING = 0.15, 0.5
"""Speeds of the hips, m/s, below which a person stands and above which one walks."""

_NATURAL: tuple[tuple[str, str], ...] = (
    *(("idle-walk", f"cmu_expmap/train/walking_extra/walking_{i}") for i in (18, 31, 32, 52)),
    *(("walk-idle", f"cmu_expmap/train/walking_extra/walking_{i}") for i in (22, 24)),
)
"""Transitions as they were recorded."""

_HELD = 0.1
"""Seconds for which the new behaviour must stay the most probable one to count as recognised."""


@dataclass(frozen=True, eq=False)
class Change:
    """A motion in which something changes.

    Attributes:
        kind: What to what, such as "walk-run".
        motion: The motion.
        frame: When.
        towards: The behaviour after it, where a model may tell it from the one before; else empty.
        out: Sequences that must be left out.
    """

    kind: str
    motion: Motion
    frame: int
    towards: str
    out: tuple[str, ...]


class _Figures(NamedTuple):
    """Of one run around one change."""

    jump: float
    jerk: float
    skate: float
    error: float
    delay: float


def transitions(plan: Plan, tell: Progress) -> list[Row]:
    """Velocity jump, jerk and foot skate around changes, of the methods and of the truth; and how soon ours follows."""
    changes, methods = changes_of(plan), plan.chosen(METHODS)
    figures: dict[tuple[str, str], list[_Figures]] = {}
    for done, change in enumerate(changes):
        tell("transitions", done, len(changes))
        recording = simulate_imus(change.motion, layout(FOOT), seed=seed_of(change.motion.name, plan.seed, change.kind))
        for method in methods:
            fit = fitted(Question(plan.data, method, FOOT, change.out, seed=plan.seed, mirrored=plan.mirrored))
            run = run_on(fit, recording)
            found = _figures(change, run, _delay(change, fit, recording))
            figures.setdefault((change.kind, method), []).append(found)
            if method == methods[0]:
                itself = _figures(change, Run(run.truth, run.made), float("nan"), run.truth)
                figures.setdefault((change.kind, "truth"), []).append(itself)
    tell("transitions", len(changes), len(changes))
    return [row for (kind, method), some in figures.items() for row in _rows(plan, kind, method, some)]


def changes_of(plan: Plan) -> list[Change]:
    """Recorded starts and stops, and walks and runs put together from sequences of one fold."""
    pool = pooled(plan.data)
    asked = {take.source: take for take in (*pool.tables, *pool.transitions)}
    found: list[Change] = []
    for kind, source in _NATURAL:
        take = asked[source]
        frame = _onset(take.motion, kind)
        found.append(_cut(Change(kind, take.motion, frame, "", _sources(pool.fold_of(take)))))
    for fold in pool.folds:
        natural = {source for _, source in _NATURAL}
        walks = [t for t in fold if t.behaviour == "walking" and t.source not in natural]
        runs = [t for t in fold if t.behaviour == "running" and t.person == "cmu"]
        for index, walk in enumerate(walks[:2]):
            other = walks[(index + 1) % len(walks)]
            found.append(_spliced("walk-walk", walk, other, "", fold))
            found += [_spliced("walk-run", walk, run, "running", fold) for run in runs[:1]]
            found += [_spliced("run-walk", run, walk, "walking", fold) for run in runs[:1]]
    return found[::6] if plan.quick else found


def _spliced(kind: str, first: Take, second: Take, towards: str, fold: Sequence[Take]) -> Change:
    lead = 0.6 if first.behaviour == "running" else 1.0
    tail = 0.6 if second.behaviour == "running" else 1.0
    made: Splice = splice(first.motion, second.motion, lead, tail)
    return Change(kind, made.motion, made.change, towards, _sources(fold))


def _cut(change: Change) -> Change:
    """A second before the change and a second after it."""
    rate = change.motion.rate
    start = max(change.frame - round(rate), 0)
    motion = change.motion.cut(start, min(change.frame + round(rate), len(change.motion)))
    return Change(change.kind, motion, change.frame - start, change.towards, change.out)


def _onset(motion: Motion, kind: str) -> int:
    """When a walk begins, or ends: the hips' speed over a third of a second goes through 0.3 m/s for the first time."""
    reach = round(motion.rate / 6)
    frames = np.arange(len(motion))
    first, last = np.maximum(frames - reach, 0), np.minimum(frames + reach, len(motion) - 1)
    ground = motion.q[:, [0, 2]]
    speed = np.linalg.norm(ground[last] - ground[first], axis=1) * motion.rate / (last - first)
    limit = (_STILL + _WALKING) / 2
    moving = np.flatnonzero(speed > limit)
    if kind == "idle-walk":
        return int(moving[0])
    walking = int(np.flatnonzero(speed > _WALKING)[0])
    return int(walking + np.flatnonzero(speed[walking:] < limit)[0])


def _figures(change: Change, run: Run, delay: float, motion: Motion | None = None) -> _Figures:
    estimate = run.made.motion if motion is None else motion
    frame = change.frame - int(run.made.samples[0])
    reach = round(_AROUND * estimate.rate)
    start, stop = max(frame - reach, 0), min(frame + reach, len(estimate))
    part, true = estimate.cut(start, stop), run.truth.cut(start, stop)
    return _Figures(
        largest_velocity_jump_m_s(estimate, start, stop),
        jitter_km_s3(part),
        foot_skate_cm_s(part, standing_soles(run.truth)[start:stop]),
        float(pose_errors_cm(true, part).mean()),
        delay,
    )


def _delay(change: Change, method: Reconstructor[Any], recording: Recording) -> float:
    """Seconds from the change until the new behaviour is and stays the most probable; NaN where none can tell it."""
    if not change.towards or not isinstance(method, PhaseHmm):
        return float("nan")
    share = behaviour_shares(method, recording, change.towards)
    held = max(round(_HELD * recording.layout.rate), 1)
    known = np.convolve(share[change.frame :] > 0.5, np.ones(held), mode="valid") >= held
    return float(np.argmax(known) / recording.layout.rate) if known.any() else len(known) / recording.layout.rate


def behaviour_shares(method: PhaseHmm, recording: Recording, behaviour: str) -> Floats[Array, "samples"]:
    """The probability of a behaviour at each sample, by the model's phases."""
    state = method.start(recording.skeleton, recording.placements)
    shares = np.zeros(len(recording))
    for index in range(len(recording)):
        state, _ = method.step(state, recording.sample(index))
        phases = method.phase_probabilities(state)
        shares[index] = sum(share for name, share in phases.items() if name.startswith(f"{behaviour}:"))
    return shares


def _rows(plan: Plan, kind: str, method: str, some: Sequence[_Figures]) -> list[Row]:
    names = ("largest_velocity_jump_m_s", "jerk_km_s3", "foot_skate_cm_s", "joint_position_cm", "recognised_after_s")
    rows: list[Row] = []
    for name, column in zip(names, zip(*some, strict=True), strict=True):
        known = np.array([value for value in column if np.isfinite(value)])
        if len(known) and not (method == "truth" and name == "joint_position_cm"):
            spread = float(known.std(ddof=1)) if len(known) > 1 else None
            frames = round(2 * _AROUND * 60) * len(known)
            rows.append(
                Row("transitions", method, kind, "by-sequence", name, float(known.mean()), spread, len(known), frames,
                    plan.seed)
            )  # fmt: skip
            if name == "recognised_after_s":
                rows.append(
                    Row("transitions", method, kind, "by-sequence", "worst_recognised_after_s", float(known.max()),
                        None, len(known), frames, plan.seed)
                )  # fmt: skip
    return rows


def _sources(takes: Sequence[Take]) -> tuple[str, ...]:
    return tuple(take.source for take in takes)
