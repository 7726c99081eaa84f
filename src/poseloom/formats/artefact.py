"""The one format of everything fitted, models and calibrations: arrays and a JSON header in one file, never a pickle.

The file is a zip archive that `numpy.load` opens as `.npz`: `header.json` and one `.npy` member an array. The same
content gives the same bytes.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version as package_version
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import frozen
from poseloom.errors import FormatError
from poseloom.formats.atomic import atomic_file

_MAGIC = "poseloom artefact"
_HEADER = "header.json"
_EPOCH = (1980, 1, 1, 0, 0, 0)
_DAMAGE = (
    zipfile.BadZipFile,
    EOFError,
    ValueError,
    KeyError,
    TypeError,
    NotImplementedError,
    RuntimeError,
    OverflowError,
)


@dataclass(frozen=True, eq=False)
class Artefact:
    """What a fitted thing's file holds.

    Attributes:
        kind: What it is, e.g. "phase-hmm".
        version: Version of that kind's content.
        poseloom_version: The poseloom that wrote it.
        seed: Seed of what was drawn in fitting; None where nothing was.
        data_digest: Digest of the data it was fitted to; empty where there was none.
        header: The kind's own settings, as JSON knows them.
        arrays: The kind's own arrays, read-only.
    """

    kind: str
    version: int
    poseloom_version: str
    seed: int | None
    data_digest: str
    header: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]


def write_artefact(
    path: str | Path,
    kind: str,
    version: int,
    header: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    *,
    seed: int | None = None,
    data_digest: str = "",
) -> None:
    """Writes a fitted thing, whole or not at all.

    Args:
        path: The file; one that exists is replaced.
        kind: What it is, e.g. "phase-hmm"; `read_artefact` asks for it.
        version: Version of that kind's content, from 1; raise it when the content's meaning changes.
        header: Settings that JSON can hold.
        arrays: Arrays of numbers, booleans or text by name.
        seed: Seed of what was drawn in fitting.
        data_digest: Digest of the data it was fitted to.

    Raises:
        FormatError: if the header does not fit JSON, or an array holds Python objects.
    """
    text = _header_text(path, kind, version, header, seed, data_digest)
    for name, array in arrays.items():
        if array.dtype.hasobject or not name or "/" in name:
            raise FormatError(
                f"array {name!r} of type {array.dtype} cannot be stored",
                remedy="Store arrays of numbers, booleans or text, under names without a slash",
                file=path,
            )
    with atomic_file(path) as part, zipfile.ZipFile(part, "x") as archive:
        archive.writestr(zipfile.ZipInfo(_HEADER, _EPOCH), text)
        for name, array in sorted(arrays.items()):
            with archive.open(zipfile.ZipInfo(f"{name}.npy", _EPOCH), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def _header_text(
    path: str | Path, kind: str, version: int, header: Mapping[str, Any], seed: int | None, data_digest: str
) -> str:
    content = {
        "format": _MAGIC,
        "kind": kind,
        "version": version,
        "poseloom_version": package_version("poseloom"),
        "seed": seed,
        "data_digest": data_digest,
        "header": dict(header),
    }
    try:
        return json.dumps(content, indent=1, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise FormatError(
            f"the header of a {kind} cannot be stored", cause=str(error), remedy="Keep to JSON's types", file=path
        ) from None


def read_artefact(path: str | Path, kind: str, version: int | None = None) -> Artefact:
    """Reads a fitted thing of the asked kind, and of the asked version if one is given.

    Raises:
        FormatError: if there is no such file, or it is no artefact, damaged, of another kind or of another version.
    """
    file = Path(path)
    try:
        with zipfile.ZipFile(file) as archive:
            content = _read_header(archive, file)
            arrays = {
                name.removesuffix(".npy"): frozen(_read_array(archive, name))
                for name in archive.namelist()
                if name.endswith(".npy")
            }
        artefact = Artefact(
            kind=str(content["kind"]),
            version=int(content["version"]),
            poseloom_version=str(content["poseloom_version"]),
            seed=None if content["seed"] is None else int(content["seed"]),
            data_digest=str(content["data_digest"]),
            header=MappingProxyType(dict(content["header"])),
            arrays=MappingProxyType(arrays),
        )
    except FileNotFoundError:
        raise FormatError("there is no such file", remedy="Check the path", file=file) from None
    except IsADirectoryError:
        raise FormatError(f"this is a folder, not the file of a {kind}", remedy="Name the file", file=file) from None
    except _DAMAGE as error:
        raise FormatError(
            f"this file cannot be read as a {kind}",
            cause=f"it is damaged, cut off or no artefact of poseloom's ({error})",
            remedy="Make it anew, or name the right file",
            file=file,
        ) from None
    _check_kind(artefact, kind, version, file)
    return artefact


def _read_header(archive: zipfile.ZipFile, file: Path) -> dict[str, Any]:
    if _HEADER not in archive.namelist():
        raise FormatError(
            "this is no artefact of poseloom's",
            cause=f"it has no {_HEADER}",
            remedy="Name a file that a fit or calibration has written",
            file=file,
        )
    content = json.loads(archive.read(_HEADER))
    if not isinstance(content, dict) or cast(dict[str, Any], content).get("format") != _MAGIC:
        raise ValueError("its header is another program's")
    return cast(dict[str, Any], content)


def _read_array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    # The member is read whole first: that checks its sum before a damaged shape can ask for any amount of memory.
    return np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)


def _check_kind(artefact: Artefact, kind: str, version: int | None, file: Path) -> None:
    if artefact.kind != kind:
        raise FormatError(
            f"this file holds a {artefact.kind}, not a {kind}", remedy=f"Name the file of a {kind}", file=file
        )
    if version is not None and artefact.version != version:
        raise FormatError(
            f"this {kind} has version {artefact.version}, but poseloom reads version {version}",
            cause=f"poseloom {artefact.poseloom_version} wrote it",
            remedy="Make it anew with this poseloom, or use the poseloom that wrote it",
            file=file,
        )
