"""What a live session tells its sinks, and what a person at a sink can ask of the session.

A session hands each sink an `Update` for every step of the method, from a thread that is the sink's own, through a
bounded queue in which the newest wins. A sink that is slow or fails therefore costs itself updates, never the session.
A sink that can talk back (the viewer) posts a `Command` from any thread; the session carries it out between samples.
"""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from poseloom.methods.contract import Frame
from poseloom.sensors import Placement, Sample, SensorLayout
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class SessionFacts:
    """What stays the same until a command changes it, or until something else arrives.

    Attributes:
        layout: The sensors, in the order of all arrays' sensor axis, and the session's rate.
        skeleton: The wearer's bones.
        placements: Where each sensor sits.
        calibrated: Whether skeleton and placements were measured on the wearer.
        method: Name of the method that runs.
        methods: Names of the methods that can be chosen in this session.
        delay: Samples between hearing a moment and speaking of it.
        sources: The sources, in words, such as "vmc on 127.0.0.1:39539".
        guided: Whether the guided poses can calibrate this layout (trackers alone).
        recording: The file that is being written; None while nothing is recorded.
        arrivals: What arrives from where, what is missing and what to do; None before it is known.
        notices: The last few notices when these facts were passed on: where no sample arrives there are no updates.
    """

    layout: SensorLayout
    skeleton: Skeleton
    placements: tuple[Placement, ...]
    calibrated: bool
    method: str
    methods: tuple[str, ...]
    delay: int
    sources: tuple[str, ...]
    guided: bool
    recording: Path | None = None
    arrivals: "ArrivalStatus | None" = None
    notices: tuple["Notice", ...] = ()


class Trouble(enum.StrEnum):
    """What is wrong with a sensor."""

    SILENT = "silent"
    STUCK = "stuck"
    NOISY = "noisy"
    SWAPPED = "swapped"
    MIS_SCALED = "mis-scaled"


@dataclass(frozen=True)
class Finding:
    """One sensor's trouble.

    Attributes:
        sensor: Its name.
        trouble: What is wrong.
        text: The same for people, with figures and a remedy, without a full stop.
        since: Session time at which it was found, seconds.
    """

    sensor: str
    trouble: Trouble
    text: str
    since: float


class Level(enum.StrEnum):
    """How much a notice matters."""

    NOTE = "note"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True)
class ArrivalStatus:
    """What arrives, for people.

    Attributes:
        level: NOTE where every sensor arrives and nothing is refused.
        text: A few sentences without the last full stop.
        state: The same without rates: another state is a change.
        rates: The rates in `text`, a second.
    """

    level: Level
    text: str
    state: str
    rates: tuple[float, ...] = ()


@dataclass(frozen=True)
class Notice:
    """Something that happened and that a person should know, such as a disk that is full.

    Attributes:
        number: Counts up from 1, so that a sink shows each notice once.
        level: How much it matters.
        text: What happened and what to do.
        time: Host's monotonic time, seconds.
    """

    number: int
    level: Level
    text: str
    time: float


@dataclass(frozen=True)
class Latency:
    """Milliseconds over the last few seconds.

    Attributes:
        p50: From a sample's arrival to its pose being handed to the prompt sinks (VMC), median.
        p95: The same, 95th percentile.
        p99: The same, 99th percentile.
        newest: The same of this update.
        step: Of this update the method's own step.
        look_ahead: The method's delay in samples, as time.
    """

    p50: float
    p95: float
    p99: float
    newest: float
    step: float
    look_ahead: float


@dataclass(frozen=True)
class Counters:
    """What came and what became of it, since the session began.

    Attributes:
        packets: Packets or lines that came.
        malformed: Packets, or single messages, sensors or values of them, that were not understood and dropped.
        stale: Of these, those that came twice, late or out of order and were dropped.
        samples: Samples that were put together.
        superseded: Samples beyond the session's rate, left out in favour of newer ones.
        lost: Packets that were dropped before they were read, because too many came at once.
        filled: Of the samples, those without any reading, made so that the figure goes on while all is silent.
        usable: Of the samples, those with a reading of at least one sensor.
        dropped: Samples that the method did not hear because newer ones were waiting (they are recorded nevertheless).
        frames: Poses that were made.
        unseen: Updates that a slow sink did not get, all sinks together.
        rate: Samples a second over the last few seconds.
    """

    packets: int = 0
    malformed: int = 0
    stale: int = 0
    samples: int = 0
    superseded: int = 0
    lost: int = 0
    filled: int = 0
    usable: int = 0
    dropped: int = 0
    frames: int = 0
    unseen: int = 0
    rate: float = 0.0


