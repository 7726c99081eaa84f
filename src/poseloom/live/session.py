"""One live session: sources in, a method in its thread, sinks out, and the commands of a person who watches."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from poseloom.errors import PoseloomError
from poseloom.live.arrival_status import ArrivalMonitor
from poseloom.live.calibration_desk import CalibrationDesk
from poseloom.live.contract import (
    Calibrate,
    ChooseMethod,
    Command,
    Counters,
    Finding,
    Level,
    Notice,
    ResetHeading,
    SessionFacts,
    StartRecording,
    Stop,
    StopRecording,
    Update,
)
from poseloom.live.delays import Delays
from poseloom.live.hearing import Hearing
from poseloom.live.helm import Helm
from poseloom.live.notices import Notices
from poseloom.live.recording_desk import RecordingDesk
from poseloom.live.session_plan import Closing, SessionPlan, SessionSummary
from poseloom.live.sinks.outlet import Outlet
from poseloom.live.watch import Watch, WatchState, ended_findings, new_findings
from poseloom.live.worker import MethodWorker, Worked, warm_up
from poseloom.methods.fold import Engine
from poseloom.sensors import Sample

_TICK = 0.01
"""Seconds between looks at silence and at samples that wait for a late sensor."""
_FAILURES_TOLD_EVERY = 2.0
_QUIET = 0.5
"""Seconds without a sample from which notices take another way to the sinks than the updates."""
_STARTING = 2.0
"""Seconds in which a source that cannot begin ends the session, whatever others have said."""


class Session:
    """Runs a plan once. `run` blocks; `post` and `stop` may be called from any thread.

    Args:
        plan: What it is made of.
    """

    def __init__(self, plan: SessionPlan) -> None:
        self.plan = plan
        self.delays = Delays()
        self._notices = Notices()
        self.tell = self._notices.tell
        self._watch = Watch(plan.layout)
        self._watching = self._watch.start()
        self._hearing = Hearing(plan.layout, self._admit, self.tell, len(plan.sources) == 1, plan.thin)
        self._arrivals = ArrivalMonitor(plan.sources, self._hearing)
        self._announced = 0
        self._outlets = [Outlet(sink, self.post, self.tell) for sink in plan.sinks]
        self._records = RecordingDesk(plan.folder, plan.settings, self.tell)
        self._helm = Helm(plan, self._records, self._outlets, self._reached, self.tell)
        self._calibration = CalibrationDesk(
            plan.layout, lambda: self._records.file("calibration", ".npz"), self.tell, self._helm.take_calibration
        )
        self._number = 0
        self._newest: Sample | None = None
        self._frames = 0
        self._failure_told = -1e9
        self._loop: asyncio.AbstractEventLoop | None = None
        self._early: list[Command] = []
        self._began = 0.0

    # What others may ask at any time

    @property
    def facts(self) -> SessionFacts:
        """The present facts."""
        return self._helm.facts

    @property
    def counters(self) -> Counters:
        """Totals up to now."""
        return replace(
            self._hearing.counters,
            dropped=self._worker.dropped if self._began else 0,
            frames=self._frames,
            unseen=sum(outlet.unseen for outlet in self._outlets),
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Present troubles with sensors."""
        return tuple(self._watching.findings.values())

    @property
    def notices(self) -> tuple[Notice, ...]:
        """The last thousand notices."""
        return self._notices.kept

    def post(self, command: Command) -> None:
        """Asks for something; see `poseloom.live.contract`."""
        loop = self._loop
        if loop is None:
            self._early.append(command)
            return
        with contextlib.suppress(RuntimeError):  # the session has ended meanwhile
            loop.call_soon_threadsafe(self._command, command)

    def stop(self) -> None:
        """Asks the session to end."""
        self.post(Stop())

    # From beginning to end

    def run(self, closing: Closing | None = None) -> SessionSummary:
        """Runs until the sources have nothing more to say, the time is up, or `stop` is called.

        A session that cannot begin leaves no file behind, and no file that was there is touched.

        Args:
            closing: Told how far files are that are being finished, from any thread.

        Raises:
            PoseloomError: if a source or sink cannot begin, or the method does not fit.
        """
        with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
            return runner.run(self._main(closing))

    async def _main(self, closing: Closing | None) -> SessionSummary:
        plan = self.plan
        engine = Engine(plan.method, plan.make(plan.method), plan.skeleton, plan.placements)
        warm_up(engine, plan.layout)
        self._worker = MethodWorker(engine, self._deliver, self._method_failed, plan.capacity, plan.patience)
        self._helm.take(engine, self._worker)
        self._end = asyncio.Event()
        opened: list[Outlet] = []
        began = time.monotonic()
        try:
            if plan.record is not None:
                self._helm.begin_recording(plan.record)
            for outlet in self._outlets:
                outlet.open(self._helm.facts)
                opened.append(outlet)
            self._loop = asyncio.get_running_loop()
            self._began = began = time.monotonic()
            self._worker.start()
            for note in plan.notes:
                self.tell(Level.NOTE, note)
            for command in self._early:
                self._command(command)
            await self._listen()
        except PoseloomError:
            self._records.discard()
            for outlet in self._outlets:
                outlet.discard()
            raise
        finally:
            self._loop = None
            await asyncio.to_thread(self._finish, opened, closing)
        return SessionSummary(
            self.counters,
            self.delays.overall(),
            time.monotonic() - began,
            self.notices,
            tuple(self._records.paths),
            self._arrivals.overall().text,
            self._arrivals.refused,
            tuple(path for outlet in self._outlets for path in getattr(outlet.sink, "written", ())),
            self._failures(),
        )

    async def _listen(self) -> None:
        running = [
            asyncio.create_task(source.run(listener))
            for source, listener in zip(self.plan.sources, self._arrivals.listeners, strict=True)
        ]
        ticking = asyncio.create_task(self._tick())
        ending = asyncio.create_task(self._end.wait())
        try:
            pending: set[asyncio.Task[Any]] = set(running)
            while pending and not ending.done():
                done, _ = await asyncio.wait({*pending, ending}, return_when=asyncio.FIRST_COMPLETED)
                pending -= done
                for task in done & set(running):
                    self._source_ended(task)
        finally:
            tasks: list[asyncio.Task[Any]] = [*running, ticking, ending]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def _source_ended(self, task: "asyncio.Task[Any]") -> None:
        error = task.exception()
        starting = self._number == 0 or time.monotonic() - self._began < _STARTING
        if isinstance(error, PoseloomError) and starting:
            raise error  # it cannot even begin, though another source may have been quicker
        if error is not None:
            self.tell(Level.ERROR, f"a source has failed and is heard no more: {error}")

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(_TICK)
            # Twice round the loop: what waits to be read is read before anybody says that nothing came.
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            now = time.monotonic()
            self._hearing.poll(now)
            self._announce(now)
            if self._newest is not None:
                self._judge(self._hearing.session_time(self._newest, now))
            if self.plan.seconds is not None and now - self._began >= self.plan.seconds:
                self._end.set()

    def _announce(self, now: float) -> None:
        """Tells what arrives whenever it has changed; notices, too, while no update carries them."""
        status = self._arrivals.poll(now)
        if status is not None:
            self.tell(status.level, status.text)
        quiet = self._newest is None or now - self._newest.arrival > _QUIET
        if status is not None or (quiet and self._notices.count > self._announced):
            self._announced = self._notices.count
            self._helm.announce(status or self._helm.facts.arrivals, self._notices.shown)

    def _finish(self, opened: list[Outlet], closing: Closing | None) -> None:
        def told(what: str, waiting: Callable[[], int]) -> Callable[[], None]:
            def tell() -> None:
                # A terminal that has gone away must not cost the files.
                with contextlib.suppress(Exception):
                    if closing is not None:
                        closing(what, waiting())

            return tell

        self._worker.stop()
        self._records.end()
        for outlet in opened:
            outlet.close(told(outlet.sink.name, lambda outlet=outlet: outlet.waiting))
        self._records.wait(told("recording", lambda: self._records.waiting))

    def _failures(self) -> tuple[str, ...]:
        """What was to be kept and was not, and how it can be had nevertheless."""
        exports = [outlet for outlet in self._outlets if outlet.keeps]
        lost = [f"{outlet.sink.name}: {outlet.failure}" for outlet in exports if outlet.failure]
        lost += [
            f"{outlet.sink.name} lacks {outlet.unseen} poses (interpolated): the disk was too slow"
            for outlet in exports
            if outlet.unseen and not outlet.failure
        ]
        recorded = self._records.paths
        back = (
            f"the recording holds it: poseloom reconstruct {recorded[-1]} -o FILE"
            if recorded
            else "nothing else holds it, for no recording is whole; --record keeps one"
        )
        return (*self._records.failures, *(f"{text}; {back}" for text in lost), *self._calibration.failures)

    # In the event loop: samples in

    def _admit(self, sample: Sample) -> None:
        number = self._number
        self._number += 1
        self._newest = sample
        self._records.sample(number, sample)
        self._worker.hear(number, sample)
        before = self._watching
        self._watching = self._watch.step(before, sample)
        self._tell_findings(before, sample.time)
        self._calibration.hear(sample)

    def _judge(self, now: float) -> None:
        before = self._watching
        self._watching = self._watch.poll(before, now)
        self._tell_findings(before, now)

    def _tell_findings(self, before: WatchState, now: float) -> None:
        if before.findings is self._watching.findings:
            return
        changes = [(each, False) for each in new_findings(before, self._watching)]
        changes += [(each, True) for each in ended_findings(before, self._watching)]
        for finding, over in changes:
            text = f"{finding.sensor} is no longer {finding.trouble.value}" if over else finding.text
            self.tell(Level.NOTE if over else Level.WARNING, text)
            self._records.finding(self._number, finding, now, over)

    # In the method's thread: poses out

    def _deliver(self, worked: Worked) -> None:
        if worked.frame is not None:
            self._frames += 1
            self._helm.pose = worked.frame.pose
        update = Update(
            number=worked.number,
            sample=worked.sample,
            frame=worked.frame,
            finished=worked.finished,
            latency=self.delays.latest(self._helm.facts.delay / self.plan.layout.rate),
            counters=self.counters,
            findings=self.findings,
            notices=self._notices.shown,
            calibration=self._calibration.progress(worked.raw.time),
        )
        for outlet in self._outlets:
            if outlet.sink.capacity == 0:
                outlet.show(update)
        self.delays.add(time.monotonic() - worked.raw.arrival, worked.finished - worked.begun)
        update = replace(update, latency=self.delays.latest(self._helm.facts.delay / self.plan.layout.rate))
        for outlet in self._outlets:
            if outlet.sink.capacity > 0:
                outlet.show(update)
        self._records.step(worked)

    def _method_failed(self, number: int, error: Exception) -> None:
        now = time.monotonic()
        if now - self._failure_told > _FAILURES_TOLD_EVERY:
            self._failure_told = now
            reason = str(error) if isinstance(error, PoseloomError) else f"{type(error).__name__}: {error}"
            self.tell(Level.ERROR, f"the method failed on sample {number} and begins anew: {reason}")
        self._records.start(number + 1, self._helm.engine, 0.0)

    # In the event loop: commands

    def _command(self, command: Command) -> None:
        try:
            self._carry_out(command)
        except (PoseloomError, OSError) as error:
            self.tell(Level.ERROR, str(error))

    def _carry_out(self, command: Command) -> None:
        if isinstance(command, Stop):
            self._end.set()
        elif isinstance(command, ResetHeading):
            self._helm.reset_heading()
        elif isinstance(command, StartRecording):
            self._helm.record(command.path)
        elif isinstance(command, StopRecording):
            self._helm.stop_recording()
        elif isinstance(command, ChooseMethod):
            self._helm.choose(command.name)
        elif isinstance(command, Calibrate):
            self._calibration.begin(command, self._newest)
        else:
            self._calibration.cancel()

    def _reached(self) -> tuple[int, float]:
        """The number of the next sample, and the newest one's time."""
        return self._number, 0.0 if self._newest is None else self._newest.time
