"""Simulated devices: they speak the protocols that the sources hear, from any process, at any pace."""

import contextlib
import os
import socket
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Protocol, runtime_checkable

import numpy as np

from poseloom.errors import SensorError
from poseloom.live.lines import encode_counts
from poseloom.live.readings import Packet, readings_of_sample
from poseloom.live.vmc import Device, DeviceKind, encode_devices
from poseloom.live.wire import encode_binary, encode_json
from poseloom.sensors import Recording, Sample, SensorKind, SensorLayout

_KINDS: Mapping[str, DeviceKind] = {
    "head": DeviceKind.HEADSET,
    "leftHand": DeviceKind.CONTROLLER,
    "rightHand": DeviceKind.CONTROLLER,
}


@runtime_checkable
class Speaker(Protocol):
    """Says samples in one protocol."""

    def say(self, sample: Sample, layout: SensorLayout, time: float) -> None:
        """Says one sample, at a device time in seconds."""
        ...


class DatagramSpeaker:
    """Sends each sample as one datagram.

    Args:
        host: Where to.
        port: Where to.
        encode: Makes the bytes of a sample at a device time.
    """

    def __init__(self, host: str, port: int, encode: Callable[[Sample, SensorLayout, float], bytes]) -> None:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind)
        self._address = address
        self._encode = encode
        self.sent = 0

    def __enter__(self) -> "DatagramSpeaker":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()

    def say(self, sample: Sample, layout: SensorLayout, time: float) -> None:
        """See `Speaker`. A silent moment is not sent; a listener that is not there does not matter."""
        data = self._encode(sample, layout, time)
        if data:
            with contextlib.suppress(ConnectionRefusedError):
                self._socket.sendto(data, self._address)
                self.sent += 1


def vmc_datagram(sample: Sample, layout: SensorLayout, time: float) -> bytes:
    """The sample as a VMC bundle. Serial numbers say nothing of where a device is worn, as in life."""
    devices: list[Device] = []
    for index, sensor in enumerate(layout.sensors):
        if np.isfinite(sample.positions[index]).all() and np.isfinite(sample.quats_wxyz[index]).all():
            kind = _KINDS.get(sensor.name, DeviceKind.TRACKER)
            serial = f"SIM-{(index * 7919 + 4242) % 10000:04d}"
            devices.append(
                Device(kind, serial, tuple(sample.positions[index].tolist()), tuple(sample.quats_wxyz[index].tolist()))
            )
    return encode_devices(tuple(devices)) if devices else b""


def json_datagram(sample: Sample, layout: SensorLayout, time: float) -> bytes:
    """The sample as a line of JSON."""
    return encode_json(Packet(readings_of_sample(sample, layout), time))


def binary_datagram(sample: Sample, layout: SensorLayout, time: float) -> bytes:
    """The sample in the binary form."""
    return encode_binary(Packet(readings_of_sample(sample, layout), time), layout.names)


class LineSpeaker:
    """Prints the flex sensors' counts as lines, to a serial line or a file.

    Args:
        write: Takes the bytes.
    """

    def __init__(self, write: Callable[[bytes], object]) -> None:
        self._write = write

    def say(self, sample: Sample, layout: SensorLayout, time: float) -> None:
        """See `Speaker`."""
        counts = [float(sample.counts[index]) for index in layout.of_kind(SensorKind.FLEX)]
        self._write(encode_counts(counts, round(1e3 * time)))


@contextlib.contextmanager
def pseudo_terminal(link: Path | None = None) -> Generator[tuple[Callable[[bytes], object], str]]:
    """A pair of terminals that stands for a serial line: yields how to write to it, and the name of its other end.

    What nobody reads is thrown away rather than waited for, as a microcontroller does.

    Args:
        link: A symbolic link to make to the other end, so that its name is known beforehand.

    Raises:
        SensorError: on a system without pseudo-terminals.
    """
    if not hasattr(os, "openpty"):
        raise SensorError("this system has no pseudo-terminals", remedy="Write serial://:4000: a line by TCP")
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    name = os.ttyname(slave)

    def write(data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(master, data)

    try:
        if link is not None:
            link.unlink(missing_ok=True)
            link.symlink_to(name)
        yield write, name
    finally:
        if link is not None:
            link.unlink(missing_ok=True)
        os.close(slave)
        os.close(master)


@contextlib.contextmanager
def tcp_line(host: str = "127.0.0.1", port: int = 0) -> Generator[tuple[Callable[[bytes], object], str]]:
    """A serial line that is passed on by TCP to whoever connects: yields how to write to it, and its HOST:PORT.

    The twin of `pseudo_terminal` for systems without any. What nobody reads is thrown away.

    Args:
        host: The address to listen at.
        port: The port; 0 lets the system choose.

    Raises:
        SensorError: if the address is taken or is none of this machine's.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        server = socket.create_server((host, port), family=family)
    except OSError as error:
        raise SensorError(
            f"no line can be offered at {host}:{port}", cause=error.strerror or str(error), remedy="Choose another port"
        ) from None
    server.setblocking(False)
    readers: list[socket.socket] = []

    def write(data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            readers.append(server.accept()[0])
            readers[-1].setblocking(False)
        for reader in tuple(readers):
            try:
                reader.send(data)
            except BlockingIOError:
                continue
            except OSError:  # it has gone away
                readers.remove(reader)
                reader.close()

    try:
        yield write, f"{host}:{server.getsockname()[1]}"
    finally:
        for opened in (*readers, server):
            opened.close()


def play(
    recording: Recording,
    speaker: Speaker,
    seconds: float | None = None,
    loop: bool = True,
    speed: float = 1.0,
) -> int:
    """Says a recording at its pace, over and over unless told otherwise; returns how many samples were said.

    Args:
        recording: What to say; its device times go on through the repetitions.
        speaker: How to say it.
        seconds: When to end.
        loop: Whether to begin again at its end.
        speed: How many times faster.
    """
    times = recording.times - recording.times[0]
    cycle = float(times[-1]) + 1.0 / recording.layout.rate
    begin, turn, said = time.monotonic(), 0, 0
    while True:
        for index in range(len(recording)):
            moment = turn * cycle + float(times[index])
            if seconds is not None and moment / speed >= seconds:
                return said
            time.sleep(max(0.0, begin + moment / speed - time.monotonic()))
            speaker.say(recording.sample(index), recording.layout, moment)
            said += 1
        if not loop:
            return said
        turn += 1
