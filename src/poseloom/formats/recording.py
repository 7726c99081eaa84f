"""Recordings as `.mcap` files: an append-only log of a header, samples and the truth where it is known.

Topics: `/header` (JSON: layout, placements, skeleton, settings), `/samples` and `/truth` (binary records; their schemas
name the parts); recordings of live sessions have more (see `session_recording`), which `read_recording` passes over.
Times of messages are device times in nanoseconds; the exact doubles stand in the samples. Chunks are compressed with
zstd and carry check sums. A file without an end, from a writer that was killed or a disk that was full, is read to its
last whole chunk.
"""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Header, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from poseloom.errors import FormatError, PoseloomError, SensorError
from poseloom.formats._files import DAMAGE, open_regular
from poseloom.formats.atomic import atomic_file
from poseloom.formats.recording_header import FORMAT, RecordingHeader, header_from_json
from poseloom.formats.recording_writer import HEADER_TOPIC, SAMPLE_TOPIC, TRUTH_TOPIC, RecordingWriter
from poseloom.sensors.recording import Recording, make_recording
from poseloom.sensors.summary import summarise
from poseloom.skeleton.motion import Motion, make_motion

_DAMAGE = (McapError, zstandard.ZstdError, *DAMAGE)
"""What the MCAP reader raises on bytes that are not what they should be (its check-sum error is a ValueError)."""

_CHUNK = 1 << 25
"""Bytes to which a chunk may unpack; ours have a megabyte."""
_UNPACKED, _RATIO = 400 << 20, 32
"""Bytes to which all chunks together may unpack, or how many times the file's own size if that is more."""
_OVERHEAD = 200
"""What a message costs beside its bytes."""
_LONGEST = 1e9
"""Seconds, about 30 years: times beyond it are none, and a recording that spans more is damaged."""

CUT_OFF = "cut off"
"""Key in the settings of a recording whose file has no end."""


def write_recording(recording: Recording, path: str | Path) -> None:
    """Writes a recording, whole or not at all; a file that exists is replaced.

    Raises:
        SensorError: if the truth's joints translate (`displacements`), which the file cannot hold.
        FormatError, OSError: if the file cannot be written.
    """
    truth = recording.truth
    if truth is not None and truth.displacements is not None:
        raise SensorError(
            "the truth moves its joints apart, which a recording cannot hold", remedy="Retarget it first", file=path
        )
    header = RecordingHeader(
        recording.layout,
        recording.placements,
        recording.skeleton,
        recording.name,
        recording.settings,
        None if truth is None else truth.skeleton,
        "" if truth is None else truth.name,
    )
    with atomic_file(path) as part, RecordingWriter(part, header, flush_every=None) as writer:
        for index in range(len(recording)):
            writer.write_sample(recording.sample(index), None if truth is None else truth.q[index])


def read_recording(path: str | Path) -> Recording:
    """Reads a recording. One that was cut off is read as far as it goes, and says so in its settings.

    Raises:
        FormatError: if the file is missing, empty, no MCAP, another program's, damaged, or cut off before its header.
        SensorError: if what it says does not fit together, or it holds no sample.
    """
    file = Path(path)
    return _recording_of(_read_take(file), file)


def _recording_of(take: "_Take", file: Path) -> Recording:
    header = take.header
    if header is None:
        raise FormatError(
            "this file holds no recording of poseloom's"
            if take.whole
            else "the recording was cut off before its header",
            remedy="Name a file made by `poseloom simulate` or by a recorder",
            file=file,
        )
    try:
        return _recording(take, header)
    except PoseloomError as error:
        raise error.at(file) from None


def describe_recording(path: str | Path) -> list[tuple[str, str]]:
    """What a recording's file holds, as labels and texts for people. Raises as `read_recording`."""
    return summarise(read_recording(path))


@dataclass
class _Take:
    """What has been read so far; bytes rather than objects, for a long take has hundreds of thousands of messages."""

    whole: bool
    header: RecordingHeader | None = None
    samples: bytearray = field(default_factory=bytearray)
    truth: bytearray = field(default_factory=bytearray)
    others: dict[str, list[bytes]] = field(default_factory=dict[str, list[bytes]])


def read_topics(path: str | Path, topics: Collection[str]) -> tuple[Recording, dict[str, list[bytes]]]:
    """A recording, and the messages of other topics beside its samples, in order; raises as `read_recording`."""
    file = Path(path)
    take = _read_take(file, topics)
    return _recording_of(take, file), {topic: take.others.get(topic, []) for topic in topics}


