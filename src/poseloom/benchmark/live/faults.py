"""All that is said to go wrong, one thing after the other: what the session said of it, and what became of it."""

import contextlib
import io
import os
import socket
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from poseloom.benchmark.live.measuring import Watched, running, wait_until
from poseloom.benchmark.live.notebook import Jumps, Notebook, fastest_in
from poseloom.benchmark.live.stage import CLIP, RATE, Stage, device, listening_port, visitor
from poseloom.evaluation.rows import Row
from poseloom.formats.recording import read_recording
from poseloom.live.contract import Level
from poseloom.live.devices import json_datagram
from poseloom.live.virtual import virtual_recording
from poseloom.sensors import Recording
from poseloom.viewer.session import SessionViewer

Show = Callable[[str, int, int], None]
_row = partial(Row, "faults", split="none")


def measure_faults(stage: Stage, show: Show) -> list[Row]:
    """All of the list but the packets."""
    cases: tuple[tuple[str, Callable[[Stage], list[Row]]], ...] = (
        ("each sensor silent for 1 s", _each_silent),
        ("all silent for 3 s", _all_silent),
        ("stuck, noisy and swapped sensors", _odd_sensors),
        ("source killed and started again", _killed),
        ("browser reloaded twenty times", _reloaded),
        ("disk full while recording", _disk_full),
        ("clock jumps by an hour", _clock_jumps),
    )
    rows: list[Row] = []
    for number, (name, measure) in enumerate(cases):
        show("faults", number, len(cases))
        rows += measure(stage)
        show(f"faults: {name}", 1, 1)
    show("faults", len(cases), len(cases))
    return rows


def _each_silent(stage: Stage) -> list[Row]:
    """One device after another falls silent for a second, at 2, 4, 6, 8, 10 seconds and so on."""
    worn = stage.plan("vmc://:0").layout
    faults = [f"silent:{name}:{2 * (place % 5) + 2}:{2 * (place % 5) + 3}" for place, name in enumerate(worn.names)]
    rows: list[Row] = []
    found: list[float] = []
    jumps: list[Jumps] = []
    fastest = fastest_in(CLIP, worn)
    named = 0
    # The clip lasts 12.7 s, so the sixth sensor has a turn of its own.
    for part in (faults[:5], faults[5:]):
        notebook = Notebook()
        plan = stage.plan("udp://:0?rate=60", (notebook,), record=str(stage.folder / f"silent-{len(part)}.mcap"))
        with running([plan]) as (watched,):
            wait_until(lambda plan=plan: listening_port(plan) > 0, 60.0)
            device("udp", listening_port(plan), 12.5, faults=part).wait()
        delays = _naming_delays(stage, f"silent-{len(part)}.mcap")
        named += len(delays)
        found += delays
        jumps.append(notebook.jumps(fastest, silent=1))
        rows += _alive("each sensor silent for 1 s", watched)[:1]
    name = "each sensor silent for 1 s"
    return [
        *rows[:1],
        _row(name, "", metric="sensors_named", value=float(named), frames=len(worn)),
        _row(name, "", metric="named_after_s_most", value=max(found, default=float("nan")) if found else 99.0),
        *_jump_rows(name, jumps),
    ]


def _naming_delays(stage: Stage, file: str) -> list[float]:
    """Seconds from each sensor's last reading to its finding, by a session's own recording."""
    from poseloom.formats.session_recording import read_session

    session = read_session(stage.folder / file)
    recording = session.recording
    delays: list[float] = []
    for finding in session.findings:
        if finding.over or finding.trouble != "silent":
            continue
        sensor = recording.layout.index(finding.sensor)
        heard = recording.times[np.isfinite(recording.positions[:, sensor, 0]) & (recording.times <= finding.time)]
        # What ends with the clip is silent for another reason.
        later = recording.times[np.isfinite(recording.positions[:, sensor, 0]) & (recording.times > finding.time)]
        if len(heard) and len(later):
            delays.append(finding.time - float(heard[-1]))
    return delays


