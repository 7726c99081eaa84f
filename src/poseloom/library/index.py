"""Finding the moments of a library that are like a given one: features, their principal components, and faiss."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

import faiss as _faiss  # pyright: ignore[reportMissingTypeStubs]
import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints
from poseloom.errors import FormatError, LibraryError
from poseloom.formats._npy import write_npy
from poseloom.formats.artefact_arrays import ArtefactArrays
from poseloom.formats.atomic import naming
from poseloom.library.features import FeatureMap, FeatureSettings, make_feature_map
from poseloom.library.opened import OpenArray

faiss = cast(Any, _faiss)
"""Its own type information is partial and in places wrong."""

_SAMPLE = 40_000
"""Moments from which principal components and cells are learnt."""

_ONE_BY_ONE = 20_000
"""Moments below which all are compared."""

_CHUNK = 50_000
"""Moments whose features are held in full at a time."""


@runtime_checkable
class Span(Protocol):
    """A clip's rows in the pose array."""

    @property
    def start(self) -> int: ...
    @property
    def stop(self) -> int: ...


@dataclass(frozen=True, eq=False)
class Projection:
    """Principal components of one block of features.

    Attributes:
        mean: Mean of the raw features.
        basis: Orthonormal columns.
    """

    mean: Floats[Array, "raw"]
    basis: Floats[Array, "raw columns"]

    def __call__(self, raw: Floats[Array, "raw"]) -> Floats[Array, "columns"]:
        return (raw - self.mean) @ self.basis


@dataclass(frozen=True, eq=False)
class Exclusion:
    """Moments that a search must not return, packed as faiss wants them. Make one with `MomentIndex.exclusion`."""

    allowed: NDArray[np.uint8]
    count: int

    @cached_property
    def selector(self) -> Any:
        """The same for faiss, which looks into `allowed` itself."""
        return faiss.IDSelectorBitmap(self.count, faiss.swig_ptr(self.allowed))


@dataclass(frozen=True, eq=False)
class MomentIndex:
    """The moments of a library, searchable.

    Attributes:
        features: How moments are described.
        rows: The library row of each moment; its history is in the rows before.
        columns: Projected features of each moment: history columns, then sensor columns.
        history: Projection of the history block.
        sensors: Projection of the sensor block.
    """

    features: FeatureMap
    rows: Ints[Array, "moments"]
    columns: Floats32[Array, "moments columns"]
    history: Projection
    sensors: Projection
    _whole: Any
    _by_sensors: Any
    _watched: tuple[OpenArray, ...] = ()

    def search(
        self, query: Floats[Array, "columns"], count: int, exclusion: Exclusion | None = None
    ) -> tuple[Ints[Array, "found"], Floats[Array, "found"]]:
        """The `count` moments nearest to a projected query, nearest first, and their squared distances.

        The query has the history's columns, and the sensors' behind them if the features are searched by sensors.
        """
        self._check()
        return _search(self._whole, query, count, exclusion)

    def search_sensors(
        self, query: Floats[Array, "columns"], count: int, exclusion: Exclusion | None = None
    ) -> tuple[Ints[Array, "found"], Floats[Array, "found"]]:
        """The same by the sensor columns alone, for a start without a history."""
        if self._by_sensors is None:
            raise LibraryError(
                "this index does not know the sensors",
                cause="its features were made of the history alone",
                remedy="Name the sensors' bones in its FeatureSettings",
            )
        self._check()
        return _search(self._by_sensors, query, count, exclusion)

    def _check(self) -> None:
        """Raises LibraryError where a file of the library was cut off since it was opened."""
        for file in self._watched:
            file.check()

    def exclusion(self, allowed_rows: Bools[Array, "poses"]) -> Exclusion:
        """Packs a mask over library rows (True: may be used) for `search`."""
        return Exclusion(np.packbits(allowed_rows[self.rows], bitorder="little"), len(self.rows))


def _search(
    index: Any, query: Floats[Array, "columns"], count: int, exclusion: Exclusion | None
) -> tuple[Ints[Array, "found"], Floats[Array, "found"]]:
    wanted = query[None].astype(np.float32)
    if exclusion is None:
        distances, found = index.search(wanted, count)
        return _found(distances, found)
    selector = exclusion.selector
    if not hasattr(index, "nprobe"):
        return _found(*index.search(wanted, count, params=faiss.SearchParameters(sel=selector)))
    # Where much is left out, the nearest lists may hold nothing else: look into more of them.
    probes = index.nprobe
    while True:
        distances, found = index.search(wanted, count, params=faiss.SearchParametersIVF(sel=selector, nprobe=probes))
        if found[0, -1] >= 0 or probes >= index.nlist:
            return _found(distances, found)
        probes = min(4 * probes, index.nlist)


