"""The front door and the modules behind it."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import poseloom
from conftest import SOURCE

MODULES = sorted(SOURCE.rglob("*.py"))


def test_the_front_door_offers_what_it_lists():
    assert poseloom.__all__ == sorted(poseloom.__all__)
    assert set(poseloom.__all__) <= set(dir(poseloom))
    for name in poseloom.__all__:
        assert getattr(poseloom, name).__doc__, name


def test_type_checkers_see_the_same_names():
    tree = ast.parse(Path(poseloom.__file__).read_text(encoding="utf-8"))
    guard = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {(alias.name, node.module) for node in guard.body for alias in node.names}
    assert seen == {(name, f"poseloom.{home}") for name, home in poseloom._HOMES.items()}
    assert {name for name, _ in seen} == set(poseloom.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = poseloom.nothing


def test_importing_poseloom_loads_nothing_heavy():
    code = (
        "import sys, poseloom; print([m for m in ('numpy', 'numba', 'scipy', 'faiss', 'plotly') if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout == "[]\n"


def test_every_module_says_what_it_is_about():
    assert [path for path in MODULES if not ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))] == []


def test_every_module_can_be_imported():
    names = (".".join(path.relative_to(SOURCE).with_suffix("").parts) for path in MODULES)
    for name in names:
        if not name.endswith("__main__"):
            import_module(name.removesuffix(".__init__"))
