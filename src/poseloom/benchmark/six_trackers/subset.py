"""The two libraries of table 2: all recordings with their mirror images, and as many poses as the paper's small one."""

from collections.abc import Callable
from pathlib import Path, PurePosixPath

import numpy as np

from poseloom.benchmark.six_trackers.sequences import (
    BORROWED_SKELETONS,
    covering_takes,
    motions_folder,
    read_sequences,
    table_sequences,
    takes_by_digest,
    validation_sequences,
)
from poseloom.evaluation.cases import Conditions
from poseloom.library import MotionLibrary, build_library, open_library

PAPERS_POSES = 65_609
"""Size of the paper's small library."""

SCALE_ONLY = "bandai"
"""Recordings for tests of scale only; the small library has none of them."""


def build_libraries(
    data: Path,
    out: Path,
    seed: int = 0,
    workers: int = 2,
    replace_existing: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Path, Path]:
    """Builds both libraries, `small` and `large`, in a folder.

    Args:
        data: Folder of the recordings.
        out: Folder for the libraries.
        seed: Of the takes that the small one does without.
        workers: Processes.
        replace_existing: Replace libraries that are there.
        progress: Told how far it is.

    Returns:
        The folders of the small and of the large one.
    """
    motions = motions_folder(data)
    skeletons = {pattern: motions / file for pattern, file in BORROWED_SKELETONS.items()}
    small, large = out / "small", out / "large"
    out.mkdir(parents=True, exist_ok=True)
    build_library(
        [motions], large, mirror=True, skeletons=skeletons, workers=workers,
        replace_existing=replace_existing, progress=progress,
    )  # fmt: skip
    left_out = sources_left_out(open_library(large), motions, seed)
    build_library(
        [motions], small, exclude=(SCALE_ONLY, *left_out), skeletons=skeletons, workers=workers,
        replace_existing=replace_existing, progress=progress,
    )  # fmt: skip
    return small, large


def sources_left_out(library: MotionLibrary, motions: Path, seed: int) -> tuple[str, ...]:
    """Sources to leave out so that about `PAPERS_POSES` remain of all but the scale-only recordings.

    Whole takes go, in a seeded order, none of them a sequence of the benchmark or one that covers such a sequence.
    """
    conditions = Conditions()
    named = (*table_sequences(motions), *validation_sequences(motions))
    kept: set[str] = set()
    for case in read_sequences(motions, named, conditions):
        kept |= {takes_by_digest(library)[case.digest], *covering_takes(library, case)}
    clips = [c for c in library.clips if not c.mirrored and SCALE_ONLY not in PurePosixPath(c.source).parts]
    poses: dict[str, int] = {}
    for clip in clips:
        poses[clip.take] = poses.get(clip.take, 0) + len(clip)
    surplus = sum(poses.values()) - PAPERS_POSES
    spare = [take for take in sorted(poses) if take not in kept]
    gone: set[str] = set()
    order = np.random.default_rng(seed).permutation(len(spare))
    for take in (spare[int(index)] for index in order):
        if poses[take] <= surplus:
            gone.add(take)
            surplus -= poses[take]
    return tuple(sorted(clip.source for clip in clips if clip.take in gone))
