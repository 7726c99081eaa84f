"""Whole sessions: what goes in comes out, is recorded, is solved again bit for bit, and outlives what goes wrong."""

import errno
import io
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pythonosc.osc_packet import OscPacket

from poseloom.errors import PoseloomError
from poseloom.formats import read_motion
from poseloom.formats.recording import CUT_OFF, read_recording, write_recording
from poseloom.formats.session_recording import SessionRecording, read_session
from poseloom.live.contract import (
    Calibrate,
    CalibrationKind,
    ChooseMethod,
    Command,
    Level,
    Post,
    ResetHeading,
    SessionFacts,
    StartRecording,
    StopRecording,
    Trouble,
    Update,
)
from poseloom.live.devices import DatagramSpeaker, json_datagram, play, pseudo_terminal, vmc_datagram
from poseloom.live.lines import encode_counts
from poseloom.live.reprocess import Comparison, compare_with_session, plan_reprocessing, recorded_motion, reprocess
from poseloom.live.session import Session
from poseloom.live.session_plan import SessionPlan, SessionSummary
from poseloom.live.settings import LiveSettings, make_settings, read_settings
from poseloom.live.setup import joint_layout, plan_session
from poseloom.live.sinks.motion_export import MotionExport
from poseloom.live.sinks.vmc_sender import VmcSender
from poseloom.live.source import Source
from poseloom.live.source_replay import ReplaySource
from poseloom.live.source_serial import SerialSource
from poseloom.live.sources_network import DatagramSource, VmcSource
from poseloom.live.virtual import virtual_recording
from poseloom.live.worker import Heard, MethodWorker
from poseloom.methods import make_method
from poseloom.methods.contract import Frame, Health, Reconstructor
from poseloom.methods.fold import Engine
from poseloom.methods.reconstruction import Reconstruction
from poseloom.rotations import matrix_from_rotvec
from poseloom.sensors import Placement, Recording, Sample, default_placements, layout
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.skeleton import Skeleton
from poseloom.synthesis import NO_NOISE, simulate_trackers

SIX = replace(layout("six-trackers"), rate=60.0)
FLEX = layout("flex-four")
BODY = average_body()


@pytest.fixture(scope="module")
def walk() -> Recording:
    return virtual_recording("sample:walk", SIX, endless=False)


class Ears:
    """A sink that remembers, and calls back at the n-th update."""

    name = "ears"

    def __init__(self, at: dict[int, Command] | None = None, capacity: int = 10_000) -> None:
        self.updates: list[Update] = []
        self.facts: list[SessionFacts] = []
        self.closed = False
        self.capacity = capacity
        self._at = at or {}

    def open(self, facts: SessionFacts, post: Post) -> None:
        self.facts.append(facts)
        self._post = post

    def changed(self, facts: SessionFacts) -> None:
        self.facts.append(facts)

    def show(self, update: Update) -> None:
        self.updates.append(update)
        if len(self.updates) in self._at:
            self._post(self._at[len(self.updates)])

    def close(self) -> None:
        self.closed = True


def plan_of(source: Source, *sinks: Any, method: str = "inverse-kinematics", **more: Any) -> SessionPlan:
    worn = source.layout
    recording = source.recording if isinstance(source, ReplaySource) else None
    return SessionPlan(
        sources=(source,),
        layout=worn,
        skeleton=BODY if recording is None else recording.skeleton,
        placements=default_placements(worn, BODY) if recording is None else recording.placements,
        method=method,
        make=lambda name: make_method(name, worn),
        sinks=tuple(sinks),
        # No sample is passed over, however slow the machine is on which this runs, unless a test wants it.
        **{"capacity": 10_000, "patience": 1e9, "thin": False, **more},
    )


def solved_again(path: Path) -> tuple[SessionRecording, Reconstruction, Comparison]:
    session = read_session(path)
    again = reprocess(session, plan_reprocessing(session))
    return session, again, compare_with_session(session, again)


