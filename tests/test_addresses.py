"""Addresses as URLs, and the settings that they stand in: one definition for options, file and programs."""

import inspect
import os
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseloom.cli import live as live_command
from poseloom.cli._app import run
from poseloom.errors import PoseloomError, SensorError
from poseloom.formats.recording import write_recording
from poseloom.live.addresses import Address, parse_address, write_address
from poseloom.live.device_addresses import open_device
from poseloom.live.session import Session
from poseloom.live.session_plan import SessionSummary
from poseloom.live.settings import LiveSettings, facts_of, make_settings, read_settings
from poseloom.live.setup import plan_session
from poseloom.live.sinks.vmc_sender import VmcSender
from poseloom.live.source_replay import ReplaySource
from poseloom.live.source_serial import LineFileSource, SerialSource
from poseloom.live.sources_network import DatagramSource, VmcSource
from poseloom.live.specifications import SOURCES, make_sender, make_source
from poseloom.live.virtual import virtual_recording
from poseloom.sensors import layout


def parsed(text: str) -> Address:
    return parse_address(text, "source", lambda: {"replay": "replay://a.mcap", "vmc": "vmc://:39539"})


# Paths: no URL parser of the standard library beside ours would take `simulate://sample:walk`, so the oracle is the
# round trip: any path and any value that a person has can be written, and comes back the same.
NAMES = st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), min_size=1)


@given(NAMES, st.lists(st.tuples(NAMES, NAMES), max_size=4))
def test_any_path_and_any_value_come_back_as_they_were(name: str, query: list[tuple[str, str]]):
    for path in (f"/{name}", f"x{name}"):
        address = parsed(write_address("replay", path, query))
        assert address.path() == Path(path)
        for key, _ in query:
            assert address.many(key) == tuple(value for other, value in query if other == key)


def refusal(make: Callable[[str], object], text: str) -> SensorError | None:
    try:
        make(text)
    except SensorError as error:
        return error
    return None


@given(st.text() | st.text("vmcudp:/[]?&=%#@.,0123456789", max_size=30).map("vmc://".__add__))
def test_whatever_is_written_is_an_address_or_a_told_error(text: str):
    for make in (parsed, make_sender, open_device):
        error = refusal(make, text)
        assert error is None or error.remedy


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("replay:///path/with,comma.mcap?speed=2&loop=1", "/path/with,comma.mcap"),
        ("replay://beside.mcap", "beside.mcap"),
        ("replay://../up/a b.mcap", "../up/a b.mcap"),
        ("replay:///a%20b%3Fc%23d%25.mcap", "/a b?c#d%.mcap"),
        ("replay:///Größe+1&2=3;a:b@c.mcap", "/Größe+1&2=3;a:b@c.mcap"),
        ("replay:///C:/x.mcap", "C:/x.mcap"),
        ("replay:///C:\\takes\\x.mcap", "C:\\takes\\x.mcap"),
        ("replay://C:/x.mcap", "C:/x.mcap"),
        ("replay:////server/share/x.mcap", "//server/share/x.mcap"),
        ("serial://COM3", "COM3"),
        ("serial:///COM3", "COM3"),
        ("REPLAY:///A.mcap", "/A.mcap"),
        (" replay:///a.mcap ", "/a.mcap"),
    ],
)
def test_paths(text: str, path: str):
    assert str(parsed(text).path()) == str(Path(path))


@pytest.mark.skipif(os.name == "nt", reason="file names of Windows are text")
def test_a_name_that_is_no_utf8_can_be_written():
    assert os.fsencode(parsed("replay:///a%ff.mcap").path()) == b"/a\xff.mcap"


