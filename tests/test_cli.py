"""The command line's frame: exit codes, messages instead of tracebacks, and a start without heavy parts."""

import os
import subprocess
import sys

import pytest
import typer

from poseloom.cli import _app
from poseloom.errors import FormatError


def failing_app(error: BaseException) -> typer.Typer:
    app = typer.Typer(pretty_exceptions_enable=False)

    @app.command()
    def fail() -> None:
        raise error

    return app


@pytest.fixture
def run_failing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def run(error: BaseException) -> tuple[int, str]:
        monkeypatch.setattr(_app, "build_app", lambda: failing_app(error))
        return _app.run([]), capsys.readouterr().err

    return run


def test_a_poseloom_error_is_told_with_its_file_and_remedy(run_failing):
    error = FormatError("no frames", cause="the file is empty", remedy="Export it again", file="walk.bvh", line=7)
    assert run_failing(error) == (2, "poseloom: walk.bvh:7: no frames. the file is empty. Export it again.\n")


@pytest.mark.parametrize("kind", [PermissionError, FileNotFoundError, OSError])
def test_an_error_of_the_system_names_the_file(run_failing, kind):
    code, message = run_failing(kind(28, "No space left on device", "/out/motion.glb"))
    assert code == 2
    assert message.startswith("poseloom: /out/motion.glb: ")
    assert "No space left on device" in message
    assert "Traceback" not in message


def test_an_interrupt_exits_with_130(run_failing):
    assert run_failing(KeyboardInterrupt())[0] == 130


def test_a_defect_is_not_hidden(run_failing):
    with pytest.raises(ZeroDivisionError):
        run_failing(ZeroDivisionError())


@pytest.mark.parametrize("argv", [["nonsense"], ["--nonsense"], []])
def test_a_wrong_command_line_exits_with_2(argv, capsys):
    assert _app.run(argv) == 2
    assert "Usage: poseloom" in "".join(capsys.readouterr())


def test_version_and_help(capsys):
    assert _app.run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("poseloom 0.")
    assert _app.run(["--help"]) == 0
    assert "Usage: poseloom" in capsys.readouterr().out


def test_help_loads_no_heavy_part():
    code = (
        "import sys; from poseloom.cli._app import run; run(['--help']);"
        "print([m for m in ('numpy', 'numba', 'scipy', 'faiss', 'plotly') if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines()[-1] == "[]"


def test_a_closed_pipe_is_quiet():
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed:
        answer = subprocess.run([sys.executable, "-m", "poseloom", "--help"], stdout=closed, stderr=subprocess.PIPE)
    assert answer.stderr == b""