def test_a_session_is_solved_again_bit_for_bit(walk: Recording, tmp_path: Path):
    """Through a heading reset, at a pace and with a queue with which samples may be passed over."""
    path = tmp_path / "a.mcap"
    ears = Ears({20: ResetHeading()})
    summary = Session(
        plan_of(ReplaySource(walk, speed=4.0), ears, MotionExport(tmp_path / "a.npz"), record=path, capacity=2)
    ).run()
    session, _, same = solved_again(path)
    assert len(session.recording) == summary.counters.samples == len(walk)
    assert len(session.steps) == summary.counters.frames == len(walk) - summary.counters.dropped
    assert len(session.starts) == 2
    assert same.identical == same.compared == len(session.steps)
    assert same.agrees
    assert same.largest == 0.0
    shown = {update.number: update for update in ears.updates}
    for row, number in enumerate(session.steps.samples.tolist()):
        frame = shown[number].frame
        assert frame is not None
        assert np.array_equal(frame.pose.q, session.steps.q[row])
    # After the reset the wearer is near the origin and faces ahead.
    reset = session.starts[1].sample
    row = int(np.searchsorted(session.steps.samples, reset))
    assert np.hypot(*session.steps.q[row, [0, 2]]) < 0.3
    assert matrix_from_rotvec(session.steps.q[row, 3:6])[2, 2] > 0.95
    motion = recorded_motion(session)
    assert motion is not None
    assert np.allclose(read_motion(tmp_path / "a.npz").q, motion.q)
    assert ears.closed
    assert summary.recordings == (path,)


def test_what_is_heard_is_what_was_said(walk: Recording, tmp_path: Path):
    path = tmp_path / "a.mcap"
    Session(plan_of(ReplaySource(walk.cut(0, 100), speed=2.0), record=path)).run()
    heard = read_recording(path)
    assert np.array_equal(heard.positions, walk.positions[:100])
    assert np.array_equal(heard.quats_wxyz, walk.quats_wxyz[:100])
    assert heard.settings["method"] == "inverse-kinematics"
    # A recording that no session made has no steps, and is heard whole.
    write_recording(walk.cut(0, 50), tmp_path / "b.mcap")
    plain, again, same = solved_again(tmp_path / "b.mcap")
    assert plain.starts == ()
    assert len(again.motion) == 50
    assert same.compared == 0


def test_recording_begins_and_ends_on_demand(walk: Recording, tmp_path: Path):
    first = tmp_path / "first.mcap"
    ears = Ears({50: StartRecording(first), 120: StopRecording(), 150: StartRecording(first), 160: StartRecording()})
    summary = Session(plan_of(ReplaySource(walk), ears, folder=tmp_path)).run()
    session, _, same = solved_again(first)
    assert 0 < len(session.recording) < len(walk)
    assert same.identical == same.compared == len(session.steps)
    # A recording is never overwritten: that is told, and the session goes on.
    assert any(n.level is Level.ERROR and "of this name already" in n.text for n in summary.notices)
    assert len(summary.recordings) == 2
    assert summary.recordings[1].parent == tmp_path
    assert {facts.recording for facts in ears.facts} == {None, first, summary.recordings[1]}


def test_sinks_that_fail_or_are_slow_cost_themselves_only(walk: Recording):
    class Slow(Ears):
        name = "slow"

        def show(self, update: Update) -> None:
            super().show(update)
            wait_for(lambda: len(ears.updates) >= 100)  # slower than all others, on any machine

    class Broken(Ears):
        name = "broken"

        def show(self, update: Update) -> None:
            raise RuntimeError("out of paper")

    slow, broken, prompt, ears = Slow(capacity=1), Broken(), Broken(capacity=0), Ears()
    summary = Session(plan_of(ReplaySource(walk, speed=2.0), slow, broken, prompt, ears)).run()
    assert len(ears.updates) == summary.counters.frames >= len(walk) - summary.counters.dropped
    assert len(slow.updates) < len(ears.updates) - 90
    assert summary.counters.unseen >= len(ears.updates) - len(slow.updates) - 1
    assert [update.number for update in slow.updates] == sorted(update.number for update in slow.updates)
    assert sum("out of paper" in notice.text for notice in summary.notices) == 2
    assert broken.closed


def test_a_method_that_fails_begins_anew(walk: Recording, tmp_path: Path):
    class Fragile(Reconstructor[int]):
        layout = SIX

        def start(self, skeleton: Skeleton, placements: Any) -> int:
            return 0

        def step(self, state: int, sample: Sample) -> tuple[int, Frame | None]:
            if state == 20:
                raise ZeroDivisionError("no luck")
            q = np.full(BODY.size, float(state))
            return state + 1, Frame(sample.time, Pose(BODY, q), np.zeros(BODY.size), Health())

    path = tmp_path / "a.mcap"
    plan = replace(plan_of(ReplaySource(walk.cut(0, 60), speed=2.0), record=path), make=lambda name: Fragile())
    summary = Session(plan).run()
    assert any("no luck" in notice.text for notice in summary.notices)
    session = read_session(path)
    same = compare_with_session(session, reprocess(session, plan_reprocessing(session, Fragile())))
    assert same.identical == same.compared == len(session.steps) >= 50


