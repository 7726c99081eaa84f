"""Half an hour at 60 Hz with viewer, recorder and VMC; 240 Hz; two sessions at once."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from poseloom.benchmark.live.measuring import Watched, running, wait_until
from poseloom.benchmark.live.stage import Stage, all_sinks, device, listening_port
from poseloom.evaluation.rows import Row
from poseloom.formats.session_recording import read_session
from poseloom.live.contract import Counters

Show = Callable[[str, int, int], None]
_row = partial(Row, split="none")


def measure_endurance(stage: Stage, seconds: float, show: Show) -> list[Row]:
    """A session as a person would run it, for a long time: delays, losses, memory."""
    name = f"{seconds:g} s at 60 Hz with viewer, recorder and VMC"
    with all_sinks(stage.folder) as (viewer, settings):
        plan = stage.plan("vmc://:0", (viewer,), **settings)
        with running([plan]) as (watched,):
            wait_until(lambda: listening_port(plan) > 0, 60.0)
            speaker = device("vmc", listening_port(plan), seconds)
            _wait(seconds, show, f"endurance, {seconds:g} s")
            sent = speaker.wait()
            time.sleep(0.5)
    rows = _delays(name, watched, sent)
    session = read_session(stage.folder / "session.mcap")
    readings = watched.readings
    used = (readings[-2].cpu - readings[0].cpu) / (readings[-2].time - readings[0].time)
    unrecorded = _total(watched).samples - len(session.recording)
    rows += [
        _row("endurance", name, "", metric="samples_not_recorded", value=float(unrecorded)),
        _row("endurance", name, "", metric="memory_mb_after_a_fifth", value=watched.memory(0.15, 0.25)),
        _row("endurance", name, "", metric="memory_mb_at_the_end", value=watched.memory(0.9, 1.0)),
        _row("endurance", name, "", metric="share_of_a_core", value=used),
        _row("endurance", name, "", metric="load_mean", value=float(np.mean([reading.load for reading in readings]))),
        _row("endurance", name, "", metric="load_most", value=float(max(reading.load for reading in readings))),
    ]
    for part in range(6):
        start, stop = part / 6, (part + 1) / 6
        load = [each.load for each in readings[round(start * len(readings)) : round(stop * len(readings))]]
        values = dict(zip(("p50_ms", "p95_ms", "p99_ms"), watched.percentiles(start, stop), strict=True))
        values |= {"memory_mb": watched.memory(start, stop), "load": float(np.mean(load or [0.0]))}
        setting = f"part {part + 1} of 6"
        rows += [_row("endurance by time", name, setting, metric=key, value=value) for key, value in values.items()]
    return rows


def measure_fast_input(stage: Stage, seconds: float, show: Show) -> list[Row]:
    """Devices at 240 Hz: a method at that rate, and one at 60 Hz that takes the newest."""
    rows: list[Row] = []
    cases: tuple[tuple[str, dict[str, str], str], ...] = (
        (
            "240 Hz into inverse kinematics at 240 Hz",
            {"method": "inverse-kinematics", "library": ""},
            "vmc://:0?rate=240",
        ),
        ("240 Hz into local-filter at 60 Hz", {}, "vmc://:0"),
    )
    for name, settings, source in cases:
        plan = stage.plan(source, (), **settings)
        with running([plan], every=1.0) as (watched,):
            wait_until(lambda plan=plan: listening_port(plan) > 0, 60.0)
            speaker = device("vmc", listening_port(plan), seconds, rate=240.0)
            _wait(seconds, show, name)
            sent = speaker.wait()
            time.sleep(0.5)
        rows += _delays(name, watched, sent, "fast input")
        first, last = watched.percentiles(0.1, 0.4), watched.percentiles(0.7, 1.0)
        rows.append(_row("fast input", name, "", metric="growth_of_p50_ms", value=last[0] - first[0]))
    return rows


def measure_two_sessions(stage: Stage, seconds: float, show: Show) -> list[Row]:
    """Two wearers in one process, each at 60 Hz."""
    plans = [stage.plan("vmc://:0"), stage.plan("udp://:0?rate=60")]
    with running(plans, every=1.0) as watched:
        wait_until(lambda: all(listening_port(plan) > 0 for plan in plans), 120.0)
        speakers = [
            device(kind, listening_port(plan), seconds, seed=seed)
            for seed, (kind, plan) in enumerate(zip(("vmc", "udp"), plans, strict=True))
        ]
        _wait(seconds, show, "two sessions")
        sent = [speaker.wait() for speaker in speakers]
        time.sleep(0.5)
    rows: list[Row] = []
    for name, each, count in zip(("first of two sessions", "second of two sessions"), watched, sent, strict=True):
        rows += _delays(name, each, count, "two sessions")
    return rows


def _total(watched: Watched) -> Counters:
    assert watched.summary is not None
    return watched.summary.counters


def _delays(name: str, watched: Watched, sent: int, table: str = "endurance") -> list[Row]:
    counters = _total(watched)
    p50, p95, p99 = watched.percentiles()
    values = {
        "p50_ms": p50,
        "p95_ms": p95,
        "p99_ms": p99,
        "sent": float(sent),
        "lost": float(max(sent - counters.packets, 0)),
        "passed_over": float(counters.dropped),
        "superseded": float(counters.superseded),
        "empty": float(counters.filled),
    }
    return [
        _row(table, name, "", metric=metric, value=value, frames=counters.frames) for metric, value in values.items()
    ]


def _wait(seconds: float, show: Show, what: str) -> None:
    end, total = time.monotonic() + seconds, max(int(seconds), 1)
    while (left := end - time.monotonic()) > 0:
        show(what, total - int(left), total)
        time.sleep(min(1.0, left))
    show(what, total, total)
