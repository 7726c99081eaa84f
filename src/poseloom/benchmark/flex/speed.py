"""Time per step of exported networks, in the live path."""

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.evaluation.rows import Row
from poseloom.methods.flex.network_method import FlexNetwork, load_flex_model
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, layout
from poseloom.synthesis import simulate_flex
from poseloom.training.export import export
from poseloom.training.fitting import Fitted

_STEPS = 1500
_WARM_UP = 50


def speed_rows(networks: Mapping[str, Fitted]) -> list[Row]:
    """Percentiles of the whole step, from counts to frame, on a walk; and the size of the model's file.

    Wall time counts what other programs take from the processor; `step_cpu_ms` is this thread's own time.
    """
    recording = simulate_flex(sample_motions()["walk"], layout("flex-four"))
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, fitted in networks.items():
            path = Path(folder) / "model.npz"
            export(fitted, path, "measured", np.zeros(69), np.ones(69), {})
            times = step_times(load_flex_model(path, "measured"), recording, _STEPS)[_WARM_UP:]
            for clock, seconds in zip(("step_ms", "step_cpu_ms"), times.T, strict=True):
                for share in (50, 95, 99):
                    value = float(np.percentile(1e3 * seconds, share))
                    rows.append(Row("speed", name, "", "none", f"{clock}_p{share}", value, frames=len(seconds)))
            rows.append(Row("speed", name, "", "none", "model_mb", path.stat().st_size / 1e6))
    return rows


def step_times(method: FlexNetwork, recording: Recording, steps: int) -> Floats[Array, "steps 2"]:
    """Wall time and the thread's own time of each step, seconds; the recording is gone through again and again."""
    times = np.empty((steps, 2))
    state = method.start(recording.skeleton, recording.placements)
    for number in range(steps):
        index = number % len(recording)
        if index == 0:
            state = method.start(recording.skeleton, recording.placements)
        sample = recording.sample(index)
        wall, own = time.perf_counter(), time.thread_time()
        state, _ = method.step(state, sample)
        times[number] = time.perf_counter() - wall, time.thread_time() - own
    return times
