"""The file of a fitted flex network: an artefact that holds its weights, or its ONNX graph, and its card."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import reading
from poseloom.formats.artefact import Artefact, read_artefact, write_artefact
from poseloom.formats.artefact_arrays import ArtefactArrays, checked_number, plain_settings
from poseloom.methods.flex.angles import angle_columns
from poseloom.methods.flex.filter_bank import BankSettings
from poseloom.methods.flex.filter_bank_lstm import FilterBankLstm
from poseloom.methods.flex.onnx_network import MemoryPart, OnnxNetwork
from poseloom.methods.flex.step_network import INPUTS
from poseloom.skeleton.body import average_body

KIND = "flex-network"
VERSION = 2

_WEIGHT = "network."
"""What the names of a network's weights begin with."""

_LARGEST = 1e6
"""Numbers that a network may remember."""
_SCALES = (1e-3, 1e6)
"""Least and greatest time scale of a filter bank, in samples."""


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
    network: FilterBankLstm | OnnxNetwork
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
    network = model.network
    header: dict[str, Any] = {"method": model.method, "card": dict(model.card)}
    arrays: dict[str, NDArray[Any]] = {"rest": model.rest, "rest_spread": model.rest_spread}
    if isinstance(network, OnnxNetwork):
        header["memory"] = [{"name": part.name, "shape": list(part.shape)} for part in network.parts]
        arrays["graph"] = np.frombuffer(network.graph, dtype=np.uint8)
    else:
        header["bank"] = {**asdict(network.bank), "smoothing": network.smoothing}
        arrays |= {f"{_WEIGHT}{name}": weight for name, weight in network.weights.items()}
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
    with reading(path, "a flex network"):
        card = {str(key): str(value) for key, value in cast("dict[str, Any]", artefact.header["card"]).items()}
        own = str(artefact.header["method"])
        if method is not None and own != method:
            raise FormatError(f"this model is for the method {own!r}, not {method!r}", remedy=f"Give --method {own}")
        arrays = ArtefactArrays(artefact.arrays, dofs=average_body().size)
        rest = arrays.floats("rest", "dofs", low=-100.0, high=100.0)
        spread = arrays.floats("rest_spread", "dofs", low=0.0, high=1e4)
        network = _network(artefact, arrays)
        _check(network, len(angle_columns()))
        return FlexModel(own, network, rest, spread, card)


def _network(artefact: Artefact, arrays: ArtefactArrays) -> FilterBankLstm | OnnxNetwork:
    if "graph" in artefact.arrays:
        parts = [_part(each) for each in artefact.header["memory"]]
        return OnnxNetwork(arrays.numbers("graph", "bytes", np.uint8).tobytes(), parts)
    settings = dict(cast("Mapping[str, Any]", artefact.header["bank"]))
    smoothing = checked_number("the smoothing", settings.pop("smoothing", None), *_SCALES)
    scales = {"means": _SCALES, "liveliness": _SCALES, "together": _SCALES}
    bank = plain_settings(BankSettings(), settings, scales)
    if max(bank.swift, bank.slow) >= len(bank.means):
        raise FormatError(f"the filter bank has no mean number {max(bank.swift, bank.slow)}")
    weights = {name.removeprefix(_WEIGHT): array for name, array in artefact.arrays.items() if name.startswith(_WEIGHT)}
    return FilterBankLstm(bank, smoothing, weights)


def _part(entry: Any) -> MemoryPart:
    shape = tuple(int(checked_number("a length of the memory", size, 1.0, _LARGEST)) for size in entry["shape"])
    if math.prod(shape) > _LARGEST:
        raise FormatError(f"a memory of shape {shape} is no network's of poseloom's")
    return MemoryPart(str(entry["name"]), shape)


def _check(network: FilterBankLstm | OnnxNetwork, angles: int) -> None:
    """Runs a network a few times on made-up samples: what it makes must have the right sizes, and be numbers."""
    memory: Any = network.start()
    for turn, value in enumerate((0.0, 1.0, 0.5)):
        half = np.full(INPUTS // 2, value)
        try:
            memory, told, spread = network.step(memory, half, np.ones(INPUTS // 2), turn == 0)
        except Exception as error:  # onnxruntime's own errors share no base class but Exception
            raise _unfit(str(error).partition("\n")[0]) from None
        if isinstance(network, OnnxNetwork) and [part.shape for part in memory] != [
            part.shape for part in network.parts
        ]:
            raise _unfit("what it remembers changes its shape")
        if told.shape != (angles,) or spread.shape != (angles,):
            raise _unfit(f"it makes {told.shape} angles, not {angles}")
        if not (np.isfinite(told).all() and np.isfinite(spread).all() and spread.min() >= 0):
            raise _unfit("the angles that it makes are no numbers")


def _unfit(cause: str) -> FormatError:
    return FormatError(
        "this model's network does not run", cause=cause, remedy="Fit the model again with this poseloom"
    )
