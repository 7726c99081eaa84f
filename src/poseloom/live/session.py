"""One live session: sources in, a method in its thread, sinks out, and the commands of a person who watches."""

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from poseloom.calibration.calibration import Calibration, write_calibration
from poseloom.calibration.calibration import Level as VerdictLevel
from poseloom.errors import PoseloomError, unknown_name
from poseloom.formats.recording_header import RecordingHeader
from poseloom.formats.session_recording import MethodStart
from poseloom.live.alignment import facing_ahead
from poseloom.live.calibrating import CalibrationRun
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
    Sink,
    StartRecording,
    Stop,
    StopRecording,
    Update,
)
from poseloom.live.delays import Delays
from poseloom.live.hearing import Hearing
from poseloom.live.sinks.outlet import Outlet
from poseloom.live.sinks.recorder import Recorder
from poseloom.live.source import Source
from poseloom.live.watch import Watch, ended_findings, new_findings
from poseloom.live.worker import Engine, MethodWorker, Worked, warm_up
from poseloom.methods.contract import Reconstructor
from poseloom.sensors import Placement, Sample, SensorKind, SensorLayout
from poseloom.skeleton.skeleton import Skeleton

_TICK = 0.01
"""Seconds between looks at silence and at samples that wait for a late sensor."""
_NOTICES_SHOWN, _NOTICES_KEPT = 8, 1000
_FAILURES_TOLD_EVERY = 2.0


@dataclass(frozen=True, eq=False)
class SessionPlan:
    """What a session is made of.

    Attributes:
        sources: Where samples come from.
        layout: All their sensors, at the session's rate.
        skeleton: The wearer's bones.
        placements: Where the sensors sit.
        method: Name of the method to begin with.
        make: Makes a method by name; may take seconds.
        sinks: Where poses go.
        methods: Names that `make` knows, for people to choose from.
        calibrated: Whether skeleton and placements were measured on the wearer.
        record: File to record to from the beginning.
        folder: Where files that a person asks for at a sink are put.
        settings: How the session was set up, for the recording.
        seconds: When to end; None: when the sources do, or on demand.
        capacity: Samples that may wait for the method.
        thin: Whether samples beyond the layout's rate are left out; not where a recording is played faster.
    """

    sources: tuple[Source, ...]
    layout: SensorLayout
    skeleton: Skeleton
    placements: tuple[Placement, ...]
    method: str
    make: Callable[[str], Reconstructor[Any]]
    sinks: tuple[Sink, ...] = ()
    methods: tuple[str, ...] = ()
    calibrated: bool = False
    record: Path | None = None
    folder: Path = Path()
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    seconds: float | None = None
    capacity: int = 8
    thin: bool = True


@dataclass(frozen=True, eq=False)
class SessionSummary:
    """What a session has done.

    Attributes:
        counters: Totals.
        latency: Milliseconds from arrival to pose sent: median, 95th and 99th percentile, over the whole session.
        seconds: How long it lasted.
        notices: The last thousand notices.
        recordings: Files that were recorded.
    """

    counters: Counters
    latency: tuple[float, float, float]
    seconds: float
    notices: tuple[Notice, ...]
    recordings: tuple[Path, ...]


