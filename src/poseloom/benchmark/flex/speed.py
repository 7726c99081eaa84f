"""Time per step of exported networks, in the live path."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from poseloom.evaluation.rows import Row
from poseloom.methods.contract import reconstruct
from poseloom.methods.flex.network_method import load_flex_model
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.synthesis import simulate_flex
from poseloom.training.export import export
from poseloom.training.fitting import Fitted

_REPEATS = 20
_WARM_UP = 50


def speed_rows(networks: Mapping[str, Fitted]) -> list[Row]:
    """Percentiles of the whole step, from counts to frame, on a walk; and the size of the model's file."""
    motion = sample_motions()["walk"]
    recording = simulate_flex(motion, layout("flex-four"))
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, fitted in networks.items():
            path = Path(folder) / "model.npz"
            export(fitted, path, "measured", np.zeros(69), np.ones(69), {})
            method = load_flex_model(path, "measured")
            runs = [reconstruct(method, recording).step_seconds for _ in range(max(1, _REPEATS * 40 // len(recording)))]
            seconds = np.concatenate(runs)[_WARM_UP:]
            for share in (50, 95, 99):
                value = float(np.percentile(1e3 * seconds, share))
                rows.append(Row("speed", name, "", "none", f"step_ms_p{share}", value, frames=len(seconds)))
            rows.append(Row("speed", name, "", "none", "model_mb", path.stat().st_size / 1e6))
    return rows
