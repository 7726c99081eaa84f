"""No jump in what is shown: where an estimate finds itself anew, the figure glides there from where it was.

A method may take up sensors that come back at once, and its estimate then leaps to where they are. What it speaks of
keeps the difference and lets it fade (inertialisation: Bollo, "Inertialization: High-Performance Animation Transitions
in Gears of War", Game Developers Conference 2018), as slowly as a limit on the joints' speed asks. Nothing is changed
unless the estimate leaps while it is watched.
"""

from dataclasses import dataclass, replace

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.rotations import matrix_from_rotvec, nearest_branch, rotvec_from_matrix
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.skeleton.skeleton import Skeleton

_STOPS = 7
"""Poses on the way along which its length is measured."""
_FASTEST_PLACE, _FASTEST_TURN = 3.0, 10.0
"""Metres and radians a second by which figure and estimate are taken to move differently; more is another leap."""
_STEEPEST = 1.875
"""Steepest slope of the curve along which a difference fades, for one that fades in one second."""


@dataclass(frozen=True)
class GlideSettings:
    """What counts as a leap, and how fast the figure follows it.

    Attributes:
        leap: Metres by which a joint may miss where its movement leads to; more is a leap.
        speed: Most metres a second that any joint is moved beyond its own movement, while `longest` allows it.
        shortest: Seconds of a glide at least.
        longest: And at most: a figure that was left far behind comes faster than `speed`.
        watch: Seconds after trouble for which leaps are still put down to it.
    """

    leap: float = 0.06
    speed: float = 3.0
    shortest: float = 0.3
    longest: float = 4.0
    watch: float = 0.25


@dataclass(frozen=True, eq=False)
class Glide:
    """What is remembered from frame to frame.

    Attributes:
        time: Device time of the last frame, seconds.
        shown: The last pose that was spoken of.
        passed: Seconds between the frame before and the last; 0 where there was none.
        before: The pose that was spoken of in the frame before.
        offset: What was added to the estimate when the glide began: metres of the root's place, then each bone's
            rotation vector in the world, which a twist that one bone takes over from the next leaves in place; None
            while nothing is added.
        rate: How the offset changed when the glide began, a second: the difference between how the figure moved and
            how the estimate does, which fades too.
        began: Device time at which the glide began.
        lasts: Seconds that it lasts.
        watched_until: Device time up to which leaps are looked for.
    """

    time: float
    shown: Floats[Array, "dofs"]
    passed: float
    before: Floats[Array, "dofs"]
    offset: Floats[Array, "dofs"] | None = None
    rate: Floats[Array, "dofs"] | None = None
    began: float = 0.0
    lasts: float = 0.0
    watched_until: float = -np.inf


def glide_to(
    glide: Glide | None,
    skeleton: Skeleton,
    q: Floats[Array, "dofs"],
    time: float,
    troubled: bool,
    settings: GlideSettings,
) -> tuple[Glide, Floats[Array, "dofs"]]:
    """What to remember and what to show, given the next estimate.

    Args:
        glide: What was remembered; None before the first frame, which is shown as it is.
        skeleton: The wearer's.
        q: The estimated pose.
        time: Its device time, later than the last.
        troubled: Whether the method has just begun anew: then, and for a while after, leaps are looked for. Never
            without trouble, so that what a method makes of sound sensors is shown as it is.
        settings: What counts as a leap, and how fast the figure follows it.
    """
    if glide is None:
        return Glide(time, q, 0.0, q), q
    until = time + settings.watch if troubled else glide.watched_until
    passed = max(time - glide.time, 1e-3)
    now = replace(glide, time=time, passed=passed, before=glide.shown, watched_until=until)
    if now.offset is not None and time - now.began >= now.lasts:
        now = replace(now, offset=None, rate=None)
    shown = q if now.offset is None else _added(skeleton, q, _remaining(now, settings), glide.shown)
    if time <= until:
        # Samples may come closer together than they are apart in time: never on by more than the last movement.
        share = min(passed / glide.passed, 1.0) if glide.passed else 0.0
        movement = share * _difference(skeleton, glide.shown, glide.before)
        led = _added(skeleton, glide.shown, movement, glide.shown)
        if _distance(skeleton, shown, led) > settings.leap:
            now, shown = _aimed(glide, now, skeleton, q, led, settings), led
    return replace(now, shown=shown), shown


