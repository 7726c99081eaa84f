"""The site of the documents, and what hosted runners call."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]


def _script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_links_that_lead_nowhere_are_found(tmp_path: Path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.html").write_text(
        '<a href="sub/b.html#here">x</a><a href="#top"></a><h1 id="top"></h1><a href="https://example.org/x">y</a>',
        encoding="utf-8",
    )
    (tmp_path / "sub" / "b.html").write_text(
        '<p id="here"></p><a href="../a.html#bottom"></a><img src="no%20picture.png"><a href="../a.html"></a>',
        encoding="utf-8",
    )
    found = list(_script("build_site").broken_links(tmp_path))
    assert found == [
        "sub/b.html: link to ../a.html#bottom: no such place",
        "sub/b.html: link to no%20picture.png: no such file",
    ]


def test_each_public_name_is_described_once():
    """The pages of the reference hold each face's names, in full on one page and as a link on the others."""
    site = _script("build_site")
    public = site.faces()
    import poseloom

    assert public["poseloom"] == list(poseloom.__all__)
    assert {"poseloom.methods", "poseloom.errors", "poseloom.skeleton"} <= set(public)
    shown = site.homes(public)
    for face, names in shown.items():
        page = site.reference_page(face, names)
        for name, home in names.items():
            directive = re.search(rf"^\.\. auto\w+:: {re.escape(face)}\.{name}$", page, re.MULTILINE)
            assert (directive is not None) == (home == face)
            assert home == face or f"<{home}.{name}>`" in page
            assert shown[home][name] == home


def test_sphinx_makes_the_reference_without_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """One face of it here; `make docs` and `make check` make the whole site, and follow every link of it."""
    build = pytest.importorskip("sphinx.cmd.build", reason="Sphinx is not installed (the extra docs has it)")
    pytest.importorskip("furo", reason="furo is not installed (the extra docs has it)")
    pytest.importorskip("myst_parser", reason="myst-parser is not installed (the extra docs has it)")
    site = _script("build_site")
    monkeypatch.setattr(site, "faces", lambda: {"poseloom.sensors": __import__("poseloom.sensors").sensors.__all__})
    shown = site.homes(site.faces())
    source = tmp_path / "source"
    source.mkdir()
    (source / "conf.py").write_text((ROOT / "docs" / "conf.py").read_text(encoding="utf-8"), encoding="utf-8")
    (source / "api").mkdir()
    (source / "index.md").write_text("# x\n\n```{toctree}\napi/poseloom.sensors\n```\n", encoding="utf-8")
    page = site.reference_page("poseloom.sensors", shown["poseloom.sensors"])
    (source / "api" / "poseloom.sensors.md").write_text(page, encoding="utf-8")
    assert build.build_main(["-W", "-q", str(source), str(tmp_path / "site")]) == 0
    assert list(site.broken_links(tmp_path / "site")) == []
    assert list(site.undescribed(shown, tmp_path / "site")) == []


def test_hosted_runners_call_what_make_calls():
    targets = set(_script("make").TARGETS)
    written = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = re.search(r"^\.PHONY: (.*)$", written, re.MULTILINE)
    assert phony is not None
    assert set(phony[1].split()) == targets
    workflows = [path.read_text(encoding="utf-8") for path in (ROOT / ".github" / "workflows").glob("*.yml")]
    called = {name for text in workflows for name in re.findall(r"run: (?:make|python scripts/make\.py) (\w+)", text)}
    assert {"check", "test", "demo"} <= called <= targets
    assert all(system in "".join(workflows) for system in ("ubuntu", "windows", "macos"))
    oldest = re.search(r'requires-python = ">=(\d+\.\d+)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert oldest is not None
    assert f'"{oldest[1]}"' in "".join(workflows)


def test_the_runner_finds_programs_as_each_system_names_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    ran: list[list[str]] = []
    monkeypatch.setattr(sys, "platform", "win32")
    make = _script("make")
    assert make.BIN.name == "Scripts"
    monkeypatch.setattr(make, "install", lambda *_: None)
    monkeypatch.setattr(make, "run", lambda *words, **_: ran.append(list(words)))
    assert make.main(["demo", "a folder with spaces"]) == 0
    assert ran == [["poseloom", "demo", "--data", "a folder with spaces", "-o", "demo"]]
    assert make.main(["nothing"]) == 2
    assert make.main(["test", "more"]) == 2
