"""A process tuned to answer in milliseconds, for as long as a session runs."""

import contextlib
import ctypes
import gc
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager

_SWITCH_SECONDS = 0.0005
_COARSE_SECONDS = 0.002


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
        with _fine_timers():
            yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)


@contextmanager
def _fine_timers() -> Generator[None]:
    """Lets waits of Windows end within a millisecond; by default they end at the next tick of 16 ms."""
    timers = getattr(ctypes, "windll").winmm if sys.platform == "win32" else None  # noqa: B009 - only Windows has it
    if timers is None:
        yield
        return
    timers.timeBeginPeriod(1)
    with contextlib.ExitStack() as stack:
        stack.callback(timers.timeEndPeriod, 1)
        yield


def coarse_clock_note() -> str:
    """What people are told where the clock that stamps arrivals is coarse (Windows before Python 3.13); else empty."""
    tick = time.get_clock_info("monotonic").resolution
    if tick < _COARSE_SECONDS:
        return ""
    return f"this Python's clock has ticks of {1e3 * tick:.0f} ms, which blur every time of arrival: use Python 3.13"
