"""The speed of what every method rests on: kinematics, solve, files, library, one step, start-up."""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.benchmark.startup import time_first_step, time_import
from poseloom.benchmark.timing import Timing, time_calls, timing_of
from poseloom.formats import read_motions, write_motion
from poseloom.formats.recording import write_recording
from poseloom.library import MotionLibrary, build_library, open_library
from poseloom.methods import DEFAULT_METHOD, make_method, reconstruct
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, default_placements, layout
from poseloom.skeleton import _kernels
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import make_skeleton
from poseloom.solve import GaussianPrior, SolverSettings, mount, readings, solve_pose
from poseloom.synthesis import simulate_trackers

Show = Callable[[str, int, int], None]
"""Called with the name of what is being done, and how many of how many are."""

_LAYOUT = "six-trackers"
_PAPERS_METHOD = "local-regression"
_EXCLUDED = ("bandai",)
"""Recordings that are for tests of scale only."""


@dataclass(frozen=True)
class Measurement:
    """One timing beside its bound.

    Attributes:
        name: What was timed.
        setting: On what.
        bound: Seconds that it may take.
        timing: What it took.
    """

    name: str
    setting: str
    bound: float
    timing: Timing


def measure_core(recordings: Path | None, show: Show) -> tuple[Measurement, ...]:
    """Measures everything.

    Args:
        recordings: Folder of motion files for the library, `bandai` left out; the built-in motions where None.
        show: Told how far it is.
    """
    measured: list[Measurement] = []
    recording = simulate_trackers(sample_motions()["walk"], layout(_LAYOUT))
    with tempfile.TemporaryDirectory(prefix="poseloom-benchmark-") as scratch:
        folder = Path(scratch) / "library"
        take = Path(scratch) / "walk.mcap"
        write_recording(recording, take)
        build = library_build_time(recordings, folder, show)
        library = open_library(folder)
        size = f"{len(library.poses):,} poses"
        stages: tuple[Callable[[], Measurement], ...] = (
            kinematics_time,
            lambda: solve_time(recording),
            bvh_time,
            lambda: Measurement("open a library", size, 1.0, time_calls(lambda: open_library(folder), 15)),
            lambda: step_time(DEFAULT_METHOD, library, recording),
            lambda: step_time(_PAPERS_METHOD, library, recording),
            lambda: Measurement("import poseloom", "a new process", 0.5, time_import(7)),
            lambda: Measurement("import every name", "a new process", 2.0, time_import(7, everything=True)),
            lambda: Measurement("first step, cold", size, 5.0, time_first_step(folder, take, 3, compiled=False)),
            lambda: Measurement("first step, compiled", size, 2.0, time_first_step(folder, take, 5, compiled=True)),
        )
        for done, stage in enumerate(stages):
            show("measuring", done, len(stages))
            measured.append(stage())
        show("measuring", len(stages), len(stages))
    return (*measured[:3], build, *measured[3:])


def library_build_time(recordings: Path | None, folder: Path, show: Show) -> Measurement:
    """One build of a library, as `poseloom library build` does it, on two processes."""
    begin = time.perf_counter()
    sources = ["samples" if recordings is None else recordings]
    report = build_library(sources, folder, exclude=_EXCLUDED, workers=2, progress=show)
    seconds = time.perf_counter() - begin
    setting = f"{report.clips:,} clips, {report.poses:,} poses, 2 processes"
    return Measurement("build a library", setting, 120.0, timing_of([seconds]))


def step_time(name: str, library: MotionLibrary, recording: Recording) -> Measurement:
    """Steps of a method over a recording, three times over, after a few that compile."""
    method = make_method(name, recording.layout, library)
    reconstruct(method, recording.cut(0, 5))
    seconds = np.concatenate([reconstruct(method, recording).step_seconds for _ in range(3)])
    return Measurement(f"step of {name}", f"{len(library.poses):,} poses", 2e-3, timing_of(seconds))


def kinematics_time() -> Measurement:
    """Forward kinematics of the body with the Jacobians of six sensors, one call of the kernel from Python."""
    body, worn = average_body(), layout("six-trackers")
    sensors = mount(body, default_placements(worn, body))
    count, points = len(body), len(worn)
    q = np.random.default_rng(0).normal(scale=0.3, size=body.size)
    positions, rotations, axes = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3, 3))
    places = np.empty((points, 3))
    linear, angular = np.zeros((points, 3, body.size)), np.zeros((points, 3, body.size))

    def call() -> None:
        _kernels.frames_and_jacobians(
            body.parents, body.offsets, q, sensors.bones, sensors.p_bone_sensor,
            positions, rotations, axes, places, linear, angular,
        )  # fmt: skip

    setting = f"{count} bones, {points} sensors"
    return Measurement("forward kinematics with Jacobians", setting, 10e-6, time_calls(call, 50, 1000))


def solve_time(recording: Recording) -> Measurement:
    """Solves of a recording's poses, each with the true pose before it for a prior mean and a dense covariance."""
    truth = recording.truth
    assert truth is not None  # it was simulated just now
    sensors = mount(recording.skeleton, recording.placements)
    sigmas = np.tile([0.005, np.radians(1.0)], (len(recording.layout), 1))
    covariance = np.cov(truth.q.T) * 0.05 + np.eye(truth.q.shape[1]) * 0.02**2
    frames = range(1, min(len(recording), 101))
    measured = [readings(recording.positions[i], recording.quats_wxyz[i], sigmas) for i in frames]
    priors = [GaussianPrior(truth.q[i - 1], covariance) for i in frames]

    def solve_all() -> None:
        for one, prior in zip(measured, priors, strict=True):
            solve_pose(recording.skeleton, sensors, one, prior, settings=SolverSettings())

    timing = time_calls(solve_all, 20)
    count = len(measured)
    each = Timing(timing.median / count, timing.least / count, timing.most / count, timing.repeats)
    return Measurement("solve of one pose", f"{truth.q.shape[1]} unknowns, 36 measured numbers", 0.3e-3, each)


def bvh_time() -> Measurement:
    """Reading 3,000 frames of 96 channels (31 joints, as CMU's) from a BVH file."""
    with tempfile.TemporaryDirectory(prefix="poseloom-benchmark-") as folder:
        path = Path(folder) / "long.bvh"
        write_motion(_long_motion(3000, 31), path)
        timing = time_calls(lambda: read_motions(path), 15)
    return Measurement("read a BVH file", "3,000 frames, 96 channels", 60e-3, timing)


def _long_motion(frames: int, joints: int) -> Motion:
    rng = np.random.default_rng(0)
    parents = [-1, *(max(0, j - int(rng.integers(1, 4))) for j in range(joints - 1))]
    skeleton = make_skeleton([f"joint{j}" for j in range(joints)], parents, rng.normal(scale=0.2, size=(joints, 3)))
    q = np.cumsum(rng.normal(scale=0.01, size=(frames, skeleton.size)), axis=0)
    return make_motion(skeleton, q, 120.0, "long")
