"""Clips by name: a motion file, or a built-in motion."""

from pathlib import Path

from poseloom.errors import PoseloomError, unknown_name
from poseloom.formats import drop_rest_frame, read_motion
from poseloom.formats.conventions import NOTHING_SAID, MotionChoices, check_human
from poseloom.samples.motions import sample_motions
from poseloom.skeleton.motion import Motion

SAMPLE_PREFIX = "sample:"
"""What stands before the name of a built-in motion where a file could stand."""


def sample_motion(name: str, error: type[PoseloomError] = PoseloomError) -> Motion:
    """A built-in motion by its name, with or without the prefix. Raises `error`, with the valid names."""
    samples = sample_motions()
    bare = name.removeprefix(SAMPLE_PREFIX)
    if bare not in samples:
        raise unknown_name("sample motion", bare, samples, error)
    return samples[bare]


def read_clip(
    clip: str, skeleton: Path | None = None, choices: MotionChoices = NOTHING_SAID, human: bool = False
) -> Motion:
    """A motion on its own skeleton: a built-in one (`sample:walk`), or one of a file, without a drawn rest frame.

    Args:
        clip: Which.
        skeleton: The file of the skeleton, where none stands beside the motion.
        choices: What the user says of a file that does not say it itself.
        human: Refuse a file whose body is human in no unit of length, unless the user gives the unit.

    Raises:
        PoseloomError: for an unknown name, or a file that holds no motion.
    """
    if clip.startswith(SAMPLE_PREFIX):
        return sample_motion(clip)
    motion = read_motion(Path(clip), skeleton, choices=choices)
    if human:
        check_human(motion, Path(clip))
    return drop_rest_frame(motion)