def _aimed(
    glide: Glide,
    now: Glide,
    skeleton: Skeleton,
    q: Floats[Array, "dofs"],
    led: Floats[Array, "dofs"],
    settings: GlideSettings,
) -> Glide:
    """A glide that begins now, where the figure's own movement led, and ends at the estimate."""
    offset, rate = _difference(skeleton, led, q), np.zeros_like(q)
    if glide.offset is not None and glide.began == glide.time:
        # The estimate leapt a frame ago. By now it shows how it moves, and the figure moves otherwise.
        offset[3:] = nearest_branch(offset[3:].reshape(-1, 3), glide.offset[3:].reshape(-1, 3)).ravel()
        rate = (offset - glide.offset) / now.passed
        rate[:3] = np.clip(rate[:3], -_FASTEST_PLACE, _FASTEST_PLACE)
        rate[3:] = np.clip(rate[3:], -_FASTEST_TURN, _FASTEST_TURN)
    lasts = _STEEPEST * _way(skeleton, q, offset) / settings.speed
    lasts = float(np.clip(lasts, settings.shortest, settings.longest))
    return replace(now, offset=offset, rate=rate, began=now.time, lasts=lasts)


def _remaining(glide: Glide, settings: GlideSettings) -> Floats[Array, "dofs"]:
    """What is added to the estimate at the last frame (see `Glide.offset`); zeros while nothing is.

    Two polynomials of the fifth degree, whose speed and acceleration end at zero: the offset fades over the whole
    glide, what is left of its rate over the shortest one.
    """
    if glide.offset is None or glide.rate is None:
        return np.zeros_like(glide.shown)
    passed = glide.time - glide.began
    s, u = min(passed / glide.lasts, 1.0), min(passed / settings.shortest, 1.0)
    moved = settings.shortest * u * (1.0 - u * u * (6.0 - 8.0 * u + 3.0 * u * u))
    return (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s * s)) * glide.offset + moved * glide.rate


def _distance(skeleton: Skeleton, one: Floats[Array, "dofs"], other: Floats[Array, "dofs"]) -> float:
    """Metres between the places that two poses give to the joint on which they agree least."""
    gaps = forward_kinematics(skeleton, one).positions - forward_kinematics(skeleton, other).positions
    return float(np.linalg.norm(gaps, axis=1).max())


def _difference(skeleton: Skeleton, start: Floats[Array, "dofs"], end: Floats[Array, "dofs"]) -> Floats[Array, "dofs"]:
    """What leads from the end back to the start."""
    first, second = forward_kinematics(skeleton, start), forward_kinematics(skeleton, end)
    turns = rotvec_from_matrix(first.rotations @ np.swapaxes(second.rotations, -1, -2))
    return np.concatenate([start[:3] - end[:3], turns.ravel()])


def _added(
    skeleton: Skeleton, q: Floats[Array, "dofs"], offset: Floats[Array, "dofs"], reference: Floats[Array, "dofs"]
) -> Floats[Array, "dofs"]:
    """The pose with an offset, its rotation vectors on the branches of a reference."""
    bones = matrix_from_rotvec(offset[3:].reshape(-1, 3)) @ forward_kinematics(skeleton, q).rotations
    parents = bones[skeleton.parents]
    parents[skeleton.parents < 0] = np.eye(3)
    rotvecs = rotvec_from_matrix(np.swapaxes(parents, -1, -2) @ bones)
    return np.concatenate([q[:3] + offset[:3], nearest_branch(rotvecs, reference[3:].reshape(-1, 3)).ravel()])


def _way(skeleton: Skeleton, q: Floats[Array, "dofs"], offset: Floats[Array, "dofs"]) -> float:
    """Metres that the joint with the longest way goes as an offset fades to nothing."""
    shares = np.linspace(0.0, 1.0, _STOPS)
    places = np.stack(
        [forward_kinematics(skeleton, _added(skeleton, q, share * offset, q)).positions for share in shares]
    )
    return float(np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0).max())
