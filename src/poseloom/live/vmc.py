"""The VMC protocol (Virtual Motion Capture, OSC over UDP): devices in, bones out, in Unity's axes on the wire.

In: `/VMC/Ext/Hmd/Pos`, `/VMC/Ext/Con/Pos` and `/VMC/Ext/Tra/Pos`, each a serial number, a position and a quaternion
`xyzw`. Out: `/VMC/Ext/OK`, `/VMC/Ext/T`, `/VMC/Ext/Root/Pos` and `/VMC/Ext/Bone/Pos`, the bones named as Unity's
HumanBodyBones, with local places and rotations. The specification stands at https://protocol.vmc.info/english.
"""

import enum
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.live.osc import OscMessage, OscValue, decode_packet, encode_bundle, encode_message
from poseloom.live.readings import LIMITS, MalformedPacket, Refusal, Vector, checked_quat, checked_vector, without_fix
from poseloom.live.unity_axes import mirrored_position, mirrored_quat
from poseloom.rotations import quat_from_rotvec
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.motion import Pose

VMC_PORT = 39539
"""The port at which programs that receive VMC listen by custom."""

_LONGEST_SERIAL = 64
_DEVICE_ARGUMENTS = 8
_BONES_A_PACKET = 12
"""Bones in one bundle: it then stays below 1,500 bytes, the size that networks carry in one piece."""


class DeviceKind(enum.StrEnum):
    """What a device is, by its address."""

    HEADSET = "headset"
    CONTROLLER = "controller"
    TRACKER = "tracker"


class Device(NamedTuple):
    """What a device said, in poseloom's axes.

    Attributes:
        kind: What it is.
        serial: Its serial number or name.
        position: Metres.
        quat_wxyz: `R_world_device`.
    """

    kind: DeviceKind
    serial: str
    position: Vector
    quat_wxyz: Vector


_ADDRESSES = {
    "/VMC/Ext/Hmd/Pos": DeviceKind.HEADSET,
    "/VMC/Ext/Con/Pos": DeviceKind.CONTROLLER,
    "/VMC/Ext/Tra/Pos": DeviceKind.TRACKER,
}
_ADDRESS_OF = {kind: address for address, kind in _ADDRESSES.items()}


def unity_bone(bone: str) -> str:
    """The name that Unity's HumanBodyBones give a bone: VRM 1.0's with a capital."""
    return bone[0].upper() + bone[1:]


_KINDS_OF_MESSAGES = {
    "/VMC/Ext/Hmd/Pos": "headset",
    "/VMC/Ext/Con/Pos": "controllers",
    "/VMC/Ext/Tra/Pos": "trackers",
    "/VMC/Ext/Bone/Pos": "bones",
    "/VMC/Ext/Root/Pos": "the root",
    "/VMC/Ext/Blend/Val": "blend shapes",
    "/VMC/Ext/Blend/Apply": "blend shapes",
    "/VMC/Ext/Cam": "a camera",
    "/VMC/Ext/Light": "a light",
    "/VMC/Ext/Key": "keys",
    "/VMC/Ext/OK": "status",
    "/VMC/Ext/T": "status",
}
_OTHER_MESSAGES = "other messages"


@dataclass(frozen=True)
class DevicePacket:
    """What a packet tells of devices.

    Attributes:
        devices: Those with a position and an orientation.
        refused: Messages of devices that are not used, each with its reason.
        absent: Kind and serial of devices that have no position yet.
        messages: How many messages of each kind came, in words.
        repeated: Serials that several devices of the packet share; from the second on `#2` and so on is appended.
    """

    devices: tuple[Device, ...]
    refused: tuple[Refusal, ...]
    absent: tuple[tuple[DeviceKind, str], ...]
    messages: Mapping[str, int]
    repeated: tuple[str, ...]


def read_devices(data: bytes) -> DevicePacket:
    """The devices that a packet tells of. Each message stands alone: one that is malformed costs no other.

    More arguments than name, position and quaternion are accepted, as the protocol demands.
    """
    reasons: list[str] = []
    devices: list[Device] = []
    absent: list[tuple[DeviceKind, str]] = []
    placed: set[tuple[str, Vector]] = set()
    messages: Counter[str] = Counter()
    serials: Counter[str] = Counter()
    decoded = decode_packet(data, reasons)
    refused = [Refusal(reason) for reason in reasons]
    for message in decoded:
        messages[_kind_of_message(message.address)] += 1
        kind = _ADDRESSES.get(message.address)
        if kind is None:
            continue
        serial = ""
        try:
            serial = _serial(message)
            device, missing = _device(kind, serial, message)
        except MalformedPacket as error:
            refused.append(Refusal(f"{message.address}: {error}", serial))
            continue
        if device is not None and (serial, device.position) in placed:
            continue  # the same one, told of twice
        serials[serial] += 1
        name = serial if serials[serial] == 1 else f"{serial} #{serials[serial]}"
        if device is None:
            absent.append((kind, name))
            refused.append(Refusal(missing, name, missing=True))
        else:
            placed.add((serial, device.position))
            devices.append(device._replace(serial=name))
    repeated = tuple(serial for serial, count in serials.items() if count > 1)
    return DevicePacket(tuple(devices), tuple(refused), tuple(absent), messages, repeated)


