"""A session's files: whole, or told to be lost; none left behind by a session that did not begin."""

import asyncio
import errno
import io
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseloom.cli._app import run
from poseloom.errors import PoseloomError, SensorError
from poseloom.formats import read_motion, write_motion
from poseloom.formats.pose_table import write_pose_table
from poseloom.formats.recording import CUT_OFF, read_recording
from poseloom.formats.session_recording import read_session
from poseloom.live.contract import Counters, Latency, Level, SessionFacts, Update
from poseloom.live.readings import sample_of_readings
from poseloom.live.session import Session
from poseloom.live.settings import LiveSettings
from poseloom.live.setup import plan_session
from poseloom.live.sinks.motion_export import MotionExport
from poseloom.live.sinks.outlet import Outlet
from poseloom.live.source_replay import ReplaySource
from poseloom.methods import Frame, Health, make_method, reconstruct
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.skeleton import Motion, Pose, average_body
from poseloom.skeleton.resample import EvenPoses, even_motion

SIX = replace(layout("six-trackers"), rate=60.0)
BODY = average_body()
FACTS = SessionFacts(SIX, BODY, (), True, "m", ("m",), 0, (), True)


def updates_of(motion: Motion, times: np.ndarray) -> list[Update]:
    nothing = sample_of_readings({}, SIX, 0.0, 0.0)
    return [
        Update(i, nothing, Frame(t, Pose(motion.skeleton, q), q, Health()), t, Latency(*6 * [0.0]), Counters())
        for i, (t, q) in enumerate(zip(times.tolist(), motion.q, strict=True))
    ]


class FullDisk(io.FileIO):
    """A file that takes so many bytes, then says that the disk is full."""

    left = 0

    def write(self, data: Any) -> int:
        self.left -= len(data)
        if self.left < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data) or 0


def fill_the_disk(monkeypatch: pytest.MonkeyPatch, room: int) -> None:
    """Lets every file that is opened as an export's take so many bytes."""
    opened = Path.open

    def limited(self: Path, mode: str = "r", *more: Any, **named: Any) -> Any:
        if mode != "w+b":
            return opened(self, mode, *more, **named)
        raw = FullDisk(self, "w+")
        raw.left = room
        return io.BufferedRandom(raw)

    monkeypatch.setattr(Path, "open", limited)


# Written as the session goes


@pytest.mark.parametrize("suffix", [".bvh", ".csv", ".npz", ".glb"])
def test_an_export_is_what_the_writer_of_whole_files_writes(suffix: str, tmp_path: Path):
    motion = sample_motions()["spinkick"].cut(0, 200)
    path, whole = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    path.write_text("what was there before")
    export = MotionExport(path)
    export.open(FACTS, lambda command: None)
    for update in updates_of(motion, 7.0 + np.arange(200) / 60):
        export.show(update)
    assert path.read_text() == "what was there before"
    export.close()
    (write_pose_table if suffix == ".csv" else write_motion)(replace(motion, name="a"), whole)
    if suffix == ".bvh":
        assert np.allclose(read_motion(path).q, read_motion(whole).q, atol=1e-9)
        assert len(read_motion(path)) == 200
        assert "".join(path.read_text().split()) == "".join(whole.read_text().split())
    elif suffix != ".glb":
        assert path.read_bytes() == whole.read_bytes()
    assert sorted(each.name for each in tmp_path.iterdir()) == [f"a{suffix}", f"b{suffix}"]
    assert export.written == [path]


@pytest.mark.parametrize("seed", range(3))
def test_poses_at_uneven_times_become_even_ones_piece_by_piece(seed: int):
    rng = np.random.default_rng(seed)
    times = 3.0 + np.cumsum(rng.uniform(0.2, 2.5, 300)) / 60
    q = np.cumsum(rng.normal(scale=0.01, size=(300, BODY.size)), axis=0)
    whole = even_motion(BODY, times, q, 60.0, "x")
    even, at = EvenPoses(60.0), 0
    rows: list[np.ndarray] = []
    while at < 300:
        step = int(rng.integers(1, 40))
        rows.append(even.add(times[at : at + step], q[at : at + step]))
        at += step
    made = np.concatenate(rows)
    assert np.array_equal(made, whole.q)
    assert abs((len(made) - 1) / 60 - (times[-1] - times[0])) < 1 / 60
    # Between its neighbours, or within a twentieth of a period as it is.
    at = times[0] + np.arange(len(made)) / 60
    for column in range(3):
        assert np.abs(made[:, column] - np.interp(at, times, q[:, column])).max() < 0.005


# A disk that is full


