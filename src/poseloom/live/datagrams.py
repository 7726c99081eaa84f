"""A UDP port that is listened to: each datagram with the time at which the system received it."""

import asyncio
import socket
import struct
import time
from collections.abc import Callable

from poseloom.errors import SensorError

_BUFFER = 1 << 20
_LARGEST = 1 << 16
_AT_ONCE = 64
"""Datagrams read before other work of the loop has its turn: a flood must not starve it."""

_FLOOD = 4
"""Full readings in a row from which there is a flood: this process having slept for a second is none."""
_TOO_OLD = 0.5
"""Seconds that a datagram of a flood may have waited. A flood fills the system's buffer with what takes seconds to
read; what is of now must not wait behind it."""

# Numbers of Linux; where the system does not know them, arrival is the moment of reading and no loss is told.
_TIMESTAMPS = getattr(socket, "SO_TIMESTAMPNS", 35)
_OVERFLOWS = getattr(socket, "SO_RXQ_OVFL", 40)

HearDatagram = Callable[[bytes, float, str], None]
"""Called with the bytes, the monotonic time of arrival in seconds, and the sender."""


class DatagramPort:
    """Listens on one address, on the running event loop, as an asynchronous context manager.

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
        self._dropped = 0
        self._batches = 0

    async def __aenter__(self) -> "DatagramPort":
        self._socket = open_port(*self._address)
        asyncio.get_running_loop().add_reader(self._socket, self._read)
        return self

    async def __aexit__(self, *_: object) -> None:
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    @property
    def port(self) -> int:
        """The port that is listened to."""
        return int(self._socket.getsockname()[1])

    def _read(self) -> None:
        for _ in range(_AT_ONCE):
            try:
                data, extra, _flags, sender = self._socket.recvmsg(_LARGEST, 128)
            except (BlockingIOError, InterruptedError):
                self._batches = 0
                return
            except OSError:
                return  # an earlier answer could not be delivered; what comes next is not touched by it
            arrival = self._arrival(extra)
            if self._batches >= _FLOOD and time.monotonic() - arrival > _TOO_OLD:
                self._lost(1)
            else:
                self._hear(data, arrival, f"{sender[0]}:{sender[1]}")
        self._batches += 1

    def _arrival(self, extra: list[tuple[int, int, bytes]]) -> float:
        now = time.monotonic()
        arrival = now
        for level, kind, data in extra:
            if level != socket.SOL_SOCKET:
                continue
            if kind == _TIMESTAMPS and len(data) >= 16:
                seconds, nanoseconds = struct.unpack_from("qq", data)
                age = time.time() - seconds - 1e-9 * nanoseconds
                # The stamp is of the wall clock, which may have been set since.
                arrival = now - age if 0.0 <= age < 1.0 else now
            elif kind == _OVERFLOWS and len(data) >= 4:
                total = int(struct.unpack_from("I", data)[0])
                if total > self._dropped:
                    self._lost(total - self._dropped)
                self._dropped = total
        return arrival


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
        for option in ((socket.SO_RCVBUF, _BUFFER), (_TIMESTAMPS, 1), (_OVERFLOWS, 1)):
            try:
                opened.setsockopt(socket.SOL_SOCKET, *option)
            except OSError:
                continue  # a system without it: see above
        opened.bind((host, port))
    except OSError as error:
        opened.close()
        raise _refused(host, port, error) from None
    opened.setblocking(False)
    return opened


def _refused(host: str, port: int, error: OSError) -> SensorError:
    return SensorError(
        f"nothing can be heard on {host}:{port}",
        cause=error.strerror or str(error),
        remedy="Choose another port, or end the program that has it; an address must be one of this machine's",
    )
