"""Virtual flex sensors: what bend sensors over knees and elbows would say."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Floats
from poseloom.errors import SensorError
from poseloom.rotations import matrix_from_rotvec
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.sensors.placement import default_placements
from poseloom.sensors.recording import Recording, make_recording
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import resample
from poseloom.skeleton.skeleton import Skeleton
from poseloom.synthesis.faults import Fault, check_fault
from poseloom.synthesis.flex_faults import apply_flex_faults
from poseloom.synthesis.flex_readings import flex_counts
from poseloom.synthesis.flex_sensors import FlexSensors, check_sensors, draw_channels
from poseloom.synthesis.noise import Streams
from poseloom.synthesis.wearing import check_wearer


def bend_angles(motion: Motion, layout: SensorLayout) -> Floats[Array, "frames channels"]:
    """How far the joints under flex sensors are bent: the angle between the two bones' directions, radians.

    The direction of a bone runs from its joint to its first child's. Zero is straight; turning a bone about its own
    axis bends nothing, and a joint bent backwards counts as bent.

    Args:
        motion: Moves the body.
        layout: Its flex sensors are asked, in order; others are passed over.

    Raises:
        SensorError: if the layout has no flex sensor, or a bone has no parent or no length.
    """
    bones = [layout.sensors[i].bone for i in layout.of_kind(SensorKind.FLEX)]
    if not bones:
        raise SensorError(f"layout {layout.name!r} has no flex sensors", remedy="Choose flex-four")
    rotvecs = motion.rotvecs
    angles = np.empty((len(motion), len(bones)))
    for column, bone in enumerate(bones):
        joint = motion.skeleton.index(bone)
        upper, lower = _directions(motion.skeleton, joint)
        turned = matrix_from_rotvec(rotvecs[:, joint]) @ lower
        # Not the arc cosine of the product alone: near a straight joint that loses half of the digits.
        angles[:, column] = np.arctan2(np.linalg.norm(np.cross(upper, turned), axis=-1), turned @ upper)
    return angles


def _directions(skeleton: Skeleton, joint: int) -> tuple[Floats[Array, "3"], Floats[Array, "3"]]:
    """Unit vectors along the parent bone, in its frame, and along the bone itself, in its own frame."""
    children = skeleton.children(joint)
    lower = skeleton.offsets[children[0]] if len(children) else skeleton.tips[joint]
    pair = (skeleton.offsets[joint], lower)
    lengths = [float(np.linalg.norm(vector)) for vector in pair]
    if skeleton.parents[joint] < 0 or not all(np.isfinite(length) and length > 0 for length in lengths):
        raise SensorError(
            f"the joint of bone {skeleton.names[joint]!r} has not two bones to bend",
            remedy="Put flex sensors on the lower bone of a joint, such as leftLowerArm",
        )
    return pair[0] / lengths[0], pair[1] / lengths[1]


def simulate_flex(
    motion: Motion,
    layout: SensorLayout,
    sensors: FlexSensors = FlexSensors(),  # noqa: B008 - frozen
    minutes_of_use: float = 0.0,
    faults: Sequence[Fault] = (),
    seed: int | Generator = 0,
) -> Recording:
    """Lets a body wear virtual flex sensors and records them (flex paper, section 3.1 and equation 1).

    The motion is resampled to the layout's rate and becomes the recording's truth. One sensor a channel is drawn from
    `sensors`; each channel's and each fault's draws have a stream of their own.

    Args:
        motion: Moves the body that wears the sensors; its skeleton becomes the recording's.
        layout: Flex sensors only, at 20 to 200 Hz (`dataclasses.replace(layout("flex-four"), rate=20.0)`).
        sensors: The batch that the sensors come from.
        minutes_of_use: How long they were worn before; within the recording use goes on.
        faults: What goes wrong at stated times, in addition.
        seed: Number or generator for all that is drawn.

    Returns:
        Counts, NaN where nothing came. The status stays OK where something came: a sensor does not know its faults.

    Raises:
        SensorError: if the layout has other sensors than flex sensors, the motion's joints translate, or a parameter
            makes no sense.
    """
    check_wearer(motion, layout, SensorKind.FLEX)
    check_sensors(sensors)
    for fault in faults:
        check_fault(fault, layout)
    streams = Streams(seed)
    truth = resample(motion, layout.rate)
    bends = bend_angles(truth, layout)
    times = np.arange(len(truth)) / layout.rate
    counts = np.empty_like(bends)
    for column, name in enumerate(layout.names):
        drawn = draw_channels(replace(sensors, lost_lines=0.0), 1, streams.stream(name, "sensor"))
        stream = streams.stream(name, "reading")
        counts[:, column] = flex_counts(bends[:, [column]], layout.rate, drawn, minutes_of_use, stream)[:, 0]
    counts[streams.stream("line").random(len(truth)) < sensors.lost_lines] = np.nan
    apply_flex_faults(counts, bends, times, faults, layout, sensors, streams)
    return make_recording(
        layout,
        default_placements(layout, motion.skeleton),
        motion.skeleton,
        times,
        counts=counts,
        truth=truth,
        name=motion.name,
        settings=_settings(motion, sensors, minutes_of_use, faults, streams),
    )


def _settings(
    motion: Motion, sensors: FlexSensors, minutes_of_use: float, faults: Sequence[Fault], streams: Streams
) -> Mapping[str, str]:
    settings = {
        "made by": "simulate_flex",
        "source": motion.name,
        "seed": str(streams.seed),
        "minutes of use": repr(float(minutes_of_use)),
        "flex sensors": json.dumps(asdict(sensors)),
    }
    if faults:
        settings["faults"] = json.dumps([asdict(fault) for fault in faults])
    return settings