@pytest.mark.parametrize("suffix", [".bvh", ".csv", ".npz", ".glb"])
def test_a_full_disk_while_exporting_is_told_at_once(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    motion = sample_motions()["walk"]
    motion = motion.cut(0, min(len(motion), 400))
    told: list[tuple[Level, str]] = []
    path = tmp_path / f"a{suffix}"
    outlet = Outlet(MotionExport(path), lambda command: None, lambda level, text: told.append((level, text)))
    fill_the_disk(monkeypatch, 100_000)
    outlet.open(FACTS)
    for update in updates_of(motion, np.arange(len(motion)) / 60):
        outlet.show(update)
    outlet.close()
    ((level, text),) = told
    assert level is Level.ERROR
    assert "HAS FAILED" in text
    assert "No space left" in text
    assert path.name in text
    assert outlet.failure
    assert not path.exists()
    left = [each.name for each in tmp_path.iterdir()]
    if suffix == ".bvh":
        assert left == ["a-incomplete.bvh"]
        kept = read_motion(tmp_path / left[0])
        assert 30 <= len(kept) < 400
        assert np.allclose(kept.root_positions, motion.root_positions[: len(kept)], atol=1e-4)
        assert "a-incomplete.bvh" in text
    elif suffix == ".csv":
        assert left == ["a-incomplete.csv"]
        assert len(set(map(len, (line.split(",") for line in (tmp_path / left[0]).read_text().splitlines())))) == 1
    else:
        assert left == []


@pytest.mark.parametrize("recorded", [True, False])
def test_a_session_whose_export_is_lost_says_so_and_ends_with_1(
    recorded: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    fill_the_disk(monkeypatch, 60_000)
    path = tmp_path / "a.mcap"
    record = ["--record", str(path)] if recorded else []
    command = ["live", "-s", "simulate://sample:kick?once=1&speed=4", "--export", str(tmp_path / "a.csv"), *record]
    assert run(command) == 1
    told = " ".join(capsys.readouterr().out.split())
    assert "NOT KEPT" in told
    assert "No space left" in told
    assert "exported" not in told
    assert not (tmp_path / "a.csv").exists()
    if recorded:
        assert f"poseloom reconstruct {path}" in told
        assert len(read_recording(path)) > 50
    else:
        assert "--record keeps one" in told


def test_an_export_that_takes_long_is_waited_for_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("poseloom.live.sinks.outlet._LONGEST_CLOSE", 0.0)
    monkeypatch.setattr("poseloom.live.sinks.outlet._LOOK_EVERY", 0.01)
    written = MotionExport._finish  # pyright: ignore[reportPrivateUsage]

    def slowly(self: MotionExport, path: Path) -> None:
        time.sleep(0.3)
        written(self, path)

    monkeypatch.setattr(MotionExport, "_finish", slowly)
    plan = plan_session(LiveSettings(("simulate://sample:kick?once=1&speed=8",), export=str(tmp_path / "a.npz")))
    shown: list[str] = []
    summary = Session(plan).run(lambda what, waiting: shown.append(what))
    assert summary.exports == (tmp_path / "a.npz",)
    assert summary.failures == ()
    assert "export to a.npz" in shown
    assert len(read_motion(tmp_path / "a.npz")) > 30


def test_a_recording_that_is_cut_off_is_not_called_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def limited(path: Path) -> FullDisk:
        file = FullDisk(path, "xb")
        file.left = 40_000
        return file

    monkeypatch.setattr("poseloom.formats.recording_writer._new_file", limited)
    monkeypatch.setattr("poseloom.live.sinks.recorder._FLUSH_EVERY", 0.02)
    path = tmp_path / "a.mcap"
    assert run(["live", "-s", "simulate://sample:walk?once=1&speed=4", "--record", str(path)]) == 1
    told = " ".join(capsys.readouterr().out.split())
    assert "THE RECORDING HAS STOPPED" in told
    assert "NOT KEPT: the recording" in told
    assert "recorded" not in told.split("arrival to pose sent")[1].replace("unrecorded", "")
    assert CUT_OFF in read_recording(path).settings


# Ended from outside


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="a system without SIGHUP")
@pytest.mark.parametrize("name", ["SIGHUP", "SIGTERM"])
def test_a_session_that_is_ended_from_outside_leaves_whole_files(name: str, tmp_path: Path):
    recording, motion = tmp_path / "a.mcap", tmp_path / "a.bvh"
    command = [sys.executable, "-m", "poseloom", "live", "-s", "simulate://sample:walk"]
    command += ["--record", str(recording), "--export", str(motion)]
    # Under nohup children ignore SIGHUP, and the session respects it.
    restore = partial(signal.signal, getattr(signal, name), signal.SIG_DFL)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, preexec_fn=restore)
    assert process.stdout is not None
    while "Ctrl-C ends it" not in (line := process.stdout.readline()):
        assert line, "the session did not begin"
    end = time.monotonic() + 60.0
    while not (recording.exists() and recording.stat().st_size > 30_000):
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(getattr(signal, name))
    if name == "SIGHUP":
        process.send_signal(signal.SIGHUP)  # shell and system both send it when a terminal is closed
    told, _ = process.communicate(timeout=60)
    assert process.returncode == 0, told
    session = read_session(recording)
    assert CUT_OFF not in session.recording.settings
    made = read_motion(motion)
    span = session.recording.times[-1] - session.recording.times[0]
    # A busy machine may pass over the first poses.
    assert abs((len(made) - 1) / made.rate - span) < 0.3


