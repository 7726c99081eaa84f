"""One bad device costs no other; what arrives, from where and at what rate is said; and that nothing came is said."""

import contextlib
import json
import math
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.cli._app import run
from poseloom.errors import SensorError
from poseloom.formats.recording import write_recording
from poseloom.live.arrival_status import ArrivalMonitor
from poseloom.live.arrivals import SourceArrivals
from poseloom.live.contract import ArrivalStatus, Level, Post, SessionFacts, Update
from poseloom.live.devices import pseudo_terminal
from poseloom.live.lines import parse_counts
from poseloom.live.osc import encode_bundle, encode_message
from poseloom.live.readings import AT_ORIGIN, NO_FIX, Packet, Reading, Refusal
from poseloom.live.session import Session
from poseloom.live.session_plan import SessionSummary
from poseloom.live.settings import LiveSettings
from poseloom.live.setup import plan_session
from poseloom.live.source import Source
from poseloom.live.source_serial import LineFileSource, SerialSource
from poseloom.live.sources_network import DatagramSource, VmcSource
from poseloom.live.specifications import make_source
from poseloom.live.vmc import parse_devices, read_devices
from poseloom.live.wire import encode_binary, parse_datagram
from poseloom.sensors import default_placements, layout, make_recording
from poseloom.skeleton.body import average_body
from test_live_session import Straight, in_background, plan_of

SIX = layout("six-trackers")
FLEX = layout("flex-four")
UNTURNED = [0.0, 0.0, 0.0, 1.0]
WORN = {
    "HMD1": ("Hmd", [0.0, 1.65, 0.1]),
    "ConL": ("Con", [-0.3, 0.9, 0.2]),
    "ConR": ("Con", [0.3, 0.9, 0.2]),
    "T1": ("Tra", [0.0, 1.25, 0.1]),
    "T2": ("Tra", [-0.1, 0.12, 0.1]),
    "T3": ("Tra", [0.1, 0.12, 0.1]),
}
"""Devices as a program with Unity's axes sends them: X to the right."""
ROLES = {"HMD1": "head", "ConL": "leftHand", "ConR": "rightHand", "T1": "upperChest", "T2": "leftAnkle",
         "T3": "rightAnkle"}  # fmt: skip


def vmc_message(serial: str, quat: list[float] = UNTURNED, more: list[Any] | None = None) -> bytes:
    kind, position = WORN[serial]
    return encode_message(f"/VMC/Ext/{kind}/Pos", [serial, *position, *quat, *(more or [])])


# Each message of a packet stands alone


def too_few(serial: str) -> bytes:
    return encode_message("/VMC/Ext/Tra/Pos", [serial, 0.0, 1.0])


