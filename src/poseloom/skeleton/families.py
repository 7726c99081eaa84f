"""Which source joint stands for which bone of the body: one readable map for each naming family.

In a map, `"leftUpperArm": "lhumerus"` says that the body's bone begins where the source joint `lhumerus` begins and
turns with it. A pair, `"head": ("upperneck", "head")`, says that it begins at the first and turns with the second.
Bones that are absent from a map turn with the body bone that carries them and lie on the straight line to the next one.
The right side follows from the left one and the family's spelling of left and right.
"""

from dataclasses import replace

import numpy as np

from poseloom.errors import RetargetError
from poseloom.skeleton._family import Family, Source, both_sides, plain_name
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.skeleton import Skeleton

__all__ = ["FAMILIES", "Family", "plain_name", "recognise"]

_TOES = frozenset({"leftToes", "rightToes"})
_ELBOW_ROLL = {"leftUpperArm": -30.0, "rightUpperArm": -30.0}
"""In CMU's model the elbow's axis is rolled: a straight arm in the T-pose bends forward and 30 degrees up."""

_CMU_PELVIS = 23.0
"""Mean over 161 of CMU's and HDM05's recordings, 22.5 +- 3.5 degrees."""

CMU_ASF = Family(
    "CMU ASF/AMC (also HDM05)",
    both_sides(
        {"l": "r"},
        hips="root",
        spine="lowerback",
        chest="upperback",
        upperChest="thorax",
        neck="lowerneck",
        head=("upperneck", "head"),
        leftShoulder="lclavicle",
        leftUpperArm="lhumerus",
        leftLowerArm=("lradius", "lwrist"),
        leftHand=("lwrist", "lhand"),
        leftUpperLeg="lfemur",
        leftLowerLeg="ltibia",
        leftFoot="lfoot",
        leftToes="ltoes",
    ),
    rolls=_ELBOW_ROLL,
    left_arm="+X",
    loose_forearms=True,
    pelvis_deg=_CMU_PELVIS,
)
"""Acclaim files of CMU's and HDM05's Vicon BodyBuilder model. `lwrist` rolls the forearm, `lhand` bends the wrist."""

CMU_ASF_BVH = replace(
    CMU_ASF,
    name="CMU ASF names in BVH, axes as in the ASF",
    frames={
        "lhumerus": "-Y -X -Z",
        "lradius": "-Y -X -Z",
        "lwrist": "-Z -X +Y",
        "lhand": "-Z -X +Y",
        "lfingers": "-Z -X +Y",
        "rhumerus": "+Y +X -Z",
        "rradius": "+Y +X -Z",
        "rwrist": "+Z +X +Y",
        "rhand": "+Z +X +Y",
        "rfingers": "+Z +X +Y",
        "lfoot": "+X -Z +Y",
        "ltoes": "+X -Z +Y",
        "rfoot": "+X -Z +Y",
        "rtoes": "+X -Z +Y",
    },
    rolls={},
    left_arm="-Y",
)
"""A BVH conversion whose joints have the ASF's own axes: in its zero pose arms hang with the elbows to the front, and
the feet point down."""

CMU_BVH = Family(
    "CMU BVH for MotionBuilder (also the exponential-map CSV)",
    both_sides(
        {"Left": "Right"},
        hips="Hips",
        spine="LowerBack",
        chest="Spine",
        upperChest="Spine1",
        neck="Neck",
        head=("Neck1", "Head"),
        leftShoulder="LeftShoulder",
        leftUpperArm="LeftArm",
        leftLowerArm=("LeftForeArm", "LeftHand"),
        leftHand=("LeftHand", "LeftFingerBase"),
        leftUpperLeg="LeftUpLeg",
        leftLowerLeg="LeftLeg",
        leftFoot="LeftFoot",
        leftToes="LeftToeBase",
    ),
    rolls=_ELBOW_ROLL,
    loose_forearms=True,
    pelvis_deg=_CMU_PELVIS,
    lost_segment=True,
)
"""`LeftHand` is the ASF's `lwrist`; two segments of length zero have lost the thorax and the wrist."""