def test_recording_export_and_reconstruction_last_as_long(tmp_path: Path):
    """A device of 90 Hz in a session of 40 Hz, whose samples and poses must not last longer than it spoke."""
    recording, export = tmp_path / "a.mcap", tmp_path / "a.npz"
    settings = LiveSettings(
        ("simulate://sample:walk?once=1&rate=90",),
        record=str(recording),
        export=str(export),
        method="inverse-kinematics",
    )
    plan = plan_session(settings)
    slow = replace(plan.layout, rate=40.0)

    def make(name: str) -> Any:
        return make_method(name, slow)

    # No pose is passed over, however busy the machine is.
    Session(replace(plan, layout=slow, make=make, capacity=10_000, patience=1e9)).run()
    heard = read_recording(recording)
    lasts = float(heard.times[-1] - heard.times[0])
    spoke = float(heard.arrivals[-1] - heard.arrivals[0])
    source = plan.sources[0]
    assert isinstance(source, ReplaySource)
    said = float(source.recording.times[-1] - source.recording.times[0])
    # What a busy machine says late is measured when it should have been said.
    assert said - 0.1 < lasts < spoke + 0.1
    made = read_motion(export)
    assert made.rate == 40.0
    assert abs((len(made) - 1) / 40.0 - lasts) <= 0.05
    again = reconstruct(make_method("inverse-kinematics", heard.layout), heard)
    assert abs(again.times[-1] - again.times[0] - lasts) < 1e-9


# A start that fails


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["-s", "serial:///dev/none-such?layout=flex-four", "-m", "flex-scales"], "cannot be opened"),
        (["-s", "udp://203.0.113.7:5"], "nothing can be heard"),
        (["-s", "simulate://sample:walk", "-m", "no-such-method"], "unknown method"),
        (["-s", "simulate://sample:walk?layout=hips-imu", "-m", "phase-hmm", "--model", "none.npz"], "no such file"),
        (["-s", "simulate://sample:walk", "--send", "vmc://no-such-host.invalid:5"], "cannot be sent"),
        (["-s", "simulate://sample:walk", "--calibration", "none.npz"], "no such file"),
        (["-s", "replay://none.mcap"], "no such file"),
    ],
)
def test_a_start_that_fails_leaves_no_file_and_destroys_none(
    arguments: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.bvh").write_text("dear")
    assert run(["live", *arguments, "--record", "new.mcap", "--export", "a.bvh"]) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert [each.name for each in tmp_path.iterdir()] == ["a.bvh"]
    assert (tmp_path / "a.bvh").read_text() == "dear"


def test_a_recording_that_is_there_is_not_touched(tmp_path: Path):
    (tmp_path / "a.mcap").write_text("dear")
    files = ["--record", str(tmp_path / "a.mcap"), "--export", str(tmp_path / "a.bvh")]
    assert run(["live", "-s", "simulate://sample:walk", *files]) == 2
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]
    assert (tmp_path / "a.mcap").read_text() == "dear"


def test_a_source_that_cannot_begin_ends_a_session_in_which_another_has_spoken(tmp_path: Path):
    settings = LiveSettings(
        ("simulate://sample:walk",), record=str(tmp_path / "a.mcap"), export=str(tmp_path / "a.bvh")
    )
    plan = plan_session(settings)

    class Late:
        name, layout = "a late one", plan.layout

        async def run(self, listener: Any) -> None:
            await asyncio.sleep(0.2)
            raise SensorError("this one cannot begin")

    with pytest.raises(PoseloomError, match="this one cannot begin"):
        Session(replace(plan, sources=(*plan.sources, Late()))).run()
    assert list(tmp_path.iterdir()) == []


def test_a_session_in_which_nothing_came_leaves_no_empty_recording(tmp_path: Path):
    plan = plan_session(LiveSettings(("udp://:0",), record=str(tmp_path / "a.mcap"), seconds=0.3))
    summary = Session(plan).run()
    assert summary.recordings == ()
    assert any("nothing came while" in notice.text for notice in summary.notices)
    assert list(tmp_path.iterdir()) == []
