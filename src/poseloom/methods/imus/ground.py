"""The root's path and the feet on the ground.

A pose without a place gets its place from where its feet stand: while a sole's point is in contact the root moves so
that the point does not. Where none is certain to stand the root goes the way that the examples go. The mean of several
examples' legs swings less than any of them, so by standing feet alone the way would be short. What they withhold of the
examples' way is owed, and paid little by little (a complementary filter: feet say how the root moves within a step, the
examples how far it goes). What is left of a foot's sliding is taken up by the legs (Kim et al. 2012 in the paper): each
standing foot is held where it came down, its own orientation kept, and let go gently.
"""

from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Ints
from poseloom.rotations import matrix_from_rotvec, quat_from_matrix, rotvec_from_quat
from poseloom.skeleton.contacts import sole_points
from poseloom.skeleton.kinematics import forward_kinematics, point_jacobians
from poseloom.skeleton.skeleton import Skeleton

_RELEASE = 0.8
"""Share of a foot's displacement that is left a frame after it was let go."""

_LEVELLING = 0.15
"""Share of the standing soles' distance from the floor that is taken off in a frame."""

_DAMPING = 1e-4
_EASE = np.array([1.0, 0.3, 1.0, 1.0, 0.0, 0.0])
"""How easily thigh and shank turn about their axes."""


@dataclass(frozen=True, eq=False)
class Legs:
    """A wearer's legs and soles.

    Attributes:
        skeleton: The wearer's.
        bones: Bones of left heel, left toes, right heel, right toes.
        points: These points in their bones' frames, metres.
        feet: Indices of the left and right foot.
        columns: For each leg the pose vector's columns of thigh and shank.
    """

    skeleton: Skeleton
    bones: Ints[Array, "4"]
    points: Floats[Array, "4 3"]
    feet: Ints[Array, "2"]
    columns: Ints[Array, "2 6"]


class Footing(NamedTuple):
    """How the body is put on its feet.

    Attributes:
        lock: Probability of contact from which on a foot is held.
        limit: Metres by which a held foot may be pulled.
        paid: Share of what is missing of the way that is made up for in a frame.
        kept: Share of what the examples' way is owed that is remembered a frame later.
    """

    lock: float
    limit: float
    paid: float
    kept: float


class Ground(NamedTuple):
    """Where the body is.

    Attributes:
        root: Root place before any leg is bent, metres.
        lift: Metres added to the height that the examples state, so that standing soles are on the floor.
        soles: Places of the sole's points in the last frame.
        standing: Their probabilities of contact.
        held: Where each foot (ankle) is held on the ground; NaN where it is free.
        pulls: How far each foot is pulled from where the pose puts it.
        owed: Metres (x, z) that the examples went of late and the root did not.
    """

    root: Floats[Array, "3"]
    lift: float
    soles: Floats[Array, "4 3"]
    standing: Floats[Array, "4"]
    held: Floats[Array, "2 3"]
    pulls: Floats[Array, "2 3"]
    owed: Floats[Array, "2"]


def make_legs(skeleton: Skeleton) -> Legs:
    """The legs of a wearer. Raises SkeletonError if the skeleton is not the body."""
    names = ("leftFoot", "leftToes", "rightFoot", "rightToes")
    points = [point for side in ("left", "right") for point in sole_points(skeleton, side)]
    columns = [
        [3 + 3 * skeleton.index(f"{side}{bone}") + axis for bone in ("UpperLeg", "LowerLeg") for axis in range(3)]
        for side in ("left", "right")
    ]
    return Legs(
        skeleton,
        np.array([skeleton.index(name) for name in names], dtype=np.int64),
        np.stack(points),
        np.array([skeleton.index("leftFoot"), skeleton.index("rightFoot")], dtype=np.int64),
        np.array(columns, dtype=np.int64),
    )


def start_ground(legs: Legs, q: Floats[Array, "dofs"], standing: Floats[Array, "4"]) -> Ground:
    """The first frame: above the origin, on its lowest sole if a foot stands."""
    soles = _soles(legs, q)
    lift = -float(soles[:, 1].min()) if standing.max() > 0.5 or soles[:, 1].min() < 0 else 0.0
    root = q[:3] + np.array([0.0, lift, 0.0])
    soles = soles + np.array([0.0, lift, 0.0])
    return Ground(root, lift, soles, standing, np.full((2, 3), np.nan), np.zeros((2, 3)), np.zeros(2))