BAD_MESSAGES = st.one_of(
    st.just(encode_message("/VMC/Ext/Tra/Pos", ["", 0.0, 1.0, 0.0, *UNTURNED])),
    st.just(encode_message("/VMC/Ext/Tra/Pos", ["bad", 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])),
    st.just(encode_message("/VMC/Ext/Tra/Pos", ["bad", math.nan, 1.0, 0.0, *UNTURNED])),
    st.just(encode_message("/VMC/Ext/Tra/Pos", ["bad", 0.0, 1.0, 0.0, 9.0, 9.0, 9.0, 9.0])),
    st.just(encode_message("/VMC/Ext/Con/Pos", [7, 0.0, 1.0, 0.0, *UNTURNED])),
    st.just(encode_message("/VMC/Ext/Con/Pos", ["bad", "x", 1.0, 0.0, *UNTURNED])),
    st.just(too_few("bad")),
    st.just(encode_message("/VMC/Ext/Hmd/Pos")),
    st.just(encode_message("/VMC/Ext/Blend/Val", ["A", 0.5])),
    st.just(b"/VMC/Ext/Tra/Pos\0\0\0\0,sZZ\0\0\0\0"),
    st.binary(min_size=4, max_size=64).map(lambda data: data[: len(data) // 4 * 4]),
)


@settings(deadline=None)
@given(st.lists(BAD_MESSAGES, max_size=6), st.permutations(sorted(WORN)), st.data())
def test_a_bad_message_costs_no_device_of_the_same_packet(bad: list[bytes], serials: list[str], data: st.DataObject):
    messages = [vmc_message(serial) for serial in serials]
    for message in bad:
        messages.insert(data.draw(st.integers(0, len(messages))), message)
    alone = {device.serial: device for serial in serials for device in parse_devices(vmc_message(serial))}
    heard = {device.serial: device for device in read_devices(encode_bundle(messages)).devices}
    assert {serial: heard.get(serial) for serial in serials} == alone


def test_devices_within_bundles_within_a_broken_bundle_are_heard():
    broken = encode_bundle([vmc_message("T2")]) + struct.pack(">i", 5000) + b"/rest"
    packet = read_devices(encode_bundle([vmc_message("HMD1"), broken + bytes(-len(broken) % 4), vmc_message("T3")]))
    assert [device.serial for device in packet.devices] == ["HMD1", "T2", "T3"]
    assert len(packet.refused) == 1


@pytest.mark.parametrize("more", [[1.0], [1.0, 1.0, 1.0, 0.0, 0.0, 0.0], ["x", 7, True]])
def test_more_arguments_than_known_are_accepted(more: list[Any]):
    assert parse_devices(vmc_message("T2", more=more)) == parse_devices(vmc_message("T2"))


def test_a_device_before_its_first_fix_is_missing_and_named():
    packet = read_devices(encode_bundle([vmc_message("T2", [0.0] * 4), vmc_message("T3")]))
    assert [device.serial for device in packet.devices] == ["T3"]
    assert packet.refused == (Refusal(NO_FIX, "T2", missing=True),)
    at_origin = encode_message("/VMC/Ext/Tra/Pos", ["T2", 0.0, 0.0, 0.0, *UNTURNED])
    assert read_devices(at_origin).refused == (Refusal(AT_ORIGIN, "T2", missing=True),)


def test_devices_of_one_name_are_told_apart_by_their_order():
    message = [encode_message("/VMC/Ext/Tra/Pos", ["Tracker", 0.1 * i, 1.0, 0.0, *UNTURNED]) for i in range(3)]
    packet = read_devices(encode_bundle(message))
    assert [device.serial for device in packet.devices] == ["Tracker", "Tracker #2", "Tracker #3"]
    assert packet.repeated == ("Tracker",)


BAD_PARTS: list[Any] = [
    {"position": [1, 2]},
    {"position": [1, 2, None]},
    {"position": "abc"},
    {"quat": [2, 0, 0, 0]},
    {"count": -1},
    {"count": True},
    {"position": 5},
    7,
    None,
    [],
]


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from(SIX.names), st.sampled_from(BAD_PARTS), max_size=5))
def test_a_bad_sensor_costs_no_other_of_the_same_line(bad: dict[str, Any]):
    sound = {name: {"position": [0.5, 1, i]} for i, name in enumerate(SIX.names) if name not in bad}
    (packet,) = parse_datagram(json.dumps({"time": 1.0, "sensors": {**bad, **sound}}).encode(), SIX.names)
    assert set(packet.readings) == set(sound)
    assert {refusal.who for refusal in packet.refused} == set(bad)


def test_a_bad_line_costs_no_other_of_the_same_datagram():
    lines = b'{"time": 1, "sensors": {"head": {"count": 1}}}\nnot json\n{"time": 2, "sensors": {"head": {"count": 2}}}'
    first, second = parse_datagram(lines, SIX.names)
    assert (first.time, second.time) == (1.0, 2.0)
    assert [refusal.who for refusal in second.refused] == [""]


