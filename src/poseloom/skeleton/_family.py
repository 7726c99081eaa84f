"""A way of naming and resting a skeleton's joints, and how its map to the body is written down."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from poseloom.skeleton.body import BODY_BONES

Source = str | tuple[str, str]
"""A source joint, or the joint at which a bone begins and the joint with which it turns."""


@dataclass(frozen=True)
class Family:
    """A way of naming and resting a skeleton's joints.

    Attributes:
        name: What a person calls it.
        bones: For each body bone its source; see the module's head.
        optional: Body bones in `bones` that a file of this family may lack.
        ends: Source joints at which hands and heads end, where several joints branch off.
        frames: For files whose zero pose is no T-pose: where the x, y and z axes of a source joint point in a T-pose
            (left is +X, up +Y, front +Z), such as "+Y -X +Z". Joints without an entry keep the world's axes.
        rolls: Degrees by which a body bone's frame is turned about its own X axis: for upper arms where the family's
            elbows bend about another axis than the body's.
        left_arm: The axis along which the left upper arm points in the zero pose, if that tells this family from
            another with the same names.
        loose_forearms: True if its recordings put any twist into the forearms of straight arms (`share_arm_twist`).
        lost_segment: True if the segment from `upperChest` to neck and shoulders has length zero by a known fault of
            the family's conversion and is to be restored.
        pelvis_deg: By which angle the hip joints lie in front of the plumb line through the hips' joint, in degrees, if
            all of the family's files have the same kind of pelvis.
    """

    name: str
    bones: Mapping[str, Source]
    optional: frozenset[str] = frozenset()
    ends: Mapping[str, str] = field(default_factory=dict[str, str])
    frames: Mapping[str, str] = field(default_factory=dict[str, str])
    rolls: Mapping[str, float] = field(default_factory=dict[str, float])
    left_arm: str = ""
    loose_forearms: bool = False
    lost_segment: bool = False
    pelvis_deg: float | None = None

    def start(self, bone: str) -> str:
        """The source joint where a body bone begins; empty if the family has none."""
        source = self.bones.get(bone, "")
        return source[0] if isinstance(source, tuple) else source

    def turn(self, bone: str) -> str:
        """The source joint with which a body bone turns; empty if the family has none."""
        source = self.bones.get(bone, "")
        return source[1] if isinstance(source, tuple) else source

    def missing(self, names: Iterable[str]) -> list[str]:
        """The joints that this family must have and `names` lacks."""
        present = set(names)
        needed = [joint for bone in self.bones if bone not in self.optional for joint in self._joints(bone)]
        return [joint for joint in dict.fromkeys(needed) if joint not in present]

    def unknown(self, names: Iterable[str]) -> list[str]:
        """The joints in `names` that stand for no body bone."""
        known = {joint for bone in self.bones for joint in self._joints(bone)}
        return [name for name in names if name not in known]

    def _joints(self, bone: str) -> tuple[str, str]:
        return self.start(bone), self.turn(bone)


def both_sides(sides: Mapping[str, str], **bones: Source) -> dict[str, Source]:
    """A map of both sides, in the body's order, from its middle and left bones and the spelling of left and right."""

    def right(joint: str) -> str:
        for left, other in sides.items():
            if left in joint:
                return joint.replace(left, other, 1)
        raise ValueError(f"{joint} is not on the left side")

    whole = dict(bones)
    for bone, source in bones.items():
        if bone.startswith("left"):
            other = (right(source[0]), right(source[1])) if isinstance(source, tuple) else right(source)
            whole[bone.replace("left", "right")] = other
    return {bone: whole[bone] for bone in BODY_BONES if bone in whole}


_PREFIX = re.compile(r"(?:mixamorig\d*[_:]?|Character\d+_|(?:ValveBiped\.)?Bip\d+[ _]|J_Bip_)(?=.)")


def plain_name(name: str) -> str:
    """A joint's name without namespace or its program's prefix: `mixamorig:Hips`, `a:Hips`, `Character1_Hips` are
    `Hips`, and `Bip01_L_Thigh` is `L Thigh`."""
    bare = name.rsplit(":", 1)[-1]
    found = _PREFIX.match(bare)
    if found is None:
        return bare
    rest = bare[found.end() :]
    return rest.replace("_", " ") if "Bip" in found.group() else rest
