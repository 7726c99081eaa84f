"""Poses to Blender, Unity, VSeeFace and whatever else receives the VMC protocol."""

import socket

from poseloom.errors import SensorError
from poseloom.live.addresses import bracketed
from poseloom.live.contract import Post, SessionFacts, Update
from poseloom.live.vmc import VMC_PORT, PoseEncoder


class VmcSender:
    """Sends each pose as VMC bones, at once, from the method's own thread.

    Args:
        host: Where the receiver is.
        port: Its port.
    """

    capacity = 0

    def __init__(self, host: str = "127.0.0.1", port: int = VMC_PORT) -> None:
        self.host, self.port = host, port
        self.name = f"vmc to {bracketed(host)}:{port}"
        self.sent = 0
        self.refused = 0

    def open(self, facts: SessionFacts, post: Post) -> None:
        """See `Sink`.

        Raises:
            SensorError: if the host is unknown.
        """
        try:
            family, kind, _, _, self._address = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind)
        except OSError as error:
            raise SensorError(
                f"poses cannot be sent to {bracketed(self.host)}:{self.port}",
                cause=error.strerror or str(error),
                remedy="Check the host's name or address",
            ) from None
        self._socket.setblocking(False)
        self._encoder = PoseEncoder()

    def changed(self, facts: SessionFacts) -> None:
        """See `Sink`: poses carry their own skeleton."""

    def show(self, update: Update) -> None:
        """See `Sink`. A receiver that is not there, or a full buffer, is counted and does not matter."""
        if update.frame is None:
            return
        try:
            for packet in self._encoder.encode(update.frame.pose, update.frame.time):
                self._socket.sendto(packet, self._address)
            self.sent += 1
        except OSError:
            self.refused += 1

    def close(self) -> None:
        """See `Sink`."""
        self._socket.close()
