"""A session that is watched while it runs: delays, memory and counts every few seconds."""

import os
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from poseloom.benchmark.memory import resident_memory
from poseloom.live.contract import Counters
from poseloom.live.delays import BIN_COUNT, Delays
from poseloom.live.responsiveness import responsive_process
from poseloom.live.session import Session
from poseloom.live.session_plan import SessionPlan, SessionSummary


@dataclass(frozen=True, eq=False)
class Reading:
    """A look at a running session.

    Attributes:
        time: Seconds since it began.
        memory: Resident memory of the process, MB.
        bins: Those bins of `Delays` into which delays fell since the look before. A long session is looked at often:
            whole histograms would look like a session that grows.
        counts: How many fell into each.
        counters: Totals so far.
        load: Processes that want a core, over the last minute; 0 where the system does not report it.
        cpu: Seconds of a core that the process has used.
    """

    time: float
    memory: float
    bins: NDArray[np.int16]
    counts: NDArray[np.uint32]
    counters: Counters
    load: float
    cpu: float


@dataclass(eq=False)
class Watched:
    """A session that ran, or runs.

    Attributes:
        session: The session.
        readings: Looks at it, in order.
        summary: What it did, once it has ended.
    """

    session: Session
    readings: list[Reading] = field(default_factory=list[Reading])
    summary: SessionSummary | None = None
    _seen: NDArray[np.int64] = field(default_factory=lambda: np.zeros(BIN_COUNT, dtype=np.int64), repr=False)

    def look(self, moment: float) -> None:
        """Adds a look at it, so many seconds after it began."""
        now = self.session.delays.histogram()
        fresh, self._seen = now - self._seen, now
        bins = np.flatnonzero(fresh)
        self.readings.append(
            Reading(
                moment,
                resident_memory(),
                bins.astype(np.int16),
                fresh[bins].astype(np.uint32),
                self.session.counters,
                os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0,
                time.process_time(),
            )
        )

    def percentiles(self, start: float = 0.0, stop: float = 1.0) -> tuple[float, float, float]:
        """Median, 95th and 99th percentile of the delays of a stretch of the session, given as shares; milliseconds."""
        last = len(self.readings) - 1
        first, end = round(start * last) + 1 if start > 0 else 0, round(stop * last) + 1
        histogram = np.zeros(BIN_COUNT, dtype=np.int64)
        for reading in self.readings[first:end]:
            histogram[reading.bins] += reading.counts
        return Delays.percentiles_of(histogram)

    def memory(self, start: float, stop: float) -> float:
        """Median resident memory of a stretch, MB."""
        last = len(self.readings) - 1
        return float(np.median([r.memory for r in self.readings[round(start * last) : round(stop * last) + 1]]))


@contextmanager
def running(plans: list[SessionPlan], every: float = 5.0) -> Generator[list[Watched]]:
    """Runs sessions in threads of this process and looks at them; they are stopped at the end of the block."""
    watched = [Watched(Session(plan)) for plan in plans]
    ended = threading.Event()

    def run(each: Watched) -> None:
        each.summary = each.session.run()

    threads = [threading.Thread(target=run, args=(each,), daemon=True) for each in watched]
    with responsive_process():
        for thread in threads:
            thread.start()
        looking = threading.Thread(target=_look, args=(watched, ended, every), daemon=True)
        looking.start()
        try:
            yield watched
        finally:
            for each in watched:
                each.session.stop()
            for thread in threads:
                thread.join()
            ended.set()
            looking.join()
            for each in watched:
                each.look(0.0 if not each.readings else each.readings[-1].time)


def _look(watched: list[Watched], ended: threading.Event, every: float) -> None:
    began = time.monotonic()
    while not ended.wait(every):
        for each in watched:
            each.look(time.monotonic() - began)


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    """Waits for something, and says whether it happened."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.005)
    return condition()