CMU_BVH_MAX = Family(
    "CMU BVH for 3ds Max",
    both_sides(
        {"Left": "Right", "lhand": "rhand"},
        hips="Hips",
        spine="lowerback",
        chest="Chest",
        upperChest="Chest2",
        neck="lowerneck",
        head=("Neck", "Head"),
        leftShoulder="LeftCollar",
        leftUpperArm="LeftShoulder",
        leftLowerArm=("LeftElbow", "LeftWrist"),
        leftHand=("LeftWrist", "lhand"),
        leftUpperLeg="LeftHip",
        leftLowerLeg="LeftKnee",
        leftFoot="LeftAnkle",
        leftToes="LeftToe",
    ),
    rolls=_ELBOW_ROLL,
    loose_forearms=True,
    pelvis_deg=_CMU_PELVIS,
    lost_segment=True,
)
"""The same conversion with other names and hanging arms at rest."""

CMU_BVH_DAZ = Family(
    "CMU BVH for DAZ and Poser",
    both_sides(
        {"l": "r"},
        hips="hip",
        spine="abdomen",
        upperChest="chest",
        neck="neck",
        head="head",
        leftShoulder="lCollar",
        leftUpperArm="lShldr",
        leftLowerArm="lForeArm",
        leftHand="lHand",
        leftUpperLeg="lThigh",
        leftLowerLeg="lShin",
        leftFoot="lFoot",
    ),
    ends={"leftHand": "lMid1", "rightHand": "rMid1"},
    rolls={**_ELBOW_ROLL, "head": 18.0},
    loose_forearms=True,
)
"""CMU's motions on a figure of fixed size with two joints in the trunk; the foot's end site is where toes begin. The
head has no direction in the file; against the ASF of the same take (11_01) it is pitched by 17.7 +- 0.8 degrees."""


