"""The source that listens to a serial line, or reads the same lines from a file of a memory card."""

import asyncio
import time
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import serial  # pyright: ignore[reportMissingTypeStubs]

from poseloom.errors import SensorError
from poseloom.live.lines import LineBuffer, parse_counts
from poseloom.live.readings import MalformedPacket, Packet
from poseloom.live.source import Listener, Needs
from poseloom.sensors import SensorKind, SensorLayout, make_layout

_WAIT = 0.05
"""Seconds for which a read waits at most, so that it can be ended."""
_AGAIN = 0.5
"""Seconds between attempts to open a line that has gone away."""
_AT_ONCE = 4096


def flex_part(layout: SensorLayout) -> SensorLayout:
    """The flex sensors of a layout alone.

    Raises:
        SensorError: if it has none.
    """
    sensors = [sensor for sensor in layout.sensors if sensor.kind is SensorKind.FLEX]
    if not sensors:
        raise SensorError(
            f"the layout {layout.name!r} has no flex sensors", remedy="Choose a layout such as flex-four for this line"
        )
    if len(sensors) == len(layout):
        return layout
    return make_layout(f"{layout.name}, flex sensors", sensors, layout.rate)


class SerialSource:
    """Lines of converter counts from a serial line. A line that goes away is opened again when it is back.

    Args:
        layout: The flex sensors, in the order of the numbers.
        device: The device, such as `/dev/ttyACM0` or `COM3`; or `socket://HOST:PORT`, a line that another program
            passes on by TCP (as ser2net does).
        baud: Bits a second.
    """

    def __init__(self, layout: SensorLayout, device: str, baud: int = 115200) -> None:
        self.layout = flex_part(layout)
        self.device, self.baud = device, baud

    @property
    def name(self) -> str:
        """See `Source`."""
        return f"serial line {self.device} at {self.baud} baud"

    @property
    def needs(self) -> Needs:
        """What must arrive, and what to do where it does not."""
        return Needs(
            messages=f"lines of {len(self.layout)} counts ({', '.join(self.layout.names)})",
            begin=f"check that the device prints, and that it does so at {self.baud} baud (baud=NUMBER sets another)",
            remedy=f"check the baud rate ({self.baud}) and what the device prints (docs/live-serial.md)",
            absent="check their wires: the device prints no count for them",
        )

    async def run(self, listener: Listener) -> None:
        """See `Source`."""
        loop = asyncio.get_running_loop()
        ended, taken = Event(), Event()
        port = self._open()
        if port is None:
            raise SensorError(
                f"the serial line {self.device} cannot be opened",
                remedy="Check that the device is plugged in, its name, and that you may read it",
            )

        def deliver(data: bytes, arrival: float, buffer: LineBuffer) -> None:
            try:
                hear_lines(buffer, data, arrival, self.layout, self.device, listener)
            finally:
                taken.set()

        def read(port: Any) -> None:
            buffer = LineBuffer(midway=True)
            while not ended.is_set():
                try:
                    data = bytes(port.read(1))
                    while data and len(data) < _AT_ONCE and (waiting := int(port.in_waiting)):
                        data += bytes(port.read(min(waiting, _AT_ONCE - len(data))))
                except (OSError, TypeError):  # pyserial: TypeError where another thread closed the line
                    loop.call_soon_threadsafe(listener.note, f"{self.name} has gone away; waiting for it", True)
                    reopened = self._wait_for_line(ended)
                    if reopened is None:
                        return
                    port, buffer = reopened, LineBuffer(midway=True)
                    loop.call_soon_threadsafe(listener.note, f"{self.name} is back")
                    continue
                if data:
                    # One at a time: a line that floods must not fill the loop's queue faster than it is emptied.
                    taken.clear()
                    loop.call_soon_threadsafe(deliver, data, time.monotonic(), buffer)
                    while not (taken.wait(_WAIT) or ended.is_set()):
                        pass
            port.close()

        reading = asyncio.create_task(asyncio.to_thread(read, port))
        try:
            await asyncio.shield(reading)
        finally:
            ended.set()
            await reading

    def _wait_for_line(self, ended: Event) -> Any:
        while not ended.wait(_AGAIN):
            port = self._open()
            if port is not None:
                return port
        return None

    def _open(self) -> Any:
        try:
            return serial.serial_for_url(self.device, self.baud, timeout=_WAIT)
        except (OSError, ValueError):
            return None


class LineFileSource:
    """The same lines from a file, at the pace of their times or of the layout's rate.

    Args:
        layout: The flex sensors, in the order of the numbers.
        path: The file.
        speed: How many times faster than it was written.
    """

    def __init__(self, layout: SensorLayout, path: Path, speed: float = 1.0) -> None:
        self.layout = flex_part(layout)
        self.path, self.speed = path, speed

    @property
    def name(self) -> str:
        """See `Source`."""
        return f"lines of {self.path}"

    @property
    def needs(self) -> Needs:
        """What must arrive, and what to do where it does not."""
        return Needs(
            messages=f"lines of {len(self.layout)} counts ({', '.join(self.layout.names)})",
            begin="check that the file has lines",
            remedy="check the file against docs/live-serial.md",
            absent="the file has no count for them",
        )

    async def run(self, listener: Listener) -> None:
        """See `Source`. Ends with the file."""
        stream = str(self.path)
        packets = [
            packet for line in self._lines() if (packet := _parsed(line, self.layout, stream, listener)) is not None
        ]
        begin = time.monotonic()
        for number, packet in enumerate(packets):
            first = packets[0].time
            at = number / self.layout.rate if packet.time is None or first is None else packet.time - first
            await asyncio.sleep(max(0.0, begin + at / self.speed - time.monotonic()))
            # Lines without times go by the host's clock, at the file's own pace.
            heard = packet if self.speed == 1.0 else replace(packet, time=at, paced=True)
            listener.packet(heard, time.monotonic(), stream)

    def _lines(self) -> list[bytes]:
        try:
            return self.path.read_bytes().split(b"\n")
        except OSError as error:
            raise SensorError(
                "the lines cannot be read", cause=error.strerror or "", remedy="Check the path", file=self.path
            ) from None


def hear_lines(
    buffer: LineBuffer, data: bytes, arrival: float, layout: SensorLayout, stream: str, listener: Listener
) -> None:
    """Takes in bytes of a line."""
    before = buffer.overlong
    for line in buffer.feed(data):
        packet = _parsed(line, layout, stream, listener)
        if packet is not None:
            listener.packet(packet, arrival, stream)
    for _ in range(buffer.overlong - before):
        listener.malformed("a line without end", stream)


def _parsed(line: bytes, layout: SensorLayout, stream: str, listener: Listener) -> Packet | None:
    try:
        return parse_counts(line, layout.names)
    except MalformedPacket as error:
        listener.malformed(str(error), stream)
        return None
