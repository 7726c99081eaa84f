"""The source `csv://:PORT`: UDP datagrams with one tracker each, `NAME,x,y,z,qw,qx,qy,qz` (metres, Y up)."""

from poseloom.live.addresses import Address
from poseloom.live.readings import LIMITS, MalformedPacket, Packet, Reading, checked_quat, checked_vector
from poseloom.live.source import Listener
from poseloom.live.sources_network import PortSource
from poseloom.live.specifications import SourceEntry
from poseloom.sensors import layout


class CsvSource(PortSource):
    """Trackers by lines of numbers. They have no clock: a reading's time is its arrival."""

    protocol = "csv"

    def hear(self, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
        """Takes in one datagram."""
        try:
            name, *words = data[:1000].decode().strip().split(",")
            values = [float(word) for word in words]
            reading = Reading(checked_vector(values[:3], 3, LIMITS.position), checked_quat(values[3:]))
        except MalformedPacket as error:
            listener.malformed(str(error), sender)
        except ValueError:
            listener.malformed("not NAME and seven numbers with commas between", sender)
        else:
            listener.packet(Packet({name: reading}), arrival, sender)


def make(address: Address) -> CsvSource:
    """The source of an address."""
    return CsvSource(layout(address.one("layout", "six-trackers")), *address.host_and_port(9000))


SOURCE = SourceEntry("trackers by lines of numbers; an example", make, "csv://:9000", ("layout",))