def parse_devices(data: bytes) -> tuple[Device, ...]:
    """The devices of `read_devices`.

    Raises:
        MalformedPacket: where something is refused and nothing is left.
    """
    packet = read_devices(data)
    if packet.refused and not packet.devices:
        raise MalformedPacket(packet.refused[0].reason)
    return packet.devices


def _kind_of_message(address: str) -> str:
    known = _KINDS_OF_MESSAGES.get(address)
    if known is not None:
        return known
    local = _KINDS_OF_MESSAGES.get(address.removesuffix("/Local"))
    return _OTHER_MESSAGES if local is None else f"{local} in room scale (/Local)"


def _serial(message: OscMessage) -> str:
    serial = message.arguments[0] if message.arguments else None
    if not isinstance(serial, str):
        raise MalformedPacket("the first argument is no name")
    if not serial.strip():
        raise MalformedPacket("an empty serial number")
    if len(serial) > _LONGEST_SERIAL or not serial.isprintable():
        raise MalformedPacket("a serial number that is too long or not printable")
    return serial


def _device(kind: DeviceKind, serial: str, message: OscMessage) -> tuple[Device | None, str]:
    """The device of a message; None, and why, where it has no position yet."""
    if len(message.arguments) < _DEVICE_ARGUMENTS:
        raise MalformedPacket(f"fewer than {_DEVICE_ARGUMENTS} arguments")
    numbers = [_real(value) for value in message.arguments[1:_DEVICE_ARGUMENTS]]
    x, y, z, w = numbers[3:]
    missing = without_fix(numbers[:3], (w, x, y, z))
    if missing:
        return None, missing
    position = checked_vector(numbers[:3], 3, LIMITS.position)
    return Device(kind, serial, mirrored_position(position), mirrored_quat(checked_quat((w, x, y, z)))), ""


def _real(value: OscValue) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MalformedPacket("a text where a number should stand")
    return float(value)


def encode_devices(devices: tuple[Device, ...]) -> bytes:
    """One packet that tells of devices, as a program with a headset would send it."""
    return encode_bundle(_device_message(device) for device in devices)


def _device_message(device: Device) -> bytes:
    w, x, y, z = mirrored_quat(device.quat_wxyz)
    values = [*mirrored_position(device.position), x, y, z, w]
    return encode_message(_ADDRESS_OF[device.kind], [device.serial, *map(float, values)])


class PoseEncoder:
    """Encodes poses of the 22-bone body; what is the same in every packet is made once."""

    def __init__(self) -> None:
        self._bones = [encode_message("/VMC/Ext/Bone/Pos", [unity_bone(bone), *[0.0] * 7])[:-28] for bone in BODY_BONES]
        self._root = encode_message("/VMC/Ext/Root/Pos", ["root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        self._loaded = encode_message("/VMC/Ext/OK", [1])

    def encode(self, pose: Pose, seconds: float) -> tuple[bytes, ...]:
        """The packets of one pose, the last with the time at which it belongs.

        Args:
            pose: On the body; bones' names and order are `BODY_BONES`.
            seconds: Time of the pose.
        """
        values = _bone_values(pose)
        bones = [head + struct.pack(">7f", *row) for head, row in zip(self._bones, values.tolist(), strict=True)]
        first = encode_bundle([self._loaded, self._root, *bones[:_BONES_A_PACKET]])
        return first, encode_bundle([*bones[_BONES_A_PACKET:], encode_message("/VMC/Ext/T", [float(seconds)])])


def _bone_values(pose: Pose) -> Floats[Array, "bones 7"]:
    """Each bone's place in its parent's axes and its local rotation `xyzw`, in Unity's axes; the hips' in the world."""
    count = len(pose.skeleton)
    values = np.empty((count, 7))
    values[:, :3] = pose.skeleton.offsets
    values[0, :3] = pose.q[:3]
    values[:, 0] *= -1.0
    quats = quat_from_rotvec(pose.q[3:].reshape(count, 3))
    values[:, 3] = quats[:, 1]
    values[:, 4:6] = -quats[:, 2:]
    values[:, 6] = quats[:, 0]
    return values
