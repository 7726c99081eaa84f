"""The tables of sources and receivers, and what their addresses make: `vmc://:39539`, `simulate://sample:walk`."""

import ipaddress
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace as replaced
from pathlib import Path

from poseloom.errors import Named, SensorError
from poseloom.formats.recording import read_recording
from poseloom.live.addresses import Address, bracketed, parse_address
from poseloom.live.contract import Sink
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


@dataclass(frozen=True)
class SourceEntry:
    """A kind of source that can be named.

    Attributes:
        summary: What it is, in half a line.
        make: Makes it of an address, whose keys have been checked. Raises PoseloomError for one that it does not
            understand.
        example: An address of it, for help and errors; empty: its scheme alone.
        keys: Keys that may stand in the address's query; any other is refused.
        sensors_of: Name of the layout, where the key `layout` names no other, whose sensors are keys, too (each for
            the device that it is); empty: sensors are no keys.
    """

    summary: str
    make: Callable[[Address], Source]
    example: str = ""
    keys: tuple[str, ...] = ()
    sensors_of: str = ""


def make_source(text: str) -> Source:
    """A source of its address, a URL whose scheme is a key of `SOURCES`.

    - `vmc://[HOST]:PORT`, keys: layout, rate, from (repeated), SENSOR=SERIAL
    - `udp://[HOST]:PORT`, keys: layout, rate, from (repeated)
    - `serial:///dev/ttyACM0` or `serial://COM3`, keys: layout, rate, baud
    - `lines:///FILE`, keys: layout, rate, speed
    - `replay:///FILE.mcap`, keys: speed, loop
    - `simulate://CLIP`, keys: layout, rate, fault=KIND:SENSOR:START:STOP (repeated), seed, once, speed

    A network source listens on the loopback unless HOST says otherwise. A path after `//` that does not begin with `/`
    is relative to the working directory.

    Args:
        text: The address.

    Raises:
        PoseloomError: for anything that is not understood, or a file that cannot be read.
    """
    address = parse_address(
        text, "source", lambda: {scheme: row.example or f"{scheme}://" for scheme, row in SOURCES.items()}
    )
    row = SOURCES.row(address.scheme)
    keys = row.keys
    if row.sensors_of:
        keys = (*keys, *layout(address.one("layout", row.sensors_of)).names)
    address.only(keys)
    return row.make(address)


def make_sender(text: str) -> Sink:
    """A sink that sends poses to an address: `vmc://[HOST]:PORT`; this machine unless HOST says otherwise.

    Raises:
        SensorError: for anything else.
    """
    address = parse_address(text, "receiver", lambda: _RECEIVERS)
    _ = _RECEIVERS[address.scheme]
    address.only(())
    return VmcSender(*address.host_and_port(VMC_PORT + 1, lowest=1))


_RECEIVERS = Named("scheme of a receiver", {"vmc": f"vmc://:{VMC_PORT + 1}"}, SensorError)
"""An example of each receiver's address, by its scheme."""


def _vmc(address: Address) -> Source:
    worn = layout_of(address, "six-trackers", 60.0)
    roles = {address.one(name): name for name in worn.names if name in address.query}
    return VmcSource(worn, *address.host_and_port(VMC_PORT), roles=roles, senders=_senders(address))


def _udp(address: Address) -> Source:
    return DatagramSource(
        layout_of(address, "six-trackers"), *address.host_and_port(WIRE_PORT), senders=_senders(address)
    )


def _serial(address: Address) -> Source:
    if not address.location:
        raise address.error("names no serial line", "Write serial:///dev/ttyACM0, or serial://COM3 on Windows")
    device = str(address.path())
    if address.is_host_and_port:  # a line that another machine or a simulator passes on by TCP
        host, port = address.host_and_port(4000, lowest=1)
        device = f"socket://{bracketed(host)}:{port}"
    return SerialSource(layout_of(address, "flex-four"), device, address.whole("baud", 115200))


def _lines(address: Address) -> Source:
    return LineFileSource(layout_of(address, "flex-four"), _file(address), address.number("speed", 1.0))


def _replay(address: Address) -> Source:
    path, speed, loop = _file(address), address.number("speed", 1.0), address.flag("loop")
    return ReplaySource(read_recording(path), f"replay of {path.name}", speed, loop)


def _simulate(address: Address) -> Source:
    clip = str(address.path()) if address.location else "sample:walk"
    worn, faults = layout_of(address, "six-trackers", 60.0), [parse_fault(text) for text in address.many("fault")]
    endless, speed = not address.flag("once"), address.number("speed", 1.0)
    recording = virtual_recording(clip, worn, faults, address.whole("seed", 0), endless)
    return ReplaySource(recording, f"virtual sensors on {clip}", speed, endless)


SOURCES = Registry(
    SOURCES_GROUP,
    "scheme of a source",
    SourceEntry,
    {
        "vmc": SourceEntry(
            "headset, controllers and trackers by the VMC protocol",
            _vmc,
            f"vmc://:{VMC_PORT}",
            ("layout", "rate", "from"),
            sensors_of="six-trackers",
        ),
        "udp": SourceEntry(
            "poseloom's own datagrams, JSON or binary", _udp, f"udp://:{WIRE_PORT}", ("layout", "rate", "from")
        ),
        "serial": SourceEntry(
            "lines of converter counts from a serial line", _serial, "serial:///dev/ttyACM0", ("layout", "rate", "baud")
        ),
        "lines": SourceEntry("the same lines from a file", _lines, "lines://counts.txt", ("layout", "rate", "speed")),
        "replay": SourceEntry("a recording played again", _replay, "replay://session.mcap", ("speed", "loop")),
        "simulate": SourceEntry(
            "virtual sensors on a motion",
            _simulate,
            "simulate://sample:walk",
            ("layout", "rate", "fault", "seed", "once", "speed"),
        ),
    },
    SensorError,
)
"""Every kind of source, by the scheme of its addresses; other packages add theirs through `poseloom.sources`."""


def layout_of(address: Address, default: str, rate: float | None = None) -> SensorLayout:
    """The layout that an address names, at the rate that it names.

    Args:
        address: The address; its keys `layout` and `rate` are read.
        default: Name of the layout where it names none.
        rate: Samples a second where it names none; None: as the layout has it.

    Raises:
        SensorError: for an unknown layout, or a rate that is none.
    """
    named = layout(address.one("layout", default))
    if "rate" in address.query:
        return replaced(named, rate=address.number("rate", 1.0))
    return named if rate is None else replaced(named, rate=rate)


def _file(address: Address) -> Path:
    if not address.location:
        raise address.error("names no file", f"Write {SOURCES[address.scheme].example}")
    return address.path()


def _senders(address: Address) -> tuple[str, ...]:
    """The machines that may send."""
    for sender in address.many("from"):
        try:
            ipaddress.ip_address(sender)
        except ValueError:
            raise address.error(
                f"has from={sender!r}, which is no IP address", "Write from=192.168.1.20, the sender's address"
            ) from None
    return address.many("from")
