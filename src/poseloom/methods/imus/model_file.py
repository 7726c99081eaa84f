"""The phase HMM as a file: arrays and a JSON header, in the one artefact format."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseloom.errors import FormatError
from poseloom.formats._files import reading
from poseloom.formats.artefact import Artefact, read_artefact, write_artefact
from poseloom.formats.artefact_arrays import ArtefactArrays, checked_number, plain_settings, rate
from poseloom.methods.imus.features import SignalFeatures
from poseloom.methods.imus.model import WAY_ENTRIES, Emission, HmmModel
from poseloom.methods.imus.pairs import CHANNELS
from poseloom.methods.imus.phase_hmm import PhaseHmm
from poseloom.methods.imus.settings import PhaseHmmSettings
from poseloom.sensors import SensorKind, SensorLayout, SensorSpec, make_layout
from poseloom.skeleton.body import BODY_BONES, average_body

KIND = "phase-hmm"
VERSION = 2

_NOT_ARRAYS = ("emissions", "phase_names")


def write_phase_hmm(method: PhaseHmm, path: str | Path) -> None:
    """Writes a fitted phase HMM, whole or not at all.

    Raises:
        OSError: where the file cannot be written.
    """
    model = method.model
    arrays: dict[str, NDArray[Any]] = {
        field.name: getattr(model, field.name) for field in fields(HmmModel) if field.name not in _NOT_ARRAYS
    }
    for index, emission in enumerate(model.emissions):
        arrays |= {f"{index}_features": emission.features, f"{index}_precision": emission.precision}
        arrays |= {
            f"{index}_{each.name}": getattr(emission.signal_features, each.name) for each in fields(SignalFeatures)
        }
    header = {
        "layout": {
            "name": method.layout.name,
            "rate": method.layout.rate,
            "sensors": [[sensor.name, sensor.bone] for sensor in method.layout.sensors],
        },
        "settings": asdict(method.settings),
        "phases": list(model.phase_names),
        "emissions": len(model.emissions),
    }
    write_artefact(path, KIND, VERSION, header, arrays, seed=method.seed, data_digest=method.data_digest)


def read_phase_hmm(path: str | Path) -> PhaseHmm:
    """Reads what `write_phase_hmm` wrote. Every number is checked: the kernels that run the model check none.

    Raises:
        FormatError: if there is no such file, it is damaged, of another kind or version, or lacks something.
    """
    artefact = read_artefact(path, KIND, VERSION)
    with reading(path, "a phase HMM"):
        layout = _layout(artefact.header["layout"])
        settings = plain_settings(PhaseHmmSettings(), artefact.header["settings"], _RANGES)
        return PhaseHmm(layout, _model(artefact, len(layout)), settings, artefact.seed or 0, artefact.data_digest)


_RANGES = {
    "neighbours": (1.0, 1e4),
    "echoes": (0.0, 1e4),
    "restart_states": (1.0, 1e9),
    "beam": (0.1, 1e4),
    "evenness": (1.0, 1e4),
    "restart": (0.0, 1.0),
    "continuity": (0.0, 1.0),
    "steps": (0.0, 1.0),
    "echo_share": (0.0, 1.0),
    "echo_seconds": (1e-3, 1e4),
    "weight_smoothing": (0.0, 1.0),
    "blend": (0.0, 1.0),
    "start_blend": (0.0, 1.0),
    "rejoin_seconds": (0.0, 1e4),
    "body_scale": (1e-6, 1e3),
    "mounting": (0.0, 3.2),
    "mounting_gain": (0.0, 1.0),
    "turn_seconds": (1e-3, 1e4),
    "contact_lock": (0.0, 1.0),
    "way_seconds": (0.0, 1e4),
    "way_memory": (1e-3, 1e4),
    "lost_after": (0.0, 1e4),
}
"""Settings that are not from 0 to a million."""


def _layout(content: Mapping[str, Any]) -> SensorLayout:
    sensors = [SensorSpec(str(name), SensorKind.IMU, str(bone)) for name, bone in content["sensors"]]
    for sensor in sensors:
        average_body().index(sensor.bone)
    return make_layout(str(content["name"]), sensors, rate(content["rate"]))


def _emission(arrays: ArtefactArrays, index: int) -> Emission:
    # Every emission has its own window and columns.
    window, columns = f"samples_channels_{index}", f"columns_{index}"
    scale = arrays.floats(f"{index}_scale", "channels", low=1e-9)
    mean = arrays.floats(f"{index}_mean", window)
    basis = arrays.floats(f"{index}_basis", f"{window} {columns}")
    if len(mean) % len(scale):
        raise FormatError(f"windows of {len(mean)} values have no whole number of {len(scale)} channels")
    return Emission(
        SignalFeatures(scale, mean, basis),
        arrays.floats(f"{index}_features", f"states {columns}", np.float32),
        arrays.floats(f"{index}_precision", f"phases {columns}", low=1e-12),
    )


def _model(artefact: Artefact, sensors: int) -> HmmModel:
    names = tuple(str(name) for name in artefact.header["phases"])
    arrays = ArtefactArrays(artefact.arrays, phases=len(names), sensors=sensors, channels=CHANNELS * sensors)
    count = checked_number("the number of emissions", artefact.header["emissions"], 1.0, 100.0)
    signals = arrays.floats("signals", "states channels", np.float32, -1e6, 1e6)
    emissions = tuple(_emission(arrays, index) for index in range(int(count)))
    states, joints = arrays.sizes["states"], len(BODY_BONES)
    arrays.sizes |= {"last_columns": emissions[-1].features.shape[1], "entries": 3 * joints + WAY_ENTRIES}
    gains = arrays.floats("gains", "maps entries last_columns", np.float32, -1e6, 1e6)
    first, stop = (arrays.indices(name, "segments", states + 1) for name in ("first", "stop"))
    segments = len(first)
    phase_of_segment = arrays.indices("phase_of_segment", "segments", len(names))
    bodies = arrays.floats("bodies", f"bodies {joints - 1}", low=0.0, high=100.0)
    model = HmmModel(
        emissions=emissions,
        signals=signals,
        quats_wxyz=arrays.floats("quats_wxyz", f"states {joints} 4", np.float32, -1.001, 1.001),
        others=arrays.floats("others", f"states {WAY_ENTRIES + 4}", np.float32, -100.0, 100.0),
        ups=arrays.floats("ups", "states sensors 3", np.float32, -2.0, 2.0),
        maps=arrays.indices("maps", "states", len(gains)),
        gains=gains,
        variances=arrays.floats("variances", "maps entries", np.float32, 0.0, 1e6),
        first=first,
        stop=stop,
        phase_of_segment=phase_of_segment,
        successor=arrays.indices("successor", "segments", segments, low=-1),
        body_of_segment=arrays.indices("body_of_segment", "segments", len(bodies)),
        phase_of_state=arrays.indices("phase_of_state", "states", len(names)),
        phase_names=names,
        phase_sizes=arrays.indices("phase_sizes", "phases", segments + 1, low=1),
        entry=arrays.floats("entry", "phases phases", low=0.0, high=1.0 + 1e-6),
        bodies=bodies,
    )
    lengths = stop - first
    fitting = (
        first[0] == 0
        and stop[-1] == states
        and bool((first[1:] == stop[:-1]).all())
        and bool((lengths > 0).all())
        and np.array_equal(model.phase_of_state, np.repeat(phase_of_segment, lengths))
        and np.array_equal(model.phase_sizes, np.bincount(phase_of_segment, minlength=len(names)))
        and bool((np.abs(np.linalg.norm(model.quats_wxyz, axis=-1) - 1.0) < 1e-3).all())
        and all(each.signal_features.window <= model.window for each in emissions)
    )
    if not fitting:
        raise FormatError("its segments, phases and states do not fit each other")
    return model