def test_parts_that_are_not_known_are_named_and_cost_nothing():
    line = {"sensors": {"head": {"position": [0, 1, 0], "accel": [0, 0, 1]}}}
    (packet,) = parse_datagram(json.dumps(line).encode(), SIX.names)
    assert packet.readings["head"].position == (0.0, 1.0, 0.0)
    assert "'accel'" in packet.refused[0].reason


def test_an_imu_without_orientation_keeps_what_it_measures():
    line = {"sensors": {"hips": {"quat": [0, 0, 0, 0], "force": [0, 9.8, 0]}, "head": {"position": [0, 1, 0],
                                                                                    "quat": [0, 0, 0, 0]}}}  # fmt: skip
    (packet,) = parse_datagram(json.dumps(line).encode(), ("hips", "head"))
    assert packet.readings == {"hips": Reading(specific_force=(0.0, 9.8, 0.0))}
    assert {refusal.who for refusal in packet.refused if refusal.missing} == {"hips", "head"}


def test_a_bad_sensor_costs_no_other_of_the_same_binary_datagram():
    readings = {name: Reading((0.0, 1.0, 2.0), (1.0, 0.0, 0.0, 0.0)) for name in SIX.names}
    data = bytearray(encode_binary(Packet(readings, 1.0), SIX.names))
    data[16 + 4 : 16 + 8] = struct.pack("<f", math.nan)  # the first sensor's position
    data[16 + 32] = 200  # the second one's index
    data[16 + 64 + 16 : 16 + 64 + 32] = bytes(16)  # the third one's quaternion
    (packet,) = parse_datagram(bytes(data), SIX.names)
    assert set(packet.readings) == set(SIX.names[3:])
    assert {refusal.who for refusal in packet.refused} == {SIX.names[0], "sensor 200", SIX.names[2]}


@pytest.mark.parametrize("bad", [b"-1", b"ovf", b"99999999999", b"1e9", b"", b"nan", b"inf"])
@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("head", [[], [b"40210"]])
def test_a_bad_count_costs_no_other_of_the_same_line(bad: bytes, place: int, head: list[bytes]):
    fields = [b"512", b"498", b"601", b"580"]
    fields[place] = bad
    packet = parse_counts(b",".join([*head, *fields]), FLEX.names)
    assert packet is not None
    assert packet.time == (40.21 if head else None)
    assert set(packet.readings) == {name for i, name in enumerate(FLEX.names) if i != place}


# What arrives, in words


class Sink:
    """Where packets go: those with an old time are late."""

    def __init__(self) -> None:
        self.late = False

    def packet(self, packet: Packet, arrival: float, stream: str) -> bool:
        return not self.late

    def malformed(self, reason: str, sender: str = "") -> None: ...

    def lost(self, count: int) -> None: ...

    def note(self, text: str, warning: bool = False) -> None: ...


class Watched:
    """A monitor on a made-up clock."""

    def __init__(self, text: str = "vmc://:39539") -> None:
        self.source = make_source(text)
        self.sink = Sink()
        self.monitor = ArrivalMonitor([self.source], self.sink)
        self.now = 1000.0
        self.reported: list[tuple[float, ArrivalStatus]] = []

    @property
    def listener(self) -> SourceArrivals:
        return self.monitor.listeners[0]

    def run(self, seconds: float, send: Callable[[float], None] | None = None, rate: float = 60.0) -> list[str]:
        before, begin = len(self.reported), self.now
        for tick in range(round(seconds * rate)):
            self.now = begin + tick / rate
            if send is not None:
                send(self.now)
            status = self.monitor.poll(self.now)
            if status is not None:
                self.reported.append((self.now - begin, status))
        self.now = begin + seconds
        return [status.text for _, status in self.reported[before:]]

    def send(self, data: bytes) -> Callable[[float], None]:
        assert isinstance(self.source, VmcSource | DatagramSource)
        source = self.source
        return lambda now: source.hear(data, now, "127.0.0.1:52011", self.listener)


