"""How good and how fast the search is: against exact search, in time, and in memory."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import faiss as _faiss  # pyright: ignore[reportMissingTypeStubs]
import numpy as np

from poseloom.benchmark.six_trackers.accuracy import Sequences, rows_of
from poseloom.benchmark.six_trackers.plan import OURS, PAPERS, Plan, Progress
from poseloom.benchmark.six_trackers.sequences import forbidden_takes, takes_by_digest
from poseloom.benchmark.six_trackers.trials import Trial, opened, recording_of, warm_up
from poseloom.errors import PoseloomError
from poseloom.evaluation.cases import Case
from poseloom.evaluation.results import compare
from poseloom.evaluation.rows import Row
from poseloom.library import MotionLibrary
from poseloom.library.index import MomentIndex
from poseloom.methods import LocalFilter, reconstruct
from poseloom.sensors import Recording, layout

faiss: Any = _faiss

QUERIES = 300
"""Moments whose neighbours are compared with the exact ones."""

EFFECT_SEQUENCES, EFFECT_SAMPLES = 8, 100
"""On how much the whole method is run with exact search."""

_SPEED = """
import json, sys
import numpy as np
import poseloom
from poseloom.benchmark.memory import peak_memory
from poseloom.methods import make_method, reconstruct
library, recording = poseloom.open_library(sys.argv[1]), poseloom.read_recording(sys.argv[2])
method = make_method(sys.argv[3], recording.layout, library)
reconstruct(method, recording.cut(0, 20))
steps = np.concatenate([reconstruct(method, recording).step_seconds for _ in range(3)])
print(json.dumps({
    "steps": len(steps),
    "step_ms_p50": 1e3 * float(np.percentile(steps, 50)),
    "step_ms_p99": 1e3 * float(np.percentile(steps, 99)),
    "memory_gib": peak_memory() / 1024,
}))
"""


class Exact(NamedTuple):
    """A library that searches exactly.

    Attributes:
        library: The same poses.
        moments: Its moments.
    """

    library: MotionLibrary
    moments: MomentIndex


def exact(library: MotionLibrary, index: MomentIndex) -> Exact:
    """The library with its search of these moments done exhaustively."""
    width = _width(index)
    flat = faiss.IndexFlatL2(width)
    for start in range(0, len(index.columns), 50_000):
        flat.add(np.ascontiguousarray(index.columns[start : start + 50_000, :width]))
    exhaustive = replace(index, _whole=flat)
    return Exact(replace(library, _indexes={index.features.settings: exhaustive}), exhaustive)


def search_quality(plan: Plan, sequences: Sequences, tell: Progress) -> list[Row]:
    """Share of the nearest moments that the search finds, and what that does to the result, at each size."""
    rows: list[Row] = []
    for folder in plan.libraries:
        library = opened(folder)
        label = f"search, {len(library.poses):,} poses"
        setting = f"{len(library.poses):,} poses"
        recording = recording_of(Trial(OURS, sequences.cases[0], 0, plan.conditions, folder, limit=20))
        method = LocalFilter(library, recording.layout)
        index = library.moments(method.features)
        thorough = exact(library, index)
        count = method.neighbours.neighbours
        shares = [
            recall(index, thorough.moments, library, case, count, max(1, QUERIES // len(sequences.cases)), plan, number)
            for number, case in enumerate(sequences.cases)
        ]
        rows += rows_of(
            "search", OURS, setting, "by-sequence", [(f"recall_at_{count}", shares)], QUERIES, plan.conditions.seed
        )
        pairs: list[tuple[float, float]] = []
        for done, (case, seed) in enumerate(_some(sequences)):
            trial = Trial(OURS, case, seed, plan.conditions, folder, limit=EFFECT_SAMPLES)
            heard = recording_of(trial)
            pairs.append((_error(library, heard, case), _error(thorough.library, heard, case)))
            tell(label, done + 1, EFFECT_SEQUENCES)
        frames = EFFECT_SAMPLES * len(pairs)
        values = [
            ("joint_angle_deg_approximate", [a for a, _ in pairs]),
            ("joint_angle_deg_exact", [b for _, b in pairs]),
            ("difference_deg", [a - b for a, b in pairs]),
        ]
        rows += rows_of("search", OURS, setting, "by-sequence", values, frames, plan.conditions.seed)
    return rows


def recall(
    index: MomentIndex,
    thorough: MomentIndex,
    library: MotionLibrary,
    case: Case,
    count: int,
    queries: int,
    plan: Plan,
    number: int,
) -> float:
    """Share of the `count` exactly nearest moments among those found, over moments of a sequence, its take left out."""
    clip = next(c for c in library.clips if c.digest == case.digest and not c.mirrored)
    assert clip.take == takes_by_digest(library)[case.digest]
    allowed = library.rows_excluding(forbidden_takes(library, case, False))
    exclusion = index.exclusion(allowed)
    own = np.flatnonzero((index.rows >= clip.start) & (index.rows < clip.stop))
    if len(own) == 0:
        return float("nan")
    rng = np.random.default_rng([plan.conditions.seed, number])
    chosen = rng.choice(own, size=min(queries, len(own)), replace=False)
    found: list[float] = []
    for row in chosen:
        query = index.columns[row, : _width(index)]
        near, _ = index.search(query.astype(np.float64), count, exclusion)
        best, _ = thorough.search(query.astype(np.float64), count, exclusion)
        found.append(len(set(near.tolist()) & set(best.tolist())) / len(best))
    return float(np.mean(found))


def speed(plan: Plan, recording_file: Path, tell: Progress) -> list[Row]:
    """Steps in a process of its own for each library, on one thread, nothing left out; and its memory."""
    rows: list[Row] = []
    questions = [(folder, method) for folder in plan.libraries for method in (OURS, PAPERS)]
    for done, (folder, method) in enumerate(questions):
        setting = f"{len(opened(folder).poses):,} poses"
        told = _measured(folder, recording_file, method)
        steps = int(told.pop("steps"))
        rows += [Row("speed", method, setting, "none", name, value, frames=steps) for name, value in told.items()]
        tell("speed", done + 1, len(questions))
    if len(plan.libraries) > 1:
        for method in (OURS, PAPERS):
            small, *_, large = (r for r in rows if r.method == method and r.metric == "step_ms_p50")
            setting = f"{large.setting} over {small.setting}"
            rows.append(
                Row("speed", method, setting, "none", "step_p50_ratio", large.value / small.value, frames=small.frames)
            )
    return rows


def _measured(folder: Path, recording_file: Path, method: str) -> dict[str, float]:
    import os

    environment = {**os.environ, **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")}
    answer = subprocess.run(
        [sys.executable, "-c", _SPEED, str(folder), str(recording_file), method],
        capture_output=True, text=True, encoding="utf-8", env=environment, check=False,
    )  # fmt: skip
    if answer.returncode != 0:
        raise PoseloomError("a process that was to be timed failed", cause=answer.stderr.strip().splitlines()[-1])
    return json.loads(answer.stdout)


def _width(index: MomentIndex) -> int:
    settings = index.features.settings
    return index.columns.shape[1] if settings.by_sensors else index.history.basis.shape[1]


def _some(sequences: Sequences) -> list[tuple[Case, int]]:
    every = max(1, len(sequences.cases) // EFFECT_SEQUENCES)
    return list(zip(sequences.cases, sequences.seeds, strict=True))[::every][:EFFECT_SEQUENCES]


def _error(library: MotionLibrary, recording: Recording, case: Case) -> float:
    truth = recording.truth
    assert truth is not None  # it was simulated
    allowed = library.rows_excluding(forbidden_takes(library, case, False))
    method = LocalFilter(library, layout(recording.layout.name), allowed=allowed)
    warm_up(method, recording)
    made = reconstruct(method, recording)
    return compare(OURS, truth, made.motion, made.samples).metrics["joint_angle_deg"]