def _all_silent(stage: Stage) -> list[Row]:
    name = "all silent for 3 s"
    worn = stage.plan("vmc://:0").layout
    notebook = Notebook()
    plan = stage.plan("udp://:0?rate=60", (notebook,))
    with running([plan]) as (watched,):
        wait_until(lambda: listening_port(plan) > 0, 60.0)
        device("udp", listening_port(plan), 12.0, faults=[f"silent:{each}:3:6" for each in worn.names]).wait()
    states = np.array(notebook.states)
    without = np.isin(states, ["coasting", "lost"])
    # The longest stretch without sensors before the device's end is the fault; a busy machine makes short ones, too.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], without, [False]]).astype(int)))
    starts, stops = edges[::2], edges[1::2]
    inner = [(stop - start, start, stop) for start, stop in zip(starts, stops, strict=True) if stop < len(states)]
    longest, _, end = max(inner, default=(0, 0, 0))
    back = states[end:]
    gliding = int(np.argmin(np.concatenate([back == "rejoining", [False]])))
    following = back[gliding : gliding + 60]
    return [
        *_alive(name, watched),
        _row(name, "", metric="poses_without_sensors", value=float(longest)),
        _row(name, "", metric="s_of_rejoining", value=gliding / RATE),
        _row(name, "", metric="poses_after_it", value=float(len(following))),
        _row(name, "", metric="of_them_ok_or_degraded", value=float(np.isin(following, ["ok", "degraded"]).sum())),
        *_jump_rows(name, [notebook.jumps(fastest_in(CLIP, worn), silent=None)]),
    ]


def _odd_sensors(stage: Stage) -> list[Row]:
    name = "stuck, noisy and swapped sensors"
    faults = ["stuck:leftAnkle:2:4", "noise:head:5:7.5", "swap:leftHand+rightHand:9:11"]
    plan = stage.plan("vmc://:0")
    texts: set[str] = set()
    with running([plan]) as (watched,):
        wait_until(lambda: listening_port(plan) > 0, 60.0)
        device("vmc", listening_port(plan), 12.5, faults=faults).wait()
        texts = {notice.text for notice in watched.session.notices}
    wanted = ("leftAnkle is stuck", "head is noisy", "leftHand and rightHand are swapped")
    told = sum(any(text.startswith(each) for text in texts) for each in wanted)
    return [*_alive(name, watched), _row(name, "", metric="troubles_named", value=float(told), frames=len(wanted))]


def _killed(stage: Stage) -> list[Row]:
    name = "source killed and started again"
    notebook = Notebook()
    plan = stage.plan("udp://:0?rate=60", (notebook,))
    with running([plan]) as (watched,):
        wait_until(lambda: listening_port(plan) > 0, 60.0)
        for _ in range(3):
            before = _spoken(watched)
            speaker = device("udp", listening_port(plan))
            wait_until(lambda before=before: _spoken(watched) > before + 120, 60.0)
            speaker.kill()
        healthy = notebook.states[-60:]
    return [
        *_alive(name, watched),
        _row(name, "", metric="times_heard_again", value=2.0 if "ok" in healthy else 0.0, frames=2),
        _row(name, "", metric="samples_after_all", value=float(_spoken(watched))),
    ]


def _spoken(watched: Watched) -> int:
    counters = watched.session.counters
    return counters.samples - counters.filled


def _reloaded(stage: Stage) -> list[Row]:
    name = "browser reloaded twenty times"
    viewer = SessionViewer(port=0)
    plan = stage.plan("vmc://:0", (viewer,))
    reloads = 0
    with running([plan]) as (watched,):
        wait_until(lambda: listening_port(plan) > 0, 60.0)
        speaker = device("vmc", listening_port(plan))
        for _ in range(20):
            with visitor(viewer):
                reloads += 1
                time.sleep(0.3)
        speaker.kill()
    return [*_alive(name, watched), _row(name, "", metric="reloads", value=float(reloads), frames=20)]


