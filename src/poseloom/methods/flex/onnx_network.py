"""A network as an ONNX graph, run by onnxruntime; what it remembers is handed in and out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, cast

import numpy as np

from poseloom.arrays import Array, Floats, Floats32
from poseloom.errors import FormatError, missing_extra

Arrays = tuple[Floats32[Array, "..."], ...]


@dataclass(frozen=True)
class MemoryPart:
    """One array that a network remembers.

    Attributes:
        name: Its name as the graph's input; the output with what follows it is called `next_` and this.
        shape: Its shape.
    """

    name: str
    shape: tuple[int, ...]


class OnnxNetwork:
    """An ONNX graph from a sample and a memory to angles and the next memory.

    The graph's inputs are `sample` (1, 8), `fresh` (1,), which is 1 with the first sample of all and 0 later, and the
    parts of the memory; its outputs `angles` (1, angles) in radians, `spread` (1, angles), and `next_` with each part.

    Args:
        graph: The serialised ONNX model.
        parts: What it remembers.

    Raises:
        FormatError: if onnxruntime cannot run the graph, or it has other inputs or outputs.
        PoseloomError: if onnxruntime is not installed (extra `onnx`).
    """

    def __init__(self, graph: bytes, parts: Sequence[MemoryPart]) -> None:
        self.graph = graph
        self.parts = tuple(parts)
        self._session = _open(graph)
        self._names = ["angles", "spread", *(f"next_{part.name}" for part in self.parts)]
        inputs = {"sample", "fresh", *(part.name for part in self.parts)}
        given = {each.name for each in self._session.get_inputs()}
        made = {each.name for each in self._session.get_outputs()}
        if not given <= inputs or not set(self._names) <= made:
            raise FormatError(
                f"a network with inputs {sorted(given)} and outputs {sorted(made)} is no step network",
                remedy="Fit the model again with this poseloom",
            )
        self._given = given

    def start(self) -> Arrays:
        """The memory before the first sample."""
        return tuple(np.zeros(part.shape, dtype=np.float32) for part in self.parts)

    def step(
        self, memory: Arrays, values: Floats[Array, "channels"], measured: Floats[Array, "channels"], fresh: bool
    ) -> tuple[Arrays, Floats[Array, "angles"], Floats[Array, "angles"]]:
        """One sample; see `StepNetwork.step`."""
        sample = np.concatenate([values, measured]).astype(np.float32)[None]
        feed: Mapping[str, Any] = {
            "sample": sample,
            "fresh": np.array([float(fresh)], dtype=np.float32),
            **{part.name: array for part, array in zip(self.parts, memory, strict=True)},
        }
        answer = self._session.run(self._names, {name: array for name, array in feed.items() if name in self._given})
        angles, spread, *following = (cast("Floats32[Array, '...']", each) for each in answer)
        return tuple(following), angles[0].astype(np.float64), spread[0].astype(np.float64)


def _open(graph: bytes) -> Any:
    try:
        onnxruntime = cast(Any, import_module("onnxruntime"))  # takes long to load, and only these networks need it
    except ImportError:
        raise missing_extra("this model's network runs in onnxruntime", "onnx") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own errors share no base class but Exception
        raise FormatError(
            "onnxruntime cannot open this model's network",
            cause=str(error).partition("\n")[0],
            remedy="Fit the model again, or name the right file",
        ) from None
