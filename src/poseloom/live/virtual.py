"""Virtual sensors of every kind on a motion, as one recording, for sources and simulators without any device."""

from collections.abc import Sequence
from pathlib import Path

from poseloom.errors import SensorError, unknown_name
from poseloom.formats import drop_rest_frame, read_motion
from poseloom.live.endless import endless_motion
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, SensorKind, SensorLayout
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.retarget import retarget
from poseloom.synthesis import Fault, FaultKind, merge_recordings, simulate_flex, simulate_imus, simulate_trackers
from poseloom.synthesis.mixed import layout_of_kind

SAMPLE_PREFIX = "sample:"
"""What stands before the name of a built-in motion."""


def read_clip(clip: str) -> Motion:
    """A motion on the body: a built-in one (`sample:walk`), or one of a file.

    Raises:
        PoseloomError: for an unknown name, or a file that holds no motion.
    """
    if clip.startswith(SAMPLE_PREFIX):
        samples = sample_motions()
        name = clip.removeprefix(SAMPLE_PREFIX)
        if name not in samples:
            raise unknown_name("sample motion", name, samples)
        return samples[name]
    return retarget(drop_rest_frame(read_motion(Path(clip))))


def virtual_recording(
    clip: str, layout: SensorLayout, faults: Sequence[Fault] = (), seed: int = 0, endless: bool = True
) -> Recording:
    """What sensors on a body that moves as a clip does would say.

    Args:
        clip: See `read_clip`.
        layout: The sensors, of any kinds, at the rate that is wanted.
        faults: What goes wrong, at times within the clip.
        seed: Of all that is drawn.
        endless: Whether the clip is to be played over and over without a jump.

    Raises:
        PoseloomError: for an unknown clip, sensor or bone.
    """
    motion = read_clip(clip)
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


def parse_fault(text: str) -> Fault:
    """A fault from KIND:SENSOR:START:STOP, or with A+B as SENSOR for a swap. Raises SensorError."""
    try:
        kind, sensor, start, stop = text.split(":")
        begin, end = float(start), float(stop)
    except ValueError:
        raise SensorError(
            f"the fault {text!r} is not understood",
            remedy="Write KIND:SENSOR:START:STOP with times in seconds, such as silent:leftHand:2:3",
        ) from None
    if kind not in set(FaultKind):
        raise unknown_name("kind of fault", kind, list(FaultKind), SensorError)
    first, _, other = sensor.partition("+")
    return Fault(first, begin, end, FaultKind(kind), other=other)
