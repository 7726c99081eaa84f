"""A process tuned to answer in milliseconds, for as long as a session runs."""

import gc
import sys
from collections.abc import Generator
from contextlib import contextmanager

_SWITCH_SECONDS = 0.0005


@contextmanager
def responsive_process() -> Generator[None]:
    """Lets threads take turns often, and keeps the collector from walking through what was loaded before.

    A thread that computes in Python gives way after 5 ms by default: as long as a whole step may take. These are
    settings of the process, so the program decides, not the session.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_SECONDS)
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
