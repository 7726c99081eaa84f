"""What `make` does, on every system: Windows has no make.

python scripts/make.py demo [DATA] | test | check | docs | benchmark | clean

The environment is made in .venv, by the Python that runs this file, unless one is there.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = ROOT / ".venv"
BIN = ENVIRONMENT / ("Scripts" if sys.platform == "win32" else "bin")
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
BROWSER_TESTS = "tests/test_viewer_browser.py"  # a browser that draws without a graphics card needs both cores
MADE = ("build", "dist", "demo", ".pytest_cache", ".ruff_cache", ".hypothesis", ".import_linter_cache")


def install(extra: str, stamp: str) -> None:
    """Makes the environment, and installs the package with an extra, unless nothing has changed since."""
    python = BIN / ("python.exe" if sys.platform == "win32" else "python")
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(ENVIRONMENT)], check=True)
    done, asked = ENVIRONMENT / stamp, (ROOT / "pyproject.toml", ROOT / "constraints.txt")
    if done.exists() and all(done.stat().st_mtime >= file.stat().st_mtime for file in asked):
        return
    print(f"Installing poseloom[{extra}] into .venv", flush=True)
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "--constraint", "constraints.txt", "--editable", f".[{extra}]"], cwd=ROOT, check=True)
    done.touch()


def run(program: str, *arguments: str, **environment: str) -> None:
    """Runs a program of the environment; a failure ends everything with its exit code."""
    found = shutil.which(program, path=str(BIN)) or str(BIN / program)
    code = subprocess.run([found, *arguments], cwd=ROOT, env={**os.environ, **environment}, check=False).returncode
    if code:
        sys.exit(code)


def demo(*data: str) -> None:
    """The whole way once: sensors in, motion out, a report to look at, in demo/."""
    install("report", "installed")
    run("poseloom", "demo", *(("--data", data[0]) if data else ()), "-o", "demo")


def test() -> None:
    """The tests; real recordings are used where POSELOOM_DATA (or its default folder) holds them."""
    install("dev", "installed-dev")
    one = dict.fromkeys(ONE_THREAD, "1")
    run("python", "-m", "pytest", "-n", "2", "--dist", "loadgroup", "--ignore", BROWSER_TESTS, **one)
    run("python", "-m", "pytest", BROWSER_TESTS, **one)


def check() -> None:
    """Style, types, layers, documents and their site."""
    install("dev", "installed-dev")
    run("ruff", "check", ".")
    run("ruff", "format", "--check", ".")
    run("pyright")
    run("lint-imports")
    run("python", "scripts/check_docs.py")
    run("python", "scripts/build_site.py")


def docs() -> None:
    """The documents and the reference of every public name as a site, in build/site."""
    install("dev", "installed-dev")
    run("python", "scripts/build_site.py")


def benchmark() -> None:
    """The figures of docs/benchmarks/core.md, measured again."""
    install("report", "installed")
    (ROOT / "build").mkdir(exist_ok=True)
    run("poseloom", "benchmark", "core", "--json", "build/core.json", "--markdown", "docs/benchmarks/core.md")


def clean() -> None:
    """Removes what was made, but not .venv."""
    caches = [path for top in ("src", "tests", "examples", "scripts") for path in (ROOT / top).rglob("__pycache__")]
    for path in [*(ROOT / name for name in MADE), *caches]:
        shutil.rmtree(path, ignore_errors=True)


TARGETS = {each.__name__: each for each in (demo, test, check, docs, benchmark, clean)}


def main(arguments: list[str]) -> int:
    """Makes one target, `demo` where none is named."""
    name, *rest = arguments or ["demo"]
    if name not in TARGETS or (rest and name != "demo"):
        print(f"python scripts/make.py {' | '.join(TARGETS)}", file=sys.stderr)
        return 2
    try:
        TARGETS[name](*rest)
    except subprocess.CalledProcessError as error:
        print(f"make: this command failed: {' '.join(map(str, error.cmd))}", file=sys.stderr)
        return error.returncode or 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
