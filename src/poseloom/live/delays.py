"""How long samples take from arrival to pose: over the last seconds, and over the whole session in fixed memory."""

import threading
from collections import deque

import numpy as np

from poseloom.live.contract import Latency

_LAST = 600
_EVERY = 15
"""Steps between looks at the percentiles, which cost more than a step's bookkeeping."""
_BINS = np.concatenate([np.arange(0.0, 50.0, 0.05), np.geomspace(50.0, 60_000.0, 200)])
"""Edges of a histogram, milliseconds."""
BIN_COUNT = len(_BINS)
"""Bins of a histogram."""


class Delays:
    """Delays as they come in, from one thread; may be asked from any."""

    def __init__(self) -> None:
        self._last: deque[float] = deque(maxlen=_LAST)
        self._counts = np.zeros(BIN_COUNT, dtype=np.int64)
        self._lock = threading.Lock()
        self._count = 0
        self._percentiles = (0.0, 0.0, 0.0)
        self._newest, self._step = 0.0, 0.0

    def add(self, delay: float, step: float) -> None:
        """Takes in one sample's delay and the method's own time, seconds."""
        milliseconds = 1e3 * delay
        with self._lock:
            self._last.append(milliseconds)
            self._counts[int(np.searchsorted(_BINS, milliseconds, side="right")) - 1] += 1
        self._newest, self._step = milliseconds, 1e3 * step
        if self._count % _EVERY == 0:
            p50, p95, p99 = np.percentile(self._last, [50, 95, 99]).tolist()
            self._percentiles = (p50, p95, p99)
        self._count += 1

    def latest(self, look_ahead: float) -> Latency:
        """Figures of the last seconds; `look_ahead` is the method's delay in seconds."""
        return Latency(*self._percentiles, newest=self._newest, step=self._step, look_ahead=1e3 * look_ahead)

    def overall(self) -> tuple[float, float, float]:
        """Median, 95th and 99th percentile of all delays, milliseconds, to 0.05 ms; zeros where there are none."""
        return self.percentiles_of(self.histogram())

    def histogram(self) -> np.ndarray:
        """How many delays fell into each bin, for percentiles of stretches of time."""
        with self._lock:
            return self._counts.copy()

    @staticmethod
    def percentiles_of(counts: np.ndarray) -> tuple[float, float, float]:
        """Median, 95th and 99th percentile of a histogram, or of the difference of two, milliseconds."""
        total = int(counts.sum())
        if total == 0:
            return 0.0, 0.0, 0.0
        sums = np.cumsum(counts)
        p50, p95, p99 = (float(_BINS[int(np.searchsorted(sums, share * total))]) for share in (0.5, 0.95, 0.99))
        return p50, p95, p99
