"""Sources and sinks as a person writes them: `vmc:39539`, `simulate:sample:walk,fault=silent:leftHand:2:3`."""

import ipaddress
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from dataclasses import replace as replaced
from pathlib import Path

from poseloom.errors import SensorError, unknown_name
from poseloom.formats.recording import read_recording
from poseloom.live.sinks.vmc_sender import VmcSender
from poseloom.live.source import Source
from poseloom.live.source_replay import ReplaySource
from poseloom.live.source_serial import LineFileSource, SerialSource
from poseloom.live.sources_network import DatagramSource, VmcSource
from poseloom.live.virtual import virtual_recording
from poseloom.live.vmc import VMC_PORT
from poseloom.live.wire import WIRE_PORT
from poseloom.plugins import SOURCES_GROUP, Registry
from poseloom.sensors import SensorLayout, layout
from poseloom.synthesis import parse_fault

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Specification:
    """A source or sink as written.

    Attributes:
        kind: What stands before the first colon.
        address: What stands between it and the first comma that is followed by `key=`.
        options: What follows, by key; keys that come twice have several values.
        text: All of it.
    """

    kind: str
    address: str
    options: Mapping[str, tuple[str, ...]]
    text: str

    def one(self, key: str, default: str = "") -> str:
        """The value of an option that is given once at most. Raises SensorError."""
        values = self.options.get(key, ())
        if len(values) > 1:
            raise SensorError(f"{self.text!r} has {key} more than once", remedy="Give it once")
        return values[0] if values else default

    def number(self, key: str, default: float) -> float:
        """The same as a positive number. Raises SensorError."""
        return self.as_number(key, self.one(key, str(default)))

    def as_number(self, what: str, text: str) -> float:
        """A positive number. Raises SensorError."""
        try:
            value = float(text)
        except ValueError:
            value = -1.0
        if not 0 < value < 1e9:
            raise SensorError(f"{self.text!r} has no {what}: {text!r}", remedy="Give a positive number")
        return value


@dataclass(frozen=True)
class SourceEntry:
    """A kind of source that can be named.

    Attributes:
        summary: What it is, in half a line.
        make: Makes it of a specification. Raises PoseloomError for one that it does not understand.
    """

    summary: str
    make: Callable[[Specification], Source]


def parse_specification(text: str) -> Specification:
    """Takes a specification apart: `KIND[:ADDRESS][,KEY=VALUE]...`; a word without `=` is an option that is on."""
    head, *rest = text.split(",")
    kind, _, address = head.partition(":")
    options: dict[str, tuple[str, ...]] = {}
    for word in rest:
        key, equals, value = word.partition("=")
        options[key.strip()] = (*options.get(key.strip(), ()), value.strip() if equals else "yes")
    return Specification(kind.strip(), address.strip(), options, text)


def make_source(text: str) -> Source:
    """A source as a person writes it.

    - `vmc[:[HOST:]PORT][,layout=six-trackers][,rate=60][,from=ADDRESS]...[,SENSOR=SERIAL]...`
    - `udp[:[HOST:]PORT][,layout=NAME][,rate=HZ][,from=ADDRESS]...`
    - `serial:DEVICE[,baud=115200][,layout=flex-four][,rate=50]`, `lines:FILE[,layout=flex-four][,speed=1]`
    - `replay:FILE.mcap[,speed=1][,loop]`
    - `simulate:CLIP[,layout=six-trackers][,rate=60][,fault=KIND:SENSOR:START:STOP]...[,seed=0][,once]`

    A network source listens on the loopback unless HOST says otherwise.

    Args:
        text: The specification.

    Raises:
        PoseloomError: for anything that is not understood, or a file that cannot be read.
    """
    written = parse_specification(text)
    return SOURCES.row(written.kind).make(written)


def make_sender(text: str) -> VmcSender:
    """A sink for poses as a person writes it: `vmc:HOST:PORT`, or `vmc` for this machine.

    Raises:
        SensorError: for anything else.
    """
    written = parse_specification(text)
    if written.kind != "vmc":
        raise unknown_name("kind of receiver", written.kind, ["vmc"], SensorError)
    _only(written, ())
    return VmcSender(*_host_and_port(written, VMC_PORT, LOOPBACK))


