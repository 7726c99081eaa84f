"""Which locomotion a clip shows: by its name where that says it, by how it moves where it does not."""

import enum
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools
from poseloom.rotations import heading_angle, quat_from_rotvec
from poseloom.skeleton.contacts import contacts
from poseloom.skeleton.motion import Motion

_WINDOW = 0.5
"""Seconds over which the root's way is looked at: about half a step."""


class Behaviour(enum.StrEnum):
    """A kind of locomotion."""

    WALKING = "walking"
    RUNNING = "running"
    JUMPING = "jumping"
    HOPPING = "hopping"
    SIDE_STEPPING = "side-stepping"
    TURNING = "turning"
    IDLE = "idle"
    OTHER = "other"


_WORDS: Mapping[str, Behaviour] = MappingProxyType(
    {
        "walk": Behaviour.WALKING,
        "walking": Behaviour.WALKING,
        "sneak": Behaviour.WALKING,
        "run": Behaviour.RUNNING,
        "running": Behaviour.RUNNING,
        "jog": Behaviour.RUNNING,
        "jump": Behaviour.JUMPING,
        "jumping": Behaviour.JUMPING,
        "hop": Behaviour.HOPPING,
        "hopping": Behaviour.HOPPING,
        "signal": Behaviour.IDLE,
        "directing": Behaviour.IDLE,
    }
)
"""Words of a clip's tags that tell the behaviour of all of it."""

_MORE_THAN_ONE = frozenset({"playground", "climb", "swing", "balance", "exercise", "dance", "basketball", "soccer"})
"""Words of clips in which several things happen: their movement decides."""


class Movement(NamedTuple):
    """How a motion moves over the ground, as shares of its frames and means over them.

    Attributes:
        speed: Median horizontal speed of the hips, m/s.
        sideways: Share of the way that goes to a side rather than ahead or back, 0 to 1.
        turning: Median speed of the heading, rad/s.
        flight: Share of frames in which neither foot stands.
        together: Share of the flights that begin from both feet at once and end on both.
        one_legged: Share of the flights that begin and end on the same single foot.
    """

    speed: float
    sideways: float
    turning: float
    flight: float
    together: float
    one_legged: float


def behaviour_of(tags: Iterable[str], motion: Motion) -> Behaviour:
    """The behaviour of a clip.

    Args:
        tags: Words for what happens in it (`Clip.tags`); one known word decides, unless the words tell of a medley.
        motion: What happens; decides where the words do not. On the body.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    words = [word.lower() for word in tags]
    found = {_WORDS[word] for word in words if word in _WORDS}
    if len(found) == 1 and not _MORE_THAN_ONE & set(words):
        return found.pop()
    return behaviour_of_movement(movement_of(motion))


def behaviour_of_movement(movement: Movement) -> Behaviour:
    """The behaviour that a movement is most like."""
    m = movement
    if m.flight > 0.04 and m.speed < 1.8 and m.one_legged > 0.5:
        return Behaviour.HOPPING
    if m.flight > 0.04 and m.speed < 1.8 and m.together > 0.5:
        return Behaviour.JUMPING
    if m.speed > 1.7 and m.flight > 0.08:
        return Behaviour.RUNNING
    if m.speed > 0.25 and m.sideways > 0.7:
        return Behaviour.SIDE_STEPPING
    if m.speed > 0.45:
        return Behaviour.WALKING
    if m.turning > 0.6:
        return Behaviour.TURNING
    return Behaviour.IDLE if m.speed < 0.15 else Behaviour.OTHER


def movement_of(motion: Motion) -> Movement:
    """How a motion moves over the ground.

    Raises:
        SkeletonError: if the motion is not on the body.
    """
    reach = min(max(round(_WINDOW * motion.rate), 1), max(len(motion) - 1, 1))
    if len(motion) < 2:
        return Movement(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    ground = motion.q[:, [0, 2]]
    heading = np.unwrap(heading_angle(quat_from_rotvec(motion.q[:, 3:6])))
    way = (ground[reach:] - ground[:-reach]) * motion.rate / reach
    turn = (heading[reach:] - heading[:-reach]) * motion.rate / reach
    middle = heading[reach // 2 : reach // 2 + len(way)]
    ahead = way[:, 0] * np.sin(middle) + way[:, 1] * np.cos(middle)
    aside = way[:, 0] * np.cos(middle) - way[:, 1] * np.sin(middle)
    total = np.abs(ahead).sum() + np.abs(aside).sum()
    stands = contacts(motion)
    together, one_legged = _flights(stands.left, stands.right, motion.rate)
    return Movement(
        float(np.median(np.linalg.norm(way, axis=1))),
        float(np.abs(aside).sum() / total) if total > 0 else 0.0,
        float(np.median(np.abs(turn))),
        float((~stands.left & ~stands.right).mean()),
        together,
        one_legged,
    )


def _flights(left: Bools[Array, "frames"], right: Bools[Array, "frames"], rate: float) -> tuple[float, float]:
    """Shares of the flights from and to both feet, and from and to one and the same foot."""
    near = max(round(0.08 * rate), 1)
    airborne = ~left & ~right
    edges = np.diff(airborne.astype(np.int8))
    starts = np.flatnonzero(edges == 1) + 1
    both = single = count = 0
    for start in starts:
        landings = np.flatnonzero(edges[start:] == -1)
        if landings.size == 0:
            continue
        stop = int(start + landings[0] + 1)
        if (stop - start) / rate < 0.06:
            continue
        count += 1
        before = slice(max(int(start) - near, 0), int(start))
        after = slice(stop, stop + near)
        feet = [(bool(foot[before].any()), bool(foot[after].any())) for foot in (left, right)]
        both += all(on and off for on, off in feet)
        single += sorted(feet) == [(False, False), (True, True)]
    return (both / count, single / count) if count else (0.0, 0.0)
