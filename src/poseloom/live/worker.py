"""The one thread in which the method runs, and the bounded queue before it."""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from poseloom.methods.alignment import Alignment, aligned
from poseloom.methods.contract import Frame
from poseloom.methods.fold import Engine, advance, begin
from poseloom.rotations import quat_from_matrix
from poseloom.sensors import Sample, SensorKind, SensorLayout, SensorStatus, place_sensors
from poseloom.skeleton.kinematics import forward_kinematics

_WARM_UP_STEPS = 12


@dataclass(frozen=True, eq=False)
class Worked:
    """What became of one sample.

    Attributes:
        number: Its number.
        raw: The sample as it came.
        sample: The sample as the method heard it.
        frame: The pose that the method spoke of, if it did.
        begun: Host's monotonic time at which the method began.
        finished: And ended.
    """

    number: int
    raw: Sample
    sample: Sample
    frame: Frame | None
    begun: float
    finished: float


@dataclass(frozen=True, eq=False)
class Heard:
    """A sample that waits.

    Attributes:
        number: Its number.
        sample: The sample as it came.
    """

    number: int
    sample: Sample


@dataclass(frozen=True, eq=False)
class _Restart:
    engine: Engine
    begin: Callable[[], None]


class MethodWorker:
    """Runs a method over samples in a thread of its own.

    Args:
        engine: What it begins with.
        deliver: Called from the thread with each step.
        failed: Called from the thread with what went wrong; the method has then begun anew.
        capacity: Samples that may wait; when one more comes, the oldest is dropped.
        patience: Seconds after its arrival from which a sample is passed over if a newer one waits: a burst is heard
            in full, but a machine that is too slow for all samples does not fall behind by the whole queue.
    """

    def __init__(
        self,
        engine: Engine,
        deliver: Callable[[Worked], None],
        failed: Callable[[int, Exception], None],
        capacity: int = 8,
        patience: float = 0.05,
    ) -> None:
        self.dropped = 0
        self.steps = 0
        self._engine = engine
        self._fold = begin(engine)
        self._deliver, self._failed = deliver, failed
        self._capacity, self._patience = capacity, patience
        self._waiting: deque[Heard | _Restart | None] = deque()
        self._samples = 0
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="method", daemon=True)

    def start(self) -> None:
        """Begins."""
        self._thread.start()

    def hear(self, number: int, sample: Sample) -> None:
        """Passes on a sample."""
        with self._change:
            if self._samples >= self._capacity:
                oldest = next(i for i, each in enumerate(self._waiting) if isinstance(each, Heard))
                del self._waiting[oldest]
                self._samples -= 1
                self.dropped += 1
            self._waiting.append(Heard(number, sample))
            self._samples += 1
            self._change.notify()

    def restart(self, engine: Engine, begin: Callable[[], None]) -> None:
        """Begins anew with another engine, after the samples that wait; never dropped.

        Args:
            engine: What to go on with.
            begin: Called from the thread just before.
        """
        with self._change:
            self._waiting.append(_Restart(engine, begin))
            self._change.notify()

    def stop(self) -> None:
        """Ends after what waits; returns when it has ended."""
        with self._change:
            self._waiting.append(None)
            self._change.notify()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while (item := self._next()) is not None:
            if isinstance(item, _Restart):
                self._engine = item.engine
                item.begin()
                self._begin()
            else:
                self._step(item)

    def _next(self) -> Heard | _Restart | None:
        with self._change:
            while True:
                while not self._waiting:
                    self._change.wait()
                item = self._waiting.popleft()
                if not isinstance(item, Heard):
                    return item
                self._samples -= 1
                if not self._samples or time.monotonic() - item.sample.arrival <= self._patience:
                    return item
                self.dropped += 1

    def _begin(self) -> None:
        self._fold = begin(self._engine)

    def _step(self, heard: Heard) -> None:
        begun = time.monotonic()
        try:
            self._fold, sample, frame = advance(self._fold, heard.sample)
        # A live session never dies of a sample, whatever it makes a method do.
        except Exception as error:
            self._begin()
            self._failed(heard.number, error)
            return
        self.steps += 1
        self._deliver(Worked(heard.number, heard.sample, sample, frame, begun, time.monotonic()))


def warm_up(engine: Engine, layout: SensorLayout) -> None:
    """Runs a method over a person who stands in the rest pose, so that the first real sample waits for no compiler."""
    method = engine.method
    state = method.start(engine.skeleton, engine.placements)
    sample = _standing_sample(engine, layout)
    for step in range(_WARM_UP_STEPS):
        moved = Sample(step / layout.rate, 0.0, *_channels(sample), status=sample.status)
        aligned(moved, Alignment(0.1, 0.0, 0.0))
        state, _ = method.step(state, moved)


def _channels(sample: Sample) -> tuple[Any, ...]:
    return (sample.positions, sample.quats_wxyz, sample.specific_forces, sample.angular_rates, sample.counts)


def _standing_sample(engine: Engine, layout: SensorLayout) -> Sample:
    q = np.zeros(engine.skeleton.size)
    q[1] = -float(engine.skeleton.rest_positions()[:, 1].min())
    worn = place_sensors(forward_kinematics(engine.skeleton, q), engine.skeleton, engine.placements)
    count = len(layout)
    kinds = np.array([sensor.kind for sensor in layout.sensors])
    trackers, imus, flexes = (kinds == kind for kind in (SensorKind.TRACKER, SensorKind.IMU, SensorKind.FLEX))
    up = np.einsum("sji,j->si", worn.rotations, np.array([0.0, 9.81, 0.0]))
    return Sample(
        0.0,
        0.0,
        np.where(trackers[:, None], worn.positions, np.nan),
        np.where((trackers | imus)[:, None], quat_from_matrix(worn.rotations), np.nan),
        np.where(imus[:, None], up, np.nan),
        np.where(imus[:, None], np.zeros((count, 3)), np.nan),
        np.where(flexes, 500.0, np.nan),
        np.full(count, int(SensorStatus.OK), dtype=np.int64),
    )