def _vmc(written: Specification) -> Source:
    worn = _layout(written, "six-trackers", 60.0)
    _only(written, ("layout", "rate", "from", *worn.names))
    roles = {written.one(name): name for name in worn.names if name in written.options}
    return VmcSource(worn, *_host_and_port(written, VMC_PORT, LOOPBACK), roles=roles, senders=_senders(written))


def _udp(written: Specification) -> Source:
    _only(written, ("layout", "rate", "from"))
    worn = _layout(written, "six-trackers")
    return DatagramSource(worn, *_host_and_port(written, WIRE_PORT, LOOPBACK), senders=_senders(written))


def _serial(written: Specification) -> Source:
    _only(written, ("layout", "rate", "baud"))
    if not written.address:
        raise SensorError("no serial line is named", remedy="Write serial:DEVICE, such as serial:/dev/ttyACM0")
    return SerialSource(_layout(written, "flex-four"), written.address, int(written.number("baud", 115200.0)))


def _lines(written: Specification) -> Source:
    _only(written, ("layout", "rate", "speed"))
    return LineFileSource(_layout(written, "flex-four"), Path(written.address), written.number("speed", 1.0))


def _replay(written: Specification) -> Source:
    _only(written, ("speed", "loop"))
    recording = read_recording(Path(written.address))
    title = f"replay of {Path(written.address).name}"
    return ReplaySource(recording, title, written.number("speed", 1.0), "loop" in written.options)


def _simulate(written: Specification) -> Source:
    _only(written, ("layout", "rate", "fault", "seed", "once", "speed"))
    clip = written.address or "sample:walk"
    faults = [parse_fault(text) for text in written.options.get("fault", ())]
    endless = "once" not in written.options
    worn = _layout(written, "six-trackers", 60.0)
    recording = virtual_recording(clip, worn, faults, int(written.one("seed", "0")), endless)
    return ReplaySource(recording, f"virtual sensors on {clip}", written.number("speed", 1.0), endless)


SOURCES = Registry(
    SOURCES_GROUP,
    "kind of source",
    SourceEntry,
    {
        "vmc": SourceEntry("headset, controllers and trackers by the VMC protocol", _vmc),
        "udp": SourceEntry("poseloom's own datagrams, JSON or binary", _udp),
        "serial": SourceEntry("lines of converter counts from a serial line", _serial),
        "lines": SourceEntry("the same lines from a file", _lines),
        "replay": SourceEntry("a recording played again", _replay),
        "simulate": SourceEntry("virtual sensors on a motion", _simulate),
    },
    SensorError,
)
"""Every kind of source, by the word with which its specification begins; other packages add theirs through
`poseloom.sources`."""


def _layout(written: Specification, default: str, rate: float | None = None) -> SensorLayout:
    """The layout that is named; its rate unless one is given here or is the device's custom."""
    named = layout(written.one("layout", default))
    if "rate" in written.options:
        return replaced(named, rate=written.number("rate", 1.0))
    return named if rate is None else replaced(named, rate=rate)


def _only(written: Specification, keys: tuple[str, ...]) -> None:
    for key in written.options:
        if key not in keys:
            raise unknown_name(f"option of {written.kind}", key, keys, SensorError)


def _senders(written: Specification) -> tuple[str, ...]:
    """The machines that may send."""
    addresses = written.options.get("from", ())
    for address in addresses:
        try:
            ipaddress.ip_address(address)
        except ValueError:
            raise SensorError(
                f"{written.text!r} has no address: {address!r}", remedy="Write from=192.168.1.20, the sender's address"
            ) from None
    return addresses


def _host_and_port(written: Specification, port: int, host: str) -> tuple[str, int]:
    before, colon, after = written.address.rpartition(":")
    text = after if colon else written.address
    named = before if colon else host
    if not text:
        return named, port
    if not colon and not text.isdigit():
        return text, port
    if not text.isdigit() or not 0 <= int(text) < 65536:
        raise SensorError(f"{written.text!r} has no port: {text!r}", remedy="Write KIND:PORT or KIND:HOST:PORT")
    return named, int(text)
