"""Sources that listen to a UDP port: VMC, and poseloom's own datagrams."""

import abc
import asyncio
from collections.abc import Mapping
from typing import ClassVar

from poseloom.live.datagrams import DatagramPort
from poseloom.live.device_roles import guess_roles
from poseloom.live.readings import MalformedPacket, Packet, Reading
from poseloom.live.source import Listener
from poseloom.live.vmc import VMC_PORT, Device, parse_devices
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

    Attributes:
        protocol: What is spoken there, in a word.
    """

    protocol: ClassVar[str]

    def __init__(self, layout: SensorLayout, host: str, port: int) -> None:
        self.layout = layout
        self.host, self.port = host, port

    @property
    def name(self) -> str:
        """See `Source`."""
        return f"{self.protocol} on {self.host}:{self.port}"

    async def run(self, listener: Listener) -> None:
        """See `Source`."""

        def hear(data: bytes, arrival: float, sender: str) -> None:
            self.hear(data, arrival, sender, listener)

        async with DatagramPort(self.host, self.port, hear, listener.lost) as opened:
            self.port = opened.port
            await asyncio.Event().wait()

    @abc.abstractmethod
    def hear(self, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
        """Takes in one datagram."""


class VmcSource(PortSource):
    """Headset, controllers and trackers by the VMC protocol.

    The devices share no clock: a reading's time is its arrival.

    Args:
        layout: The sensors that the devices are.
        host: Address to listen on.
        port: Port to listen on; 0 lets the system choose.
        roles: Sensor names by serial number, where a person said; the others are guessed.
    """

    protocol = "vmc"

    def __init__(
        self,
        layout: SensorLayout,
        host: str = "127.0.0.1",
        port: int = VMC_PORT,
        roles: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(layout, host, port)
        self._given = dict(roles or {})
        self._roles: dict[str, str] = {}
        self._devices: dict[str, Device] = {}
        self._first: float | None = None

    def hear(self, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
        """Takes in one datagram."""
        try:
            if len(data) > LONGEST_DATAGRAM:
                raise MalformedPacket(f"a datagram of {len(data)} bytes")
            devices = parse_devices(data)
        except MalformedPacket as error:
            listener.malformed(str(error))
            return
        if not devices:
            return  # bones, blend shapes and the like are none of ours
        for device in devices:
            if device.serial in self._devices or len(self._devices) < _MOST_DEVICES:
                self._devices[device.serial] = device
        self._assign(arrival, listener)
        readings = {
            self._roles[device.serial]: Reading(device.position, device.quat_wxyz)
            for device in devices
            if device.serial in self._roles
        }
        if readings:
            listener.packet(Packet(readings), arrival, sender)

    def _assign(self, arrival: float, listener: Listener) -> None:
        """Says who is worn where once all have come, or some time has gone by; later ones take what is left."""
        if self._first is None:
            self._first = arrival
        fresh = [serial for serial in self._devices if serial not in self._roles]
        missing = set(self.layout.names) - set(self._roles.values())
        enough = len(self._devices) >= len(self.layout)
        if not fresh or not missing or not (enough or arrival - self._first > _LOOKING):
            return
        said = {serial: name for serial, name in self._given.items() if serial in self._devices}
        taken = set(said.values()) | set(self._roles.values())
        free = [device for serial, device in self._devices.items() if serial not in said and serial not in self._roles]
        guessed = {
            serial: name
            for serial, name in guess_roles(free, self.layout).items()
            if name not in taken and name in missing
        }
        added = {**said, **guessed}
        new = {serial: name for serial, name in added.items() if serial not in self._roles}
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
    """

    protocol = "udp"

    def __init__(self, layout: SensorLayout, host: str = "127.0.0.1", port: int = WIRE_PORT) -> None:
        super().__init__(layout, host, port)

    def hear(self, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
        """Takes in one datagram."""
        try:
            packets = parse_datagram(data, self.layout.names)
        except MalformedPacket as error:
            listener.malformed(str(error))
            return
        for packet in packets:
            listener.packet(packet, arrival, sender)
