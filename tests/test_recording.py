"""Recordings on disk: every bit comes back, cut-off files are read to their last whole chunk, bad ones are named."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from poseloom.errors import FormatError, SensorError
from poseloom.formats.recording import CUT_OFF, describe_recording, read_recording, write_recording
from poseloom.formats.recording_header import RecordingHeader
from poseloom.formats.recording_writer import PackedIndex, RecordingWriter
from poseloom.sensors import (
    Recording,
    SensorKind,
    SensorSpec,
    SensorStatus,
    default_placements,
    layout,
    make_layout,
    make_placement,
    make_recording,
)
from poseloom.sensors.recording import CHANNEL_SHAPES
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import make_motion

COLUMNS = ("times", "arrivals", *CHANNEL_SHAPES, "status")


def random_recording(samples: int = 400, seed: int = 0) -> Recording:
    """Numbers without meaning in every channel, with gaps."""
    rng = np.random.default_rng(seed)
    body = average_body()
    six = layout("six-trackers")
    shape = (samples, len(six))
    quats = rng.normal(size=(*shape, 4))
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    positions = rng.normal(size=(*shape, 3)) * 10.0 ** rng.integers(-9, 9, size=(*shape, 3))
    gone = rng.random(shape) < 0.1
    positions[gone], quats[gone] = np.nan, np.nan
    status = np.where(gone, SensorStatus.MISSING, SensorStatus.OK)
    status[~gone & (rng.random(shape) < 0.05)] = SensorStatus.STUCK
    times = np.cumsum(rng.uniform(0.02, 0.03, samples))
    return make_recording(
        six,
        default_placements(six, body),
        body,
        times,
        arrivals=times + rng.exponential(0.01, samples),
        positions=positions,
        quats_wxyz=quats,
        status=status,
        truth=make_motion(body, rng.normal(size=(samples, body.size)), six.rate, "a walk"),
        name="Zoë's take",
        settings={"seed": "3"},
    )


@pytest.fixture(scope="module")
def take() -> Recording:
    return random_recording()


@pytest.fixture(scope="module")
def take_file(take: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "take.mcap"
    write_recording(take, path)
    return path


def assert_same_samples(first: Recording, second: Recording) -> None:
    for name in COLUMNS:
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes(), name


def test_every_bit_comes_back(take: Recording, take_file: Path):
    back = read_recording(take_file)
    assert_same_samples(back, take)
    assert back.layout == take.layout
    assert back.name == take.name
    assert dict(back.settings) == dict(take.settings)
    assert back.skeleton.names == take.skeleton.names
    for part in ("parents", "offsets", "tips", "locked"):
        np.testing.assert_array_equal(getattr(back.skeleton, part), getattr(take.skeleton, part))
    for got, given in zip(back.placements, take.placements, strict=True):
        assert got.bone == given.bone
        np.testing.assert_array_equal(got.R_bone_sensor, given.R_bone_sensor)
        np.testing.assert_array_equal(got.p_bone_sensor, given.p_bone_sensor)
    assert take.truth is not None
    assert back.truth is not None
    assert back.truth.q.tobytes() == take.truth.q.tobytes()
    assert back.truth.name == "a walk"
    assert back.truth.skeleton is back.skeleton


def test_other_kinds_of_sensors_and_an_unknown_layout_come_back(tmp_path: Path):
    rng = np.random.default_rng(1)
    body = average_body()
    mixed = make_layout(
        "hers",
        [SensorSpec("shoe", SensorKind.IMU, "leftFoot"), SensorSpec("bend", SensorKind.FLEX, "leftLowerArm")],
        7.5,
    )
    imu = np.stack([rng.normal(size=(9, 3)), np.full((9, 3), np.nan)], axis=1)
    counts = np.stack([np.full(9, np.nan), rng.integers(0, 4096, 9).astype(np.float64)], axis=1)
    given = make_recording(
        mixed,
        [make_placement("leftFoot", rng.normal(size=3)), make_placement("leftLowerArm")],
        body,
        np.arange(9) - 4.0,
        specific_forces=imu,
        angular_rates=imu * 2,
        counts=counts,
    )
    write_recording(given, tmp_path / "hers.mcap")
    back = read_recording(tmp_path / "hers.mcap")
    assert back.layout == mixed
    assert back.truth is None
    assert_same_samples(back, given)


def test_a_truth_on_other_bone_lengths_keeps_its_skeleton(tmp_path: Path):
    body = average_body()
    small = body.with_offsets(body.offsets * 0.9, body.tips * 0.9)
    full = random_recording(3)
    assert full.truth is not None
    write_recording(replace(full, truth=make_motion(small, full.truth.q, full.truth.rate)), tmp_path / "a.mcap")
    back = read_recording(tmp_path / "a.mcap")
    assert back.truth is not None
    np.testing.assert_array_equal(back.truth.skeleton.offsets, small.offsets)
    np.testing.assert_array_equal(back.skeleton.offsets, body.offsets)


def test_other_readers_of_mcap_understand_the_file(take: Recording, take_file: Path):
    with take_file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 1 + 2 * len(take)
        schema, channel, message = next(iter(reader.iter_messages(topics="/samples")))
    assert schema is not None
    parts = json.loads(schema.data)["parts"]
    record = np.dtype([(name, kind, tuple(shape)) for name, kind, shape in parts])
    row = np.frombuffer(message.data, record)[0]
    assert channel.message_encoding == "x-poseloom-f64le"
    assert row["time"] == take.times[0]
    assert message.log_time == round(take.times[0] * 1e9)
    np.testing.assert_array_equal(row["positions"], take.positions[0])


def test_the_list_of_chunks_is_kept_packed_and_written_whole(take: Recording, tmp_path: Path):
    path = tmp_path / "often.mcap"
    header = RecordingHeader(take.layout, take.placements, take.skeleton, take.name)
    with RecordingWriter(path, header) as writer:
        for index in range(30):
            writer.write_sample(take.sample(index))
            writer.flush()
        chunks = getattr(writer._writer, "_Writer__chunk_indices")  # noqa: B009
        assert isinstance(chunks, PackedIndex)
        assert len(chunks) == 0  # nothing is kept as an object
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert len(summary.chunk_indexes) == 31  # the header's, and one a flush
        since = round(take.times[20] * 1e9)
        late = [message for _, _, message in reader.iter_messages("/samples", starting_at=since)]
    assert len(late) == 10


def test_cut_anywhere_the_file_is_read_to_its_last_whole_chunk(take: Recording, tmp_path: Path):
    assert take.truth is not None
    whole = tmp_path / "whole.mcap"
    header = RecordingHeader(take.layout, take.placements, take.skeleton, truth_skeleton=take.truth.skeleton)
    with RecordingWriter(whole, header, flush_every=0.5) as writer:
        for index in range(len(take)):
            writer.write_sample(take.sample(index), take.truth.q[index])
    content = whole.read_bytes()
    part = tmp_path / "part.mcap"
    lengths: list[int] = []
    for size in [*range(0, 40, 5), *np.linspace(40, len(content) - 1, 60).astype(int)]:
        part.write_bytes(content[:size])
        try:
            back = read_recording(part)
        except (FormatError, SensorError):
            lengths.append(0)
            continue
        assert CUT_OFF in back.settings
        assert_same_samples(back, take.cut(0, len(back)))
        assert back.truth is not None
        np.testing.assert_array_equal(back.truth.q, take.truth.q[: len(back)])
        lengths.append(len(back))
    assert lengths == sorted(lengths)
    # The flush of each half second bounds what a cut can lose; the file's last part is its index only.
    assert lengths[-1] == len(take)
    assert np.max(np.diff(lengths)) < 0.15 * len(take)


_ENDLESS = """
import sys, numpy as np
from poseloom.formats.recording_header import RecordingHeader
from poseloom.formats.recording_writer import PackedIndex, RecordingWriter
from poseloom.sensors import default_placements, layout, make_recording
from poseloom.skeleton.body import average_body
three = layout("three-trackers")
places = default_placements(three, average_body())
with RecordingWriter(sys.argv[1], RecordingHeader(three, places, average_body()), flush_every=1.0) as writer:
    for step in range(10**9):
        one = make_recording(three, places, average_body(), [step / 40], positions=np.full((1, 3, 3), float(step)))
        writer.write_sample(one.sample(0))
        if step == 200:
            print("ready", flush=True)
