"""Packets that mean no good: random, mutated, huge, replayed and reordered."""

import socket
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.random import Generator

from poseloom.benchmark.live.measuring import running, wait_until
from poseloom.benchmark.live.stage import RATE, Stage, listening_port
from poseloom.evaluation.rows import Row
from poseloom.live.devices import binary_datagram, json_datagram, vmc_datagram
from poseloom.live.lines import LineBuffer, encode_counts, parse_counts
from poseloom.live.readings import MalformedPacket
from poseloom.live.virtual import virtual_recording
from poseloom.live.vmc import parse_devices
from poseloom.live.wire import parse_datagram
from poseloom.sensors import layout

Show = Callable[[str, int, int], None]
_row = partial(Row, "packets", split="none")


def measure_parsers(count: int, seed: int, show: Show) -> list[Row]:
    """Random and mutated packets straight into every parser: each must be understood or called malformed."""
    rng = np.random.default_rng(seed)
    worn = layout("six-trackers")
    sample = virtual_recording("sample:walk", worn, endless=False).sample(0)
    names, flexes = worn.names, layout("flex-four").names
    parsers: dict[str, tuple[bytes, Callable[[bytes], object]]] = {
        "vmc": (vmc_datagram(sample, worn, 0.0), parse_devices),
        "udp, JSON": (json_datagram(sample, worn, 1.0), lambda data: parse_datagram(data, names)),
        "udp, binary": (binary_datagram(sample, worn, 1.0), lambda data: parse_datagram(data, names)),
        "serial": (encode_counts([1.0, 2.0, 3.0, 4.0], 5), lambda data: parse_counts(data.strip(), flexes)),
    }
    rows: list[Row] = []
    for number, (name, (sound, parse)) in enumerate(parsers.items()):
        show("hostile packets", number, len(parsers))
        understood = malformed = 0
        each = count // len(parsers)
        begin = time.perf_counter()
        for _ in range(each):
            try:
                parse(hostile(sound, rng))
                understood += 1
            except MalformedPacket:
                malformed += 1
        seconds = time.perf_counter() - begin
        rows += [
            _row(name, "random and mutated", metric="understood", value=float(understood), frames=each, seed=seed),
            _row(name, "random and mutated", metric="malformed", value=float(malformed), frames=each, seed=seed),
            _row(name, "random and mutated", metric="crashes", value=float(each - understood - malformed), frames=each),
            _row(name, "random and mutated", metric="us_a_packet", value=1e6 * seconds / each, frames=each),
        ]
        rows += _huge(name, parse)
    show("hostile packets", len(parsers), len(parsers))
    return rows


def hostile(sound: bytes, rng: Generator) -> bytes:
    """A packet that somebody got wrong, or made so."""
    kind = int(rng.integers(5))
    if kind == 0:
        return rng.bytes(int(rng.integers(0, 400)))
    data = bytearray(sound)
    if kind in (1, 2):
        for _ in range(int(rng.integers(1, 8))):
            data[int(rng.integers(len(data)))] = int(rng.integers(256))
    elif kind == 3:
        del data[int(rng.integers(len(data))) :]
    else:
        start, stop = sorted(rng.integers(0, len(data), size=2).tolist())
        data[stop:stop] = data[start:stop] * int(rng.integers(1, 4))
    return bytes(data)


def _huge(name: str, parse: Callable[[bytes], object]) -> list[Row]:
    begin, refused = time.perf_counter(), 0
    for filling in (b"\0", b"[", b"1", b"#bundle\0", b"9," * 4):
        data = (filling * (10_000_000 // len(filling) + 1))[:10_000_000]
        try:
            if name == "serial":
                refused += not list(LineBuffer(midway=False).feed(data))
            else:
                parse(data)
        except MalformedPacket:
            refused += 1
    seconds = (time.perf_counter() - begin) / 5
    return [
        _row(name, "10 MB", metric="refused", value=float(refused), frames=5),
        _row(name, "10 MB", metric="ms_a_packet", value=1e3 * seconds, frames=5),
    ]


def measure_flood(stage: Stage, count: int, seed: int, show: Show) -> list[Row]:
    """Hostile, replayed and reordered packets into a port, between the sound ones of a wearer at 60 Hz."""
    rng = np.random.default_rng(seed)
    plan = stage.plan("udp:0,rate=60")
    worn = plan.layout
    recording = virtual_recording("sample:walk", worn)
    moments = 600
    each = max(count // moments, 1)
    replayed = sent = 0
    with running([plan], every=1.0) as (watched,), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as speaker:
        wait_until(lambda: listening_port(plan) > 0, 60.0)
        address = ("127.0.0.1", listening_port(plan))
        begin = time.monotonic()
        for index in range(moments):
            time.sleep(max(0.0, begin + index / RATE - time.monotonic()))
            show("flood", index + 1, moments)
            sound = json_datagram(recording.sample(index), worn, index / RATE)
            speaker.sendto(sound, address)
            speaker.sendto(sound, address)
            older = max(index - int(rng.integers(1, 30)), 0)
            speaker.sendto(json_datagram(recording.sample(older), worn, older / RATE), address)
            replayed += 2
            for _ in range(each):
                # From the same sender: its mutated times must not lead the clock astray for long.
                speaker.sendto(hostile(sound, rng), address)
            sent += 3 + each
        wait_until(lambda: watched.session.counters.packets + watched.session.counters.lost >= sent, 5.0)
    assert watched.summary is not None
    counters = watched.summary.counters
    name = f"{each} hostile packets beside each sound one"
    values = {
        "sent": float(sent),
        "malformed": float(counters.malformed),
        "late_or_twice": float(counters.stale),
        "lost": float(counters.lost),
        "samples": float(counters.samples - counters.filled),
        "poses": float(counters.frames),
        "p95_ms": watched.summary.latency[1],
    }
    return [_row(name, f"{moments} sound ones", metric=key, value=value, seed=seed) for key, value in values.items()]
