"""Finding the moments of a library that are like a given one: features, their principal components, and faiss."""

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

import faiss as _faiss  # pyright: ignore[reportMissingTypeStubs]
import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints
from poseloom.errors import LibraryError
from poseloom.library.features import FeatureMap, FeatureSettings, make_feature_map

faiss = cast(Any, _faiss)
"""Its own type information is partial and in places wrong."""

_SAMPLE = 40_000
"""Moments from which principal components and cells are learnt."""

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

    def search(
        self, query: Floats[Array, "columns"], count: int, exclusion: Exclusion | None = None
    ) -> tuple[Ints[Array, "found"], Floats[Array, "found"]]:
        """The `count` moments nearest to a projected query, nearest first, and their squared distances.

        The query has the history's columns, and the sensors' behind them if the features are searched by sensors.
        """
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
        return _search(self._by_sensors, query, count, exclusion)

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
) -> MomentIndex:
    """Describes every moment of a library, learns the projections and the cells, and writes all of it into `folder`.

    Raises:
        LibraryError: where no clip is long enough to have a moment.
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
    columns = np.lib.format.open_memmap(folder / "columns.npy", "w+", dtype=np.float32, shape=(len(rows), width))
    for start in range(0, len(rows), _CHUNK):
        part = rows[start : start + _CHUNK]
        columns[start : start + len(part), : history.basis.shape[1]] = (
            features.library_history(poses, part) - history.mean
        ) @ history.basis
        columns[start : start + len(part), history.basis.shape[1] :] = (
            features.library_sensors(poses, part) - sensors.mean
        ) @ sensors.basis
    columns.flush()
    np.save(folder / "rows.npy", rows)
    np.savez(
        folder / "projection.npz",
        history_mean=history.mean, history_basis=history.basis, sensor_mean=sensors.mean, sensor_basis=sensors.basis,
    )  # fmt: skip
    searched = columns if settings.by_sensors else np.ascontiguousarray(columns[:, : history.basis.shape[1]])
    faiss.write_index(_cells(searched), str(folder / "moments.faiss"))
    if sensors.basis.shape[1]:
        faiss.write_index(
            _cells(np.ascontiguousarray(columns[:, history.basis.shape[1] :])), str(folder / "sensors.faiss")
        )
    (folder / "features.json").write_text(json.dumps(asdict(settings), indent=1))
    return load_index(folder)


def load_index(folder: Path) -> MomentIndex:
    """Opens an index that `build_index` wrote. Raises LibraryError naming what is missing or damaged."""
    faiss.omp_set_num_threads(1)
    try:
        stated = json.loads((folder / "features.json").read_text())
        stated["sensor_bones"] = tuple(stated["sensor_bones"])
        settings = FeatureSettings(**stated)
        rows = np.load(folder / "rows.npy")
        columns = np.asarray(np.load(folder / "columns.npy", mmap_mode="r"))
        with np.load(folder / "projection.npz") as arrays:
            history = Projection(arrays["history_mean"], arrays["history_basis"])
            sensors = Projection(arrays["sensor_mean"], arrays["sensor_basis"])
        whole = faiss.read_index(str(folder / "moments.faiss"))
        by_sensors = faiss.read_index(str(folder / "sensors.faiss")) if sensors.basis.shape[1] else None
    except (OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise LibraryError(
            "the library's index cannot be read",
            cause=str(error).splitlines()[0],
            remedy="Delete the folder: it is built again when it is next needed",
            file=folder,
        ) from None
    if not len(rows) == len(columns) == whole.ntotal:
        raise LibraryError(
            "the parts of the library's index do not fit together",
            cause=f"{len(rows)} rows, {len(columns)} features, {whole.ntotal} searchable moments",
            remedy="Delete the folder: it is built again when it is next needed",
            file=folder,
        )
    return MomentIndex(make_feature_map(settings), rows, columns, history, sensors, whole, by_sensors)


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


def _cells(columns: Floats32[Array, "moments columns"]) -> Any:
    """A faiss index: exact for small libraries, else inverted lists, about four times the root of the moments' number.

    At 1.26 million moments 4096 lists, of which 20 are looked into, take a third of the time of 1024 and 24, and find
    the same: a search costs one distance a list and one for each moment in the lists looked into.
    """
    faiss.omp_set_num_threads(1)
    count, width = columns.shape
    if count < 20_000:
        index = faiss.IndexFlatL2(width)
        index.add(np.ascontiguousarray(columns))
        return index
    lists = 2 ** round(math.log2(4.0 * math.sqrt(count)))
    index = faiss.index_factory(width, f"IVF{lists},Flat")
    training = np.sort(np.random.default_rng(0).permutation(count)[: 40 * lists])
    index.cp.niter = 10
    index.train(np.ascontiguousarray(columns[training]))
    for start in range(0, count, _CHUNK):
        index.add(np.ascontiguousarray(columns[start : start + _CHUNK]))
    index.nprobe = 20
    return index
