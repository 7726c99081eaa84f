"""What every source is to a session, and what a session is to every source."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from poseloom.live.readings import Packet
from poseloom.sensors import SensorLayout


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

    def malformed(self, reason: str, sender: str = "") -> None:
        """Bytes that were not understood and dropped.

        Args:
            reason: Why, in words that are the same for all of one kind.
            sender: Who sent them, as far as it is known.
        """
        ...

    def lost(self, count: int) -> None:
        """Packets that the system dropped before they were read."""
        ...

    def note(self, text: str, warning: bool = False) -> None:
        """Something that a person should know."""
        ...


@dataclass(frozen=True)
class Needs:
    """What a source must receive, and what a person can do where it does not; phrases that follow a colon.

    Attributes:
        messages: What poseloom needs.
        begin: What to do where nothing arrives.
        remedy: What to do where other things arrive.
        absent: What to do where some sensors do not arrive.
        refused: What to do where all is refused; empty: the remedy.
    """

    messages: str = "readings of the layout's sensors"
    begin: str = "check that the device is on and sends"
    remedy: str = "check what the device sends"
    absent: str = "check that they are switched on and sent"
    refused: str = ""


@runtime_checkable
class Source(Protocol):
    """Where samples come from. A source may have an attribute `needs` (`Needs`), for what is reported of it.

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
