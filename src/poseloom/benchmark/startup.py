"""How long a fresh process takes to be of use."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from poseloom.benchmark.timing import Timing, timing_of
from poseloom.errors import PoseloomError

_IMPORT = """
from time import perf_counter
begin = perf_counter()
import poseloom
print(perf_counter() - begin)
"""
_IMPORT_ALL = _IMPORT.replace("import poseloom\n", "from poseloom import *\n")
_FIRST_STEP = """
import sys
import poseloom
from time import perf_counter
begin = perf_counter()
from poseloom.methods import DEFAULT_METHOD, make_method
library, recording = poseloom.open_library(sys.argv[1]), poseloom.read_recording(sys.argv[2])
method = make_method(DEFAULT_METHOD, recording.layout, library)
state = method.start(recording.skeleton, recording.placements)
for index in range(len(recording)):
    state, frame = method.step(state, recording.sample(index))
    if frame is not None:
        break
print(perf_counter() - begin)
"""


def time_import(repeats: int, everything: bool = False) -> Timing:
    """Time of `import poseloom` in fresh processes, or of everything behind its names (`from poseloom import *`)."""
    return timing_of(_seconds(_IMPORT_ALL if everything else _IMPORT) for _ in range(repeats))


def time_first_step(library: Path, recording: Path, repeats: int, compiled: bool) -> Timing:
    """Time from `import poseloom` done to the first frame of the recommended method, in fresh processes.

    It holds opening the library, reading the recording, loading all that is behind, and (unless `compiled`) compiling
    every kernel on the way, into an empty cache.
    """
    with tempfile.TemporaryDirectory(prefix="poseloom-kernels-") as cache:

        def once(index: int) -> float:
            folder = cache if compiled else str(Path(cache) / str(index))
            return _seconds(_FIRST_STEP, library, recording, NUMBA_CACHE_DIR=folder)

        if compiled:
            once(0)
        return timing_of(once(index) for index in range(repeats))


def _seconds(code: str, *arguments: Path, **environment: str) -> float:
    answer = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        env={**os.environ, **environment},
        check=False,
    )
    if answer.returncode != 0:
        raise PoseloomError("a process that was to be timed failed", cause=answer.stderr.strip().splitlines()[-1])
    return float(answer.stdout)