@pytest.mark.parametrize(("age", "heard", "dropped"), [(0.0, 2, 2), (100.0, 5, 5)])
def test_a_burst_is_heard_and_what_has_waited_long_is_passed_over(
    walk: Recording, age: float, heard: int, dropped: int
):
    """Six samples for a queue of four: the oldest two go; of those that waited too long all but the newest."""
    engine = Engine("x", make_method("inverse-kinematics", SIX), BODY, default_placements(SIX, BODY))
    worker = MethodWorker(engine, lambda worked: None, lambda number, error: None, capacity=4, patience=10.0)
    for number in range(6):
        worker.hear(number, replace(walk.sample(number), arrival=time.monotonic() - age))
    first = worker._next()
    assert isinstance(first, Heard)
    assert (first.number, worker.dropped) == (heard, dropped)


def test_the_figure_goes_on_while_all_is_silent_and_rejoins(walk: Recording, tmp_path: Path):
    silent = np.arange(120, 180)
    positions, quats = walk.positions.copy(), walk.quats_wxyz.copy()
    positions[silent], quats[silent] = np.nan, np.nan
    status = walk.status.copy()
    status[silent] = 1
    gone = replace(walk, positions=positions, quats_wxyz=quats, status=status)
    path, ears = tmp_path / "a.mcap", Ears()
    # At another speed a recording brings its own times along, however busy the machine is.
    Session(plan_of(ReplaySource(gone, speed=1.5), ears, record=path)).run()
    states = [update.frame.health.state.value for update in ears.updates if update.frame is not None]
    assert set(states[130:175]) == {"coasting"}
    assert states[-1] == "ok"
    q = np.stack([update.frame.pose.q for update in ears.updates if update.frame is not None])
    steps = np.linalg.norm(np.diff(q[:, :3], axis=0), axis=1)
    assert steps[100:].max() < 0.2
    found = {(each.sensor, each.trouble) for each in read_session(path).findings}
    assert found == {(name, Trouble.SILENT.value) for name in SIX.names}
    assert any(update.findings for update in ears.updates)


def test_arms_out_finds_how_trackers_are_turned_and_how_tall_the_wearer_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Trackers fixed any way round on someone of 88 % of the average, who holds the pose facing somewhere."""
    from poseloom.calibration.calibration import read_calibration
    from poseloom.calibration.poses import guided_poses
    from poseloom.live.calibrating import arms_out_calibration
    from poseloom.skeleton.motion import make_motion

    rng = np.random.default_rng(0)
    wearer = BODY.with_offsets(BODY.offsets * 0.88, BODY.tips * 0.88)
    worn = tuple(
        Placement(p.bone, matrix_from_rotvec(rng.normal(size=3)), p.p_bone_sensor)
        for p in default_placements(SIX, wearer)
    )
    q = guided_poses()[0].q.copy()
    q[1] *= 0.88
    q[:3] += [1.0, 0.0, -2.0]
    q[3:6] = [0.0, 2.2, 0.0]
    still = simulate_trackers(make_motion(wearer, np.tile(q, (240, 1)), 60.0), SIX, NO_NOISE, placements=worn)
    found = arms_out_calibration([still.sample(i) for i in range(120)], SIX)
    assert np.allclose(found.skeleton.offsets, wearer.offsets, atol=1e-9)
    for mine, its in zip(found.placements, worn, strict=True):
        assert np.allclose(mine.R_bone_sensor, its.R_bone_sensor, atol=1e-9)
    # The same within a session, asked for at a sink.
    monkeypatch.setattr("poseloom.live.calibrating._FIRST_READY", 0.3)
    monkeypatch.setattr("poseloom.live.calibrating._HOLD", 0.5)
    ears = Ears({5: Calibrate(CalibrationKind.ARMS_OUT)})
    noisy = simulate_trackers(make_motion(wearer, np.tile(q, (240, 1)), 60.0), SIX, placements=worn)
    plan = plan_of(ReplaySource(noisy, speed=0.5), ears, folder=tmp_path, record=tmp_path / "a.mcap")
    summary = Session(replace(plan, skeleton=BODY, placements=default_placements(SIX, BODY))).run()
    assert ears.facts[-1].calibrated
    assert np.allclose(ears.facts[-1].skeleton.offsets, wearer.offsets, atol=0.01)
    phases = [update.calibration.phase for update in ears.updates if update.calibration is not None]
    # A busy machine shows poses of the hold when it is over.
    assert "".join(dict.fromkeys(phases)) in ("get ready", "get readyhold", "get readyholdcomputing")
    kept = read_calibration(next(tmp_path.glob("calibration-*.npz")))
    assert kept.skeleton.names == wearer.names
    # Another body, another file.
    assert len(summary.recordings) == 2
    assert read_session(summary.recordings[1]).starts[0].sample == 0


def test_calibration_without_anybody_is_told(walk: Recording):
    ears = Ears()
    session = Session(plan_of(ReplaySource(walk.cut(0, 30)), ears))
    session.post(Calibrate())
    session.post(ChooseMethod("magic"))
    notices = [notice.text for notice in session.run().notices]
    assert any("nothing has been heard yet" in text for text in notices)
    assert any("unknown method 'magic'" in text for text in notices)


# Files and disks


class FullDisk(io.FileIO):
    """A file that takes so many bytes and no more."""

    left = 60_000

    def write(self, data: Any) -> int:
        self.left -= len(data)
        if self.left < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data) or 0


def test_a_full_disk_ends_the_recording_and_not_the_session(
    walk: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("poseloom.formats.recording_writer._new_file", lambda path: FullDisk(path, "xb"))
    monkeypatch.setattr("poseloom.live.sinks.recorder._FLUSH_EVERY", 0.05)
    path, ears = tmp_path / "a.mcap", Ears()
    summary = Session(plan_of(ReplaySource(walk, speed=2.0), ears, record=path)).run()
    assert len(ears.updates) >= len(walk)
    (error,) = [notice.text for notice in summary.notices if notice.level is Level.ERROR]
    assert "THE RECORDING HAS STOPPED" in error
    assert "No space left" in error
    kept = read_recording(path)
    assert CUT_OFF in kept.settings
    assert 0 < len(kept) < len(walk)


def test_a_kill_loses_the_last_second_at_most(tmp_path: Path):
    code = f"""