"""


def test_a_killed_writer_loses_at_most_what_was_not_flushed(tmp_path: Path):
    path = tmp_path / "live.mcap"
    with subprocess.Popen([sys.executable, "-c", _ENDLESS, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        os.kill(process.pid, signal.SIGKILL)
    back = read_recording(path)
    assert len(back) > 160
    assert CUT_OFF in back.settings
    np.testing.assert_array_equal(back.positions[:, 0, 0], np.arange(len(back)))


def test_an_exception_while_recording_leaves_a_whole_file(take: Recording, tmp_path: Path):
    path = tmp_path / "broken-off.mcap"
    header = RecordingHeader(take.layout, take.placements, take.skeleton)
    with pytest.raises(KeyboardInterrupt), RecordingWriter(path, header) as writer:  # noqa: PT012
        writer.write_sample(take.sample(0))
        raise KeyboardInterrupt
    back = read_recording(path)
    assert len(back) == 1
    assert CUT_OFF not in back.settings


def test_the_writer_refuses_what_does_not_fit(take: Recording, tmp_path: Path):
    header = RecordingHeader(take.layout, take.placements, take.skeleton, truth_skeleton=take.skeleton)
    three = layout("three-trackers")
    other = make_recording(three, default_placements(three, take.skeleton), take.skeleton, [99.0])
    assert take.truth is not None
    with RecordingWriter(tmp_path / "a.mcap", header) as writer:
        writer.write_sample(take.sample(1), take.truth.q[1])
        with pytest.raises(SensorError, match="not after the one before"):
            writer.write_sample(take.sample(0), take.truth.q[0])
        with pytest.raises(SensorError, match="3 sensors does not fit a layout of 6"):
            writer.write_sample(other.sample(0), take.truth.q[0])
        with pytest.raises(SensorError, match="has no entries, not 69"):
            writer.write_sample(take.sample(2))
    assert len(read_recording(tmp_path / "a.mcap")) == 1


def test_a_take_is_never_overwritten_by_the_recorder(take: Recording, take_file: Path):
    before = take_file.read_bytes()
    with (
        pytest.raises(SensorError, match="file of this name already"),
        RecordingWriter(take_file, RecordingHeader(take.layout, take.placements, take.skeleton)),
    ):
        pass
    assert take_file.read_bytes() == before


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    take: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "take.mcap"
    path.write_bytes(b"old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RecordingWriter, "write_sample", fail)
    with pytest.raises(OSError, match="No space"):
        write_recording(take, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["take.mcap"]
    assert path.read_bytes() == b"old"


def test_a_missing_folder_is_named(take: Recording, tmp_path: Path):
    with pytest.raises(FormatError, match="nowhere: there is no such folder"):
        write_recording(take, tmp_path / "nowhere" / "take.mcap")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"HIERARCHY\nROOT Hips\n", "this is no recording"),
        (bytes(range(256)) * 8, "this is no recording"),
        (b"\x89MCAP0\r\n", "cut off before its header"),
        (b"\x89MCAP0\r\n" + bytes(500), "cut off before its header"),
        (b"\x89MCAP0\r\n" + b"\xff" * 500, "cut off before its header"),
        (b"\x89MCAP0\r\n" + b"\xff" * 500 + b"\x89MCAP0\r\n", "damaged"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, content: bytes, message: str):
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=message) as caught:
        read_recording(path)
    assert caught.value.file == str(path)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(FormatError, match="no such file"):
        read_recording(tmp_path / "none.mcap")


def test_another_programs_mcap_is_named(tmp_path: Path):
    path = tmp_path / "ros.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        writer.finish()
    with pytest.raises(FormatError, match="profile is 'ros2'"):
        read_recording(path)


def test_damage_inside_a_whole_file_is_an_error_or_harmless(take: Recording, take_file: Path, tmp_path: Path):
    content = bytearray(take_file.read_bytes())
    path = tmp_path / "damaged.mcap"
    refused = 0
    for place in np.linspace(100, len(content) - 9, 60).astype(int):
        damaged = bytearray(content)
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        try:
            # What is not refused was damage to the index, which is not needed.
            assert_same_samples(read_recording(path), take)
        except FormatError:
            refused += 1
    assert refused > 40


def test_a_version_from_the_future_is_named(take: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("poseloom.formats.recording_header.VERSION", 2)
    write_recording(take.cut(0, 2), tmp_path / "new.mcap")
    monkeypatch.undo()
    with pytest.raises(FormatError, match="version 2 of the format, but poseloom reads version 1"):
        read_recording(tmp_path / "new.mcap")


def test_a_recording_without_samples_is_named(take: Recording, tmp_path: Path):
    with RecordingWriter(tmp_path / "a.mcap", RecordingHeader(take.layout, take.placements, take.skeleton)):
        pass
    with pytest.raises(SensorError, match="no samples"):
        read_recording(tmp_path / "a.mcap")


def test_a_description_names_what_is_inside(take_file: Path):
    told = dict(describe_recording(take_file))
    assert told["layout"] == "six-trackers, 40 Hz"
    assert told["samples"].startswith("400 in ")
    assert "leftAnkle" in told["missing"]
    assert "stuck" in told["flagged"]
    assert told["truth"] == "400 poses"
    assert told["seed"] == "3"
