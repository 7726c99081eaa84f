"""A UDP port that is listened to: each datagram with the time at which the system received it."""

import asyncio
import select
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from poseloom.errors import SensorError
from poseloom.live.addresses import bracketed

_BUFFER = 1 << 20
_LARGEST = 1 << 16
_AT_ONCE = 64
"""Datagrams read before other work of the loop has its turn: a flood must not starve it."""

_FLOOD = 4
"""Full readings in a row from which there is a flood: this process having slept for a second is none."""
_TOO_OLD = 0.5
"""Seconds that a datagram of a flood may have waited. A flood fills the system's buffer with what takes seconds to
read; what is of now must not wait behind it."""

_WAIT = 0.1
"""Seconds for which the thread of an event loop without readers waits at most, so that it can be ended."""


class Stamps(NamedTuple):
    """How a system reports when it received a datagram, and how many it dropped.

    Attributes:
        option: The socket option that asks for times.
        message: Type of the control message that brings one.
        layout: Its two numbers, as `struct` has them: seconds, and parts of a second ...
        part: ... of so many seconds.
        overflows: Option and message of the number of datagrams dropped so far; None where the system has none.
    """

    option: int
    message: int
    layout: str
    part: float
    overflows: int | None


# Numbers of the systems' headers, for Python names few of them. Elsewhere (Windows) the arrival is the moment of
# reading, and no loss is reported.
SYSTEMS = {
    "linux": Stamps(35, 35, "ll", 1e-9, 40),  # SO_TIMESTAMPNS (timespec), SO_RXQ_OVFL
    "darwin": Stamps(0x0400, 0x02, "li", 1e-6, None),  # SO_TIMESTAMP, SCM_TIMESTAMP (timeval)
}

HearDatagram = Callable[[bytes, float, str], None]
"""Called with the bytes, the monotonic time of arrival in seconds, and the sender."""


class DatagramPort:
    """Listens on one address, on the running event loop, as an asynchronous context manager.

    Runs on every system and loop: where the loop watches no sockets (Proactor on Windows) a thread waits in its place,
    and where the system stamps no datagrams their arrival is the moment at which they are read.

    Args:
        host: The address to bind to; the loopback unless a person asks otherwise.
        port: The port; 0 lets the system choose.
        hear: Called for each datagram.
        lost: Called with how many datagrams the system dropped because its buffer was full, or waited too long in it.
    """

    def __init__(self, host: str, port: int, hear: HearDatagram, lost: Callable[[int], None]) -> None:
        self._address = (host, port)
        self._hear = hear
        self._lost = lost
        self._stamps = system_stamps()
        self._dropped = 0
        self._batches = 0
        self._emptied = time.monotonic()
        self._thread: _WaitingThread | None = None

    async def __aenter__(self) -> "DatagramPort":
        self._socket = open_port(*self._address)
        self._emptied = time.monotonic()
        try:
            asyncio.get_running_loop().add_reader(self._socket, self._read)
        except NotImplementedError:
            self._thread = _WaitingThread(self._socket, self._read)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._thread is None:
            asyncio.get_running_loop().remove_reader(self._socket)
        else:
            await asyncio.to_thread(self._thread.end)
        self._socket.close()

    @property
    def port(self) -> int:
        """The port that is listened to."""
        return int(self._socket.getsockname()[1])

    def _read(self) -> None:
        for _ in range(_AT_ONCE):
            try:
                data, extra, sender = self._receive()
            except (BlockingIOError, InterruptedError):
                self._batches = 0
                self._emptied = time.monotonic()
                return
            except OSError:
                return  # an earlier answer could not be delivered; what comes next is not touched by it
            now = time.monotonic()
            arrival = self._arrival(extra, now)
            # Without a stamp it may have waited since the buffer was empty last.
            oldest = self._emptied if arrival is None else arrival
            if self._batches >= _FLOOD and now - oldest > _TOO_OLD:
                self._lost(1)
            else:
                self._hear(data, now if arrival is None else arrival, f"{bracketed(sender[0])}:{sender[1]}")
        self._batches += 1

    def _receive(self) -> tuple[bytes, list[tuple[int, int, bytes]], tuple[Any, ...]]:
        if self._stamps is None:
            data, sender = self._socket.recvfrom(_LARGEST)
            return data, [], sender
        data, extra, _flags, sender = self._socket.recvmsg(_LARGEST, 128)
        return data, extra, sender

    def _arrival(self, extra: list[tuple[int, int, bytes]], now: float) -> float | None:
        """When the system received a datagram, in monotonic seconds; None if it does not report it."""
        stamps, arrival = self._stamps, None
        for level, kind, data in extra:
            if level != socket.SOL_SOCKET or stamps is None:
                continue
            if kind == stamps.message and len(data) >= struct.calcsize(stamps.layout):
                seconds, parts = struct.unpack_from(stamps.layout, data)
                age = time.time() - seconds - stamps.part * parts
                # The stamp is of the wall clock, which may have been set since.
                arrival = now - age if 0.0 <= age < 1.0 else now
            elif kind == stamps.overflows and len(data) >= 4:
                total = int(struct.unpack_from("I", data)[0])
                if total > self._dropped:
                    self._lost(total - self._dropped)
                self._dropped = total
        return arrival


class _WaitingThread:
    """Waits for a socket in place of a loop that cannot, and lets the loop read it."""

    def __init__(self, waited: socket.socket, read: Callable[[], None]) -> None:
        self._socket, self._read = waited, read
        self._loop = asyncio.get_running_loop()
        self._ended, self._taken = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._wait, name="datagrams", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Ends the thread."""
        self._ended.set()
        self._taken.set()
        self._thread.join()

    def _wait(self) -> None:
        while not self._ended.is_set():
            if select.select([self._socket], [], [], _WAIT)[0]:
                self._taken.clear()
                self._loop.call_soon_threadsafe(self._take)
                while not (self._taken.wait(_WAIT) or self._ended.is_set()):
                    pass

    def _take(self) -> None:
        try:
            if not self._ended.is_set():
                self._read()
        finally:
            self._taken.set()


def system_stamps() -> Stamps | None:
    """How this system stamps datagrams; None where it does not, or Python cannot read the stamps."""
    return SYSTEMS.get(sys.platform) if hasattr(socket.socket, "recvmsg") else None


def open_port(host: str, port: int) -> socket.socket:
    """A bound UDP socket that does not block.

    Raises:
        SensorError: if the address is taken or is none of this machine's.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0][0]
        opened = socket.socket(family, socket.SOCK_DGRAM)
    except OSError as error:
        raise _refused(host, port, error) from None
    try:
        for option, value in _options():
            try:
                opened.setsockopt(socket.SOL_SOCKET, option, value)
            except OSError:
                continue  # a system without it: see above
        opened.bind((host, port))
    except OSError as error:
        opened.close()
        raise _refused(host, port, error) from None
    opened.setblocking(False)
    return opened


def _options() -> list[tuple[int, int]]:
    stamps = system_stamps()
    options = [(socket.SO_RCVBUF, _BUFFER)]
    if stamps is not None:
        options += [(option, 1) for option in (stamps.option, stamps.overflows) if option is not None]
    exclusive = getattr(socket, "SO_EXCLUSIVEADDRUSE", None)  # Windows: else another program may take the port over
    return options if exclusive is None else [*options, (exclusive, 1)]


def _refused(host: str, port: int, error: OSError) -> SensorError:
    return SensorError(
        f"nothing can be heard on {bracketed(host)}:{port}",
        cause=error.strerror or str(error),
        remedy="Choose another port, or end the program that has it; an address must be one of this machine's",
    )
