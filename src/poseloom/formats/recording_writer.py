"""Recordings on their way to disk, sample by sample, in MCAP: what was written survives the writer's sudden end."""

import json
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.writer import CompressionType, Writer

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError, SensorError
from poseloom.formats.recording_header import FORMAT, RecordingHeader, header_to_json
from poseloom.sensors.recording import CHANNEL_SHAPES
from poseloom.sensors.sample import Sample

HEADER_TOPIC = "/header"
SAMPLE_TOPIC = "/samples"
TRUTH_TOPIC = "/truth"
BINARY = "x-poseloom-f64le"
"""Message encoding of samples and truth: little-endian doubles and status bytes; the schema names the parts."""

_LIST_OF_CHUNKS = "_Writer__chunk_indices"
"""The attribute of MCAP's writer: private, hence the bound on its version in pyproject.toml."""
_NANOSECONDS = 1e9
_LAST_NANOSECOND = 2**64 - 1


class RecordingWriter:
    """Writes a recording sample by sample, as a context manager: `with RecordingWriter(path, header) as writer: ...`.

    The file is readable at any moment up to the last flush, also if the process is killed; leaving the block, even with
    an exception, finishes the file. The header is flushed at once.

    Args:
        path: The new file. An existing one is refused: a take is never overwritten by accident.
        header: Layout, placements, skeleton, name and settings; with a truth skeleton each sample must bring its truth.
        flush_every: Seconds of samples after which they are handed to the system. None leaves it to the chunks of about
            1 MB, which compress better.

    Raises:
        SensorError: on entering, if the file exists.
    """

    def __init__(self, path: str | Path, header: RecordingHeader, flush_every: float | None = 1.0) -> None:
        self.path = Path(path)
        self.header = header
        self.flush_every = flush_every
        self._type = header.sample_type()
        self._count = 0
        self._last_time = -np.inf
        self._last_flush = -np.inf

    def __enter__(self) -> "RecordingWriter":
        self._file = _new_file(self.path)
        # Writing through a stream that we opened, not by name: only then is it closed if finishing fails.
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        # Its own list of chunks would grow by 80 kB a minute in a live session, which flushes twice a second.
        setattr(self._writer, _LIST_OF_CHUNKS, PackedIndex())
        self._writer.start(profile=FORMAT, library="poseloom")
        self._topics = self._register()
        self._add(HEADER_TOPIC, 0.0, header_to_json(self.header))
        self._writer.flush()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._writer.finish()
        finally:
            self._file.close()

    def write_sample(self, sample: Sample, truth: Floats[Array, "dofs"] | None = None) -> None:
        """Appends a sample, and the true pose vector that belongs to it where the header announces a truth.

        Raises:
            SensorError: if the sample is not later than the one before, has another number of sensors than the layout,
                or its truth is missing, unannounced or of another size. Nothing is written then.
        """
        self._check(sample, truth)
        row = np.zeros((), dtype=self._type)
        row["time"], row["arrival"], row["status"] = sample.time, sample.arrival, sample.status
        for channel in CHANNEL_SHAPES:
            row[channel] = getattr(sample, channel)
        if truth is not None:
            # Before its sample: a file that is cut between them then lacks the sample, not the truth of a sample.
            self._add(TRUTH_TOPIC, sample.time, truth.astype("<f8").tobytes())
        self._add(SAMPLE_TOPIC, sample.time, row.tobytes())
        self._count += 1
        self._last_time = sample.time
        if self.flush_every is not None and sample.time >= self._last_flush + self.flush_every:
            self._last_flush = sample.time
            self.flush()

    def flush(self) -> None:
        """Hands everything written so far to the system; after that a kill of this process loses nothing."""
        self._writer.flush()

    def _check(self, sample: Sample, truth: Floats[Array, "dofs"] | None) -> None:
        if not sample.time > self._last_time:
            raise SensorError(
                f"sample {self._count} at {sample.time} s is not after the one before at {self._last_time} s",
                remedy="Drop samples that come twice or out of order",
                file=self.path,
            )
        if len(sample.status) != len(self.header.layout):
            raise SensorError(
                f"a sample of {len(sample.status)} sensors does not fit a layout of {len(self.header.layout)}",
                remedy="Write the samples of one layout to one recording",
                file=self.path,
            )
        skeleton = self.header.truth_skeleton
        expected = None if skeleton is None else skeleton.size
        given = None if truth is None else len(truth)
        if given != expected:
            raise SensorError(
                f"the truth beside a sample has {given or 'no'} entries, not {expected or 'none'}",
                remedy="Give each sample its true pose vector if the header names a truth skeleton, and none otherwise",
                file=self.path,
            )

    def _register(self) -> dict[str, int]:
        writer = self._writer
        sample = json.dumps({"parts": _parts(self._type)}).encode()
        topics = {
            HEADER_TOPIC: writer.register_channel(
                HEADER_TOPIC, "json", writer.register_schema("poseloom.Header", "jsonschema", b'{"type": "object"}')
            ),
            SAMPLE_TOPIC: writer.register_channel(
                SAMPLE_TOPIC, BINARY, writer.register_schema("poseloom.Sample", BINARY, sample)
            ),
        }
        if self.header.truth_skeleton is not None:
            pose = json.dumps({"parts": [["q", "<f8", [self.header.truth_skeleton.size]]]}).encode()
            topics[TRUTH_TOPIC] = writer.register_channel(
                TRUTH_TOPIC, BINARY, writer.register_schema("poseloom.PoseVector", BINARY, pose)
            )
        return topics

    def _add(self, topic: str, time: float, data: bytes) -> None:
        # MCAP's clock knows no times before zero; the exact time stands in the sample itself.
        moment = min(max(round(time * _NANOSECONDS), 0), _LAST_NANOSECOND)
        self._writer.add_message(self._topics[topic], moment, data, moment, self._count)


class PackedIndex(list[Any]):
    """The chunks of a file, which its end lists, as the bytes that will be written there: a sixth of the objects."""

    def __init__(self) -> None:
        super().__init__()
        self._records = bytearray()

    def append(self, index: Any, /) -> None:
        """Takes in one chunk's record."""
        builder = RecordBuilder()
        index.write(builder)
        self._records += builder.end()

    def __iter__(self) -> Iterator[Any]:
        """All of them as one thing that can be written."""
        yield self

    def write(self, stream: RecordBuilder) -> None:
        """Writes all records."""
        stream.write(self._records)


def _new_file(path: Path) -> IO[bytes]:
    try:
        return path.open("xb")
    except FileExistsError:
        raise SensorError(
            "there is a file of this name already", remedy="Choose another name, or remove it", file=path
        ) from None
    except FileNotFoundError:
        raise FormatError(
            "there is no such folder to write to", remedy="Make it first, or name another", file=path.parent
        ) from None


def _parts(record: np.dtype[np.void]) -> list[list[object]]:
    """Name, type and shape of each part of a binary record, in order, for readers other than poseloom."""
    return [[name, part[0].base.str, list(part[0].shape)] for name, part in (record.fields or {}).items()]