def _found(
    distances: Floats32[Array, "1 count"], found: Ints[Array, "1 count"]
) -> tuple[Ints[Array, "found"], Floats[Array, "found"]]:
    good = found[0] >= 0
    return found[0][good], distances[0][good].astype(np.float64)


def moment_rows(clips: Iterable[Span], reach: int) -> Ints[Array, "moments"]:
    """Rows that have `reach` rows of the same clip before them."""
    spans = [np.arange(clip.start + reach, clip.stop, dtype=np.int64) for clip in clips]
    return np.concatenate(spans) if spans else np.empty(0, dtype=np.int64)


def build_index(
    poses: Floats32[Array, "poses dofs"], clips: Iterable[Span], settings: FeatureSettings, folder: Path
) -> None:
    """Describes every moment of a library, learns the projections and the cells, and writes all of it into `folder`.

    Raises:
        LibraryError: where no clip is long enough to have a moment.
        OSError: naming the file that cannot be written.
    """
    features = make_feature_map(settings)
    rows = moment_rows(clips, settings.reach)
    if len(rows) == 0:
        raise LibraryError(
            "the library has no moment to search for",
            cause=f"no clip is longer than {settings.reach} poses",
            remedy="Add longer motions",
        )
    sample = np.sort(np.random.default_rng(0).choice(rows, size=min(_SAMPLE, len(rows)), replace=False))
    history = _principal(features.library_history(poses, sample), settings.history_columns)
    sensors = _principal(features.library_sensors(poses, sample), settings.sensor_columns)
    folder.mkdir(parents=True, exist_ok=True)
    width = history.basis.shape[1] + sensors.basis.shape[1]
    columns = np.empty((len(rows), width), dtype=np.float32)
    for start in range(0, len(rows), _CHUNK):
        part = rows[start : start + _CHUNK]
        columns[start : start + len(part), : history.basis.shape[1]] = (
            features.library_history(poses, part) - history.mean
        ) @ history.basis
        columns[start : start + len(part), history.basis.shape[1] :] = (
            features.library_sensors(poses, part) - sensors.mean
        ) @ sensors.basis
    arrays = {
        "columns": columns,
        "rows": rows,
        "history_mean": history.mean,
        "history_basis": history.basis,
        "sensor_mean": sensors.mean,
        "sensor_basis": sensors.basis,
        **_learnt("whole", columns if settings.by_sensors else columns[:, : history.basis.shape[1]]),
        **_learnt("sensors", columns[:, history.basis.shape[1] :]),
    }
    for name, array in arrays.items():
        with naming(folder / f"{name}.npy"):
            write_npy(folder / f"{name}.npy", array)


def load_index(
    folder: Path, settings: FeatureSettings, rows: Ints[Array, "moments"], watched: Sequence[OpenArray] = ()
) -> MomentIndex:
    """Opens an index that `build_index` wrote. Every number in it is checked: it may be a stranger's.

    Args:
        folder: Where it is.
        settings: Of which features.
        rows: The rows that it must have.
        watched: Files that are looked at before each search, and must not have been cut off.

    Raises:
        LibraryError: naming what is missing or damaged.
    """
    features = make_feature_map(settings)
    opened = {name: OpenArray(folder / f"{name}.npy", _REMEDY) for name in _FILES if (folder / f"{name}.npy").exists()}
    arrays = ArtefactArrays({name: each.values for name, each in opened.items()}, moments=len(rows))
    try:
        columns = arrays.floats("columns", "moments columns", np.float32)
        if not np.array_equal(arrays.indices("rows", "moments", int(rows.max()) + 1), rows):
            raise FormatError("its rows are not those of the library's clips")
        history = _projection(arrays, "history", settings.history * (9 + 6 * len(features.bones)))
        sensors = _projection(arrays, "sensor", 9 * len(features.sensor_joints))
        split = history.basis.shape[1]
        if columns.shape[1] != split + sensors.basis.shape[1]:
            raise FormatError("its features have another number of columns than their projections")
        whole = _searchable(arrays, "whole", columns if settings.by_sensors else columns[:, :split])
        by_sensors = _searchable(arrays, "sensors", columns[:, split:]) if columns.shape[1] > split else None
    except FormatError as error:
        raise LibraryError(
            "the library's index cannot be used", cause=error.fact, remedy=_REMEDY, file=folder
        ) from None
    except RuntimeError as error:  # faiss's
        raise LibraryError("the library's index cannot be made", cause=str(error)[:160], file=folder) from None
    return MomentIndex(features, rows, columns, history, sensors, whole, by_sensors, tuple(watched))


