"""A disk that is full at any moment: an error that names what the user asked for, and nothing half-written or lost."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from poseloom.formats._npy import read_npy, write_npy

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no system call there bounds the size of files")

BUDGETED = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from poseloom.formats._npy import write_npy
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
try:
    write_npy(Path(sys.argv[1]), np.arange(999.0))
except OSError:
    print("told")
"""


def test_every_command_tells_of_a_full_disk_and_leaves_nothing(tmp_path: Path) -> None:
    script = Path(__file__).with_name("fuzz_disk.py")
    done = subprocess.run([sys.executable, str(script), str(tmp_path)], capture_output=True, text=True, timeout=500)
    lines = done.stdout.splitlines()
    assert done.returncode == 0, f"ended by {done.returncode} at {lines[-1:]}: {done.stderr[-2000:]}"
    assert lines[-1] == "escaped 0", [line for line in lines if line.startswith("ESCAPED")][:10]
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("lacking", [1, 4000, 8100])
def test_the_last_bytes_of_an_array_are_not_lost_in_silence(tmp_path: Path, lacking: int) -> None:
    whole = 128 + 8 * 999
    command = [sys.executable, "-c", BUDGETED, str(tmp_path / "a.npy"), str(whole - lacking)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "told\n"


@pytest.mark.parametrize("array", [np.arange(7), np.ones((3, 2), np.float32).T, np.zeros((0, 4)), np.array(True)])
def test_arrays_are_written_as_numpy_reads_them(tmp_path: Path, array: np.ndarray) -> None:
    write_npy(tmp_path / "a.npy", array)
    assert np.array_equal(np.load(tmp_path / "a.npy"), array)
    with (tmp_path / "a.npy").open("rb") as stream:
        assert np.array_equal(read_npy(stream, (tmp_path / "a.npy").stat().st_size, "a"), array)