def move(
    legs: Legs,
    ground: Ground,
    q: Floats[Array, "dofs"],
    way: Floats[Array, "2"],
    height: float,
    standing: Floats[Array, "4"],
    missing: Floats[Array, "2"],
    how: Footing,
) -> tuple[Ground, Floats[Array, "dofs"]]:
    """Puts a pose in its place.

    Args:
        legs: The wearer's.
        ground: Where the body was.
        q: The pose, its root's place not looked at.
        way: Metres (x, z) that the examples go in this frame.
        height: Of the root as the examples state it.
        standing: Probability of contact of left heel, left toes, right heel, right toes.
        lock: Probability from which on a foot is held.
        limit: Metres by which a foot may be pulled.

    Returns:
        The new ground, and the pose in its place.
    """
    placed = q.copy()
    placed[[0, 2]] = ground.root[[0, 2]] + way
    placed[1] = height + ground.lift
    soles = _soles(legs, placed)
    both = np.minimum(standing, ground.standing)
    firm = np.clip((both - 0.3) / 0.4, 0.0, 1.0)
    if firm.max() > 0:
        weights = firm / firm.sum()
        slip = weights @ (soles - ground.soles)[:, [0, 2]] * firm.max()
        shift = np.array([-slip[0], 0.0, -slip[1]])
        level = -_LEVELLING * firm.max() * float((firm * soles[:, 1]).sum() / firm.sum())
        sunk = -min(float(soles[:, 1].min()) + level, 0.0)
        shift[1] = level + 0.5 * sunk
        placed[:3] += shift
        soles = soles + shift
    made_up = how.paid * (ground.owed + missing)
    placed[[0, 2]] += made_up
    soles[:, [0, 2]] += made_up
    lift = float(placed[1]) - height
    root = placed[:3].copy()
    owed = how.kept * (ground.owed + way - (root - ground.root)[[0, 2]])
    held, pulls, bent = _hold(legs, ground, placed, standing, how)
    return Ground(root, lift, soles, standing, held, pulls, owed), bent


def _hold(
    legs: Legs, ground: Ground, q: Floats[Array, "dofs"], standing: Floats[Array, "4"], how: Footing
) -> tuple[Floats[Array, "2 3"], Floats[Array, "2 3"], Floats[Array, "dofs"]]:
    """Holds standing feet where they came down, within the limit, and lets others go."""
    ankles = forward_kinematics(legs.skeleton, q).positions[legs.feet]
    held, pulls = ground.held.copy(), ground.pulls * _RELEASE
    out = q
    for side in range(2):
        heel, toe = standing[2 * side], standing[2 * side + 1]
        # A foot that rolls over its toes moves its ankle: it is held only while the whole sole stands.
        if min(heel, toe) < how.lock:
            held[side] = np.nan
        elif np.isnan(held[side, 0]):
            held[side] = ankles[side] + pulls[side]
        else:
            pull = held[side] - ankles[side]
            pull[1] = 0.0
            size = float(np.linalg.norm(pull))
            pulls[side] = pull if size <= how.limit else pull * (how.limit / size)
            held[side] = ankles[side] + pulls[side]
        if float(np.abs(pulls[side]).max()) > 1e-4:
            out = _bend_leg(legs, out, side, ankles[side] + pulls[side])
    return held, pulls, out


def _bend_leg(legs: Legs, q: Floats[Array, "dofs"], side: int, target: Floats[Array, "3"]) -> Floats[Array, "dofs"]:
    """Thigh and shank turned so that the ankle comes to the target; the foot keeps its orientation in the world."""
    skeleton, foot = legs.skeleton, int(legs.feet[side])
    shank = int(skeleton.parents[foot])
    columns = legs.columns[side]
    bone, origin = legs.feet[side : side + 1], np.zeros((1, 3))
    before = forward_kinematics(skeleton, q).rotations[foot]
    out = q.copy()
    there = point_jacobians(skeleton, out, bone, origin)
    jacobian = there.linear[0][:, columns]
    # The knee is a hinge: turning the shank about its other axes is dear. Pulls are short: one step is enough.
    weighted = jacobian * _EASE
    normal = jacobian @ weighted.T + _DAMPING * np.eye(3)
    out[columns] += weighted.T @ cast(NDArray[np.float64], np.linalg.solve(normal, target - there.points[0]))
    shank_turn = forward_kinematics(skeleton, out).rotations[shank]
    at = 3 + 3 * foot
    out[at : at + 3] = rotvec_from_quat(quat_from_matrix(shank_turn.T @ before))
    return out


def _soles(legs: Legs, q: Floats[Array, "dofs"]) -> Floats[Array, "4 3"]:
    frames = forward_kinematics(legs.skeleton, q)
    return frames.positions[legs.bones] + np.einsum("pij,pj->pi", frames.rotations[legs.bones], legs.points)


def heading_turn(angle: float) -> Floats[Array, "3 3"]:
    """The rotation about world up by an angle."""
    return matrix_from_rotvec(np.array([0.0, angle, 0.0]))
