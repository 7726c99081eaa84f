"""What the documents show exists, and every example runs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


def test_links_commands_and_names_in_documents_resolve():
    answer = subprocess.run([sys.executable, ROOT / "scripts" / "check_docs.py"], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stdout + answer.stderr


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example: Path, tmp_path: Path):
    assert len(example.read_text(encoding="utf-8").splitlines()) < 80
    answer = subprocess.run([sys.executable, example], cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout
