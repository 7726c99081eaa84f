"""Phases of locomotion: the right leg's gait cycle from contacts and ankle crossings, and push-off, flight and landing.

Source: table 1 of the single-IMU paper, which tells the right leg's cycle as eight phases between events of heels, toes
and ankles. Each phase is named by the event that begins it, and the left leg's cycle is the same eight, half a cycle
later (`MIRRORED`):

    initial contact   right heel strikes .. left toes leave      pre-swing       left heel strikes .. right toes leave
    loading response  left toes leave .. left ankle passes       initial swing   right toes leave .. right ankle passes
    mid-stance        left ankle passes .. right heel rises      mid-swing       right ankle passes .. left heel rises
    terminal stance   right heel rises .. left heel strikes      terminal swing  left heel rises .. right heel strikes

Departures: in a run no heel strikes while the other foot stands, so what lies between the two single supports is a
flight; it takes the place of the double support. Standing still is a phase of its own, which the paper does not have.
"""

import enum
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints, frozen
from poseloom.errors import MethodError
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.rotations import heading_angle, quat_from_rotvec
from poseloom.skeleton.contacts import Contacts, contacts, sole_positions
from poseloom.skeleton.differences import derivative
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion


class Phase(enum.IntEnum):
    """A phase of locomotion: of the right leg's gait cycle, or of a leap or side step."""

    INITIAL_CONTACT = 0
    LOADING_RESPONSE = 1
    MID_STANCE = 2
    TERMINAL_STANCE = 3
    PRE_SWING = 4
    INITIAL_SWING = 5
    MID_SWING = 6
    TERMINAL_SWING = 7
    REST = 8
    PUSH_OFF = 9
    FLIGHT = 10
    LANDING = 11

    @property
    def title(self) -> str:
        """The phase's name as people read it."""
        return self.name.lower().replace("_", "-" if self.name.startswith(("MID", "PRE", "PUSH")) else " ")


GAIT_CYCLE = tuple(Phase(value) for value in range(8))
"""The right leg's cycle, in its order."""

LEAP_CYCLE = (Phase.PUSH_OFF, Phase.FLIGHT, Phase.LANDING)
"""What a jump, a hop and a side step go through."""

MIRRORED: Mapping[Phase, Phase] = MappingProxyType(
    {phase: Phase((phase + 4) % 8) if phase < 8 else phase for phase in Phase}
)
"""For each phase of the right leg's cycle the one that the left leg is in, and so the phase of the mirror image."""

LEAPS = frozenset({Behaviour.JUMPING, Behaviour.HOPPING, Behaviour.SIDE_STEPPING})
"""Behaviours whose phases come from contact and speed; all others have the gait cycle's."""

_RUN_FEET = {1: "left", 2: "right"}


@dataclass(frozen=True)
class PhaseSettings:
    """How phases are told.

    Attributes:
        shortest: Seconds below which a phase is taken for a flicker and given to the one before it.
        longest: Seconds above which a segment is cut: standing can go on for minutes.
        still_speed: Speed of the hips, m/s, below which a person who stands on both feet may be at rest.
        still_seconds: How long that must last.
        heel_rise: Metres above its height in loading response from which on a heel has risen: sooner than its contact
            is over for certain, for terminal stance is short.
        leap_speed: Speed of the hips, m/s, from which on a push-off has begun and up to which a landing lasts.
    """

    shortest: float = 0.045
    longest: float = 0.75
    still_speed: float = 0.25
    still_seconds: float = 0.4
    heel_rise: float = 0.015
    leap_speed: float = 0.25


class Segment(NamedTuple):
    """Frames `start` to `stop - 1` of a motion, all in one phase."""

    phase: Phase
    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True, eq=False)
class PhaseTrack:
    """The phases of a motion and what they were told from.

    Attributes:
        phases: For each frame a `Phase`.
        contacts: Which heels and toes stand.
        ahead: How far the right ankle is before the left one, along the heading, metres.
        speed: Of the hips, m/s.
    """

    phases: Ints[Array, "frames"]
    contacts: Contacts
    ahead: Floats[Array, "frames"]
    speed: Floats[Array, "frames"]

    def segments(self, longest: int | None = None) -> tuple[Segment, ...]:
        """Stretches of one phase each, in order; those of more than `longest` frames are cut into equal parts."""
        out: list[Segment] = []
        for start, stop in _runs(self.phases):
            parts = 1 if longest is None else -(-(stop - start) // longest)
            cuts = np.linspace(start, stop, parts + 1).round().astype(int)
            out += [Segment(Phase(int(self.phases[start])), int(a), int(b)) for a, b in pairwise(cuts)]
        return tuple(out)


def label_phases(motion: Motion, behaviour: Behaviour, settings: PhaseSettings | None = None) -> PhaseTrack:
    """The phase of each frame.

    Args:
        motion: On the body, of two frames or more.
        behaviour: What happens in it; decides between the gait cycle and the phases of leaps.
        settings: Limits.

    Raises:
        SkeletonError: if the motion is not on the body.
        MethodError: for a motion of less than two frames.
    """
    if len(motion) < 3:
        raise MethodError(f"{len(motion)} frames have no phases", remedy="Give a motion of three frames or more")
    limits = settings or PhaseSettings()
    stands = contacts(motion)
    velocity = derivative(motion.q[:, :3], motion.rate)
    speed = np.linalg.norm(velocity, axis=1)
    ahead = ankle_lead(motion)
    if behaviour in LEAPS:
        sideways = behaviour is Behaviour.SIDE_STEPPING
        phases = _leap_phases(stands, speed, motion.q[:, 1], sideways, limits)
    else:
        phases = _gait_phases(motion, stands, ahead, speed, limits)
    phases = _without_flicker(phases, max(round(limits.shortest * motion.rate), 1))
    return PhaseTrack(frozen(phases), stands, ahead, speed)


def ankle_lead(motion: Motion) -> Floats[Array, "frames"]:
    """How far the right ankle is before the left one along the hips' heading, metres: zero where the ankles cross."""
    skeleton = motion.skeleton
    positions = motion_frames(motion).positions
    apart = positions[:, skeleton.index("rightFoot")] - positions[:, skeleton.index("leftFoot")]
    heading = heading_angle(quat_from_rotvec(motion.q[:, 3:6]))
    return np.asarray(apart[:, 0] * np.sin(heading) + apart[:, 2] * np.cos(heading))


def _gait_phases(
    motion: Motion,
    stands: Contacts,
    ahead: Floats[Array, "frames"],
    speed: Floats[Array, "frames"],
    limits: PhaseSettings,
) -> Ints[Array, "frames"]:
    soles = sole_positions(motion)[..., 1]
    heels = {"left": soles[:, 0], "right": soles[:, 2]}
    support = stands.left.astype(np.int64) + 2 * stands.right
    phases = np.empty(len(support), dtype=np.int64)
    foot = ""
    still = max(round(limits.still_seconds * motion.rate), 1)
    for start, stop in _runs(support):
        run = slice(start, stop)
        kind = int(support[start])
        if kind in _RUN_FEET:
            foot = _RUN_FEET[kind]
            phases[run] = _single_support(foot, heels[foot][run], ahead[run], limits.heel_rise)
            continue
        came_from_left = foot == "left" if foot else bool(ahead[start] > 0)
        phases[run] = Phase.INITIAL_CONTACT if came_from_left else Phase.PRE_SWING
        if kind == 3:
            for first, last in _runs(speed[run] < limits.still_speed):
                if speed[start + first] < limits.still_speed and last - first >= still:
                    phases[start + first : start + last] = Phase.REST
    return phases


def _single_support(
    foot: str, heel: Floats[Array, "frames"], ahead: Floats[Array, "frames"], rise: float
) -> Ints[Array, "frames"]:
    """Loading response, mid-stance and terminal stance of one foot; on the left they are the right leg's swing."""
    sign = 1.0 if foot == "right" else -1.0
    passed = np.flatnonzero(sign * ahead < 0)
    crossing = int(passed[0]) if passed.size else len(heel)
    standing = np.flatnonzero(heel[crossing:] <= float(np.median(heel[: max(crossing, 1)])) + rise)
    # The last frame on which the heel stands ends mid-stance: before that it may tremble.
    risen = crossing + (int(standing[-1]) + 1 if standing.size else 0)
    out = np.full(len(heel), Phase.LOADING_RESPONSE, dtype=np.int64)
    out[crossing:risen] = Phase.MID_STANCE
    out[risen:] = Phase.TERMINAL_STANCE
    return out if foot == "right" else out + 4


def _leap_phases(
    stands: Contacts,
    speed: Floats[Array, "frames"],
    height: Floats[Array, "frames"],
    sideways: bool,
    limits: PhaseSettings,
) -> Ints[Array, "frames"]:
    grounded = (stands.left & stands.right) if sideways else (stands.left | stands.right)
    fast = speed > limits.leap_speed
    phases = np.full(len(speed), Phase.REST, dtype=np.int64)
    phases[~grounded] = Phase.FLIGHT
    for start, stop in _runs(grounded):
        if not grounded[start]:
            continue
        run = fast[start:stop]
        slow = np.flatnonzero(~run)
        # A landing lasts from touch-down to the first slow frame, a push-off from the last slow frame to take-off;
        # where it is never slow the lowest place of the hips divides the two.
        lowest = int(np.argmin(height[start:stop]))
        landed = (int(slow[0]) if slow.size else lowest) if start > 0 else 0
        pushing = (int(slow[-1]) + 1 if slow.size else lowest) if stop < len(speed) else len(run)
        phases[start : start + landed] = Phase.LANDING
        phases[start + max(pushing, landed) : stop] = Phase.PUSH_OFF
    return phases


def _without_flicker(phases: Ints[Array, "frames"], shortest: int) -> Ints[Array, "frames"]:
    """Phases in which each run has the least length: shorter ones go to the run before, or after at the start."""
    out = phases.copy()
    runs = list(_runs(out))
    for index, (start, stop) in enumerate(runs):
        if stop - start < shortest and len(runs) > 1:
            out[start:stop] = out[start - 1] if index else phases[runs[1][0]]
    return out


def _runs(values: Ints[Array, "frames"] | Bools[Array, "frames"]) -> Iterator[tuple[int, int]]:
    """Start and stop of each stretch of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    yield from pairwise([0, *edges.tolist(), len(values)])