BONES = encode_bundle(
    [encode_message("/VMC/Ext/OK", [1]), encode_message("/VMC/Ext/T", [1.0])]
    + [encode_message("/VMC/Ext/Bone/Pos", [bone, *[0.0] * 6, 1.0]) for bone in ("Hips", "Spine", "Head")]
)
GOOD = encode_bundle([vmc_message(serial) for serial in WORN])


def test_only_bones_is_said_within_two_seconds_with_the_remedy():
    watched = Watched()
    (text,) = watched.run(10.0, watched.send(BONES))
    assert watched.reported[0][0] < 2.0
    assert watched.reported[0][1].level is Level.WARNING
    assert text == (
        "only bones come from 127.0.0.1:52011 at 60 packets/s; poseloom needs /VMC/Ext/Tra/Pos, Con/Pos, Hmd/Pos: "
        "switch on 'send trackers' in the sender"
    )


def test_nothing_then_all_then_one_missing_then_nothing_is_each_said_once():
    watched = Watched()
    assert [text[:15] for text in watched.run(5.0)] == ["nothing arrives"]
    (text,) = watched.run(8.0, watched.send(GOOD))
    assert text == "all 6 sensors come from 127.0.0.1:52011 at 60 Hz"
    assert watched.reported[-1][0] < 2.0
    assert watched.reported[-1][1].level is Level.NOTE
    without = encode_bundle([vmc_message(serial, [0.0] * 4 if serial == "T2" else UNTURNED) for serial in WORN])
    texts = watched.run(8.0, watched.send(without))
    assert "leftAnkle is missing" in texts[-1]
    assert f"{NO_FIX} (T2)" in texts[-1]
    assert len(texts) <= 2
    assert ["nothing arrives any more" in text for text in watched.run(8.0)] == [True]


def test_another_rate_is_said_and_jitter_is_not():
    watched = Watched()
    send = watched.send(GOOD)
    rng = np.random.default_rng(0)

    def jittered(now: float) -> None:
        if rng.random() < 0.9:
            send(now)

    assert len(watched.run(20.0, jittered)) == 1
    (text,) = watched.run(20.0, send, rate=20.0)
    assert text.endswith("at 20 Hz")


@pytest.mark.parametrize("absent", sorted(WORN))
def test_whichever_device_has_no_fix_at_the_start_the_others_are_worn_where_they_are(absent: str):
    watched = Watched()
    source = watched.source
    assert isinstance(source, VmcSource)
    heard: dict[str, Reading] = {}

    def send(data: bytes) -> Callable[[float], None]:
        class Catch(Sink):
            def packet(self, packet: Packet, arrival: float, stream: str) -> bool:
                heard.update(packet.readings)
                return True

        caught = ArrivalMonitor([source], Catch())
        return lambda now: source.hear(data, now, "x:1", caught.listeners[0])

    watched.run(2.0, send(encode_bundle([vmc_message(s, [0.0] * 4 if s == absent else UNTURNED) for s in WORN])))
    places = {ROLES[serial]: (-WORN[serial][1][0], *WORN[serial][1][1:]) for serial in WORN}
    assert set(heard) == set(SIX.names) - {ROLES[absent]}
    watched.run(2.0, send(GOOD))
    assert {name: reading.position for name, reading in heard.items()} == {
        name: pytest.approx(place) for name, place in places.items()
    }


def test_sensors_of_other_names_are_named():
    watched = Watched("udp://:9870")
    line = json.dumps({"sensors": {"pelvis": {"position": [0, 1, 0]}}}).encode()
    (text,) = watched.run(5.0, watched.send(line))
    assert "has no sensor 'pelvis'" in text
    assert "head, upperChest" in text


def test_a_clock_that_stands_still_is_said():
    watched = Watched("udp://:9870")
    watched.sink.late = True
    (text,) = watched.run(5.0, watched.send(b'{"time": 1, "sensors": {"head": {"position": [0, 1, 0]}}}'))
    assert "late or received twice" in text