@pytest.mark.parametrize(
    ("location", "expected"),
    [
        (":39539", ("127.0.0.1", 39539)),
        ("0.0.0.0:1", ("0.0.0.0", 1)),
        ("localhost:65535/", ("localhost", 65535)),
        ("[::1]:39539", ("::1", 39539)),
        ("[::]:0", ("::", 0)),
        ("[fe80::1%25eth0]:7", ("fe80::1%eth0", 7)),
        ("motion-pc.local:007", ("motion-pc.local", 7)),
    ],
)
def test_hosts_and_ports(location: str, expected: tuple[str, int]):
    assert parsed(f"vmc://{location}").host_and_port(39539) == expected


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("vmc://", ["has no port", "vmc://:39539"]),
        ("vmc://0.0.0.0", ["has no port", "vmc://0.0.0.0:39539"]),
        ("vmc://[::1]", ["has no port", "vmc://[::1]:39539"]),
        ("vmc://0.0.0.0:", ["has no port", "vmc://0.0.0.0:39539"]),
        ("udp://:65536", ["the port 65536", "from 0 to 65535"]),
        ("udp://:-1", ["'-1' is no number"]),
        ("udp://:９８７０", ["is no number"]),
        ("vmc://::1:39539", ["more than one colon", "vmc://[::1]:39539"]),
        ("vmc://::1", ["more than one colon", "vmc://[::1]:39539"]),
        ("vmc://[::g]:1", ["no IPv6 address"]),
        ("vmc://[::1:1", ["no IPv6 address"]),
        ("vmc://[127.0.0.1]:1", ["no IPv6 address"]),
        ("vmc://user@host:1", ["no host: 'user@host'"]),
        ("vmc:///39539", ["a path, '/39539'", "vmc://:39539"]),
        ("vmc://:39539/x", ["a path, '/x'"]),
        ("vmc://:39539?rat=90", ["unknown key", "'rat'", "Did you mean 'rate'?", "layout, rate, from, head"]),
        ("udp://:9870?leftAnkle=7", ["unknown key", "layout, rate, from"]),
        ("vmc://:39539?rate=fast", ["rate: 'fast' is no positive number", "rate=60"]),
        ("vmc://:39539?rate=", ["rate: '' is no positive number"]),
        ("vmc://:39539?rate=nan", ["no positive number"]),
        ("vmc://:39539?rate=60&rate=90", ["rate more than once"]),
        ("vmc://:39539?layout=seven", ["unknown sensor layout 'seven'"]),
        ("vmc://:39539?from=somewhere", ["'somewhere', which is no IP address", "from=192.168.1.20"]),
        ("vmc://:39539?=60", ["a value without a key"]),
        ("serial://", ["names no serial line", "serial:///dev/ttyACM0"]),
        ("serial:///dev/x?baud=9600.5", ["baud: '9600.5' is no whole number"]),
        ("replay://", ["names no file", "replay://session.mcap"]),
        ("lines://", ["names no file"]),
        ("replay:///a.mcap?loop=maybe", ["loop='maybe'", "loop=1 or loop=0"]),
        ("replay:///take#1.mcap", ["has a #", "%23"]),
        ("replay:///50%.mcap", ["has a %", "%25"]),
        ("simulate://sample:wlk", ["'wlk'", "Did you mean 'walk'?"]),
        ("simulate://sample:walk?seed=-1", ["seed: '-1' is no whole number"]),
        ("simulate://sample:walk?fault=silent:hand", ["not understood", "KIND:SENSOR:START:STOP"]),
        ("vnc://:39539", ["unknown scheme of a source 'vnc'", "Did you mean 'vmc'?", "vmc, udp, serial, lines"]),
        ("vnc:39539", ["unknown scheme of a source", "'vnc'", "Did you mean 'vmc'?"]),
        ("http://127.0.0.1:39539", ["unknown scheme of a source 'http'"]),
        ("127.0.0.1:39539", ["it has no scheme", "vmc://:39539"]),
        ("", ["it has no scheme"]),
        # The former way of writing: each is refused with the URL to write instead.
        ("vmc", ["no URL", "Write vmc://:39539."]),
        ("vmc:39539", ["no URL", "Write vmc://:39539."]),
        ("vmc,rate=90", ["Write vmc://:39539?rate=90."]),
        ("vmc:0.0.0.0", ["Write vmc://0.0.0.0:39539."]),
        ("vmc:0.0.0.0:39540,rate=90,from=10.0.0.2", ["Write vmc://0.0.0.0:39540?rate=90&from=10.0.0.2."]),
        ("udp:9870", ["Write udp://:9870."]),
        ("udp:9870,layout=flex-four+hips-imu", ["Write udp://:9870?layout=flex-four+hips-imu."]),
        ("serial:/dev/ttyACM0,baud=9600", ["Write serial:///dev/ttyACM0?baud=9600."]),
        ("serial:COM3", ["Write serial://COM3."]),
        ("lines:card.txt,layout=flex-four", ["Write lines://card.txt?layout=flex-four."]),
        ("replay:take 1.mcap,speed=2,loop", ["Write replay://take%201.mcap?speed=2&loop=1."]),
        ("replay:/path/with,comma.mcap", ["Write replay:///path/with,comma.mcap."]),
        ("simulate:sample:walk,once,fault=swap:leftHand+rightHand:1:2",
         ["Write simulate://sample:walk?once=1&fault=swap:leftHand+rightHand:1:2."]),
        ("session.mcap", ["Write replay://session.mcap."]),
        ("/dev/ttyACM0", ["Write serial:///dev/ttyACM0."]),
    ],
)  # fmt: skip
def test_what_cannot_be_an_address_is_refused_with_its_remedy(text: str, told: Sequence[str]):
    with pytest.raises(PoseloomError) as caught:
        make_source(text)
    for words in told:
        assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("vmc:127.0.0.1:39540", ["Write vmc://127.0.0.1:39540."]),
        ("vmc", ["Write vmc://:39540."]),
        ("vmc://127.0.0.1", ["has no port", "vmc://127.0.0.1:39540"]),
        ("vmc://:0", ["the port 0", "from 1 to 65535"]),
        ("vmc://:39540?rate=60", ["has the key 'rate'"]),
        ("udp://:9870", ["unknown scheme of a receiver 'udp'", "vmc"]),
    ],
)
def test_receivers_are_refused_likewise(text: str, told: Sequence[str]):
    with pytest.raises(SensorError) as caught:
        make_sender(text)
    for words in told:
        assert words in str(caught.value)