import sys, threading, time
from poseloom.live.settings import LiveSettings
from poseloom.live.setup import plan_session
from poseloom.live.session import Session
settings = LiveSettings(source=("simulate://sample:walk?once=1",), record="{tmp_path}/a.mcap")
session = Session(plan_session(settings))
def tell():
    while session.counters.frames < 150:
        time.sleep(0.01)
    made = session.counters.samples
    while session.counters.samples < made + 120:
        time.sleep(0.01)
    print(made, flush=True)
threading.Thread(target=tell, daemon=True).start()
session.run()
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    made = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    session, _, same = solved_again(tmp_path / "a.mcap")
    assert CUT_OFF in session.recording.settings
    assert len(session.recording) >= made  # two seconds ago
    assert len(session.steps) > 0
    assert same.identical == same.compared == len(session.steps)


# The network


def in_background(session: Session) -> tuple[threading.Thread, list[SessionSummary]]:
    done: list[SessionSummary] = []
    thread = threading.Thread(target=lambda: done.append(session.run()), daemon=True)
    thread.start()
    return thread, done


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.005)


def test_vmc_in_and_out_in_two_sessions_at_once(walk: Recording):
    """Devices without a clock are heard, guessed and posed; poses arrive in Unity's axes; sessions do not mix."""
    ears = (Ears(), Ears())
    sources = (VmcSource(SIX, port=0), DatagramSource(SIX, port=0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        sender = VmcSender("127.0.0.1", receiver.getsockname()[1])
        sessions = [Session(plan_of(sources[0], sender, ears[0])), Session(plan_of(sources[1], ears[1]))]
        running = [in_background(session) for session in sessions]
        wait_for(lambda: all(source.port for source in sources))
        threads = []
        for source, encode in zip(sources, (vmc_datagram, json_datagram), strict=True):
            speaker = DatagramSpeaker("127.0.0.1", source.port, encode)
            threads.append(threading.Thread(target=play, args=(walk, speaker, 2.0)))
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        wait_for(lambda: all(len(each.updates) >= 118 for each in ears))
        for session, (thread, _) in zip(sessions, running, strict=True):
            session.stop()
            thread.join()
        bones = {}
        for message in OscPacket(receiver.recv(2000)).messages:
            if message.message.address == "/VMC/Ext/Bone/Pos":
                bones[message.message.params[0]] = message.message.params[1:4]
    first = ears[0].updates[0].frame
    assert first is not None
    assert np.allclose(np.array(bones["Hips"]) * [-1, 1, 1], first.pose.q[:3], atol=1e-5)
    for (_, done), ear in zip(running, ears, strict=True):
        counters = done[0].counters
        assert counters.packets == 120
        assert counters.samples - counters.filled == 120
        assert counters.lost == counters.malformed == counters.stale == 0
        said = [u for u in ear.updates if np.isfinite(u.sample.positions).all()]
        truth, frame = walk.truth, said[100].frame
        assert truth is not None
        assert frame is not None
        at = int(np.abs(walk.positions[:, 0] - said[100].sample.positions[0]).sum(axis=1).argmin())
        assert np.abs(frame.pose.q[:3] - truth.q[at, :3]).max() < 0.1
    assert any("(guessed)" in notice.text for notice in running[0][1][0].notices)


def test_hostile_packets_are_counted_and_nothing_else(walk: Recording):
    source, ears = DatagramSource(SIX, port=0), Ears()
    session = Session(plan_of(source, ears))
    thread, done = in_background(session)
    wait_for(lambda: bool(source.port))
    rng = np.random.default_rng(0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as speaker:
        address = ("127.0.0.1", source.port)
        sound = [json_datagram(walk.sample(i), SIX, i / 60) for i in range(60)]
        for i in range(60):
            speaker.sendto(sound[i], address)
            speaker.sendto(sound[i], address)
            speaker.sendto(sound[max(i - 5, 0)], address)
            speaker.sendto(rng.bytes(100), address)
            speaker.sendto(rng.bytes(20_000), address)
            speaker.sendto(b"", address)
            broken = bytearray(sound[i])
            broken[int(rng.integers(len(broken)))] = 0
            speaker.sendto(bytes(broken), address)
            time.sleep(1 / 60)
            # No faster than they are received: what the system's buffer drops is not counted.
            wait_for(lambda i=i: session.counters.packets >= 7 * (i + 1) - session.counters.lost)
    session.stop()
    thread.join()
    counters = done[0].counters
    assert 60 - counters.lost <= counters.samples - counters.filled <= 60
    assert 120 - counters.lost <= counters.stale <= 120
    assert 240 - counters.lost <= counters.malformed <= 240
    assert not [notice for notice in done[0].notices if notice.level is Level.ERROR]


def test_a_port_that_is_taken_is_told():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(PoseloomError, match=f"nothing can be heard on 127.0.0.1:{port}"):
            Session(plan_of(VmcSource(SIX, port=port))).run()
    with pytest.raises(PoseloomError, match="cannot be opened"):
        Session(replace(plan_of(SerialSource(FLEX, "/dev/none-such")), make=lambda name: Straight())).run()


def test_listeners_bind_to_this_machine_unless_asked():
    plan = plan_session(LiveSettings(source=("vmc://:0", "udp://:0"), layout="six-trackers"))
    assert [source.name for source in plan.sources] == ["vmc on 127.0.0.1:0", "udp on 127.0.0.1:0"]
    asked = plan_session(LiveSettings(source=("vmc://0.0.0.0:39539",), bind="127.0.0.1"))
    assert asked.sources[0].name == "vmc on 0.0.0.0:39539"
    viewed = plan_session(LiveSettings(source=("vmc://:39539", "udp://:0"), layout="six-trackers", bind="0.0.0.0"))
    assert [source.name for source in viewed.sources] == ["vmc on 127.0.0.1:39539", "udp on 127.0.0.1:0"]
    assert VmcSender().host == "127.0.0.1"


# Other processes


def device(*arguments: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "poseloom", "simulate-device", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    return process


def test_a_device_that_is_killed_and_started_again_is_heard_again():
    source, ears = DatagramSource(SIX, port=0), Ears()
    session = Session(plan_of(source, ears))
    thread, done = in_background(session)
    wait_for(lambda: bool(source.port))
    try:
        for turn in range(2):
            before = session.counters.samples - session.counters.filled
            process = device(f"udp://127.0.0.1:{source.port}", "sample:walk")
            try:
                wait_for(lambda before=before: session.counters.samples - session.counters.filled > before + 30)
            finally:
                process.kill()
                process.wait()
                process.stdout.close()  # pyright: ignore
            if turn == 0:
                wait_for(lambda: len(session.findings) == len(SIX))
    finally:
        session.stop()
        thread.join()
    states = {update.frame.health.state.value for update in ears.updates if update.frame is not None}
    assert {"ok", "coasting"} <= states
    assert done[0].counters.malformed == 0


class Straight(Reconstructor[int]):
    layout = FLEX

    def start(self, skeleton: Skeleton, placements: Any) -> int:
        return 0

    def step(self, state: int, sample: Sample) -> tuple[int, Frame | None]:
        return state, Frame(sample.time, Pose(BODY, np.zeros(BODY.size)), np.zeros(BODY.size), Health())


def test_a_serial_line_is_heard_until_and_after_it_goes_away(tmp_path: Path):
    link = tmp_path / "line"

    process = device(f"serial://{link}", "sample:run", "--rate", "100")
    source, ears = SerialSource(FLEX, str(link)), Ears()
    session = Session(replace(plan_of(source, ears), make=lambda name: Straight()))
    thread, done = in_background(session)
    try:
        wait_for(lambda: len(ears.updates) > 60)
        process.kill()
        process.wait()
        wait_for(lambda: any("gone away" in notice.text for notice in session.notices))
        link.unlink(missing_ok=True)
        with pseudo_terminal(link) as (write, _):
            wait_for(lambda: any("is back" in notice.text for notice in session.notices))
            heard = len(ears.updates)
            deadline, i = time.monotonic() + 60.0, 0
            while len(ears.updates) <= heard + 30:
                assert time.monotonic() < deadline, "nothing is received after the line is back"
                write(encode_counts([600.0 + i % 60, 601.0, 602.0, 603.0]))
                time.sleep(0.005)
                i += 1
    finally:
        process.kill()
        process.wait()
        process.stdout.close()  # pyright: ignore
        session.stop()
        thread.join()
    counts = np.stack([update.sample.counts for update in ears.updates])
    counts = counts[np.isfinite(counts).all(axis=1)]
    assert len(counts) > 60
    assert np.ptp(counts, axis=0).min() > 5
    assert done[0].counters.malformed == 0


# Settings


def test_a_file_holds_the_same_as_flags_and_flags_win(tmp_path: Path):
    file = tmp_path / "live.toml"
    file.write_text('source = "vmc://:5"\nmethod = "nearest-example"\nsend = ["vmc://a:7"]\nseconds = 3\nview = true\n')
    settings = read_settings(file, {"method": "inverse-kinematics", "view": None})
    assert settings == make_settings(
        {
            "source": ("vmc://:5",),
            "method": "inverse-kinematics",
            "send": ("vmc://a:7",),
            "seconds": 3.0,
            "view": True,
        }
    )
    for text, message in (
        ("metod = 'x'", "Did you mean 'method'"),
        ("seconds = 'x'", "not a float"),
        ("view = 1", "not a bool"),
        ("source = [1]", "list of texts"),
        ("=", "no TOML"),
    ):
        file.write_text(text)
        with pytest.raises(PoseloomError, match=message):
            read_settings(file, {})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "no source was given"),
        ({"source": ("vnc://:1",)}, "unknown scheme of a source 'vnc'"),
        ({"source": ("vmc://x:y",)}, "has no port"),
        ({"source": ("vmc://:0?rat=5",)}, "unknown key .*Did you mean 'rate'"),
        ({"source": ("vmc://:0?rate=-5",)}, "has no rate"),
        ({"source": ("serial://",)}, "names no serial line"),
        ({"source": ("udp://:0?layout=hips-imu",)}, "no method was given"),
        ({"source": ("vmc://:0",), "method": "nearest-example"}, "needs a motion library"),
        ({"source": ("vmc://:0",), "method": "magic"}, "unknown method"),
        ({"source": ("vmc://:0",), "send": ("osc://1:2",)}, "unknown scheme of a receiver"),
        ({"source": ("vmc://:0",), "export": "x.fbx"}, "no motion can be exported"),
        ({"source": ("udp://:0?layout=three-trackers",), "layout": "six-trackers"}, "no source speaks of upperChest"),
        ({"source": ("simulate://sample:wlk",)}, "Did you mean 'walk'"),
        ({"source": ("simulate://sample:walk?fault=silent:hand",)}, "not understood"),
    ],
)
def test_settings_that_do_not_fit_are_told(settings: dict[str, Any], message: str):
    with pytest.raises(PoseloomError, match=message):
        plan_session(LiveSettings(**settings))


def test_flex_and_imu_become_one_layout():
    worn = joint_layout([SerialSource(layout("flex-four"), "/dev/x"), DatagramSource(layout("hips-imu"))], "")
    assert worn.name == "flex-four+hips-imu"
    assert worn.rate == 60.0
