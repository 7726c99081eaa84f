"""What every source is to a session, and what a session is to every source."""

from typing import Protocol, runtime_checkable

from poseloom.live.readings import Packet
from poseloom.sensors import SensorLayout


@runtime_checkable
@runtime_checkable
class Listener(Protocol):
    """Hears what a source has to say. All calls come from the session's event loop."""

    def packet(self, packet: Packet, arrival: float, stream: str) -> None:
        """Readings that were understood.

        Args:
            packet: The readings.
            arrival: Host's monotonic time at which they came, seconds.
            stream: Who sent them, so that each sender's clock is judged by itself.
        """
        ...

    def malformed(self, reason: str) -> None:
        """Bytes that were not understood and dropped."""
        ...

    def lost(self, count: int) -> None:
        """Packets that the system dropped before they were read."""
        ...

    def note(self, text: str, warning: bool = False) -> None:
        """Something that a person should know."""
        ...


@runtime_checkable
@runtime_checkable
class Source(Protocol):
    """Where samples come from.

    Attributes:
        name: What it is, in words, such as "vmc on 127.0.0.1:39539".
        layout: The sensors that it speaks of, and the rate that is expected of it.
    """

    @property
    def name(self) -> str: ...

    @property
    def layout(self) -> SensorLayout: ...

    async def run(self, listener: Listener) -> None:
        """Speaks until it has nothing more to say, or is cancelled. Outages are its own business: it tries again.

        Raises:
            PoseloomError: if it cannot even begin: a port that is taken, a file that is none.
        """
        ...
