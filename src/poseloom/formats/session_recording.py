"""Recordings of live sessions: beside the raw samples what the method was told and made of them.

Topics beside those of `recording`: `/starts` (JSON: which method began anew before which sample, and how the world was
turned), `/steps` (binary: each sample that the method heard, and the pose that it spoke of) and `/findings` (JSON:
troubles with sensors as they came and went, in words). With the header's skeleton and placements, that is all that is
needed to solve the recording again bit for bit.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.errors import FormatError, PoseloomError
from poseloom.formats._files import DAMAGE
from poseloom.formats.artefact_arrays import plain_settings
from poseloom.formats.recording import read_topics
from poseloom.formats.recording_header import RecordingHeader
from poseloom.formats.recording_writer import BINARY, RecordingWriter
from poseloom.sensors import Recording

STARTS_TOPIC = "/starts"
STEPS_TOPIC = "/steps"
FINDINGS_TOPIC = "/findings"
Entry = TypeVar("Entry")

_LATEST = 1e9
"""Seconds beyond which a time is none."""

HEALTH_STATES = ("ok", "degraded", "coasting", "lost", "rejoining")
"""Names of a step's health by its number."""


@dataclass(frozen=True)
class MethodStart:
    """A method began anew.

    Attributes:
        sample: Index of the first sample that it was to hear.
        method: Its name.
        heading: Radians by which the sensors' world is turned back before the method hears it.
        x: Metres of the session's origin in the sensors' world.
        z: The same along Z.
    """

    sample: int
    method: str
    heading: float = 0.0
    x: float = 0.0
    z: float = 0.0


@dataclass(frozen=True)
class RecordedFinding:
    """A trouble with a sensor that began or ended.

    Attributes:
        sample: Index of the sample before which it was noticed.
        time: Session time, seconds.
        sensor: Name of the sensor.
        trouble: One word: silent, stuck, noisy, swapped, mis-scaled.
        text: The same for people.
        over: Whether it ended.
    """

    sample: int
    time: float
    sensor: str
    trouble: str
    text: str
    over: bool = False


@dataclass(frozen=True, eq=False)
class Step:
    """What the method made of one sample.

    Attributes:
        sample: Index of the sample.
        finished: Host's monotonic time at which it was done, seconds.
        time: Time to which the pose belongs; NaN where none was spoken of.
        q: The pose vector, or None.
        spread: Its standard deviations, or None.
        state: Health, as an index of `HEALTH_STATES`.
        troubled: Which sensors the method did without or doubted.
    """

    sample: int
    finished: float
    time: float = float("nan")
    q: Floats[Array, "dofs"] | None = None
    spread: Floats[Array, "dofs"] | None = None
    state: int = 0
    troubled: tuple[bool, ...] = ()


@dataclass(frozen=True, eq=False)
class Steps:
    """All steps of a recording, column by column; see `Step`. Where a step spoke of no pose, `q` is NaN."""

    samples: Ints[Array, "steps"]
    finished: Floats[Array, "steps"]
    times: Floats[Array, "steps"]
    q: Floats[Array, "steps dofs"]
    spread: Floats[Array, "steps dofs"]
    states: Ints[Array, "steps"]
    troubled: Bools[Array, "steps sensors"]

    def __len__(self) -> int:
        return len(self.samples)


@dataclass(frozen=True, eq=False)
class SessionRecording:
    """A live session's recording.

    Attributes:
        recording: The raw samples.
        starts: When which method began anew; the first one at the first sample.
        steps: What it made of them. Samples without a step were not heard: newer ones were waiting.
        findings: Troubles with sensors, in order.
    """

    recording: Recording
    starts: tuple[MethodStart, ...]
    steps: Steps
    findings: tuple[RecordedFinding, ...]


