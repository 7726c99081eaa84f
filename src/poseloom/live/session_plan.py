"""What a live session is made of, and what it has done when it ends."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from poseloom.live.contract import Counters, Notice, Sink
from poseloom.live.source import Source
from poseloom.methods.contract import Reconstructor
from poseloom.sensors import Placement, SensorLayout
from poseloom.skeleton.skeleton import Skeleton

Closing = Callable[[str, int], None]
"""Called a few times a second while files are being finished: what is, and how much of it waits."""


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
        patience: Seconds for which one may wait if a newer one waits, too.
        notes: What people are told when the session begins.
        thin: Whether samples beyond the layout's rate are left out.
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
    patience: float = 0.05
    notes: tuple[str, ...] = ()
    thin: bool = True


@dataclass(frozen=True, eq=False)
class SessionSummary:
    """What a session has done.

    Attributes:
        counters: Totals.
        latency: Milliseconds from arrival to pose sent: median, 95th and 99th percentile, over the whole session.
        seconds: How long it lasted.
        notices: The last thousand notices.
        recordings: Files that were recorded whole.
        arrivals: What arrived in the whole session, in words.
        refused: How many parts of packets were refused, by reason, the commonest first.
        exports: Files that were exported whole.
        failures: What was to be kept in a file and was not, with the way to get it back, in words. Empty: nothing.
    """

    counters: Counters
    latency: tuple[float, float, float]
    seconds: float
    notices: tuple[Notice, ...]
    recordings: tuple[Path, ...]
    arrivals: str = ""
    refused: Mapping[str, int] = field(default_factory=dict[str, int])
    exports: tuple[Path, ...] = ()
    failures: tuple[str, ...] = ()