def _trunk(*joints: str) -> dict[str, Source]:
    """Which of so many trunk joints stand for the body's three; the last one carries neck and shoulders."""
    if len(joints) < 3:
        return dict(zip(("spine", "upperChest")[-len(joints) :], joints, strict=True))
    return {"spine": joints[0], "chest": joints[(len(joints) - 1) // 2], "upperChest": joints[-1]}


_MOTIONBUILDER: dict[str, Source] = {
    "neck": "Neck",
    "head": "Head",
    "leftShoulder": "LeftShoulder",
    "leftUpperArm": "LeftArm",
    "leftLowerArm": "LeftForeArm",
    "leftHand": "LeftHand",
    "leftUpperLeg": "LeftUpLeg",
    "leftLowerLeg": "LeftLeg",
    "leftFoot": "LeftFoot",
    "leftToes": "LeftToeBase",
}
_MIDDLE_FINGERS = {"head": "HeadTop_End", "leftHand": "LeftHandMiddle1", "rightHand": "RightHandMiddle1"}

MIXAMO = Family(
    "Mixamo",
    both_sides({"Left": "Right"}, hips="Hips", **_trunk("Spine", "Spine1", "Spine2"), **_MOTIONBUILDER),
    optional=_TOES,
    ends=_MIDDLE_FINGERS,
)
"""Also MotionBuilder's own names (`Character1_...`)."""

MOTIONBUILDER: tuple[Family, ...] = tuple(
    replace(
        MIXAMO,
        name=f"MotionBuilder with {len(trunk)} trunk joint{'s' if len(trunk) > 1 else ''}",
        bones=both_sides({"Left": "Right"}, hips="Hips", **_trunk(*trunk), **_MOTIONBUILDER),
    )
    for trunk in (
        ("Spine", "Spine1", "Spine2", "Spine3", "Spine4"),
        ("Spine", "Spine1", "Spine2", "Spine3"),
        ("Spine", "Spine1"),
        ("Spine",),
    )
)

LAFAN1 = replace(
    MIXAMO,
    name="LAFAN1",
    bones={
        bone: {"leftToes": "LeftToe", "rightToes": "RightToe"}.get(bone, joint) for bone, joint in MIXAMO.bones.items()
    },
    optional=frozenset(),
)

ROKOKO = Family(
    "Rokoko",
    both_sides(
        {"Left": "Right"},
        hips="Hips",
        **_trunk("Spine1", "Spine2", "Spine3", "Spine4"),
        **{**_MOTIONBUILDER, "leftUpperLeg": "LeftThigh", "leftLowerLeg": "LeftShin", "leftToes": "LeftToe"},
    ),
    optional=_TOES,
)

_BIPED: dict[str, Source] = {
    "neck": "Neck",
    "head": "Head",
    "leftShoulder": "L Clavicle",
    "leftUpperArm": "L UpperArm",
    "leftLowerArm": "L Forearm",
    "leftHand": "L Hand",
    "leftUpperLeg": "L Thigh",
    "leftLowerLeg": "L Calf",
    "leftFoot": "L Foot",
    "leftToes": "L Toe0",
}
BIPED: tuple[Family, ...] = tuple(
    Family(
        f"3ds Max biped with {count} trunk joint{'s' if count > 1 else ''}",
        both_sides({"L ": "R "}, hips="Pelvis", **_trunk(*("Spine", "Spine1", "Spine2", "Spine3")[:count]), **_BIPED),
        optional=_TOES,
        ends={"leftHand": "L Finger2", "rightHand": "R Finger2"},
    )
    for count in (4, 3, 2, 1)
)
"""`Bip01 L Thigh`, `Bip001_L_Thigh` and the like."""

MOCOPI = Family(
    "mocopi",
    both_sides(
        {"l_": "r_"},
        hips="root",
        **_trunk("torso_1", "torso_2", "torso_3", "torso_4", "torso_5", "torso_6", "torso_7"),
        neck="neck_1",
        head="head",
        leftShoulder="l_shoulder",
        leftUpperArm="l_up_arm",
        leftLowerArm="l_low_arm",
        leftHand="l_hand",
        leftUpperLeg="l_up_leg",
        leftLowerLeg="l_low_leg",
        leftFoot="l_foot",
        leftToes="l_toes",
    ),
    optional=_TOES,
)

_SLIMEVR_ARM = ("UPPER_SHOULDER", "SHOULDER", "UPPER_ARM", "LOWER_ARM", "HAND", "HIP")
SLIMEVR = Family(
    "SlimeVR",
    both_sides(
        {"LEFT": "RIGHT"},
        hips=("LEFT_HIP", "HIP"),
        spine=("HIP", "WAIST"),
        chest=("WAIST", "CHEST"),
        upperChest=("CHEST", "UPPER_CHEST"),
        neck=("UPPER_CHEST", "NECK"),
        head=("NECK", "HEAD"),
        leftShoulder=("LEFT_UPPER_SHOULDER", "LEFT_SHOULDER"),
        leftUpperArm="LEFT_UPPER_ARM",
        leftLowerArm="LEFT_LOWER_ARM",
        leftHand="LEFT_HAND",
        leftUpperLeg="LEFT_UPPER_LEG",
        leftLowerLeg="LEFT_LOWER_LEG",
        leftFoot="LEFT_FOOT",
    ),
    optional=frozenset({"leftHand", "rightHand", "upperChest"}),
    ends={"head": "HEAD"},
    frames={
        **{f"LEFT_{joint}": "+Y -X +Z" for joint in _SLIMEVR_ARM},
        **{f"RIGHT_{joint}": "-Y +X +Z" for joint in _SLIMEVR_ARM},
        "LEFT_FOOT": "+X -Z +Y",
        "RIGHT_FOOT": "+X -Z +Y",
    },
)
"""The head is the root, the trunk hangs from it, and every bone lies along its joint's -Y axis: a trunk bone of the
body begins where the joint below begins and turns with the one above."""

XSENS = Family(
    "Xsens MVN BVH",
    both_sides(
        {"Left": "Right"},
        hips="Hips",
        spine="Chest",
        chest="Chest2",
        upperChest="Chest4",
        neck="Neck",
        head="Head",
        leftShoulder="LeftCollar",
        leftUpperArm="LeftShoulder",
        leftLowerArm="LeftElbow",
        leftHand="LeftWrist",
        leftUpperLeg="LeftHip",
        leftLowerLeg="LeftKnee",
        leftFoot="LeftAnkle",
        leftToes="LeftToe",
    ),
    optional=_TOES,
)
"""Of the four spine joints `Chest3` is bridged: the body's chest points from `Chest2` to `Chest4`."""

BANDAI = Family(
    "Bandai-Namco-Research Motiondataset",
    both_sides(
        {"_L": "_R"},
        hips="Hips",
        spine="Spine",
        upperChest="Chest",
        neck="Neck",
        head="Head",
        leftShoulder="Shoulder_L",
        leftUpperArm="UpperArm_L",
        leftLowerArm="LowerArm_L",
        leftHand="Hand_L",
        leftUpperLeg="UpperLeg_L",
        leftLowerLeg="LowerLeg_L",
        leftFoot="Foot_L",
        leftToes="Toes_L",
    ),
    frames={
        "Hips": "+Y -X +Z",
        "Spine": "+Y +Z +X",
        "Chest": "+Y +Z +X",
        "Neck": "+Y +Z +X",
        "Head": "+Y +Z +X",
        "UpperLeg_L": "-Y +X +Z",
        "LowerLeg_L": "-Y +X +Z",
        "Foot_L": "+Z +X +Y",
        "Toes_L": "+Z +X +Y",
        "Shoulder_R": "+X -Y -Z",
        "UpperArm_R": "+X -Y -Z",
        "LowerArm_R": "+X -Y -Z",
        "Hand_R": "+X -Y -Z",
        "UpperLeg_R": "+Y +X -Z",
        "LowerLeg_R": "+Y +X -Z",
        "Foot_R": "-Z +X -Y",
        "Toes_R": "-Z +X -Y",
    },
)
"""Each joint's x axis lies along its bone, so the zero pose is none that a body could take."""

DEEPMIMIC = Family(
    "DeepMimic",
    both_sides(
        {"left": "right"},
        hips="root",
        upperChest="chest",
        neck="neck",
        leftUpperArm="left_shoulder",
        leftLowerArm="left_elbow",
        leftHand="left_wrist",
        leftUpperLeg="left_hip",
        leftLowerLeg="left_knee",
        leftFoot="left_ankle",
    ),
    optional=frozenset({"leftHand", "rightHand"}),
)
"""One joint in the trunk, no collar bones, no wrists or toes that turn."""

BODY = Family(
    "poseloom's body and VRM",
    {bone: bone for bone in BODY_BONES},
    optional=_TOES | {"chest", "upperChest", "neck", "leftShoulder", "rightShoulder"},
    ends={"leftHand": "leftMiddleProximal", "rightHand": "rightMiddleProximal"},
)

UNITY = replace(
    BODY,
    name="Unity humanoid",
    bones={bone: bone[0].upper() + bone[1:] for bone in BODY_BONES},
    ends={"leftHand": "LeftMiddleProximal", "rightHand": "RightMiddleProximal"},
)

VROID = Family(
    "VRoid",
    both_sides(
        {"L ": "R "},
        hips="C Hips",
        **_trunk("C Spine", "C Chest", "C UpperChest"),
        neck="C Neck",
        head="C Head",
        leftShoulder="L Shoulder",
        leftUpperArm="L UpperArm",
        leftLowerArm="L LowerArm",
        leftHand="L Hand",
        leftUpperLeg="L UpperLeg",
        leftLowerLeg="L LowerLeg",
        leftFoot="L Foot",
        leftToes="L ToeBase",
    ),
    optional=_TOES,
    ends={"leftHand": "L Middle1", "rightHand": "R Middle1"},
)
"""`J_Bip_L_UpperArm` and the like."""

FAMILIES: tuple[Family, ...] = (
    BODY,
    CMU_ASF,
    CMU_ASF_BVH,
    CMU_BVH,
    CMU_BVH_MAX,
    CMU_BVH_DAZ,
    *MOTIONBUILDER[:2],
    LAFAN1,
    MIXAMO,
    ROKOKO,
    XSENS,
    BANDAI,
    DEEPMIMIC,
    UNITY,
    VROID,
    *BIPED,
    MOCOPI,
    SLIMEVR,
    *MOTIONBUILDER[2:],
)
"""All families; the first that fits is taken."""


def recognise(skeleton: Skeleton) -> Family:
    """The family of a skeleton, by the names of its joints.

    Raises:
        RetargetError: if no family fits; it says what the nearest lacks, which joints that one does not know, and lists
            the families.
    """
    names = [plain_name(name) for name in skeleton.names]
    fitting = [family for family in FAMILIES if not family.missing(names)]
    if fitting:
        return next((family for family in fitting if _rests(skeleton, names, family)), fitting[0])
    nearest = min(FAMILIES, key=lambda family: len(family.missing(names)) / len(family.bones))
    lacking = nearest.missing(names)
    unmapped = ", ".join(nearest.unknown(names)) or "none"
    raise RetargetError(
        f"the skeleton's joint names belong to no known family; unmapped: {unmapped}",
        cause=f"the nearest family, {nearest.name}, also needs: {', '.join(lacking)}",
        remedy="Rename the joints after one of the families: " + "; ".join(family.name for family in FAMILIES),
    )


def _rests(skeleton: Skeleton, names: list[str], family: Family) -> bool:
    """Whether the left upper arm rests as the family wants it, if it wants it in any way, to within 45 degrees."""
    if not family.left_arm:
        return True
    arm = skeleton.offsets[names.index(family.start("leftLowerArm"))]
    axis = "XYZ".index(family.left_arm[1])
    along = arm[axis] if family.left_arm[0] == "+" else -arm[axis]
    return bool(along > 0.7 * np.linalg.norm(arm))
