"""The VMC protocol (Virtual Motion Capture, OSC over UDP): devices in, bones out, in Unity's axes on the wire.

In: `/VMC/Ext/Hmd/Pos`, `/VMC/Ext/Con/Pos` and `/VMC/Ext/Tra/Pos`, each a serial number, a position and a quaternion
`xyzw`. Out: `/VMC/Ext/OK`, `/VMC/Ext/T`, `/VMC/Ext/Root/Pos` and `/VMC/Ext/Bone/Pos`, the bones named as Unity's
HumanBodyBones, with local places and rotations. The specification stands at https://protocol.vmc.info/english.
"""

import enum
import struct
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.live.osc import OscMessage, OscValue, decode_packet, encode_bundle, encode_message
from poseloom.live.readings import LIMITS, MalformedPacket, Vector, checked_quat, checked_vector
from poseloom.live.unity_axes import mirrored_position, mirrored_quat
from poseloom.rotations import quat_from_rotvec
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.motion import Pose

VMC_PORT = 39539
"""The port at which programs that receive VMC listen by custom."""

_LONGEST_SERIAL = 64
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


def parse_devices(data: bytes) -> tuple[Device, ...]:
    """The devices that a packet tells of; messages of other kinds are left out.

    Raises:
        MalformedPacket: for bytes that are no OSC, or a device with other arguments than name, position, quaternion.
    """
    return tuple(
        _device(_ADDRESSES[message.address], message)
        for message in decode_packet(data)
        if message.address in _ADDRESSES
    )


def _device(kind: DeviceKind, message: OscMessage) -> Device:
    if len(message.arguments) != 8:
        raise MalformedPacket(f"{message.address} with {len(message.arguments)} arguments, not 8")
    serial, *values = message.arguments
    if not isinstance(serial, str) or not 0 < len(serial) <= _LONGEST_SERIAL or not serial.isprintable():
        raise MalformedPacket("a device without a name")
    numbers = [_real(value) for value in values]
    position = checked_vector(numbers[:3], 3, LIMITS.position)
    x, y, z, w = numbers[3:]
    return Device(kind, serial, mirrored_position(position), mirrored_quat(checked_quat((w, x, y, z))))


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
