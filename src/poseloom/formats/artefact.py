"""The one format of everything fitted, models and calibrations: arrays and a JSON header in one file, never a pickle.

The file is a zip archive that `numpy.load` opens as `.npz`: `header.json` and one `.npy` member an array. The same
content gives the same bytes.
"""

import io
import json
import os
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
from poseloom.formats._files import DAMAGE, open_regular, reading
from poseloom.formats._npy import read_npy
from poseloom.formats.atomic import atomic_file

_MAGIC = "poseloom artefact"
_HEADER = "header.json"
_EPOCH = (1980, 1, 1, 0, 0, 0)
_UNPACKED = 1 << 28
"""Bytes beyond the file's own size to which its members may unpack."""
_MEMBERS = 10_000


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
    # Put together in memory: where the disk is full, zipfile hides why it cannot close its file.
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr(zipfile.ZipInfo(_HEADER, _EPOCH), text)
        for name, array in sorted(arrays.items()):
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _EPOCH), content.getbuffer())
    with atomic_file(path) as part:
        part.write_bytes(whole.getbuffer())


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

    Nothing in the file is trusted: members that unpack to far more than the file holds are refused before they are
    unpacked, and shapes that do not fit their bytes before an array is made. What the numbers mean the caller checks
    (`artefact_arrays`).

    Raises:
        FormatError: if there is no such file, or it is no artefact, damaged, of another kind or of another version.
    """
    file = Path(path)
    with open_regular(file) as stream:
        try:
            with reading(file), zipfile.ZipFile(stream) as archive:
                _check_sizes(archive, os.fstat(stream.fileno()).st_size, file)
                content = _read_header(archive, file)
                arrays = {
                    name.removesuffix(".npy"): _read_array(archive, name)
                    for name in archive.namelist()
                    if name.endswith(".npy")
                }
                artefact = _artefact(content, arrays)
        except FormatError as error:
            if not isinstance(error.__cause__, DAMAGE):
                raise
            raise FormatError(
                f"this file cannot be read as a {kind}",
                cause=f"it is damaged, cut off or no artefact of poseloom's ({str(error.__cause__)[:160]})",
                remedy="Make it anew, or name the right file",
                file=file,
            ) from None
    _check_kind(artefact, kind, version, file)
    return artefact


def _artefact(content: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Artefact:
    words = {name: content[name] for name in ("kind", "poseloom_version", "data_digest")}
    numbers = {name: content[name] for name in ("version", "seed")}
    if not all(isinstance(word, str) for word in words.values()):
        raise ValueError("its header's words are none")
    if type(numbers["version"]) is not int or not isinstance(numbers["seed"], int | None):
        raise ValueError("its header's numbers are none")
    if not isinstance(content["header"], dict):
        raise ValueError("its settings are no list of names and values")
    header = cast(dict[str, Any], content["header"])
    return Artefact(**words, **numbers, header=MappingProxyType(header), arrays=MappingProxyType(arrays))


def _check_sizes(archive: zipfile.ZipFile, size: int, file: Path) -> None:
    """Members must unpack to no more than the file's own size and a fixed amount; ours are not packed at all."""
    members = archive.infolist()
    if sum(member.file_size for member in members) > size + _UNPACKED or len(members) > _MEMBERS:
        raise FormatError(
            f"its {len(members)} parts would unpack to {sum(member.file_size for member in members) / 1e6:,.0f} MB",
            cause="it was made to fill the memory of whoever reads it, or is no artefact of poseloom's",
            remedy="Do not use it",
            file=file,
        )


def artefact_kind(path: str | Path) -> tuple[str, Mapping[str, Any]]:
    """The kind of a fitted thing, and its own header, without its arrays. Raises FormatError as `read_artefact`."""
    file = Path(path)
    with open_regular(file) as stream, reading(file), zipfile.ZipFile(stream) as archive:
        _check_sizes(archive, os.fstat(stream.fileno()).st_size, file)
        artefact = _artefact(_read_header(archive, file), {})
    return artefact.kind, artefact.header


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
    with archive.open(name) as member:
        return frozen(read_npy(member, archive.getinfo(name).file_size, name))


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
