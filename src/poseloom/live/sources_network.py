"""Sources that listen to a UDP port: VMC, and poseloom's own datagrams."""

import abc
import asyncio
import ipaddress
from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import ClassVar

from poseloom.live.addresses import bracketed
from poseloom.live.datagrams import DatagramPort
from poseloom.live.device_roles import guess_roles
from poseloom.live.readings import MalformedPacket, Packet, Reading
from poseloom.live.source import Listener, Needs
from poseloom.live.vmc import VMC_PORT, Device, DeviceKind, read_devices
from poseloom.live.wire import LONGEST_DATAGRAM, WIRE_PORT, parse_datagram
from poseloom.sensors import SensorLayout

_LOOKING = 0.5
"""Seconds for which devices are gathered before it is guessed where they are worn, if not all have come before."""
_MOST_DEVICES = 32


class PortSource(abc.ABC):
    """Something that sends datagrams to a port.

    Args:
        layout: The sensors.
        host: Address to listen on.
        port: Port to listen on; 0 lets the system choose.
        senders: Addresses of machines that may send; empty: any machine that reaches the port.

    Attributes:
        protocol: What is spoken there, in a word.
    """

    protocol: ClassVar[str]

    def __init__(self, layout: SensorLayout, host: str, port: int, senders: Collection[str] = ()) -> None:
        self.layout = layout
        self.host, self.port = host, port
        self.senders = frozenset(senders)

    @property
    def name(self) -> str:
        """See `Source`."""
        return f"{self.protocol} on {bracketed(self.host)}:{self.port}"

    async def run(self, listener: Listener) -> None:
        """See `Source`."""
        machines = {_machine(address) for address in self.senders}

        def hear(data: bytes, arrival: float, sender: str) -> None:
            if machines and _machine(sender.rpartition(":")[0].strip("[]")) not in machines:
                listener.malformed(f"from a machine that is not among {', '.join(sorted(self.senders))}", sender)
            else:
                self.hear(data, arrival, sender, listener)

        async with DatagramPort(self.host, self.port, hear, listener.lost) as opened:
            self.port = opened.port
            exposure = self.exposure
            if exposure:
                listener.note(exposure, warning=True)
            await asyncio.Event().wait()

    @property
    def exposure(self) -> str:
        """Who else can send to this source; empty where only this machine can."""
        if is_loopback(self.host):
            return ""
        if self.senders:
            return (
                f"{self.name} receives from other machines, but only from {', '.join(sorted(self.senders))} "
                "(addresses can be forged: use it in a network that you trust)"
            )
        return (
            f"{self.name} receives from every machine that reaches this one, and anybody there can move the figure: "
            f"{self.protocol}://127.0.0.1:{self.port} confines it to this machine, "
            f"{self.protocol}://{bracketed(self.host)}:{self.port}?from=ADDRESS to one sender"
        )

    @abc.abstractmethod
    def hear(self, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
        """Takes in one datagram."""


@lru_cache(maxsize=256)
def _machine(address: str) -> str:
    """An address in its one form: without the interface, and IPv4 as such where an IPv6 port receives it."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    return str(getattr(parsed, "ipv4_mapped", None) or parsed)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address. A name other than localhost counts as reachable from elsewhere."""
    try:
        return host.lower() == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class VmcSource(PortSource):
    """Headset, controllers and trackers by the VMC protocol.

    The devices share no clock: a reading's time is its arrival.

    Args:
        layout: The sensors that the devices are.
        host: Address to listen on.
        port: Port to listen on; 0 lets the system choose.
        roles: Sensor names by serial number, where a person said; the others are guessed.
        senders: Addresses of machines that may send; empty: any.
    """

    protocol = "vmc"

    def __init__(
        self,
        layout: SensorLayout,
        host: str = "127.0.0.1",
        port: int = VMC_PORT,
        roles: Mapping[str, str] | None = None,
        senders: Collection[str] = (),
    ) -> None:
        super().__init__(layout, host, port, senders)
        self._given = dict(roles or {})
        self._roles: dict[str, str] = {}
        self._devices: dict[str, Device] = {}
        self._first: float | None = None
        self._repeated: set[str] = set()

    @property
    def needs(self) -> Needs:
        """What must arrive, and what to do where it does not."""
        return Needs(
            messages="/VMC/Ext/Tra/Pos, Con/Pos, Hmd/Pos",
            begin=f"start the sender and let it send VMC to port {self.port} of this machine"
            + (", or listen to other machines with vmc://0.0.0.0:PORT" if is_loopback(self.host) else ""),
            remedy="switch on 'send trackers' in the sender",
            absent=self._absent,
            refused="mend what is named here in the sender",
        )

    @property
    def _absent(self) -> str:
        unmet = [f"{name}={serial}" for serial, name in self._given.items() if serial not in self._devices]
        idle = [serial for serial in self._devices if serial not in self._roles]
        if unmet:
            return f"no device has the serial number of {', '.join(unmet)}; those that came: {', '.join(self._devices)}"
        if idle:
            return f"{', '.join(idle)} could not be told to be any of them; name it, as in vmc://:{self.port}?SENSOR={idle[0]}"
        return "switch these devices on in the sender"

    def hear(self, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
        """Takes in one datagram."""
        if len(data) > LONGEST_DATAGRAM:
            listener.malformed(f"a datagram of more than {LONGEST_DATAGRAM} bytes", sender)
            return
        packet = read_devices(data)
        if not packet.messages:
            listener.malformed(packet.refused[0].reason if packet.refused else "an empty bundle", sender)
            return
        for device in packet.devices:
            if device.serial in self._devices or len(self._devices) < _MOST_DEVICES:
                self._devices[device.serial] = device
        self._tell_repeated(packet.repeated, listener)
        self._reserve(packet.absent, listener)
        if packet.devices:
            self._assign(arrival, listener)
        readings = {
            self._roles[device.serial]: Reading(device.position, device.quat_wxyz)
            for device in packet.devices
            if device.serial in self._roles
        }
        listener.packet(Packet(readings, refused=packet.refused, messages=packet.messages), arrival, sender)

    def _tell_repeated(self, serials: Collection[str], listener: Listener) -> None:
        for serial in serials:
            if serial not in self._repeated and len(self._repeated) < _MOST_DEVICES:
                self._repeated.add(serial)
                listener.note(
                    f"several devices are called {serial!r}: they are told apart by their order in a packet; "
                    "give each a name of its own in the sender",
                    True,
                )

    def _reserve(self, absent: Collection[tuple[DeviceKind, str]], listener: Listener) -> None:
        """A headset is the head even before it has a position: no tracker must be taken for it meanwhile."""
        head = next((sensor.name for sensor in self.layout.sensors if sensor.bone == "head"), None)
        taken = {*self._roles.values(), *self._given.values()}
        for kind, serial in absent:
            if kind is DeviceKind.HEADSET and head is not None and head not in taken and serial not in self._given:
                self._roles[serial] = head
                taken.add(head)
                listener.note(f"{serial} is {head} (guessed)")

    def _assign(self, arrival: float, listener: Listener) -> None:
        """Says who is worn where once all have come, or some time has gone by; later ones take what is left."""
        if self._first is None:
            self._first = arrival
        fresh = [serial for serial in self._devices if serial not in self._roles]
        missing = set(self.layout.names) - set(self._roles.values())
        enough = len(self._devices) >= len(self.layout)
        if not fresh or not missing or not (enough or arrival - self._first > _LOOKING):
            return
        said = {serial: name for serial, name in self._given.items() if serial in fresh and name in missing}
        known = {**self._roles, **said}
        # A sensor that a person gave to a device is not for another, whether that device has come or not.
        kept = {**{serial: name for serial, name in self._given.items() if serial not in known}, **known}
        new = {**said, **guess_roles(list(self._devices.values()), self.layout, kept)}
        self._roles.update(new)
        if new:
            told = ", ".join(
                f"{serial} is {name}{'' if serial in self._given else ' (guessed)'}" for serial, name in new.items()
            )
            listener.note(told)


class DatagramSource(PortSource):
    """poseloom's own datagrams, JSON or binary.

    Args:
        layout: The sensors; their order is that of the binary form's indices.
        host: Address to listen on.
        port: Port to listen on; 0 lets the system choose.
        senders: Addresses of machines that may send; empty: any.
    """

    protocol = "udp"

    def __init__(
        self,
        layout: SensorLayout,
        host: str = "127.0.0.1",
        port: int = WIRE_PORT,
        senders: Collection[str] = (),
    ) -> None:
        super().__init__(layout, host, port, senders)

    @property
    def needs(self) -> Needs:
        """What must arrive, and what to do where it does not."""
        return Needs(
            messages=f"poseloom's datagrams with the sensors {', '.join(self.layout.names)}",
            begin=f"start the device and let it send to port {self.port} of this machine"
            + (", or listen to other machines with udp://0.0.0.0:PORT" if is_loopback(self.host) else ""),
            remedy="see docs/live-udp.md for what a datagram holds",
            absent="check that the device sends them, under these names",
        )

    def hear(self, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
        """Takes in one datagram."""
        try:
            packets = parse_datagram(data, self.layout.names)
        except MalformedPacket as error:
            listener.malformed(str(error), sender)
            return
        for packet in packets:
            listener.packet(packet, arrival, sender)
