"""How much memory this process takes, on every system."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

_STATUS = Path("/proc/self/status")


def resident_memory() -> float:
    """Resident memory of this process, MB (2^20 bytes)."""
    if sys.platform == "win32":
        return _windows_counters()[0] / 2**20
    if _STATUS.is_file():
        for line in _STATUS.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1024
    shown = subprocess.run(
        ["ps", "-o", "rss=", "-p", str(os.getpid())], capture_output=True, text=True, encoding="ascii", check=True
    )
    return int(shown.stdout) / 1024


def peak_memory() -> float:
    """The most that this process has taken, MB (2^20 bytes)."""
    if sys.platform == "win32":
        return _windows_counters()[1] / 2**20
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)  # macOS counts bytes, others KiB


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of psapi.h."""

    _fields_ = [
        ("cb", ctypes.c_uint32),
        ("page_faults", ctypes.c_uint32),
        ("peak_working_set", ctypes.c_size_t),
        ("working_set", ctypes.c_size_t),
        *((f"unused_{number}", ctypes.c_size_t) for number in range(6)),
    ]


def _windows_counters() -> tuple[int, int]:
    """Working set and its peak, bytes."""
    counters = _Counters(cb=ctypes.sizeof(_Counters))
    kernel = getattr(ctypes, "windll").kernel32  # noqa: B009 - a name that only Windows has
    kernel.GetCurrentProcess.restype = ctypes.c_void_p
    if not kernel.K32GetProcessMemoryInfo(
        ctypes.c_void_p(kernel.GetCurrentProcess()), ctypes.byref(counters), ctypes.c_uint32(counters.cb)
    ):
        raise OSError("Windows does not report this process's memory")
    return int(counters.working_set), int(counters.peak_working_set)
