"""Parsers and writers of the live protocols: known bytes, independent implementations, and bytes that mean no good."""

import json
import math
import struct
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pythonosc import osc_bundle_builder, osc_message_builder
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage as OtherMessage
from pythonosc.osc_packet import OscPacket

from poseloom.live.device_roles import guess_roles
from poseloom.live.devices import binary_datagram, json_datagram, vmc_datagram
from poseloom.live.lines import LineBuffer, encode_counts, parse_counts
from poseloom.live.osc import decode_packet, encode_bundle, encode_message
from poseloom.live.readings import (
    MalformedPacket,
    Packet,
    Reading,
    readings_of_sample,
    sample_of_readings,
)
from poseloom.live.unity_axes import mirrored_position, mirrored_quat
from poseloom.live.virtual import virtual_recording
from poseloom.live.vmc import Device, DeviceKind, PoseEncoder, encode_devices, parse_devices, unity_bone
from poseloom.live.wire import LONGEST_DATAGRAM, encode_binary, encode_json, parse_datagram
from poseloom.rotations import matrix_from_quat, quat_from_rotvec
from poseloom.sensors import Recording, layout
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.skeleton.motion import Pose

SIX = layout("six-trackers")
FLEX = layout("flex-four")


@cache
def walk(name: str) -> Recording:
    """Virtual sensors of a layout on a walk."""
    return virtual_recording("sample:walk", layout(name), endless=False)


def float32(value: float) -> float:
    return struct.unpack("f", struct.pack("f", value))[0]


# OSC

plain = st.one_of(
    st.integers(-(2**31), 2**31 - 1),
    st.floats(width=32, allow_nan=False),
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20),
    st.booleans(),
)


@given(st.lists(plain, max_size=8))
def test_osc_messages_are_read_by_python_osc(arguments: list[object]):
    message = OtherMessage(encode_message("/some/where", arguments))
    assert message.address == "/some/where"
    assert message.params == arguments


@given(st.lists(plain, max_size=8))
def test_osc_messages_of_python_osc_are_read(arguments: list[object]):
    builder = osc_message_builder.OscMessageBuilder("/some/where")
    for argument in arguments:
        builder.add_arg(argument)
    (message,) = decode_packet(builder.build().dgram)
    assert message == ("/some/where", tuple(arguments))


def test_osc_bundles_agree_with_python_osc():
    ours = encode_bundle([encode_message("/a", [1, 2.5]), encode_message("/b", ["x"])])
    assert [message.address for message in OscBundle(ours)] == ["/a", "/b"]
    inner = osc_bundle_builder.OscBundleBuilder(osc_bundle_builder.IMMEDIATELY)
    builder = osc_message_builder.OscMessageBuilder("/deep")
    builder.add_arg(7)
    inner.add_content(builder.build())
    outer = osc_bundle_builder.OscBundleBuilder(osc_bundle_builder.IMMEDIATELY)
    outer.add_content(inner.build())
    assert decode_packet(outer.build().dgram) == (("/deep", (7,)),)


def test_osc_bundles_within_bundles_without_end_are_refused():
    data = encode_message("/a")
    for _ in range(50):
        data = encode_bundle([data])
    with pytest.raises(MalformedPacket, match="too deep"):
        decode_packet(data)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=200), st.data())
def test_mutated_bytes_are_malformed_or_understood_and_nothing_else(noise: bytes, data: st.DataObject):
    devices = (Device(DeviceKind.TRACKER, "a", (0.0, 1.0, 2.0), (1.0, 0.0, 0.0, 0.0)),)
    packet = Packet({"head": Reading((0.0, 1.0, 2.0), (1.0, 0.0, 0.0, 0.0))}, 1.0)
    sound = [encode_devices(devices), encode_json(packet), encode_binary(packet, SIX.names), b"1,2,3,4"]
    whole = bytearray(data.draw(st.sampled_from(sound)))
    for at in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=4)):
        whole[at] = data.draw(st.integers(0, 255))
    for hostile in (noise, bytes(whole), bytes(whole) + noise, bytes(whole)[: len(noise)]):
        for parse in (
            parse_devices,
            lambda each: parse_datagram(each, SIX.names),
            lambda each: parse_counts(each, FLEX.names),
        ):
            try:
                parse(hostile)
            except MalformedPacket:
                continue


# VMC


def test_unitys_axes_are_ours_mirrored():
    """A rotation of Unity's about each axis, as points see it: mirrored, turned with the other hand, mirrored back."""
    mirror = np.diag([-1.0, 1.0, 1.0])
    rng = np.random.default_rng(0)
    for rotvec in [*np.eye(3), *rng.normal(size=(20, 3))]:
        quat = quat_from_rotvec(rotvec)
        ours = matrix_from_quat(np.array(mirrored_quat(tuple(quat))))
        assert np.allclose(ours, mirror @ matrix_from_quat(quat) @ mirror, atol=1e-12)
        assert np.allclose(mirrored_quat(mirrored_quat(tuple(quat))), quat)
    # Unity's documentation: X is right, and a positive turn about Y turns the nose (+Z) to the right (+X).
    right_turn = mirrored_quat(tuple(quat_from_rotvec(np.array([0.0, np.pi / 2, 0.0]))))
    nose = matrix_from_quat(np.array(right_turn)) @ np.array([0.0, 0.0, 1.0])
    assert np.allclose(nose, mirrored_position((1.0, 0.0, 0.0)), atol=1e-12)
    assert mirrored_position((0.2, 1.0, 0.3)) == (-0.2, 1.0, 0.3)


