"""Virtual sensors of every kind on a motion, as one recording, for sources and simulators without any device."""

from collections.abc import Sequence

from poseloom.live.endless import endless_motion
from poseloom.samples import read_clip
from poseloom.sensors import Recording, SensorLayout
from poseloom.skeleton.retarget import retarget
from poseloom.synthesis import Fault, simulate_sensors


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
    return simulate_sensors(motion, layout, faults=faults, seed=seed)