def test_each_scheme_makes_its_source(tmp_path: Path):
    six, path = layout("six-trackers"), tmp_path / "with, comma & 50%?#.mcap"
    write_recording(virtual_recording("sample:kick", six, (), 0, endless=False), path)
    vmc = make_source("vmc://0.0.0.0:39541?rate=90&leftAnkle=LHR-1&from=10.0.0.2&from=::1")
    assert isinstance(vmc, VmcSource)
    assert (vmc.host, vmc.port, vmc.layout.rate) == ("0.0.0.0", 39541, 90.0)
    assert vmc.senders == {"10.0.0.2", "::1"}
    udp = make_source("udp://[::1]:0?layout=flex-four+hips-imu&rate=30")
    assert isinstance(udp, DatagramSource)
    assert (udp.host, udp.layout.name, udp.layout.rate) == ("::1", "flex-four+hips-imu", 30.0)
    assert udp.name == "udp on [::1]:0"
    line = make_source("serial:///dev/ttyACM0?baud=9600")
    assert isinstance(line, SerialSource)
    assert (line.device, line.baud) == (str(Path("/dev/ttyACM0")), 9600)
    lines = make_source("lines://card.txt?speed=2")
    assert isinstance(lines, LineFileSource)
    assert (lines.path, lines.speed) == (Path("card.txt"), 2.0)
    replay = make_source(write_address("replay", str(path), [("speed", "2"), ("loop", "1")]))
    assert isinstance(replay, ReplaySource)
    assert (replay.speed, replay.loop, replay.name) == (2.0, True, f"replay of {path.name}")
    assert not make_source(write_address("replay", str(path), [("loop", "0")])).loop  # pyright: ignore
    walk = make_source("simulate://sample:kick?once&rate=30&fault=silent:leftHand:0.1:0.2&fault=stuck:head:0.1:0.2")
    assert isinstance(walk, ReplaySource)
    assert (walk.loop, walk.layout.rate) == (False, 30.0)
    sender = make_sender("vmc://[::1]:39540")
    assert isinstance(sender, VmcSender)
    assert (sender.host, sender.port, sender.name) == ("::1", 39540, "vmc to [::1]:39540")


def test_the_example_of_each_scheme_is_an_address_of_it():
    for scheme in SOURCES.own:
        assert parsed(SOURCES[scheme].example).scheme == scheme


@pytest.fixture
def ipv6() -> None:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as opened:
            opened.bind(("::1", 0))
    except OSError:
        pytest.skip("this machine has no IPv6")


