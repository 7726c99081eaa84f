"""Methods, sources and formats of other packages: the example package, broken ones, and names that clash."""

import importlib
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

from poseloom import formats
from poseloom.cli._app import run
from poseloom.errors import MethodError
from poseloom.formats.recording import write_recording
from poseloom.formats.table import FORMATS
from poseloom.live.specifications import SOURCES, make_source
from poseloom.live.virtual import virtual_recording
from poseloom.methods import METHODS, choose, make_method
from poseloom.plugins import PluginWarning
from poseloom.sensors import layout
from poseloom.skeleton import average_body, make_motion
from poseloom.testing import check_format, check_method, check_source

PLUGIN = Path(__file__).parents[2] / "examples" / "plugin"
SIX = layout("six-trackers")


def _forget() -> None:
    importlib.invalidate_caches()
    for table in (METHODS, FORMATS, SOURCES):
        for name in ("_found", "_loaded"):
            vars(table).pop(name, None)


def install(folder: Path, name: str, modules: dict[str, str], points: str) -> None:
    """What an installer leaves of a package: its modules, and a record of its name and entry points."""
    about = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(points)
    for file, text in modules.items():
        (folder / file).write_text(text)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A folder of packages on the path."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    _forget()
    yield folder
    monkeypatch.undo()
    _forget()


@pytest.fixture
def example(site: Path) -> Path:
    """The example package, as an installer leaves it."""
    import tomllib

    shutil.copytree(PLUGIN / "src" / "poseloom_example", site / "poseloom_example")
    project = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]
    groups = project["entry-points"]
    lines = [f"[{group}]\n" + "".join(f"{n} = {v}\n" for n, v in rows.items()) for group, rows in groups.items()]
    install(site, project["name"], {}, "\n".join(lines))
    return site


def test_the_example_keeps_the_contracts(example: Path, tmp_path: Path) -> None:
    recording = virtual_recording("sample:walk", SIX, seed=4, endless=False).cut(10, 60)
    check_method(choose(SIX, "under-the-head").method, recording)
    sound = [b"head,0,1.6,0,1,0,0,0", b"leftHand,0.4,1,0,1,0,0,0\n"]
    check_source(lambda: make_source("csv://:0"), sound)
    (tmp_path / "files").mkdir()
    body = average_body()
    motion = make_motion(body, np.random.default_rng(0).normal(size=(5, body.size)), 30.0, "any")
    check_format(FORMATS["pose-table"], tmp_path / "files", motion=motion)


def test_the_example_is_used_by_name(example: Path, tmp_path: Path) -> None:
    recording = virtual_recording("sample:walk", SIX, seed=4, endless=False).cut(10, 40)
    write_recording(recording, tmp_path / "walk.mcap")
    made = tmp_path / "walk.poses"
    assert "under-the-head" in METHODS
    assert ".poses" in formats.motion_suffixes()
    assert "csv" in SOURCES
    given = ["reconstruct", str(tmp_path / "walk.mcap"), "-m", "under-the-head"]
    assert run([*given, "-o", str(tmp_path / "walk.npz")]) == 0
    assert run(["convert", str(tmp_path / "walk.npz"), str(made)]) == 0
    back = formats.read_motion(made)
    np.testing.assert_allclose(back.q, formats.read_motion(tmp_path / "walk.npz").q, atol=1e-7)
    assert make_source("csv://:0?layout=three-trackers").layout.names == layout("three-trackers").names


def test_a_broken_package_is_named_and_leaves_the_others_alone(example: Path) -> None:
    points = "[poseloom.methods]\nbroken = broken_module:METHOD\nnumber = number_module:METHOD\n"
    modules = {"broken_module.py": "raise OSError('no licence')\n", "number_module.py": "METHOD = 3\n"}
    install(example, "broken-package", modules, points)
    with pytest.warns(PluginWarning, match="broken-package fails with OSError: no licence"):
        assert "under-the-head" in METHODS
    with pytest.raises(MethodError, match="broken-package fails with OSError: no licence"):
        make_method("broken", SIX)
    with pytest.raises(MethodError, match="is a int, not a MethodEntry"):
        make_method("number", SIX)
    assert make_method("inverse-kinematics", SIX).layout == SIX
    assert "broken" not in list(METHODS)


def test_names_that_clash_are_refused_with_both_packages(site: Path) -> None:
    row = "from poseloom.methods import METHODS\nMETHOD = METHODS['inverse-kinematics']\n"
    for name in ("one", "other"):
        points = f"[poseloom.methods]\nmine = {name}_module:METHOD\n"
        install(site, name, {f"{name}_module.py": row}, points)
    with (
        pytest.warns(PluginWarning, match="one and other each have a method of this name"),
        pytest.raises(MethodError, match="one and other each have"),
    ):
        make_method("mine", SIX)


def test_a_name_of_poselooms_own_is_not_taken_over(site: Path) -> None:
    install(site, "thief", {}, "[poseloom.methods]\nlocal-filter = nowhere:METHOD\n")
    with pytest.warns(PluginWarning, match="poseloom and thief each have"):
        make_method("inverse-kinematics", SIX)
    assert METHODS["local-filter"].summary


def test_nothing_is_loaded_for_names_of_poselooms_own(site: Path) -> None:
    install(site, "broken-package", {}, "[poseloom.methods]\nbroken = nowhere:METHOD\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_method("inverse-kinematics", SIX)