def test_devices_of_another_program_are_heard():
    """A headset that looks to the right and down in Unity, as python-osc would send it."""
    builder = osc_message_builder.OscMessageBuilder("/VMC/Ext/Hmd/Pos")
    half = math.sqrt(0.5)
    for value in ("LHR-1", 0.5, 1.7, -0.25, 0.0, half, 0.0, half):
        builder.add_arg(value)
    (device,) = parse_devices(builder.build().dgram)
    assert device.kind is DeviceKind.HEADSET
    assert device.serial == "LHR-1"
    assert device.position == (-0.5, float32(1.7), -0.25)
    # To the wearer's right is -X with us.
    forward = matrix_from_quat(np.array(device.quat_wxyz)) @ np.array([0.0, 0.0, 1.0])
    assert np.allclose(forward, [-1.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize(
    "arguments",
    [
        ["x", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        ["x", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        ["x", math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        ["x", 1e30, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        ["x", "y", 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        ["", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        ["x" * 1000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        [1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    ],
)
def test_devices_that_are_none_are_malformed(arguments: list[object]):
    with pytest.raises(MalformedPacket):
        parse_devices(encode_message("/VMC/Ext/Tra/Pos", arguments))


def test_poses_are_read_by_python_osc_as_unity_would_place_them():
    """Every joint's place, from the local values on the wire by Unity's own rule, is ours mirrored."""
    body = average_body()
    rng = np.random.default_rng(1)
    q = rng.normal(scale=0.6, size=body.size)
    packets = PoseEncoder().encode(Pose(body, q), 12.5)
    assert all(len(packet) < 1500 for packet in packets)
    messages = {}
    bones = {}
    for packet in packets:
        for timed in OscPacket(packet).messages:
            message = timed.message
            if message.address == "/VMC/Ext/Bone/Pos":
                bones[message.params[0]] = np.array(message.params[1:])
            else:
                messages[message.address] = message.params
    assert set(bones) == {unity_bone(bone) for bone in BODY_BONES}
    assert {"Hips", "UpperChest", "LeftUpperLeg", "RightToes"} <= set(bones)
    assert messages["/VMC/Ext/OK"] == [1]
    assert messages["/VMC/Ext/T"] == [12.5]
    assert messages["/VMC/Ext/Root/Pos"] == ["root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    frames = forward_kinematics(body, q)
    places, turns = {}, {}
    for joint, name in enumerate(BODY_BONES):
        position, (x, y, z, w) = bones[unity_bone(name)][:3], bones[unity_bone(name)][3:]
        turn = matrix_from_quat(np.array([w, x, y, z]))
        parent = int(body.parents[joint])
        # Left-handed or not, places are multiplied in the same way; what differs is the numbers.
        places[joint] = position if parent < 0 else places[parent] + turns[parent] @ position
        turns[joint] = turn if parent < 0 else turns[parent] @ turn
        assert np.allclose(places[joint] * [-1, 1, 1], frames.positions[joint], atol=1e-5), name


def test_roles_are_guessed_from_where_devices_are():
    recording = walk("six-trackers")
    for index in (0, 100, 200):
        devices = parse_devices(vmc_datagram(recording.sample(index), SIX, 0.0))
        roles = guess_roles(devices, SIX)
        by_place = {tuple(np.round(d.position, 4)): roles[d.serial] for d in devices}
        truth = {
            tuple(np.round([float32(v) for v in recording.positions[index, i]], 4)): name
            for i, name in enumerate(SIX.names)
        }
        assert by_place == truth
    assert "upperChest" in guess_roles([d for d in devices if d.position[1] > 0.9], SIX).values()


# poseloom's own datagrams


@pytest.mark.parametrize("name", ["six-trackers", "flex-four+hips-imu"])
def test_datagrams_come_back(name: str):
    worn = layout(name)
    sample = walk(name).sample(7)
    (packet,) = parse_datagram(json_datagram(sample, worn, 3.25), worn.names)
    again = sample_of_readings(packet.readings, worn, 0.0, 0.0)
    assert packet.time == 3.25
    (small,) = parse_datagram(binary_datagram(sample, worn, 3.25), worn.names)
    coarse = sample_of_readings(small.readings, worn, 0.0, 0.0)
    for channel in ("positions", "quats_wxyz", "specific_forces", "angular_rates", "counts"):
        # Quaternions are made unit again, which may move the last bit.
        assert np.allclose(getattr(again, channel), getattr(sample, channel), rtol=0, atol=1e-15, equal_nan=True)
        assert np.allclose(getattr(coarse, channel), getattr(sample, channel), rtol=1e-6, atol=1e-6, equal_nan=True)


def test_readings_of_a_sample_keep_every_bit():
    sample = walk("flex-four+hips-imu").sample(7)
    worn = layout("flex-four+hips-imu")
    again = sample_of_readings(readings_of_sample(sample, worn), worn, sample.time, sample.arrival)
    for channel in ("positions", "quats_wxyz", "specific_forces", "angular_rates", "counts", "status"):
        assert np.array_equal(getattr(again, channel), getattr(sample, channel), equal_nan=True)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        '{"sensors": []}',
        '{"sensors": {"head": 1}}',
        '{"sensors": {"head": {"position": [1, 2]}}}',
        '{"sensors": {"head": {"position": [1, 2, NaN]}}}',
        '{"sensors": {"head": {"position": [1, 2, 1e400]}}}',
        '{"sensors": {"head": {"position": "abc"}}}',
        '{"sensors": {"head": {"count": -1}}}',
        '{"sensors": {"head": {"count": true}}}',
        '{"sensors": {"head": {"unknown": 1}}}',
        '{"sensors": {"head": {"count": ' + "9" * 5000 + "}}}",
        '{"time": "now", "sensors": {}}',
        '{"time": 1e300, "sensors": {}}',
        '{"sensors": ' + "[" * 6000 + "]" * 6000 + "}",
        "not json",
        "\n\n",
    ],
)
def test_json_that_is_none_of_ours_is_malformed(text: str):
    with pytest.raises(MalformedPacket):
        parse_datagram(text.encode(), SIX.names)


def test_a_datagram_of_ten_megabytes_is_dropped_unread():
    with pytest.raises(MalformedPacket, match="more than 16384 bytes"):
        parse_datagram(b"{" * 10_000_000, SIX.names)
    assert len(json_datagram(walk("six-trackers").sample(0), SIX, 1.0)) < LONGEST_DATAGRAM


def test_binary_datagrams_must_fit_exactly():
    whole = encode_binary(Packet({"head": Reading((0.0, 1.0, 2.0))}, 1.0), SIX.names)
    assert parse_datagram(whole, SIX.names)[0].readings["head"].position == (0.0, 1.0, 2.0)
    for broken in (whole[:-1], whole + b"\0", whole[:4] + b"\2" + whole[5:], whole[:16] + b"\6" + whole[17:]):
        with pytest.raises(MalformedPacket):
            parse_datagram(broken, SIX.names)
    assert parse_datagram(encode_binary(Packet({}, None), SIX.names), SIX.names)[0].time is None


# Lines


def test_lines_of_counts():
    packet = parse_counts(b" 40210, 512;498\t601,580\r", FLEX.names)
    assert packet is not None
    assert packet.time == 40.21
    assert [packet.readings[name].count for name in FLEX.names] == [512, 498, 601, 580]
    missing = parse_counts(b"512 - 601 nan", FLEX.names)
    assert missing is not None
    assert missing.time is None
    assert set(missing.readings) == {"leftKnee", "leftElbow"}
    assert parse_counts(b"# started", FLEX.names) is None
    assert parse_counts(b"\r", FLEX.names) is None
    for broken in (b"512,498,601", b"1,2,3,4,5,6", b"a,b,c,d", b"-1,x,1e9,0x1", b"x,1,2,3,4", b"1,2,3,", b"1,2,3,4,"):
        with pytest.raises(MalformedPacket):
            parse_counts(broken, FLEX.names)


@given(st.lists(st.integers(0, 4095).map(float) | st.just(math.nan), min_size=4, max_size=4), st.integers(0, 2**31))
def test_lines_come_back(counts: list[float], milliseconds: int):
    packet = parse_counts(encode_counts(counts, milliseconds).strip(), FLEX.names)
    assert packet is not None
    assert packet.time == milliseconds / 1e3
    said = [packet.readings[name].count if name in packet.readings else math.nan for name in FLEX.names]
    assert np.array_equal(said, counts, equal_nan=True)


@given(st.lists(st.binary(max_size=40), max_size=10), st.integers(1, 7))
def test_a_stream_is_cut_into_the_same_lines_however_it_comes(parts: list[bytes], size: int):
    whole = b"\n".join(part.replace(b"\n", b"") for part in parts) + b"\n"
    buffer = LineBuffer(midway=False)
    lines = [line for at in range(0, len(whole), size) for line in buffer.feed(whole[at : at + size])]
    assert lines == whole.split(b"\n")[:-1]


def test_a_line_without_end_is_forgotten_and_the_next_is_heard():
    buffer = LineBuffer(midway=False)
    for _ in range(10_000):
        assert list(buffer.feed(b"x" * 1000)) == []
    assert buffer.overlong == 1
    assert list(buffer.feed(b"\n1,2,3,4\n")) == [b"1,2,3,4"]
    assert list(LineBuffer(midway=True).feed(b"23,4\n1,2,3,4\n")) == [b"1,2,3,4"]


def test_json_is_plain_for_other_programs():
    content = json.loads(encode_json(Packet({"leftKnee": Reading(count=5.0)}, 1.5)))
    assert content == {"time": 1.5, "sensors": {"leftKnee": {"count": 5.0}}}