@dataclass(frozen=True)
class CalibrationProgress:
    """Where a calibration stands.

    Attributes:
        title: The pose to hold, in a few words.
        instruction: What to do, for the person.
        pose: Name of the guided pose (`poseloom.calibration.poses.guided_pose`); empty once all are held.
        phase: "get ready", "hold" or "computing".
        remaining: Seconds until the phase ends.
        step: Number of the pose, from 1.
        steps: How many there are.
    """

    title: str
    instruction: str
    pose: str
    phase: str
    remaining: float
    step: int
    steps: int


@dataclass(frozen=True, eq=False)
class Update:
    """One step of the session.

    Attributes:
        number: Number of the sample, from 0; gaps are samples that the method or this sink did not get.
        sample: What the sensors said, in the session's world (after heading resets), times in session seconds.
        frame: The pose that the method spoke of on hearing it; None while it speaks of none.
        finished: Host's monotonic time (`time.monotonic`) at which the frame was made.
        latency: Figures of the last few seconds.
        counters: Totals since the session began.
        findings: All present troubles with sensors; empty while all is well.
        notices: The last few notices, oldest first.
        calibration: Where a running calibration stands; None while none runs.
    """

    number: int
    sample: Sample
    frame: Frame | None
    finished: float
    latency: Latency
    counters: Counters
    findings: tuple[Finding, ...] = ()
    notices: tuple[Notice, ...] = ()
    calibration: CalibrationProgress | None = None


class CalibrationKind(enum.StrEnum):
    """How the wearer is measured.

    ARMS_OUT: one pose, held once: how each sensor is turned on its bone, and the height. GUIDED: the eight poses of
    `poseloom.calibration.poses`, in their order, `rounds` times: sizes and placements.
    """

    ARMS_OUT = "arms-out"
    GUIDED = "guided"


@dataclass(frozen=True)
class Calibrate:
    """Begin a calibration; the updates lead through it. A running one is begun anew."""

    kind: CalibrationKind = CalibrationKind.ARMS_OUT
    rounds: int = 1


@dataclass(frozen=True)
class CancelCalibration:
    """Leave the running calibration; all stays as it was."""


@dataclass(frozen=True)
class ResetHeading:
    """Turn and move the world so that the wearer stands at its origin and faces +Z. The method starts anew."""


@dataclass(frozen=True)
class ChooseMethod:
    """Go on with another method, one of `SessionFacts.methods`; it starts anew."""

    name: str


@dataclass(frozen=True)
class StartRecording:
    """Record to a new `.mcap` file; None chooses a name by date in the session's folder. The method starts anew, so
    that the recording can be solved again bit for bit."""

    path: Path | None = None


@dataclass(frozen=True)
class StopRecording:
    """Finish the file."""


@dataclass(frozen=True)
class Stop:
    """End the session."""


Command = Calibrate | CancelCalibration | ResetHeading | ChooseMethod | StartRecording | StopRecording | Stop

Post = Callable[[Command], None]
"""Asks the session for something, from any thread, and returns at once. What comes of it stands in the notices, and in
the facts if they change; a command that cannot be carried out becomes a notice, never an exception."""


@runtime_checkable
class Sink(Protocol):
    """Something that shows, sends or keeps what a session makes.

    All calls come from one thread that belongs to the sink, in the order open, then any of changed and show, then
    close. An exception ends this sink with a notice; the session and the other sinks go on.

    Attributes:
        name: What it is called in notices and counters.
        capacity: How many updates may wait for it: when one more comes the oldest is dropped and counted. 1 for
            something that shows, many for something that keeps. 0: no thread and no queue, `show` is called on the
            method's own thread and must return within a fraction of a millisecond (VMC).
    """

    @property
    def name(self) -> str: ...

    @property
    def capacity(self) -> int: ...

    def open(self, facts: SessionFacts, post: Post) -> None:
        """Called once, before the first update."""
        ...

    def changed(self, facts: SessionFacts) -> None:
        """A command changed the facts: the updates that follow belong to these."""
        ...

    def show(self, update: Update) -> None:
        """One step; not every step where `capacity` is small."""
        ...

    def close(self) -> None:
        """Called once, at the end, also after an exception in `show`; not if `open` failed."""
        ...
