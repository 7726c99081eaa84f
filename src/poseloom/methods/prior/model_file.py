"""The file of a prior network: an artefact with half-precision weights and its card; two come with poseloom."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType

import numpy as np

from poseloom.errors import unknown_name
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.methods.prior.network import PriorNetwork, spec_from_json, spec_to_json

KIND = "prior-network"
METHOD = "sensor-prior"
VERSION = 1

SHIPPED: Mapping[str, str] = MappingProxyType({"six": "prior-six.npz", "any": "prior-any.npz"})
"""Files of the networks that come with poseloom, by name."""


def write_prior(network: PriorNetwork, path: str | Path, seed: int | None = None, data_digest: str = "") -> None:
    """Writes a network, its weights rounded to half precision; whole or not at all.

    Args:
        network: The network.
        path: The file; one that exists is replaced.
        seed: Of its training.
        data_digest: Of the motions it was trained on.
    """
    arrays = {name: array.astype(np.float16) for name, array in network.weights.items()}
    arrays["sigma_factors"] = network.sigma_factors
    header = {"method": METHOD, "inputs": spec_to_json(network.spec), "card": dict(network.card)}
    write_artefact(path, KIND, VERSION, header, arrays, seed=seed, data_digest=data_digest)


def read_prior(path: str | Path) -> PriorNetwork:
    """Reads a network.

    Raises:
        FormatError: if the file is none, damaged or of another version.
    """
    held = read_artefact(path, KIND, VERSION)
    weights = {name: array for name, array in held.arrays.items() if name != "sigma_factors"}
    spec = spec_from_json(held.header.get("inputs", {}))
    return PriorNetwork(spec, weights, held.arrays.get("sigma_factors"), held.header.get("card"))


@cache
def shipped_prior(name: str) -> PriorNetwork:
    """A network that comes with poseloom.

    Args:
        name: "six" for hips, head, forearms and shanks with orientation and acceleration; "any" for any sensors.

    Raises:
        MethodError: for another name.
    """
    if name not in SHIPPED:
        raise unknown_name("prior network", name, SHIPPED)
    return read_prior(shipped_path(name))


def shipped_path(name: str) -> Path:
    """Where the file of a network that comes with poseloom stands."""
    return Path(str(files("poseloom.methods.prior").joinpath(SHIPPED[name])))
