"""The file of a fitted flex network: an artefact that holds its ONNX graph and its card."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.methods.flex.step_network import MemoryPart, StepNetwork

KIND = "flex-network"
VERSION = 1


@dataclass(frozen=True, eq=False)
class FlexModel:
    """A fitted network and what goes with it.

    Attributes:
        method: Name of the method that it is for.
        network: Runs it.
        rest: Pose vector of what the network does not tell: mean angles of the other joints, root at standing height.
        rest_spread: Standard deviation of each entry of the pose vector without the network.
        card: What one should know of the model, by heading: data, errors, limits.
    """

    method: str
    network: StepNetwork
    rest: Floats[Array, "dofs"]
    rest_spread: Floats[Array, "dofs"]
    card: Mapping[str, str]


def write_flex_model(model: FlexModel, path: str | Path, seed: int | None = None, data_digest: str = "") -> None:
    """Writes a model, whole or not at all.

    Args:
        model: The model.
        path: The file; one that exists is replaced.
        seed: Of its fit.
        data_digest: Of what it was fitted to.
    """
    header = {
        "method": model.method,
        "memory": [{"name": part.name, "shape": list(part.shape)} for part in model.network.parts],
        "card": dict(model.card),
    }
    arrays = {
        "graph": np.frombuffer(model.network.graph, dtype=np.uint8),
        "rest": model.rest,
        "rest_spread": model.rest_spread,
    }
    write_artefact(path, KIND, VERSION, header, arrays, seed=seed, data_digest=data_digest)


def read_flex_model(path: str | Path, method: str | None = None) -> FlexModel:
    """Reads a model.

    Args:
        path: The file.
        method: The method that it must be for.

    Raises:
        FormatError: if it is none, damaged, of another version or for another method.
    """
    artefact = read_artefact(path, KIND, VERSION)
    try:
        parts = [_part(each) for each in artefact.header["memory"]]
        card = {str(key): str(value) for key, value in cast("dict[str, Any]", artefact.header["card"]).items()}
        own = str(artefact.header["method"])
        graph = artefact.arrays["graph"].tobytes()
        rest, spread = (artefact.arrays[name].astype(np.float64) for name in ("rest", "rest_spread"))
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(
            "this flex network's file is incomplete", cause=repr(error), remedy="Fit the model again", file=Path(path)
        ) from None
    if method is not None and own != method:
        raise FormatError(
            f"this model is for the method {own!r}, not {method!r}", remedy=f"Give --method {own}", file=Path(path)
        )
    return FlexModel(own, StepNetwork(graph, parts), rest, spread, card)


def _part(entry: Any) -> MemoryPart:
    return MemoryPart(str(entry["name"]), tuple(int(size) for size in entry["shape"]))