def test_who_invents_senders_reasons_and_names_fills_neither_memory_nor_terminal():
    watched = Watched("udp://:9870")
    source = watched.source
    assert isinstance(source, DatagramSource)
    count = 0

    def send(now: float) -> None:
        nonlocal count
        for _ in range(5):
            count += 1
            parts = {f"x{count}\x1b[2J": {f"k{count}": 1}, "head" + "x" * count: {"count": 1}}
            source.hear(json.dumps({"sensors": parts}).encode(), now, f"10.0.0.{count}:1", watched.listener)

    texts = watched.run(60.0, send)
    assert len(texts) <= 10
    assert all(text.isprintable() and len(text) < 2000 for text in texts)
    listener = watched.listener
    sizes = (listener.senders, listener.unknown, listener.reasons)
    assert max(map(len, sizes)) <= 33
    assert all(len(counts.kinds) <= 33 and len(counts.packets.__dict__) < 9 for counts in listener.senders.values())


# Sessions


class Told:
    """A sink that keeps what it is told."""

    name, capacity = "told", 100

    def __init__(self) -> None:
        self.facts: list[SessionFacts] = []
        self.updates: list[Update] = []

    def open(self, facts: SessionFacts, post: Post) -> None:
        self.facts.append(facts)

    def changed(self, facts: SessionFacts) -> None:
        self.facts.append(facts)

    def show(self, update: Update) -> None:
        self.updates.append(update)

    def close(self) -> None: ...


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def vmc_session(data: bytes, until: Callable[[Session, Told], bool]) -> tuple[Told, SessionSummary]:
    """A session that receives one packet over and over at 60 Hz until a condition holds."""
    told = Told()
    session = Session(plan_session(LiveSettings(source=("vmc://:0",)), sinks=[told]))
    done: list[SessionSummary] = []
    thread = threading.Thread(target=lambda: done.append(session.run()))
    thread.start()
    (source,) = session.plan.sources
    assert isinstance(source, VmcSource)
    try:
        wait_for(lambda: source.port > 0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

            def sent_and_done() -> bool:
                sender.sendto(data, ("127.0.0.1", source.port))
                return until(session, told)

            wait_for(sent_and_done)
    finally:
        session.stop()
        thread.join()
    return told, done[0]


def test_five_sound_devices_move_the_figure_beside_one_without_a_fix():
    packet = encode_bundle(
        [vmc_message(serial, [0.0] * 4 if serial == "T2" else UNTURNED) for serial in WORN]
        + [too_few("T9"), encode_message("/VMC/Ext/Tra/Pos", ["", 0.0, 1.0, 0.0, *UNTURNED])]
    )
    told, summary = vmc_session(packet, lambda session, told: len(told.updates) > 20)
    ok = np.mean([update.sample.status == 0 for update in told.updates], axis=0)
    assert dict(zip(SIX.names, ok > 0.5, strict=True)) == {name: name != "leftAnkle" for name in SIX.names}
    assert summary.counters.usable > 20
    assert summary.refused[NO_FIX] >= 20
    assert summary.refused["/VMC/Ext/Tra/Pos: an empty serial number"] >= 20


def test_sinks_are_told_what_arrives_without_a_single_sample():
    def said(session: Session, told: Told) -> bool:
        return any(facts.arrivals is not None and "only bones" in facts.arrivals.text for facts in told.facts)

    told, summary = vmc_session(BONES, said)
    assert told.updates == []
    assert any("send trackers" in notice.text for facts in told.facts for notice in facts.notices)
    assert summary.counters.usable == 0
    assert "only bones come from 127.0.0.1:" in summary.arrivals


def empty_recording(path: Path) -> None:
    count = len(SIX)
    nothing = np.full((90, count, 3), np.nan)
    body = average_body()
    recording = make_recording(
        SIX, default_placements(SIX, body), body, np.arange(90) / SIX.rate, positions=nothing, name="nothing"
    )
    write_recording(recording, path)


@pytest.mark.parametrize("kind", ["vmc", "udp", "replay"])
def test_a_session_without_a_usable_sample_ends_with_a_word_and_exit_code_3(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "empty.mcap"
    if kind == "replay":
        empty_recording(path)
    source = {"vmc": "vmc://:0", "udp": "udp://:0", "replay": f"replay://{path}?speed=4"}[kind]
    assert run(["live", "-s", source, "--seconds", "1"]) == 3
    assert "Not a single usable sample has arrived" in " ".join(capsys.readouterr().out.split())


def test_a_session_with_samples_ends_with_exit_code_0(capsys: pytest.CaptureFixture[str]):
    assert run(["live", "-s", "simulate://sample:walk", "--seconds", "2"]) == 0
    assert "Not a single" not in capsys.readouterr().out


@pytest.mark.parametrize("text", ["started\nready\n1,2\n", "", "x,y,z,w\n" * 5])
@pytest.mark.parametrize("kind", ["lines", "serial"])
def test_lines_without_a_usable_one_are_said(kind: str, text: str, tmp_path: Path):
    path = tmp_path / "line"
    with contextlib.ExitStack() as stack:
        path.write_text(text)
        source: Source = LineFileSource(FLEX, path)
        write = None
        if kind == "serial":
            write, name = stack.enter_context(pseudo_terminal())
            source = SerialSource(FLEX, name)
        plan = replace(plan_of(source), make=lambda _name: Straight(), seconds=2.0)
        session = Session(plan)
        thread, done = in_background(session)
        while thread.is_alive():
            if write is not None:
                write(text.encode())
            thread.join(0.05)
    summary = done[0]
    assert summary.counters.usable == 0
    assert str(path if kind == "lines" else source.name) in summary.arrivals or "baud" in summary.arrivals
    assert bool(summary.refused) == bool(text)


# Who else can send


@pytest.mark.parametrize(
    ("source", "exposed"),
    [("vmc://:39539", False), ("udp://127.0.0.1:9", False), ("udp://localhost:9", False), ("vmc://0.0.0.0:39539", True),
     ("udp://0.0.0.0:9870", True), ("udp://192.168.1.5:9870", True)],
)  # fmt: skip
def test_a_listener_off_the_loopback_says_so_and_how_to_confine_it(source: str, exposed: bool):
    made = make_source(source)
    assert isinstance(made, VmcSource | DatagramSource)
    assert bool(made.exposure) == exposed
    if exposed:
        assert "127.0.0.1" in made.exposure
        assert "from=" in made.exposure


def test_the_line_is_said_at_the_start():
    told = Told()
    session = Session(plan_session(LiveSettings(source=("udp://0.0.0.0:0",), seconds=1.0), sinks=[told]))
    summary = session.run()
    assert any("every machine that reaches this one" in notice.text for notice in summary.notices)
    assert any("every machine" in notice.text for facts in told.facts for notice in facts.notices)


def test_only_the_named_machines_are_heard():
    watched = Watched("vmc://0.0.0.0:0?from=192.168.1.20")
    assert isinstance(watched.source, VmcSource)
    assert watched.source.senders == {"192.168.1.20"}
    with pytest.raises(SensorError, match="from=192"):
        make_source("vmc://:0?from=somewhere")
    told = Told()
    session = Session(plan_session(LiveSettings(source=("vmc://127.0.0.1:0?from=192.0.2.1",)), sinks=[told]))
    thread = threading.Thread(target=session.run)
    thread.start()
    (source,) = session.plan.sources
    assert isinstance(source, VmcSource)
    try:
        wait_for(lambda: source.port > 0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(10):
                sender.sendto(GOOD, ("127.0.0.1", source.port))
        wait_for(lambda: session.counters.malformed == 10)
    finally:
        session.stop()
        thread.join()
    assert session.counters.usable == 0
