"""The built-in motions on the body."""

from functools import cache
from math import ceil
from pathlib import Path

from poseloom.errors import Named
from poseloom.samples.encoding import decode_samples
from poseloom.samples.looping import loop
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.resample import resample
from poseloom.skeleton.retarget import retarget

_FILE = Path(__file__).with_name("motions.npz")
_RATE = 60.0
_SECONDS = 6.0
"""Cyclic motions are repeated for at least this long."""


@cache
def sample_motions() -> dict[str, Motion]:
    """The 15 built-in motions by name, on the body of average size, at 60 Hz, floor at y = 0.

    They are DeepMimic's, made from recordings of the CMU Graphics Lab: backflip, cartwheel, crawl, dance_a, dance_b,
    getup_facedown, getup_faceup, jump, kick, punch, roll, run, spin, spinkick, walk. Those that are cyclic go on for
    six seconds or more, in whole cycles. See PROVENANCE.md beside this file. An unknown name raises a PoseloomError
    that suggests one.
    """
    motions = decode_samples(_FILE).items()
    return Named("sample motion", {name: _on_body(motion, cyclic) for name, (motion, cyclic) in motions})


def sample_motion_names() -> tuple[str, ...]:
    """Names of the built-in motions."""
    return tuple(decode_samples(_FILE))


def _on_body(motion: Motion, cyclic: bool) -> Motion:
    even = resample(motion, _RATE)
    if cyclic:
        even = loop(even, max(2, ceil(_SECONDS / even.duration)))
    return retarget(even, average_body())
