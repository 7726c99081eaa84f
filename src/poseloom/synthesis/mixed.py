"""Recordings of several kinds of sensors worn at once."""

import json
from collections.abc import Sequence

import numpy as np

from poseloom.errors import SensorError
from poseloom.formats.recording_header import placements_to_json
from poseloom.sensors.layout import SensorKind, SensorLayout, make_layout
from poseloom.sensors.recording import CHANNEL_SHAPES, Recording, make_recording
from poseloom.skeleton.motion import Motion
from poseloom.synthesis.faults import Fault
from poseloom.synthesis.flex import simulate_flex
from poseloom.synthesis.imus import simulate_imus
from poseloom.synthesis.noise import TrackerNoise
from poseloom.synthesis.trackers import simulate_trackers
from poseloom.synthesis.wearing import TRUE_PLACEMENTS, true_placements


def simulate_sensors(
    motion: Motion,
    layout: SensorLayout,
    noise: TrackerNoise | None = None,
    faults: Sequence[Fault] = (),
    seed: int = 0,
) -> Recording:
    """What sensors of any kinds would say on a body that moves, each kind with its own simulator's usual errors.

    Args:
        motion: What the body does.
        layout: The sensors.
        noise: Errors of trackers, where others than the usual ones are wanted.
        faults: What goes wrong in addition.
        seed: Of all that is drawn.

    Raises:
        SensorError: for an unknown sensor or bone.
    """
    for fault in faults:
        layout.index(fault.sensor)
    parts: list[Recording] = []
    for kind in dict.fromkeys(sensor.kind for sensor in layout.sensors):
        own = layout_of_kind(layout, kind)
        concerned = [fault for fault in faults if fault.sensor in own.names]
        if kind is SensorKind.TRACKER:
            parts.append(simulate_trackers(motion, own, noise or TrackerNoise(), concerned, seed))
        elif kind is SensorKind.IMU:
            parts.append(simulate_imus(motion, own, faults=concerned, seed=seed))
        else:
            parts.append(simulate_flex(motion, own, faults=concerned, seed=seed))
    return parts[0] if len(parts) == 1 else merge_recordings(layout, parts)


def layout_of_kind(layout: SensorLayout, kind: SensorKind) -> SensorLayout:
    """The sensors of one kind, in order, at the layout's rate.

    Raises:
        SensorError: if there are none.
    """
    return make_layout(layout.name, (layout.sensors[i] for i in layout.of_kind(kind)), layout.rate)


def merge_recordings(layout: SensorLayout, parts: Sequence[Recording]) -> Recording:
    """One recording of a layout whose sensors were simulated apart, on the same motion.

    A moment arrives when its last part does. Settings that differ between the parts carry the kinds of their sensors.

    Args:
        layout: All sensors.
        parts: Recordings that have each of these sensors once.

    Raises:
        SensorError: if a sensor has no part or several, or the parts do not share their times and their body.
    """
    homes = [[(part, part.layout.index(name)) for part in parts if name in part.layout.names] for name in layout.names]
    strange = [name for name, home in zip(layout.names, homes, strict=True) if len(home) != 1]
    if strange:
        raise SensorError(
            f"not one recording each for the sensors {', '.join(strange)}",
            remedy="Give each sensor of the layout in exactly one of the recordings",
        )
    first = parts[0]
    for part in parts:
        if not np.array_equal(part.times, first.times) or part.skeleton.names != first.skeleton.names:
            raise SensorError(
                "recordings of other times or another body do not merge", remedy="Simulate them on the same motion"
            )
    columns = {
        channel: np.stack([getattr(part, channel)[:, at] for ((part, at),) in homes], axis=1)
        for channel in (*CHANNEL_SHAPES, "status")
    }
    settings = dict(first.settings)
    for part in parts:
        kinds = "+".join(sorted({sensor.kind.value for sensor in part.layout.sensors}))
        for key, value in part.settings.items():
            shared = all(other.settings.get(key) == value for other in parts)
            if not shared:
                settings.pop(key, None)
                settings[f"{kinds}: {key}"] = value
    if any(TRUE_PLACEMENTS in part.settings for part in parts):
        worn = [true_placements(part)[at] for ((part, at),) in homes]
        settings = {key: value for key, value in settings.items() if not key.endswith(TRUE_PLACEMENTS)}
        settings[TRUE_PLACEMENTS] = json.dumps(placements_to_json(worn))
    return make_recording(
        layout,
        [part.placements[at] for ((part, at),) in homes],
        first.skeleton,
        first.times,
        arrivals=np.max([part.arrivals for part in parts], axis=0),
        **columns,
        truth=first.truth,
        name=first.name,
        settings=settings,
    )