_FILES = (
    "columns",
    "rows",
    "history_mean",
    "history_basis",
    "sensor_mean",
    "sensor_basis",
    "whole_centres",
    "whole_owners",
    "sensors_centres",
    "sensors_owners",
)
_REMEDY = "Delete the folder: it is built again when it is next needed"


def _projection(arrays: ArtefactArrays, name: str, raw: int) -> Projection:
    if raw == 0:
        return Projection(np.zeros(0), np.zeros((0, 0)))
    arrays.sizes[f"{name}_raw"] = raw
    mean = arrays.floats(f"{name}_mean", f"{name}_raw")
    return Projection(mean, arrays.floats(f"{name}_basis", f"{name}_raw {name}_columns", low=-1.001, high=1.001))


def _principal(raw: Floats32[Array, "moments raw"], columns: int) -> Projection:
    """Mean and leading principal directions of a sample of raw features."""
    values = raw.astype(np.float64)
    width = values.shape[1]
    if width == 0:
        return Projection(np.zeros(0), np.zeros((0, 0)))
    mean = values.mean(axis=0)
    centred = values - mean
    basis = np.linalg.eigh(centred.T @ centred)[1][:, ::-1]
    return Projection(mean, np.ascontiguousarray(basis[:, : min(columns, width)]))


def _learnt(name: str, columns: Floats32[Array, "moments columns"]) -> dict[str, NDArray[Any]]:
    """The centres of inverted lists and the list of each moment; nothing where so few are searched one by one.

    There are about four times the root of the moments' number. At 1.26 million moments 4096 lists, of which 20 are
    looked into, take a third of the time of 1024 and 24, and find the same: a search costs one distance a list and one
    for each moment in the lists looked into.
    """
    count, width = columns.shape
    if count < _ONE_BY_ONE or width == 0:
        return {}
    faiss.omp_set_num_threads(1)
    lists = 2 ** round(math.log2(4.0 * math.sqrt(count)))
    index = faiss.index_factory(width, f"IVF{lists},Flat")
    training = np.sort(np.random.default_rng(0).permutation(count)[: 40 * lists])
    index.cp.niter = 10
    index.train(np.ascontiguousarray(columns[training]))
    owners = np.empty(count, dtype=np.int64)
    for start in range(0, count, _CHUNK):
        part = np.ascontiguousarray(columns[start : start + _CHUNK])
        owners[start : start + len(part)] = index.quantizer.assign(part, 1)[:, 0]
    return {f"{name}_centres": index.quantizer.reconstruct_n(0, lists), f"{name}_owners": owners}


def _searchable(arrays: ArtefactArrays, name: str, columns: Floats32[Array, "moments columns"]) -> Any:
    """A faiss index of all moments: exact for few, else inverted lists.

    It is put together from plain arrays, not read by faiss: what faiss reads it does not check, and a crafted file
    makes it write anywhere.
    """
    faiss.omp_set_num_threads(1)
    count, width = columns.shape
    if count < _ONE_BY_ONE:
        index = faiss.IndexFlatL2(width)
        index.add(np.ascontiguousarray(columns))
        return index
    arrays.sizes[f"{name}_width"] = width
    centres = arrays.floats(f"{name}_centres", f"{name}_lists {name}_width", np.float32)
    owners = arrays.indices(f"{name}_owners", "moments", len(centres))
    quantizer = faiss.IndexFlatL2(width)
    quantizer.add(centres)
    index = faiss.IndexIVFFlat(quantizer, width, len(centres))
    order = np.argsort(owners, kind="stable")
    begin = 0
    for cell, size in enumerate(np.bincount(owners, minlength=len(centres)).tolist()):
        members = np.ascontiguousarray(order[begin : begin + size])
        begin += size
        if size:
            codes = np.ascontiguousarray(columns[members]).view(np.uint8)
            index.invlists.add_entries(cell, size, faiss.swig_ptr(members), faiss.swig_ptr(codes))
    index.ntotal = count
    index.nprobe = min(20, len(centres))
    return index