@pytest.mark.usefixtures("ipv6")
@pytest.mark.parametrize(
    ("source", "received"),
    [
        ("udp://[::1]:0?rate=60", True),
        ("udp://[::1]:0?rate=60&from=0:0:0:0:0:0:0:1", True),
        ("udp://[::1]:0?rate=60&from=fe80::7", False),
    ],
)
def test_an_ipv6_port_receives(source: str, received: bool):
    session = Session(plan_session(LiveSettings(source=(source,))))
    (opened,) = session.plan.sources
    assert isinstance(opened, DatagramSource)
    done: list[SessionSummary] = []
    thread = threading.Thread(target=lambda: done.append(session.run()))
    thread.start()
    try:
        deadline = time.monotonic() + 60.0
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sender:
            while not (session.counters.samples if received else session.counters.malformed):
                assert time.monotonic() < deadline
                if opened.port:
                    data = b'{"time": %f, "sensors": {"head": {"position": [0.1, 1.6, 0], "quat": [1, 0, 0, 0]}}}'
                    sender.sendto(data % time.monotonic(), ("::1", opened.port))
                time.sleep(0.02)
    finally:
        session.stop()
        thread.join()
    (summary,) = done
    assert bool(summary.counters.usable) == received
    assert any("not among fe80::7" in reason for reason in summary.refused) != received
    assert not received or "[::1]:" in summary.arrivals, summary.arrivals


# Settings: one definition


VALUES: dict[type, tuple[str, Any]] = {
    str: ("'x'", "x"),
    bool: ("true", True),
    int: ("7", 7),
    float: ("7.5", 7.5),
    tuple: ("['x', 'y']", ("x", "y")),
}


def test_each_setting_is_an_option_a_key_and_a_field(tmp_path: Path):
    options = inspect.signature(live_command.live).parameters
    assert list(options) == [*(setting.name for setting in fields(LiveSettings)), "config"]
    for setting in fields(LiveSettings):
        assert facts_of(setting).help.endswith(".")
        assert f"{setting.name}: {facts_of(setting).help}" in str(LiveSettings.__doc__)
        (option,) = options[setting.name].annotation.__metadata__
        assert option.help == facts_of(setting).help
        toml, value = VALUES[type(cast("object", setting.default))]
        (tmp_path / "live.toml").write_text(f"{setting.name} = {toml}\n")
        by_file = read_settings(tmp_path / "live.toml", {})
        by_option = make_settings({setting.name: list("xy") if isinstance(value, tuple) else value})
        assert by_file == by_option == make_settings({setting.name: value})
        assert asdict(by_file) == {**asdict(LiveSettings()), setting.name: value}


def test_options_reach_the_session_and_win_over_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    seen: list[LiveSettings] = []

    def remember(settings: LiveSettings) -> Any:
        seen.append(settings)
        raise SensorError("seen")

    monkeypatch.setattr(live_command, "run_live", remember)
    (tmp_path / "live.toml").write_text("source = 'vmc://:1'\nport = 5\nseconds = 3\n")
    command = "live -s vmc://:39539?rate=90&from=::1 -s udp://:9870 -l lib --view --port 0 --bind ::1 -r a.mcap"
    assert run([*command.split(), "--send", "vmc://:39540", "--seconds", "2"]) == 2
    assert run([*command.split(), "--config", str(tmp_path / "live.toml")]) == 2
    assert run(["live", "--config", str(tmp_path / "live.toml"), "--view"]) == 2
    asked = LiveSettings(
        source=("vmc://:39539?rate=90&from=::1", "udp://:9870"),
        library="lib", view=True, port=0, bind="::1", record="a.mcap",
    )  # fmt: skip
    assert seen[0] == make_settings({**asdict(asked), "seconds": 2.0, "send": ("vmc://:39540",)})
    assert seen[1] == make_settings({**asdict(asked), "seconds": 3.0})
    assert seen[2] == LiveSettings(source=("vmc://:1",), port=5, seconds=3.0, view=True)


@pytest.mark.parametrize(
    ("toml", "told"),
    [("port = 65536", "port is 65536"), ("seconds = -1", "seconds is -1"), ("seconds = nan", "seconds is nan")],
)
def test_numbers_out_of_range_are_refused_everywhere(toml: str, told: str, tmp_path: Path):
    (tmp_path / "live.toml").write_text(toml)
    with pytest.raises(SensorError, match=told):
        read_settings(tmp_path / "live.toml", {})
    key, _, value = toml.partition(" = ")
    with pytest.raises(SensorError, match=told):
        make_settings({key: float(value) if key == "seconds" else int(value)})
    assert run(["live", f"--{key}={value}"]) == 2
