"""Every kind of source keeps its contract, without a socket; and a broken one is told."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from poseloom.formats.recording import write_recording
from poseloom.live.lines import LineBuffer
from poseloom.live.readings import Packet, Reading, readings_of_sample
from poseloom.live.source_serial import hear_lines
from poseloom.live.sources_network import DatagramSource
from poseloom.live.specifications import SOURCES, make_source
from poseloom.live.virtual import virtual_recording
from poseloom.live.vmc import Device, DeviceKind, encode_devices
from poseloom.live.wire import encode_binary, encode_json
from poseloom.sensors import layout
from poseloom.testing import check_source

SIX = layout("six-trackers")


def _datagrams(folder: Path) -> tuple[str, list[bytes]]:
    recording = virtual_recording("sample:walk", SIX, endless=False).cut(0, 4)
    packets = [Packet(readings_of_sample(recording.sample(i), SIX), 5.0 + i / 60) for i in range(4)]
    texts = [encode_json(packet) for packet in packets[:2]]
    return "udp://:0", [*texts, *(encode_binary(packet, SIX.names) for packet in packets[2:])]


def _devices(folder: Path) -> tuple[str, list[bytes]]:
    recording = virtual_recording("sample:walk", SIX, endless=False)
    sound = []
    for index in range(3):
        sample = recording.sample(index)
        devices = [
            Device(DeviceKind.TRACKER, name, tuple(sample.positions[i].tolist()), tuple(sample.quats_wxyz[i].tolist()))
            for i, name in enumerate(SIX.names)
        ]
        sound.append(encode_devices(tuple(devices)))
    return "vmc://:0", sound


def _lines(folder: Path) -> tuple[str, list[bytes]]:
    return "serial:///dev/nowhere", [b"512,400,300,2", b"00\n511,401,300,200\n", b"510,402,301,201\n"]


def _file(folder: Path) -> tuple[str, list[bytes]]:
    (folder / "counts.txt").write_text("1,2,3,4\n")
    return f"lines://{folder}/counts.txt", []


def _recording(folder: Path) -> tuple[str, list[bytes]]:
    write_recording(virtual_recording("sample:walk", SIX, endless=False).cut(0, 4), folder / "walk.mcap")
    return f"replay://{folder}/walk.mcap", []


MAKERS: dict[str, Callable[[Path], tuple[str, list[bytes]]]] = {
    "vmc": _devices,
    "udp": _datagrams,
    "serial": _lines,
    "lines": _file,
    "replay": _recording,
    "simulate": lambda folder: ("simulate://sample:walk?once", []),
}
"""An address, and what such a device sends."""


def _hear_line(source: Any, data: bytes, arrival: float, sender: str, listener: Any) -> None:
    if not hasattr(source, "buffer"):
        source.buffer = LineBuffer(midway=False)
    hear_lines(source.buffer, data, arrival, source.layout, sender, listener)


@pytest.mark.parametrize("scheme", SOURCES.own)
def test_every_source_keeps_its_contract(scheme: str, tmp_path: Path) -> None:
    address, sound = MAKERS[scheme](tmp_path)
    check_source(lambda: make_source(address), sound, _hear_line if scheme == "serial" else None)


class Broken(DatagramSource):
    """Hears as a test says."""

    def __init__(self, hear: Callable[..., object]) -> None:
        super().__init__(SIX)
        self._hear = hear

    def hear(self, data: bytes, arrival: float, sender: str, listener: Any) -> None:
        self._hear(data, listener)


def _says(reading: Reading, name: str = "head") -> Callable[..., object]:
    return lambda data, listener: listener.packet(Packet({name: reading}), 0.0, "a")


@pytest.mark.parametrize(
    ("hear", "words"),
    [
        (lambda data, listener: None, "no reading of a sensor"),
        (lambda data, listener: listener.malformed("all"), "malformed: all"),
        (_says(Reading(position=(0.0, 0.0, 1.0)), "ear"), "no reading of a sensor"),
        (_says(Reading(position=(float("nan"), 0.0, 0.0))), "no measurement"),
        (_says(Reading(quat_wxyz=(0.5, 0.0, 0.0, 0.0))), "not unit"),
        (_says(Reading(position=(0.0, 0.0, 1.0))), "noise is not told"),
        (lambda data, listener: _says(Reading(position=(float(data[0]),) * 3))(data, listener), "hostile bytes raise"),
    ],
)
def test_a_broken_source_is_told(hear: Callable[..., object], words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_source(lambda: Broken(hear), [b"sound"])