def _read_take(file: Path, others: Collection[str] = ()) -> _Take:
    with open_regular(file) as stream:
        begin = stream.read(len(MCAP0_MAGIC))
        if begin != MCAP0_MAGIC:
            raise FormatError(
                "the file is empty" if not begin else "this is no recording",
                cause="it does not begin as an MCAP file does",
                remedy="Name an .mcap file made by poseloom",
                file=file,
            )
        size = stream.seek(0, 2)
        stream.seek(-len(MCAP0_MAGIC), 2)
        take = _Take(whole=size > len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC)
        stream.seek(0)
        try:
            # No record is longer than the file: a damaged length must not ask for gigabytes.
            reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size)
            _read_records(_unpacked(reader, size), take, file, others)
        except _DAMAGE as error:
            if take.whole:
                raise FormatError(
                    "the recording is damaged",
                    cause=f"its bytes are not those that were written ({type(error).__name__})",
                    remedy="Get the file again from where it was copied",
                    file=file,
                ) from None
    return take


def _unpacked(reader: StreamReader, size: int) -> Iterator[McapRecord]:
    """The records of a file, chunks unpacked; a chunk that would unpack to more than is sound is damage."""
    room = max(_UNPACKED, _RATIO * size)
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        # Both sizes may lie: zstd goes by that of its own frame, and by the chunk's where the frame has none.
        stated = [record.uncompressed_size, len(record.data)]
        if record.compression == "zstd":
            own = zstandard.get_frame_parameters(record.data).content_size
            stated += [] if own == zstandard.CONTENTSIZE_UNKNOWN else [own]
        elif record.compression:
            raise ValueError(f"a chunk is packed by {record.compression[:20]!r}")
        room -= max(stated)
        if max(stated) > _CHUNK or room < 0:
            raise ValueError(f"a chunk would unpack to {max(stated) / 1e6:,.0f} MB")
        records = breakup_chunk(record, validate_crc=True)
        room -= _OVERHEAD * len(records)
        yield from records


def _read_records(records: Iterable[McapRecord], take: _Take, file: Path, others: Collection[str]) -> None:
    topics: dict[int, str] = {}
    for record in records:
        if isinstance(record, Header):
            if record.profile != FORMAT:
                raise FormatError(
                    "this MCAP file is not a recording of poseloom's",
                    cause=f"its profile is {record.profile[:40]!r}, not {FORMAT!r}",
                    remedy="Name a file made by `poseloom simulate` or by a recorder",
                    file=file,
                )
        elif isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            topic = topics.get(record.channel_id)
            if topic == SAMPLE_TOPIC:
                take.samples += record.data
            elif topic == TRUTH_TOPIC:
                take.truth += record.data
            elif topic == HEADER_TOPIC:
                if take.header is not None:
                    raise ValueError("it has two headers")
                take.header = header_from_json(record.data, file)
            elif topic is not None and topic in others:
                take.others.setdefault(topic, []).append(record.data)


def _recording(take: _Take, header: RecordingHeader) -> Recording:
    rows = _rows(take.samples, header.sample_type())
    if len(rows) == 0:
        raise SensorError(
            "the recording has no samples",
            cause="" if take.whole else "it was cut off before the first was whole",
            remedy="Record it anew",
        )
    if not (np.abs(rows["time"]) <= _LONGEST).all() or not (np.abs(rows["arrival"]) <= _LONGEST).all():
        raise FormatError(f"a sample's time is no number, or beyond {_LONGEST:g} s", remedy="Record it anew")
    settings = dict(header.settings)
    if not take.whole:
        settings[CUT_OFF] = f"after {len(rows)} whole samples"
    return make_recording(
        header.layout,
        header.placements,
        header.skeleton,
        rows["time"],
        arrivals=rows["arrival"],
        positions=rows["positions"],
        quats_wxyz=rows["quats_wxyz"],
        specific_forces=rows["specific_forces"],
        angular_rates=rows["angular_rates"],
        counts=rows["counts"],
        status=rows["status"].astype(np.int64),
        truth=_truth(take, header, len(rows)),
        name=header.name,
        settings=settings,
    )


def _rows(data: bytearray, kind: np.dtype[np.void]) -> NDArray[Any]:
    if len(data) % kind.itemsize:
        raise FormatError("samples are not as long as the header says", remedy="Get the file again")
    return np.frombuffer(data, dtype=kind)


def _truth(take: _Take, header: RecordingHeader, samples: int) -> Motion | None:
    skeleton = header.truth_skeleton
    if skeleton is None:
        return None
    poses = _rows(take.truth, np.dtype(("<f8", (skeleton.size,))))
    # Each pose is written just before its sample, so only a cut leaves one pose too many.
    if len(poses) != samples and (take.whole or len(poses) != samples + 1):
        raise FormatError(f"the truth has {len(poses)} poses for {samples} samples", remedy="Get the file again")
    return make_motion(skeleton, poses[:samples], header.layout.rate, header.truth_name)
