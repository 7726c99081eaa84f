"""What the documents show exists, and every example runs."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


def test_links_commands_and_names_in_documents_resolve():
    answer = subprocess.run([sys.executable, ROOT / "scripts" / "check_docs.py"], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stdout + answer.stderr


SHOWN = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*\(.*\)|_?[a-z]+(?:_[a-z0-9]+)+|_?[A-Z]+(?:_[A-Z]+)+")
"""Inline code that is a call, a name with underscores, or a constant."""
PLACEHOLDERS = {"read_NAME", "write_NAME", "knee_l", "time_ms", "nn"}
"""Names of what a reader writes, of columns in users' files, and of another library."""


def defined_names() -> set[str]:
    """Every name that the source defines or spells: functions, classes, arguments, attributes, modules, keys."""
    names: set[str] = set()
    for path in (ROOT / "src").rglob("*.py"):
        names.update(path.relative_to(ROOT / "src").with_suffix("").parts)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.arg):
                names.add(node.arg)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                names.add(node.id)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                names.update(re.findall(r"\w+", node.value) if len(node.value) < 200 else ())
    return names


def test_names_in_inline_code_exist():
    known = defined_names() | {path.stem for path in (ROOT / "tests").glob("*.py")}
    wrong: list[str] = []
    for page in sorted((ROOT / "docs").glob("*.md")):
        text = re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for code in re.findall(r"`([^`\n]+)`", text):
            if SHOWN.fullmatch(code.partition(" -> ")[0]):
                missing = [part for part in code.partition("(")[0].split(".") if part not in known | PLACEHOLDERS]
                wrong += [f"{page.name}: `{code}`: no {part!r}" for part in missing]
    assert not wrong, "\n".join(wrong)


def test_formats_page_names_functions_that_can_be_imported():
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    import poseloom

    called = {name for name in re.findall(r"`(\w+)\(", page) if name not in PLACEHOLDERS}
    assert {"read_motion", "write_motion"} <= called
    assert {name for name in called if not hasattr(poseloom, name)} <= {"drop_rest_frame", "read_deepmimic"}


def test_the_recording_in_the_documents_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    page = (ROOT / "docs" / "sensors.md").read_text(encoding="utf-8")
    (block,) = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "make_recording(" in block]
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "sensors.md", "exec"), {})
    from poseloom import read_recording

    assert len(read_recording(tmp_path / "still.mcap")) == 120


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example: Path, tmp_path: Path):
    assert len(example.read_text(encoding="utf-8").splitlines()) < 80
    answer = subprocess.run([sys.executable, example], cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout
