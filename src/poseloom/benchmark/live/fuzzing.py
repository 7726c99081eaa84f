"""Inputs that mean no good, by kind, into every parser and into a session; and what escapes.

An escape is an exception other than `MalformedPacket`, a sound device that is lost from the packet that it came in, or
a session that ends.
"""

import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.random import Generator

from poseloom.benchmark.live.hostile_inputs import BESIDE, WHOLE, Protocol, hostile, protocols
from poseloom.benchmark.live.measuring import running, wait_until
from poseloom.benchmark.live.stage import RATE, Stage, listening_port
from poseloom.evaluation.rows import Row
from poseloom.live.contract import Level
from poseloom.live.devices import json_datagram, vmc_datagram
from poseloom.live.readings import MalformedPacket
from poseloom.live.virtual import virtual_recording
from poseloom.sensors import Sample, SensorLayout

Encode = Callable[[Sample, SensorLayout, float], bytes]
Show = Callable[[str, int, int], None]
_row = partial(Row, "hostile", split="none")


@dataclass
class _Tally:
    """What became of the inputs of one kind."""

    tried: int = 0
    understood: int = 0
    refused: int = 0
    exceptions: int = 0
    lost_devices: int = 0
    seconds: float = 0.0


def measure_parsers(count: int, seed: int, show: Show) -> list[Row]:
    """Hostile inputs of every kind straight into every parser.

    Args:
        count: How many, all protocols together; huge ones are five of each protocol.
        seed: Of all that is drawn.
        show: Is told how far it is.
    """
    rng = np.random.default_rng(seed)
    rows: list[Row] = []
    spoken = protocols()
    for number, protocol in enumerate(spoken):
        kinds: Mapping[str, Callable[[], tuple[bytes, frozenset[str]]]] = {
            **{kind: partial(_alone, make, protocol, rng) for kind, make in WHOLE.items()},
            **{
                f"{kind}, beside sound ones": partial(make, protocol, rng)
                for kind, make in BESIDE.items()
                if protocol.spoils(kind)
            },
        }
        each = max(count // len(spoken) // len(kinds), 1)
        for kind, make in kinds.items():
            show("hostile inputs", number, len(spoken))
            rows += _rows(protocol.name, kind, _tried(protocol, make, each), seed)
        rows += _rows(protocol.name, "10 MB", _huge(protocol), seed)
    show("hostile inputs", len(spoken), len(spoken))
    return rows


def _alone(
    make: Callable[[bytes, Generator], bytes], protocol: Protocol, rng: Generator
) -> tuple[bytes, frozenset[str]]:
    return make(protocol.sound, rng), frozenset()


def _tried(protocol: Protocol, make: Callable[[], tuple[bytes, frozenset[str]]], count: int) -> _Tally:
    tally = _Tally()
    for _ in range(count):
        data, sound = make()
        _try(protocol, data, sound, tally)
    return tally


def _try(protocol: Protocol, data: bytes, sound: frozenset[str], tally: _Tally) -> None:
    tally.tried += 1
    begin = time.thread_time()  # of this thread alone, whatever else the machine does
    try:
        heard = protocol.heard(data)
    except MalformedPacket:
        tally.refused += 1
        tally.lost_devices += len(sound)
    except Exception:
        tally.exceptions += 1
    else:
        tally.understood += 1
        tally.lost_devices += len(sound - heard)
    tally.seconds += time.thread_time() - begin


def _huge(protocol: Protocol) -> _Tally:
    tally = _Tally()
    for filling in (b"\0", b"[", b"1", b"#bundle\0", b"9," * 4):
        _try(protocol, (filling * (10_000_000 // len(filling) + 1))[:10_000_000], frozenset(), tally)
    return tally


def _rows(protocol: str, kind: str, tally: _Tally, seed: int) -> list[Row]:
    values = {
        "tried": tally.tried,
        "understood": tally.understood,
        "refused": tally.refused,
        "escapes": tally.exceptions + tally.lost_devices,
        "us_each": 1e6 * tally.seconds / max(tally.tried, 1),
    }
    return [_row(protocol, kind, metric=key, value=float(value), seed=seed) for key, value in values.items()]


def measure_flood(stage: Stage, count: int, seed: int, show: Show) -> list[Row]:
    """Hostile, replayed and reordered packets into ports, between the sound ones of a wearer at 60 Hz."""
    return [
        *_flood(stage, "udp", json_datagram, count // 2, seed, show),
        *_flood(stage, "vmc", vmc_datagram, count // 2, seed, show),
    ]


def _flood(stage: Stage, kind: str, encode: Encode, count: int, seed: int, show: Show) -> list[Row]:
    rng = np.random.default_rng(seed)
    plan = stage.plan(f"{kind}:0,rate=60")
    worn = plan.layout
    recording = virtual_recording("sample:walk", worn)
    moments = 600
    each = max(count // moments, 1)
    sent = 0
    with running([plan], every=1.0) as (watched,), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as speaker:
        wait_until(lambda: listening_port(plan) > 0, 60.0)
        address = ("127.0.0.1", listening_port(plan))
        begin = time.monotonic()
        for index in range(moments):
            time.sleep(max(0.0, begin + index / RATE - time.monotonic()))
            show(f"flood of {kind}", index + 1, moments)
            sound = encode(recording.sample(index), worn, index / RATE)
            speaker.sendto(sound, address)
            speaker.sendto(sound, address)
            older = max(index - int(rng.integers(1, 30)), 0)
            speaker.sendto(encode(recording.sample(older), worn, older / RATE), address)
            for _ in range(each):
                # From the same sender: its mutated times must not lead the clock astray for long.
                speaker.sendto(hostile(sound, rng), address)
            sent += 3 + each
        alive = wait_until(lambda: watched.session.counters.packets + watched.session.counters.lost >= sent, 30.0)
    assert watched.summary is not None
    counters = watched.summary.counters
    failures = sum(notice.level is Level.ERROR for notice in watched.summary.notices)
    values = {
        "tried": float(sent - moments),
        "escapes": float(failures + (not alive)),
        "sound": float(moments),
        "samples": float(counters.samples - counters.filled),
        "poses": float(counters.frames),
        "refused": float(counters.malformed),
        "late_or_twice": float(counters.stale),
        "lost": float(counters.lost),
        "p95_ms": watched.summary.latency[1],
    }
    name = f"a session on {kind}, {each} hostile packets and 2 replayed ones beside each sound one"
    return [_row(name, "flood", metric=key, value=value, seed=seed) for key, value in values.items()]
