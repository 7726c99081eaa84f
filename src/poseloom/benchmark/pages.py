"""A benchmark's figures as rows and as a page."""

import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from poseloom.benchmark.core import Measurement
from poseloom.evaluation.rows import Results, Row

_UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))
_PACKAGES = ("numpy", "numba", "faiss-cpu")


def core_results(measured: Sequence[Measurement]) -> Results:
    """Rows of seconds: the median, the least and the most of each; `frames` is the number of repeats."""
    rows = [
        Row("core", each.name, each.setting, "none", metric, value, frames=each.timing.repeats)
        for each in measured
        for metric, value in (
            ("median_s", each.timing.median),
            ("least_s", each.timing.least),
            ("most_s", each.timing.most),
            ("bound_s", each.bound),
        )
    ]
    return Results("core", "", tuple(rows))


def core_page(measured: Sequence[Measurement]) -> str:
    """The page `docs/benchmarks/core.md`."""
    lines = "\n".join(f"| {' | '.join(shown(each))} |" for each in measured)
    packages = ", ".join(f"{package} {version(package)}" for package in _PACKAGES)
    parts = f"Python {platform.python_version()}, {packages}"
    return f"""# Core: the speed of what every method rests on

```sh
poseloom benchmark core --json core.json --markdown docs/benchmarks/core.md
```

Medians, with the least and the most of the repeats, on one thread (a library is built by two processes). A solve is the
mean over a hundred poses of a walk; a step is one sample of a walk through a method; a first step holds opening
the library and loading all that is behind it, in a new process, with an empty cache of compiled kernels (cold) or a
full one (compiled).

| what | on | median | least | most | repeats | bound |
|---|---|---|---|---|---|---|
{lines}

Measured by poseloom {version("poseloom")} on {_processor()}, {os.cpu_count()} cores, {parts}.
"""


def shown(measured: Measurement) -> tuple[str, str, str, str, str, str, str]:
    """A measurement's cells: what, on what, median, least, most, repeats, bound; in the unit that suits the bound."""
    scale, unit = next((s, u) for s, u in _UNITS if measured.bound >= s or s == _UNITS[-1][0])
    timing = measured.timing
    times = (f"{value / scale:.3g} {unit}" for value in (timing.median, timing.least, timing.most))
    median, least, most = times
    return (
        measured.name,
        measured.setting,
        median,
        least,
        most,
        str(timing.repeats),
        f"{measured.bound / scale:.3g} {unit}",
    )


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
