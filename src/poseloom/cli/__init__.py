"""The `poseloom` command."""

import os
import sys


def main() -> None:
    """Entry point: runs a command; a PoseloomError becomes a message on stderr and exit code 2, never a traceback."""
    # One thread a process, before numpy loads: a second BLAS thread makes small solves several times slower.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    from poseloom.cli._app import run

    sys.exit(run(sys.argv[1:]))
