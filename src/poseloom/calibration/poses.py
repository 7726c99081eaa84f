"""The eight poses that a person holds for calibration.

They were chosen among combinations of what arms, legs, trunk and head can easily do, for a small posterior standard
deviation of bone lengths and placements (docs/calibration.md). What counts: hands that bend at the wrist, a head that
moves against the neck, or a sensor's place cannot be told from a bone's length; knees that bend on both sides; feet on
the floor.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import unknown_name
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.contacts import sole_points
from poseloom.skeleton.kinematics import bone_points, forward_kinematics
from poseloom.skeleton.skeleton import Skeleton

Angles = Mapping[str, tuple[float, float, float]]
"""Rotation vectors of joints, degrees; those left out are as in the T-pose."""


@dataclass(frozen=True, eq=False)
class GuidedPose:
    """A pose that a person is asked to hold.

    Attributes:
        name: What it is called.
        title: The same in a few words.
        instruction: What to do, for the person.
        q: Pose vector on the average body, facing +Z, the lowest sole at y = 0.
    """

    name: str
    title: str
    instruction: str
    q: Floats[Array, "dofs"]


def _both(bone: str, x: float, y: float, z: float) -> Angles:
    """A left bone's angles and their mirror image on the right."""
    return {f"left{bone}": (x, y, z), f"right{bone}": (x, -y, -z)}


def _arms(upper: tuple[float, float, float], elbow: float = 0.0, wrist: float = 0.0) -> Angles:
    """Both arms: upper arms as turned, elbows bent, hands bent to their backs (positive) or palms."""
    return {**_both("UpperArm", *upper), **_both("LowerArm", 0.0, -elbow, 0.0), **_both("Hand", 0.0, 0.0, wrist)}


def _head(neck: float, head: float) -> Angles:
    """Neck and head bent forward (positive) or back."""
    return {"neck": (neck, 0.0, 0.0), "head": (head, 0.0, 0.0)}


def _raised(side: str) -> Angles:
    return {f"{side}UpperLeg": (-85.0, 0.0, 0.0), f"{side}LowerLeg": (85.0, 0.0, 0.0)}


_CHIN_OUT, _CHIN_IN = _head(35.0, -35.0), _head(-25.0, 25.0)
_LOOK_DOWN, _LOOK_UP = _head(25.0, 20.0), _head(-25.0, -20.0)
_FOLDED = (0.0, 0.0, -20.0)
_AT_SIDES = (0.0, 0.0, -80.0)
_WIDE = {**_both("UpperLeg", 0.0, 0.0, 28.0), **_both("Foot", 0.0, 0.0, -28.0)}
_SQUAT = {**_both("UpperLeg", -70.0, 0.0, 0.0), **_both("LowerLeg", 95.0, 0.0, 0.0), **_both("Foot", -25.0, 0.0, 0.0)}
_LUNGE: Angles = {
    "leftUpperLeg": (-45.0, 0.0, 0.0),
    "leftLowerLeg": (45.0, 0.0, 0.0),
    "rightUpperLeg": (25.0, 0.0, 0.0),
    "rightLowerLeg": (15.0, 0.0, 0.0),
    "rightFoot": (-10.0, 0.0, 0.0),
}

_POSES: tuple[tuple[str, str, str, Angles], ...] = (
    (
        "arms-out",
        "Arms out",
        "Stand straight, arms straight out to the sides, palms down. Look straight ahead.",
        {},
    ),
    (
        "hands-up",
        "Stop on both sides",
        "Feet wide apart, arms straight out. Bend both hands up at the wrists, as if to say stop. Draw your chin in.",
        {**_arms((0.0, 0.0, 0.0), wrist=65.0), **_WIDE, **_CHIN_IN},
    ),
    (
        "left-heel",
        "Left heel up",
        "Stand on your right leg, left heel up behind you. Upper arms out to the sides, forearms folded in front, "
        "hands hanging down from the wrists. Look down.",
        {**_arms(_FOLDED, 135.0, -60.0), "leftLowerLeg": (90.0, 0.0, 0.0), **_LOOK_DOWN},
    ),
    (
        "right-heel",
        "Right heel up",
        "Stand on your left leg, right heel up behind you. Upper arms out to the sides, forearms folded in front, "
        "wrists straight, palms down. Push your chin forward.",
        {**_arms(_FOLDED, 135.0), "rightLowerLeg": (90.0, 0.0, 0.0), **_CHIN_OUT},
    ),
    (
        "left-knee",
        "Left knee up",
        "Raise your left knee until the thigh is level. Elbows at your sides, forearms forward, palms facing each "
        "other, hands bent outward at the wrists. Look up.",
        {**_arms(_AT_SIDES, 90.0, 65.0), **_raised("left"), **_LOOK_UP},
    ),
    (
        "right-knee",
        "Right knee up",
        "Raise your right knee until the thigh is level. Elbows at your sides, forearms forward, palms facing each "
        "other, hands straight. Push your chin forward.",
        {**_arms(_AT_SIDES, 90.0), **_raised("right"), **_CHIN_OUT},
    ),
    (
        "squat",
        "Squat, arms up",
        "Sit down into the air, knees well bent, back upright, and raise both arms straight up. Draw your chin in.",
        {**_arms((0.0, 0.0, 75.0)), **_SQUAT, **_CHIN_IN},
    ),
    (
        "lunge",
        "Lunge",
        "A long step forward with the left foot, left knee bent. Arms straight out to the sides, hands hanging "
        "from the wrists. Push your chin forward.",
        {**_arms((0.0, 0.0, 0.0), wrist=-65.0), **_LUNGE, **_CHIN_OUT},
    ),
)  # fmt: skip


@cache
def guided_poses() -> tuple[GuidedPose, ...]:
    """The eight poses, in the order in which they are held."""
    return tuple(GuidedPose(name, title, text, _vector(angles)) for name, title, text, angles in _POSES)


def guided_pose(name: str) -> GuidedPose:
    """One of the poses. Raises PoseloomError, with the valid names, for an unknown one."""
    poses = {pose.name: pose for pose in guided_poses()}
    if name not in poses:
        raise unknown_name("guided pose", name, poses)
    return poses[name]


def _vector(angles: Angles) -> Floats[Array, "dofs"]:
    body = average_body()
    q = np.zeros(body.size)
    for bone, degrees in angles.items():
        at = 3 + 3 * BODY_BONES.index(bone)
        q[at : at + 3] = np.radians(degrees)
    return frozen_float(stood_on_floor(body, q))


def stood_on_floor(body: Skeleton, q: Floats[Array, "dofs"]) -> Floats[Array, "dofs"]:
    """The pose raised or lowered until its lowest sole is at y = 0."""
    grounded = q.copy()
    grounded[1] -= sole_heights(body, q).min()
    return grounded


def sole_heights(body: Skeleton, q: Floats[Array, "dofs"]) -> Floats[Array, "2 2"]:
    """Heights of heel and toe, left foot and then right, metres."""
    frames = forward_kinematics(body, q)
    heights = [
        bone_points(frames, body.index(f"{side}{bone}"), point)[1]
        for side in ("left", "right")
        for bone, point in zip(("Foot", "Toes"), sole_points(body, side), strict=True)
    ]
    return np.array(heights).reshape(2, 2)
