"""A session that is watched while it runs: delays, memory and counts every few seconds."""

import os
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseloom.live.contract import Counters, Post, SessionFacts, Update
from poseloom.live.delays import Delays
from poseloom.live.responsiveness import responsive_process
from poseloom.live.session import Session
from poseloom.live.session_plan import SessionPlan, SessionSummary


@dataclass(frozen=True, eq=False)
class Reading:
    """A look at a running session.

    Attributes:
        time: Seconds since it began.
        memory: Resident memory of the process, MB; 0 where the system does not tell.
        histogram: Of all delays so far, in the bins of `Delays`.
        counters: Totals so far.
        load: Processes that want a core, over the last minute.
        cpu: Seconds of a core that the process has used.
    """

    time: float
    memory: float
    histogram: NDArray[np.int64]
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

    def percentiles(self, start: float = 0.0, stop: float = 1.0) -> tuple[float, float, float]:
        """Median, 95th and 99th percentile of the delays of a stretch of the session, given as shares; milliseconds."""
        last = len(self.readings) - 1
        first, end = self.readings[round(start * last)], self.readings[round(stop * last)]
        return Delays.percentiles_of(end.histogram - (first.histogram if start > 0 else 0))

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
                each.readings.append(_reading(each.session, 0.0 if not each.readings else each.readings[-1].time))


def _look(watched: list[Watched], ended: threading.Event, every: float) -> None:
    began = time.monotonic()
    while not ended.wait(every):
        for each in watched:
            each.readings.append(_reading(each.session, time.monotonic() - began))


def _reading(session: Session, moment: float) -> Reading:
    return Reading(
        moment, resident_memory(), session.delays.histogram(), session.counters, os.getloadavg()[0], time.process_time()
    )


def resident_memory() -> float:
    """Resident memory of this process, MB; 0 where the system does not tell."""
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1024
    return 0.0


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    """Waits for something, and says whether it happened."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.005)
    return condition()


class Notebook:
    """A sink that keeps what a judge of the session needs, and no more.

    Attributes:
        times: Of each update's sample, session seconds.
        poses: Pose vectors.
        states: Health, in words.
    """

    name = "notebook"
    capacity = 100_000

    def __init__(self) -> None:
        self.times: list[float] = []
        self.poses: list[NDArray[np.float64]] = []
        self.states: list[str] = []

    def open(self, facts: SessionFacts, post: Post) -> None:
        """See `Sink`."""

    def changed(self, facts: SessionFacts) -> None:
        """See `Sink`."""

    def show(self, update: Update) -> None:
        """See `Sink`."""
        if update.frame is not None:
            self.times.append(update.sample.time)
            self.poses.append(update.frame.pose.q)
            self.states.append(update.frame.health.state.value)

    def close(self) -> None:
        """See `Sink`."""
