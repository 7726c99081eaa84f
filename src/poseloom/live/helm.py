"""What a person can change while a session runs: the method, the heading, the wearer's body, the recording."""

import asyncio
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from poseloom.calibration.calibration import Calibration
from poseloom.errors import PoseloomError, unknown_name
from poseloom.live.contract import ArrivalStatus, Level, Notice, SessionFacts
from poseloom.live.recording_desk import RecordingDesk
from poseloom.live.session_plan import SessionPlan
from poseloom.live.sinks.outlet import Outlet, Tell
from poseloom.live.worker import MethodWorker, warm_up
from poseloom.methods.alignment import facing_ahead
from poseloom.methods.fold import Engine
from poseloom.sensors import SensorKind
from poseloom.skeleton.motion import Pose


class Helm:
    """Changes the engine of a running session, and tells its sinks and its recording. Called from the event loop.

    Args:
        plan: What the session is made of.
        records: Its recordings.
        outlets: Its sinks.
        reached: Tells the number of the next sample, and the newest one's time.
        tell: Where it is told what was done.

    Attributes:
        facts: The present facts.
        engine: The present engine.
        pose: The last pose that the method spoke of; set from its thread.
    """

    engine: Engine

    def __init__(
        self,
        plan: SessionPlan,
        records: RecordingDesk,
        outlets: Sequence[Outlet],
        reached: Callable[[], tuple[int, float]],
        tell: Tell,
    ) -> None:
        self.pose: Pose | None = None
        self._plan, self._records, self._outlets = plan, records, outlets
        self._reached, self._tell = reached, tell
        self._tasks: set[asyncio.Future[Any]] = set()
        self._passing = threading.Lock()
        self._passed: SessionFacts | None = None
        self.facts = SessionFacts(
            layout=plan.layout,
            skeleton=plan.skeleton,
            placements=plan.placements,
            calibrated=plan.calibrated,
            method=plan.method,
            methods=plan.methods or (plan.method,),
            delay=0,
            sources=tuple(source.name for source in plan.sources),
            guided=all(sensor.kind is SensorKind.TRACKER for sensor in plan.layout.sensors),
        )

    def take(self, engine: Engine, worker: MethodWorker) -> None:
        """Takes over the engine with which the session begins, and the thread in which it runs."""
        self.engine, self._worker = engine, worker
        self.facts = replace(self.facts, delay=engine.method.delay)

    def record(self, path: Path | None) -> None:
        """Begins a recording; None: under a name by date. The method begins anew, so that it can be solved again."""
        self.begin_recording(path or self._records.file("session", ".mcap"))
        self._restart(self.engine)

    def begin_recording(self, path: Path) -> None:
        """Begins a recording, before the method has heard anything.

        Raises:
            SensorError, FormatError, OSError: if the file cannot be begun.
        """
        number, _ = self._reached()
        self._records.begin(path, self.facts, self.engine, number)
        self.facts = replace(self.facts, recording=path)

    def stop_recording(self) -> None:
        """Ends the recording."""
        self._records.end()
        self.facts = replace(self.facts, recording=self._records.path)
        self._pass_on(self.facts)

    def announce(self, arrivals: ArrivalStatus | None, notices: tuple[Notice, ...]) -> None:
        """Tells the sinks what arrives, and what a person should know, where no update may carry it."""
        self.facts = replace(self.facts, arrivals=arrivals, notices=notices)
        # Not with what a restart still has to pass on: a new body belongs to the updates that follow it.
        self._pass_on(self._passed or self.facts)

    def _pass_on(self, facts: SessionFacts) -> None:
        with self._passing:
            self._passed = replace(facts, arrivals=self.facts.arrivals, notices=self.facts.notices)
            for outlet in self._outlets:
                if outlet.alive:
                    outlet.changed(self._passed)

    def reset_heading(self) -> None:
        """Turns and moves the world so that the wearer stands at its origin and faces ahead."""
        pose = self.pose
        if pose is None:
            self._tell(Level.WARNING, "the heading cannot be reset before there is a pose")
            return
        self._restart(replace(self.engine, alignment=facing_ahead(self.engine.alignment, pose.q)))
        self._tell(Level.NOTE, "heading reset")

    def choose(self, name: str) -> None:
        """Goes on with another method once it is ready.

        Raises:
            PoseloomError: for a name that cannot be chosen.
        """
        if name not in self.facts.methods:
            raise unknown_name("method", name, self.facts.methods)

        async def prepare() -> None:
            try:
                method = await asyncio.to_thread(self._plan.make, name)
                engine = replace(self.engine, name=name, method=method)
                await asyncio.to_thread(warm_up, engine, self._plan.layout)
            except PoseloomError as error:
                self._tell(Level.ERROR, str(error))
                return
            self._restart(replace(self.engine, name=name, method=method))
            self._tell(Level.NOTE, f"the method is {name}")

        # The loop itself holds tasks only weakly.
        task = asyncio.ensure_future(prepare())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def take_calibration(self, calibration: Calibration) -> None:
        """Goes on with the body and the placements that were measured."""
        skeleton, placements = calibration.skeleton, calibration.placements
        self.facts = replace(self.facts, skeleton=skeleton, placements=placements, calibrated=True)
        engine = replace(self.engine, skeleton=skeleton, placements=placements)
        try:
            # A recording has one body: the new one gets a file of its own.
            self._records.continue_with(self.facts, engine, self._reached()[0])
        except (PoseloomError, OSError) as error:
            self._tell(Level.ERROR, f"the recording cannot go on: {error}")
        self._restart(engine)

    def _restart(self, engine: Engine) -> None:
        """Lets the method begin anew with an engine, after the samples that it has still to hear."""
        self.engine = engine
        facts = replace(self.facts, method=engine.name, delay=engine.method.delay, recording=self._records.path)
        self.facts = facts
        number, at = self._reached()

        def begin() -> None:
            self._records.start(number, engine, at)
            self._pass_on(facts)

        self._worker.restart(engine, begin)
