"""The contract of a live source."""

import inspect
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from poseloom.live.readings import LIMITS, Packet, sample_of_readings
from poseloom.live.source import Listener, Source

Hear = Callable[[Any, bytes, float, str, Listener], object]


class Heard:
    """A listener that keeps what it is told. Its attributes are lists of the arguments of `Listener`'s methods."""

    def __init__(self) -> None:
        self.packets: list[Packet] = []
        self.reasons: list[str] = []
        self.notes: list[str] = []

    def packet(self, packet: Packet, arrival: float, stream: str) -> None:
        """See `Listener`."""
        self.packets.append(packet)

    def malformed(self, reason: str, sender: str = "") -> None:
        """See `Listener`."""
        self.reasons.append(reason)

    def lost(self, count: int) -> None:
        """See `Listener`."""

    def note(self, text: str, warning: bool = False) -> None:
        """See `Listener`."""
        self.notes.append(text)


def check_source(make: Callable[[], Source], sound: Sequence[bytes] = (), hear: Hear | None = None) -> None:
    """Checks that a source keeps the contract of `Source`, without any socket.

    - It has a name and a layout, and `run` is a coroutine function.
    - What the device sends becomes packets with readings of the layout's sensors, finite and within `LIMITS`.
    - Bytes that are cut, changed or noise raise nothing, and no number beyond these limits comes of them; noise is told
      as malformed; what is sound is heard after them.

    Args:
        make: Makes the source, as new.
        sound: What the device sends, piece by piece: datagrams, or stretches of a line's bytes. All together they say
            something of some sensor. None for a source that receives no bytes.
        hear: Gives bytes to a source: called with the source, bytes, arrival in seconds, sender and listener. If left
            out, `source.hear(data, arrival, sender, listener)` is called.

    Raises:
        AssertionError: naming what is broken, and with which bytes.
    """
    source = make()
    name: Any = source.name
    _ensure(isinstance(name, str) and bool(name), f"the source's name is {name!r}")
    _ensure(len(source.layout) > 0, "the source's layout has no sensors")
    _ensure(inspect.iscoroutinefunction(source.run), "run is no coroutine function (`async def run`)")
    if not sound:
        return
    listen = hear or _own_hear
    _check_sound(source, listen, sound)
    hostile = make()
    for number, data in enumerate(_hostile(sound)):
        heard = Heard()
        try:
            listen(hostile, data, float(number), "10.0.0.1:9", heard)
        except Exception as error:
            raise AssertionError(f"hostile bytes raise {type(error).__name__} ({error}): {data[:80]!r}") from error
        _check_packets(hostile, heard, data)
    noise = Heard()
    listen(make(), b"\xff\xfe\x00 \x80" * 16 + b"\n", 0.0, "10.0.0.1:9", noise)
    _ensure(bool(noise.reasons), "noise is not told as malformed (`listener.malformed`)")
    _ensure(not any(packet.readings for packet in noise.packets), "noise gives readings")
    _check_sound(hostile, listen, [b"\n", *sound])


def _check_sound(source: Source, listen: Hear, sound: Sequence[bytes]) -> None:
    heard = Heard()
    for number, data in enumerate(sound):
        listen(source, data, 1000.0 + number / source.layout.rate, "10.0.0.2:9", heard)
        _check_packets(source, heard, data)
    said = {name for packet in heard.packets for name in packet.readings}
    told = f"; malformed: {', '.join(sorted(set(heard.reasons)))}" if heard.reasons else ""
    _ensure(bool(said & set(source.layout.names)), f"sound bytes give no reading of a sensor of the layout{told}")


def _check_packets(source: Source, heard: Heard, data: bytes) -> None:
    for packet in heard.packets:
        time = packet.time
        _ensure(time is None or abs(time) <= LIMITS.time, f"a packet has the time {time}: {data[:80]!r}")
        for name, reading in packet.readings.items():
            limits = {
                "position": (reading.position, 3, LIMITS.position),
                "quat_wxyz": (reading.quat_wxyz, 4, 1.0 + 1e-6),
                "specific_force": (reading.specific_force, 3, LIMITS.specific_force),
                "angular_rate": (reading.angular_rate, 3, LIMITS.angular_rate),
                "count": (None if reading.count is None else (reading.count,), 1, LIMITS.count),
            }
            for channel, (values, size, limit) in limits.items():
                fits = values is None or (len(values) == size and all(abs(value) <= limit for value in values))
                _ensure(fits, f"{name} has the {channel} {values}, which is no measurement: {data[:80]!r}")
            quat = reading.quat_wxyz
            unit = quat is None or abs(math.hypot(*quat) - 1.0) < 1e-6
            _ensure(unit, f"{name} has a quaternion that is not unit, {quat}: {data[:80]!r}")
        sample_of_readings(packet.readings, source.layout, 0.0 if packet.time is None else packet.time, 0.0)


def _hostile(sound: Sequence[bytes]) -> list[bytes]:
    """Nothing, noise, much of it, and what is sound: cut, changed, repeated."""
    draw = np.random.default_rng(0)
    found = [b"", b"\0", b"\n", b"{}", b"[]\n", b"nan,inf,-inf\n", b"[" * 5000, bytes(1 << 20), b"9" * 5000 + b"\n"]
    found += [draw.bytes(int(size)) for size in draw.integers(1, 300, 40)]
    for data in sound[:4]:
        found += [data[:end] for end in range(0, len(data), max(1, len(data) // 40))]
        for at in draw.integers(0, len(data), 80):
            changed = bytearray(data)
            changed[at] = int(draw.integers(256))
            found.append(bytes(changed))
        found += [data + data, data + b"\xff", data.replace(b"0", b"9"), data[::-1], data.replace(b"1", b"NaN")]
    return found


def _own_hear(source: Any, data: bytes, arrival: float, sender: str, listener: Listener) -> None:
    if not callable(getattr(source, "hear", None)):
        raise AssertionError(
            "the source has no hear(data, arrival, sender, listener), with which bytes can be tried without a socket; "
            "give check_source another way with hear="
        )
    source.hear(data, arrival, sender, listener)


def _ensure(kept: bool, broken: str) -> None:
    if not kept:
        raise AssertionError(broken)