class Session:
    """Runs a plan once. `run` blocks; `post` and `stop` may be called from any thread.

    Args:
        plan: What it is made of.
    """

    def __init__(self, plan: SessionPlan) -> None:
        self.plan = plan
        self.delays = Delays()
        self._facts = SessionFacts(
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
        self._watch = Watch(plan.layout)
        self._watching = self._watch.start()
        self._hearing = Hearing(plan.layout, self._admit, self.tell, len(plan.sources) == 1, plan.thin)
        self._outlets = [Outlet(sink, self.post, self.tell) for sink in plan.sinks]
        self._recorder: Recorder | None = None
        self._recorded: list[Path] = []
        self._calibration: CalibrationRun | None = None
        self._number = 0
        self._newest: Sample | None = None
        self._frames = 0
        self._last_pose: Any = None
        self._notices: deque[Notice] = deque(maxlen=_NOTICES_KEPT)
        self._told = 0
        self._shown: deque[Notice] = deque(maxlen=_NOTICES_SHOWN)
        self._telling = threading.Lock()
        self._failure_told = -1e9
        self._loop: asyncio.AbstractEventLoop | None = None
        self._early: list[Command] = []
        self._began = 0.0
        self._tasks: set[asyncio.Future[Any]] = set()

    # What others may ask at any time

    @property
    def facts(self) -> SessionFacts:
        """The present facts."""
        return self._facts

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
        return tuple(self._notices)

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

    def tell(self, level: Level, text: str) -> None:
        """Adds a notice."""
        with self._telling:
            self._told += 1
            notice = Notice(self._told, level, text, time.monotonic())
            self._notices.append(notice)
            self._shown.append(notice)

    # From beginning to end

    def run(self) -> SessionSummary:
        """Runs until the sources have nothing more to say, the time is up, or `stop` is called.

        Raises:
            PoseloomError: if a source or sink cannot begin, or the method does not fit.
        """
        with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
            return runner.run(self._main())

    async def _main(self) -> SessionSummary:
        plan = self.plan
        engine = Engine(plan.method, plan.make(plan.method), plan.skeleton, plan.placements)
        warm_up(engine, plan.layout)
        self._facts = replace(self._facts, delay=engine.method.delay)
        self._engine = engine
        self._worker = MethodWorker(engine, self._deliver, self._method_failed, plan.capacity)
        self._end = asyncio.Event()
        opened: list[Outlet] = []
        began = time.monotonic()
        try:
            if plan.record is not None:
                self._start_recorder(plan.record)
            for outlet in self._outlets:
                outlet.open(self._facts)
                opened.append(outlet)
            self._loop = asyncio.get_running_loop()
            self._began = began = time.monotonic()
            self._worker.start()
            for command in self._early:
                self._command(command)
            await self._listen()
        finally:
            self._loop = None
            await asyncio.to_thread(self._finish, opened)
        return SessionSummary(
            self.counters, self.delays.overall(), time.monotonic() - began, self.notices, tuple(self._recorded)
        )

    async def _listen(self) -> None:
        running = [asyncio.create_task(source.run(self._hearing)) for source in self.plan.sources]
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
        if isinstance(error, PoseloomError) and self._number == 0:
            raise error
        if error is not None:
            self.tell(Level.ERROR, f"a source has failed and is heard no more: {error}")

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(_TICK)
            now = time.monotonic()
            self._hearing.poll(now)
            if self._newest is not None:
                # Session time goes on from the newest sample, whether anything comes or not.
                self._judge(self._newest.time + now - self._newest.arrival)
            if self._calibration is not None and self._newest is not None:
                self._advance_calibration(self._newest.time)
            if self.plan.seconds is not None and now - self._began >= self.plan.seconds:
                self._end.set()

    def _finish(self, opened: list[Outlet]) -> None:
        self._worker.stop()
        for outlet in opened:
            outlet.close()
        self._stop_recorder()

    # In the event loop: samples in

    def _admit(self, sample: Sample) -> None:
        number = self._number
        self._number += 1
        self._newest = sample
        if self._recorder is not None:
            self._recorder.sample(number, sample)
        self._worker.hear(number, sample)
        before = self._watching
        self._watching = self._watch.step(before, sample)
        self._tell_findings(before, sample.time)
        if self._calibration is not None:
            self._calibration.hear(sample)

    def _judge(self, now: float) -> None:
        before = self._watching
        self._watching = self._watch.poll(before, now)
        self._tell_findings(before, now)

    def _tell_findings(self, before: Any, now: float) -> None:
        if before.findings is self._watching.findings:
            return
        changes = [(each, False) for each in new_findings(before, self._watching)]
        changes += [(each, True) for each in ended_findings(before, self._watching)]
        for finding, over in changes:
            text = f"{finding.sensor} is no longer {finding.trouble.value}" if over else finding.text
            self.tell(Level.NOTE if over else Level.WARNING, text)
            if self._recorder is not None:
                self._recorder.finding(self._number, finding, now, over)

    # In the method's thread: poses out

    def _deliver(self, worked: Worked) -> None:
        if worked.frame is not None:
            self._frames += 1
            self._last_pose = worked.frame.pose
        calibration = self._calibration
        update = Update(
            number=worked.number,
            sample=worked.sample,
            frame=worked.frame,
            finished=worked.finished,
            latency=self.delays.latest(self._facts.delay / self.plan.layout.rate),
            counters=self.counters,
            findings=self.findings,
            notices=tuple(self._shown),
            calibration=None if calibration is None else calibration.progress(worked.raw.time),
        )
        for outlet in self._outlets:
            if outlet.sink.capacity == 0:
                outlet.show(update)
        self.delays.add(time.monotonic() - worked.raw.arrival, worked.finished - worked.begun)
        update = replace(update, latency=self.delays.latest(self._facts.delay / self.plan.layout.rate))
        for outlet in self._outlets:
            if outlet.sink.capacity > 0:
                outlet.show(update)
        recorder = self._recorder
        if recorder is not None:
            recorder.step(worked.number, worked.raw, worked.frame, worked.finished)

    def _method_failed(self, number: int, error: Exception) -> None:
        now = time.monotonic()
        if now - self._failure_told > _FAILURES_TOLD_EVERY:
            self._failure_told = now
            reason = str(error) if isinstance(error, PoseloomError) else f"{type(error).__name__}: {error}"
            self.tell(Level.ERROR, f"the method failed on sample {number} and begins anew: {reason}")
        recorder = self._recorder
        if recorder is not None:
            recorder.start(number + 1, self._method_start(self._engine), 0.0)

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
            self._reset_heading()
        elif isinstance(command, StartRecording):
            path = command.path or self._file("session", ".mcap")
            self._stop_recorder()
            self._start_recorder(path)
            self._restart(self._engine)
        elif isinstance(command, StopRecording):
            self._stop_recorder()
            self._restart(None)
        elif isinstance(command, ChooseMethod):
            self._choose(command.name)
        elif isinstance(command, Calibrate):
            began = self._newest.time if self._newest is not None else 0.0
            if self._newest is None:
                raise PoseloomError("nothing has been heard yet", remedy="Switch the sensors on, then calibrate")
            self._calibration = CalibrationRun(command, self.plan.layout, began)
        else:
            self._calibration = None

    def _reset_heading(self) -> None:
        pose = self._last_pose
        if pose is None:
            self.tell(Level.WARNING, "the heading cannot be reset before there is a pose")
            return
        alignment = facing_ahead(self._engine.alignment, pose.q)
        self._restart(replace(self._engine, alignment=alignment))
        self.tell(Level.NOTE, "heading reset")

    def _choose(self, name: str) -> None:
        if name not in self._facts.methods:
            raise unknown_name("method", name, self._facts.methods)

        async def prepare() -> None:
            try:
                method = await asyncio.to_thread(self.plan.make, name)
                engine = replace(self._engine, name=name, method=method)
                await asyncio.to_thread(warm_up, engine, self.plan.layout)
            except PoseloomError as error:
                self.tell(Level.ERROR, str(error))
                return
            self._restart(replace(self._engine, name=name, method=method))
            self.tell(Level.NOTE, f"the method is {name}")

        self._keep(prepare())

    def _advance_calibration(self, now: float) -> None:
        run = self._calibration
        if run is None or not run.is_over(now) or run.computing:
            return
        run.computing = True

        async def compute() -> None:
            try:
                calibration = await asyncio.to_thread(run.result)
            except PoseloomError as error:
                self.tell(Level.ERROR, f"the calibration failed: {error}")
                return
            finally:
                if self._calibration is run:
                    self._calibration = None
            self._take_calibration(calibration)

        self._keep(compute())

    def _take_calibration(self, calibration: Calibration) -> None:
        path = self._file("calibration", ".npz")
        try:
            write_calibration(calibration, path)
            self.tell(Level.NOTE, f"calibrated; kept as {path}")
        except OSError as error:
            self.tell(Level.WARNING, f"calibrated, but {path} cannot be written: {error.strerror or error}")
        for verdict in calibration.verdicts:
            self.tell(Level.NOTE if verdict.level is VerdictLevel.GOOD else Level.WARNING, str(verdict))
        self._facts = replace(
            self._facts, skeleton=calibration.skeleton, placements=calibration.placements, calibrated=True
        )
        recording = self._recorder
        if recording is not None:
            # A recording has one body: the new one gets a file of its own.
            self._stop_recorder()
            self._start_recorder(_next_path(recording.path))
        self._restart(replace(self._engine, skeleton=calibration.skeleton, placements=calibration.placements))

    def _restart(self, engine: Engine | None) -> None:
        """Begins anew with an engine, or only tells that the facts have changed."""
        recorder = self._recorder
        if engine is not None:
            self._engine = engine
            self._facts = replace(self._facts, method=engine.name, delay=engine.method.delay)
        self._facts = replace(self._facts, recording=None if recorder is None else recorder.path)
        facts, number = self._facts, self._number
        if engine is None:
            for outlet in self._outlets:
                outlet.changed(facts)
            return
        at = 0.0 if self._newest is None else self._newest.time
        start = self._method_start(engine)

        def begin() -> None:
            if recorder is not None:
                recorder.start(number, start, at)
            for outlet in self._outlets:
                outlet.changed(facts)

        self._worker.restart(engine, begin)

    def _method_start(self, engine: Engine) -> MethodStart:
        turned = engine.alignment
        return MethodStart(0, engine.name, turned.heading, turned.x, turned.z)

    def _start_recorder(self, path: Path) -> None:
        facts = self._facts
        header = RecordingHeader(
            facts.layout,
            facts.placements,
            facts.skeleton,
            path.stem,
            {
                "made by": "poseloom live",
                "method": self._engine.name,
                "sources": "; ".join(facts.sources),
                "begun": datetime.now().astimezone().isoformat(timespec="seconds"),
                **self.plan.settings,
            },
        )
        self._recorder = Recorder(path, header, self._number, self.tell)
        self._recorded.append(path)
        self._facts = replace(facts, recording=path)
        self._recorder.start(self._number, self._method_start(self._engine), 0.0)

    def _stop_recorder(self) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        recorder.stop()
        if not recorder.failed:
            self.tell(Level.NOTE, f"recorded {recorder.samples} samples to {recorder.path}")

    def _file(self, stem: str, suffix: str) -> Path:
        return _free_path(self.plan.folder / f"{stem}-{datetime.now():%Y%m%d-%H%M%S}{suffix}")

    def _keep(self, work: Any) -> None:
        """Runs a coroutine; the loop itself holds tasks only weakly."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def _next_path(path: Path) -> Path:
    """The same name with the next number behind it."""
    stem, _, number = path.stem.rpartition("-")
    if not (stem and number.isdigit() and len(number) < 4):
        stem, number = path.stem, "1"
    return _free_path(path.with_stem(f"{stem}-{int(number) + 1}"))


def _free_path(path: Path) -> Path:
    """The path, or one with a number behind it that is not taken."""
    number, free = 2, path
    while free.exists():
        free = path.with_stem(f"{path.stem}-{number}")
        number += 1
    return free