class SessionWriter(RecordingWriter):
    """A `RecordingWriter` that also takes what the method was told and made. It flushes when it is told to.

    Args:
        path: The new file; one that exists is refused.
        header: Layout, placements, skeleton and settings.
    """

    def __init__(self, path: str | Path, header: RecordingHeader) -> None:
        super().__init__(path, header, flush_every=None)
        self._step_type = _step_type(header.skeleton.size, len(header.layout))

    def write_start(self, start: MethodStart, time: float) -> None:
        """Appends that a method begins anew."""
        self._add(STARTS_TOPIC, time, json.dumps(vars(start)).encode())

    def write_finding(self, finding: RecordedFinding) -> None:
        """Appends that a trouble began or ended."""
        self._add(FINDINGS_TOPIC, finding.time, json.dumps(vars(finding)).encode())

    def write_step(self, step: Step, time: float) -> None:
        """Appends what the method made of a sample; `time` is the sample's."""
        row = np.zeros((), dtype=self._step_type)
        row["sample"], row["finished"], row["time"] = step.sample, step.finished, step.time
        row["q"] = np.nan if step.q is None else step.q
        row["spread"] = np.nan if step.spread is None else step.spread
        row["state"], row["troubled"] = step.state, step.troubled or 0
        self._add(STEPS_TOPIC, time, row.tobytes())

    def _register(self) -> dict[str, int]:
        topics = super()._register()
        writer = self._writer
        anything = b'{"type": "object"}'
        for topic, schema in ((STARTS_TOPIC, "poseloom.MethodStart"), (FINDINGS_TOPIC, "poseloom.Finding")):
            topics[topic] = writer.register_channel(
                topic, "json", writer.register_schema(schema, "jsonschema", anything)
            )
        parts = [[name, part[0].base.str, list(part[0].shape)] for name, part in (self._step_type.fields or {}).items()]
        schema = json.dumps({"parts": parts}).encode()
        topics[STEPS_TOPIC] = writer.register_channel(
            STEPS_TOPIC, BINARY, writer.register_schema("poseloom.Step", BINARY, schema)
        )
        return topics


def read_session(path: str | Path) -> SessionRecording:
    """Reads a recording with what a live session's method made of it; one of another origin has no starts and no steps.

    Raises:
        FormatError: as `read_recording`, and where starts or steps are damaged.
        SensorError: as `read_recording`.
    """
    recording, found = read_topics(path, (STARTS_TOPIC, STEPS_TOPIC, FINDINGS_TOPIC))
    count = len(recording)
    try:
        return SessionRecording(
            recording,
            tuple(_plain(MethodStart(0, ""), text, count) for text in found[STARTS_TOPIC]),
            _steps(found[STEPS_TOPIC], recording.skeleton.size, len(recording.layout), count),
            tuple(_plain(RecordedFinding(0, 0.0, "", "", ""), text, count) for text in found[FINDINGS_TOPIC]),
        )
    except (PoseloomError, *DAMAGE) as error:
        raise FormatError(
            "what the method made of this recording is damaged",
            cause=str(error)[:160],
            remedy="`poseloom reconstruct` still reads its samples",
            file=path,
        ) from None


def _plain(usual: Entry, text: bytes, samples: int) -> Entry:
    """An entry from its JSON; it may name the sample after the last, which was never written."""
    far = (-1e9, 1e9)
    ranges = {"sample": (0.0, float(samples)), **dict.fromkeys(("heading", "x", "z", "time"), far)}
    return plain_settings(usual, json.loads(text), ranges)


def _step_type(dofs: int, sensors: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("sample", "<i8"),
            ("finished", "<f8"),
            ("time", "<f8"),
            ("q", "<f8", (dofs,)),
            ("spread", "<f8", (dofs,)),
            ("state", "u1"),
            ("troubled", "u1", (sensors,)),
        ]
    )


def _steps(rows: Sequence[bytes], dofs: int, sensors: int, samples: int) -> Steps:
    kind = _step_type(dofs, sensors)
    table: NDArray[Any] = np.frombuffer(b"".join(rows), dtype=kind)
    # A file that was cut off may hold the step of a sample that it lost.
    table = table[table["sample"] < samples]
    if len(table) and (int(table["sample"].min()) < 0 or int(table["state"].max()) >= len(HEALTH_STATES)):
        raise ValueError("a step is of no sample, or of no known health")
    if not (np.abs(table["finished"]) <= _LATEST).all() or (np.abs(table["time"]) > _LATEST).any():
        raise ValueError("a step's time is none")
    return Steps(
        samples=table["sample"].astype(np.int64),
        finished=table["finished"].astype(np.float64),
        times=table["time"].astype(np.float64),
        q=table["q"].astype(np.float64),
        spread=table["spread"].astype(np.float64),
        states=table["state"].astype(np.int64),
        troubled=table["troubled"] != 0,
    )
