"""Virtual sensors of every kind on a motion, as one recording, for sources and simulators without any device."""

from collections.abc import Sequence

from poseloom.live.endless import endless_motion
from poseloom.samples import read_clip
from poseloom.sensors import Recording, SensorKind, SensorLayout
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.retarget import retarget
from poseloom.synthesis import Fault, merge_recordings, simulate_flex, simulate_imus, simulate_trackers
from poseloom.synthesis.mixed import layout_of_kind


def virtual_recording(
    clip: str, layout: SensorLayout, faults: Sequence[Fault] = (), seed: int = 0, endless: bool = True
) -> Recording:
    """What sensors on a body that moves as a clip does would say.

    Args:
        clip: A motion file, or a built-in motion (`sample:walk`).
        layout: The sensors, of any kinds, at the rate that is wanted.
        faults: What goes wrong, at times within the clip.
        seed: Of all that is drawn.
        endless: Whether the clip is to be played over and over without a jump.

    Raises:
        PoseloomError: for an unknown clip, sensor or bone.
    """
    motion = retarget(read_clip(clip))
    if endless:
        motion = endless_motion(motion)
    kinds = dict.fromkeys(sensor.kind for sensor in layout.sensors)
    parts = [_part(motion, layout, kind, faults, seed) for kind in kinds]
    for fault in faults:
        layout.index(fault.sensor)
    return parts[0] if len(parts) == 1 else merge_recordings(layout, parts)


def _part(motion: Motion, layout: SensorLayout, kind: SensorKind, faults: Sequence[Fault], seed: int) -> Recording:
    own = layout_of_kind(layout, kind)
    simulate = {
        SensorKind.TRACKER: simulate_trackers,
        SensorKind.IMU: simulate_imus,
        SensorKind.FLEX: simulate_flex,
    }[kind]
    return simulate(motion, own, faults=[fault for fault in faults if fault.sensor in own.names], seed=seed)
