"""The phase HMM as a file: arrays and a JSON header, in the one artefact format."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseloom.errors import FormatError, PoseloomError
from poseloom.formats.artefact import Artefact, read_artefact, write_artefact
from poseloom.methods.imus.features import SignalFeatures
from poseloom.methods.imus.model import Emission, HmmModel
from poseloom.methods.imus.phase_hmm import PhaseHmm
from poseloom.methods.imus.phases import PhaseSettings
from poseloom.methods.imus.settings import PhaseHmmSettings
from poseloom.sensors import SensorKind, SensorLayout, SensorSpec, make_layout

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
    """Reads what `write_phase_hmm` wrote.

    Raises:
        FormatError: if there is no such file, it is damaged, of another kind or version, or lacks something.
    """
    artefact = read_artefact(path, KIND, VERSION)
    try:
        return PhaseHmm(
            _layout(artefact.header["layout"]),
            _model(artefact),
            _settings(artefact.header["settings"]),
            artefact.seed or 0,
            artefact.data_digest,
        )
    except PoseloomError as error:
        raise error.at(path) from None
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise FormatError(
            "this model lacks something", cause=repr(error), remedy="Fit it again with this poseloom", file=path
        ) from None


def _layout(content: Mapping[str, Any]) -> SensorLayout:
    sensors = [SensorSpec(str(name), SensorKind.IMU, str(bone)) for name, bone in content["sensors"]]
    return make_layout(str(content["name"]), sensors, float(content["rate"]))


def _settings(content: Mapping[str, Any]) -> PhaseHmmSettings:
    values = dict(content)
    values["phases"] = PhaseSettings(**values["phases"])
    values["short_windows"] = tuple((int(length), int(columns)) for length, columns in values["short_windows"])
    values["steps"] = tuple(float(step) for step in values["steps"])
    return PhaseHmmSettings(**values)


def _emission(artefact: Artefact, index: int) -> Emission:
    windows = {field.name: artefact.arrays[f"{index}_{field.name}"] for field in fields(SignalFeatures)}
    return Emission(
        SignalFeatures(**windows), artefact.arrays[f"{index}_features"], artefact.arrays[f"{index}_precision"]
    )


def _model(artefact: Artefact) -> HmmModel:
    arrays = {field.name: artefact.arrays[field.name] for field in fields(HmmModel) if field.name not in _NOT_ARRAYS}
    emissions = tuple(_emission(artefact, index) for index in range(int(artefact.header["emissions"])))
    names = tuple(str(name) for name in artefact.header["phases"])
    model = HmmModel(emissions=emissions, phase_names=names, **arrays)
    states, segments = len(model), len(model.first)
    fitting = (
        all(len(a) == states for a in (model.quats_wxyz, model.others, model.ups, model.maps))
        and all(len(a) == segments for a in (model.stop, model.phase_of_segment, model.successor))
        and len(model.phase_of_state) == states
        and bool(emissions)
        and all(len(e.features) == states and e.precision.shape == (len(names), e.features.shape[1]) for e in emissions)
        and model.entry.shape == (len(names), len(names))
        and bool(np.all(model.first < model.stop))
        and int(model.stop[-1]) == states
        and int(model.maps.max()) < len(model.gains)
    )
    if not fitting:
        raise ValueError("its arrays do not fit each other")
    return model
