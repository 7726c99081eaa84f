"""The one artefact format: what was written comes back, and what is not an artefact is named."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from poseloom.errors import FormatError
from poseloom.formats.artefact import read_artefact, write_artefact


def write_example(path: Path) -> None:
    arrays = {
        "weights": np.arange(600.0).reshape(20, 30),
        "names": np.array(["a", "bc"]),
        "file": np.ones(2, dtype=np.int8),
    }
    write_artefact(path, "model", 2, {"states": 5, "tags": ["x", None]}, arrays, seed=7, data_digest="abc")


@given(
    header=st.dictionaries(st.text(), st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, width=64)),
    array=st_numpy.arrays(
        st_numpy.floating_dtypes() | st_numpy.integer_dtypes() | st_numpy.boolean_dtypes(),
        st_numpy.array_shapes(min_dims=0, min_side=0),
    ),
)
def test_any_header_and_array_come_back(tmp_path_factory: pytest.TempPathFactory, header: dict[str, object], array):
    path = tmp_path_factory.mktemp("artefact") / "a.npz"
    header = {key: value for key, value in header.items() if not isinstance(value, float) or np.isfinite(value)}
    array = np.asarray(array)
    write_artefact(path, "thing", 1, header, {"x": array})
    back = read_artefact(path, "thing", 1)
    assert dict(back.header) == header
    assert back.arrays["x"].dtype == array.dtype
    assert back.arrays["x"].shape == array.shape
    assert back.arrays["x"].tobytes() == array.tobytes()


def test_what_every_artefact_says_comes_back(tmp_path: Path):
    write_example(tmp_path / "m.npz")
    back = read_artefact(tmp_path / "m.npz", "model")
    assert (back.kind, back.version, back.seed, back.data_digest) == ("model", 2, 7, "abc")
    assert back.poseloom_version
    assert dict(back.header) == {"states": 5, "tags": ["x", None]}
    assert sorted(back.arrays) == ["file", "names", "weights"]
    assert not back.arrays["weights"].flags.writeable


def test_numpy_opens_it_too(tmp_path: Path):
    write_example(tmp_path / "m.npz")
    with np.load(tmp_path / "m.npz") as archive:
        np.testing.assert_array_equal(archive["weights"], np.arange(600.0).reshape(20, 30))


def test_the_same_content_gives_the_same_bytes(tmp_path: Path):
    write_example(tmp_path / "a.npz")
    write_example(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_another_kind_or_version_is_named(tmp_path: Path):
    write_example(tmp_path / "m.npz")
    with pytest.raises(FormatError, match="holds a model, not a calibration"):
        read_artefact(tmp_path / "m.npz", "calibration")
    with pytest.raises(FormatError, match="version 2, but poseloom reads version 3"):
        read_artefact(tmp_path / "m.npz", "model", 3)


def test_python_objects_are_refused_and_nothing_is_left(tmp_path: Path):
    with pytest.raises(FormatError, match="'x' of type object"):
        write_artefact(tmp_path / "m.npz", "model", 1, {}, {"x": np.array([{}], dtype=object)})
    with pytest.raises(FormatError, match="header of a model"):
        write_artefact(tmp_path / "m.npz", "model", 1, {"x": object()}, {})
    with pytest.raises(FormatError, match="header of a model"):
        write_artefact(tmp_path / "m.npz", "model", 1, {"x": float("nan")}, {})
    assert list(tmp_path.iterdir()) == []


def test_a_pickle_inside_is_never_loaded(tmp_path: Path):
    write_example(tmp_path / "m.npz")
    np.save(tmp_path / "evil.npy", np.array([{}], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "m.npz", "a") as archive:
        archive.write(tmp_path / "evil.npy", "evil.npy")
    with pytest.raises(FormatError, match="type object"):
        read_artefact(tmp_path / "m.npz", "model")


def test_cut_and_damaged_files_are_named(tmp_path: Path):
    write_example(tmp_path / "m.npz")
    content = (tmp_path / "m.npz").read_bytes()
    bad = tmp_path / "bad.npz"
    for size in np.linspace(0, len(content) - 1, 40).astype(int):
        bad.write_bytes(content[:size])
        with pytest.raises(FormatError, match=r"bad\.npz"):
            read_artefact(bad, "model")
    refused = 0
    for place in np.linspace(0, len(content) - 1, 80).astype(int):
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        bad.write_bytes(damaged)
        try:
            back = read_artefact(bad, "model")
        except FormatError:
            refused += 1
        else:
            # Some bytes of a zip archive mean nothing: dates, permissions.
            np.testing.assert_array_equal(back.arrays["weights"], np.arange(600.0).reshape(20, 30))
    assert refused > 60


def test_other_archives_are_named(tmp_path: Path):
    np.savez(tmp_path / "plain.npz", x=np.ones(3))
    with pytest.raises(FormatError, match="no artefact"):
        read_artefact(tmp_path / "plain.npz", "model")
    with pytest.raises(FormatError, match="no such file"):
        read_artefact(tmp_path / "none.npz", "model")
    with pytest.raises(FormatError, match="folder"):
        read_artefact(tmp_path, "model")
