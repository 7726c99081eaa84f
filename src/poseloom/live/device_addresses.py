"""Simulated devices by their addresses: `vmc://127.0.0.1:39539`, `udp://:9870?binary=1`, `serial:///tmp/suit`."""

import contextlib
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from dataclasses import dataclass

from poseloom.errors import Named, SensorError
from poseloom.live.addresses import Address, bracketed, parse_address
from poseloom.live.devices import (
    DatagramSpeaker,
    LineSpeaker,
    Speaker,
    binary_datagram,
    json_datagram,
    pseudo_terminal,
    tcp_line,
    vmc_datagram,
)
from poseloom.live.vmc import VMC_PORT
from poseloom.live.wire import WIRE_PORT


@dataclass(frozen=True)
class SimulatedDevice:
    """A device that can be stood in for.

    Attributes:
        layout: Name of the layout of its sensors unless another is asked for.
        rate: Samples a second unless asked otherwise; 0: as the layout has it.
        speaker: Opens its line: yields what says samples there, and what it is, in words.
    """

    layout: str
    rate: float
    speaker: Callable[[], AbstractContextManager[tuple[Speaker, str]]]


def open_device(text: str) -> SimulatedDevice:
    """The device of an address that it speaks to.

    - `vmc://[HOST]:PORT`
    - `udp://[HOST]:PORT`, key: binary
    - `serial:///PATH`: the name of a pseudo-terminal; `serial://` leaves it unnamed. `serial://[HOST]:PORT`: a line
      passed on by TCP, which every system has

    Raises:
        SensorError: for anything else.
    """
    examples = {"vmc": f"vmc://:{VMC_PORT}", "udp": f"udp://:{WIRE_PORT}", "serial": "serial:///tmp/suit"}
    address = parse_address(text, "simulated device", lambda: examples)
    return _DEVICES[address.scheme](address)


def _vmc(address: Address) -> SimulatedDevice:
    address.only(())
    return _datagrams(address, VMC_PORT, vmc_datagram)


def _udp(address: Address) -> SimulatedDevice:
    address.only(("binary",))
    return _datagrams(address, WIRE_PORT, binary_datagram if address.flag("binary") else json_datagram)


def _datagrams(address: Address, port: int, encode: Callable[..., bytes]) -> SimulatedDevice:
    host, port = address.host_and_port(port, lowest=1)

    @contextlib.contextmanager
    def speaker() -> Generator[tuple[Speaker, str]]:
        with DatagramSpeaker(host, port, encode) as opened:
            yield opened, f"{address.scheme} to {bracketed(host)}:{port}"

    return SimulatedDevice("six-trackers", 60.0, speaker)


def _serial(address: Address) -> SimulatedDevice:
    address.only(())
    if address.is_host_and_port:
        host, port = address.host_and_port(4000)

        @contextlib.contextmanager
        def passed_on() -> Generator[tuple[Speaker, str]]:
            with tcp_line(host, port) as (write, name):
                yield LineSpeaker(write), f"serial line serial://{name}"

        return SimulatedDevice("flex-four", 0.0, passed_on)
    link = address.path() if address.location else None

    @contextlib.contextmanager
    def speaker() -> Generator[tuple[Speaker, str]]:
        with pseudo_terminal(link) as (write, name):
            yield LineSpeaker(write), f"serial line {name}{f' as {link}' if link else ''}"

    return SimulatedDevice("flex-four", 0.0, speaker)


_DEVICES = Named("scheme of a simulated device", {"vmc": _vmc, "udp": _udp, "serial": _serial}, SensorError)