class _FullDisk(io.FileIO):
    """A file that takes so many bytes and no more."""

    left = 100_000

    def write(self, data: Any, /) -> int:
        self.left -= len(data)
        if self.left < 0:
            raise OSError(28, os.strerror(28))
        return super().write(data) or 0


def _disk_full(stage: Stage) -> list[Row]:
    from poseloom.formats import recording_writer

    name = "disk full while recording"
    path = stage.folder / "full.mcap"
    plan = stage.plan("vmc://:0", record=str(path))
    opened = recording_writer._new_file  # pyright: ignore[reportPrivateUsage]
    recording_writer._new_file = lambda path: _FullDisk(path, "xb")  # pyright: ignore[reportPrivateUsage, reportAttributeAccessIssue]
    try:
        with running([plan]) as (watched,):
            wait_until(lambda: listening_port(plan) > 0, 60.0)
            device("vmc", listening_port(plan), 6.0).wait()
    finally:
        recording_writer._new_file = opened  # pyright: ignore[reportPrivateUsage]
    assert watched.summary is not None
    warned = sum("THE RECORDING HAS STOPPED" in notice.text for notice in watched.summary.notices)
    return [
        *_alive(name, watched),
        _row(name, "", metric="loud_warnings", value=float(warned)),
        _row(name, "", metric="samples_readable", value=float(len(read_recording(path)))),
    ]


def _clock_jumps(stage: Stage) -> list[Row]:
    name = "clock jumps by an hour"
    notebook = Notebook()
    plan = stage.plan("udp://:0?rate=60", (notebook,))
    recording = virtual_recording(CLIP, plan.layout)
    with running([plan]) as (watched,), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as speaker:
        wait_until(lambda: listening_port(plan) > 0, 60.0)
        address = ("127.0.0.1", listening_port(plan))
        offsets = [0.0] * 150 + [3600.0] * 150 + [-3600.0] * 150
        _say(speaker, address, recording, offsets)
        wait_until(lambda: _spoken(watched) + watched.session.counters.stale >= len(offsets), 5.0)
    return [
        *_alive(name, watched),
        _row(name, "", metric="packets_taken_for_late", value=float(_counters(watched).stale), frames=len(offsets)),
        *_jump_rows(name, [notebook.jumps(fastest_in(CLIP, plan.layout), silent=0)]),
    ]


def _say(speaker: socket.socket, address: tuple[str, int], recording: Recording, offsets: list[float]) -> None:
    begin = time.monotonic()
    for index, offset in enumerate(offsets):
        time.sleep(max(0.0, begin + index / RATE - time.monotonic()))
        sample = recording.sample(index % len(recording))
        with contextlib.suppress(OSError):
            speaker.sendto(json_datagram(sample, recording.layout, 5000.0 + index / RATE + offset), address)


def _counters(watched: Watched) -> Any:
    assert watched.summary is not None
    return watched.summary.counters


def _alive(name: str, watched: Watched) -> list[Row]:
    """That the session ended when it was asked to, without a failure of its method."""
    summary = watched.summary
    failures = (
        99
        if summary is None
        else sum(notice.level is Level.ERROR and "RECORDING" not in notice.text for notice in summary.notices)
    )
    frames = 0 if summary is None else summary.counters.frames
    return [_row(name, "", metric="failures", value=float(failures), frames=frames)]


def _jump_rows(name: str, jumps: list[Jumps]) -> list[Row]:
    """The largest of some, apart from what the device's own process was late for."""
    rows = [_row(name, "", metric="largest_jump_cm", value=max(each.largest for each in jumps))]
    waits = sum(each.waits for each in jumps)
    if waits:
        rows += [
            _row(name, "", metric="times_that_the_device_was_kept_waiting", value=float(waits)),
            _row(name, "", metric="largest_jump_cm_then", value=max(each.kept_waiting for each in jumps)),
        ]
    return rows
