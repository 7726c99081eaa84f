"""Which sensors a person wears, on which bones, at what rate."""

import enum
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

from poseloom.errors import SensorError, unknown_name


class SensorKind(enum.StrEnum):
    """What a sensor measures.

    TRACKER: position and orientation in the world. IMU: specific force and angular rate in its own frame, and an
    orientation in the world if it says one. FLEX: counts of a converter that follow the bend of one joint.
    """

    TRACKER = "tracker"
    IMU = "imu"
    FLEX = "flex"


@dataclass(frozen=True)
class SensorSpec:
    """One sensor of a layout.

    Attributes:
        name: What it is called, unique within its layout.
        kind: What it measures.
        bone: The bone that wears it; for a flex sensor the bone whose joint it bends with.
    """

    name: str
    kind: SensorKind
    bone: str


@dataclass(frozen=True)
class SensorLayout:
    """A named set of sensors that deliver together. Make one with `make_layout`, which checks, or take one by `layout`.

    Attributes:
        name: What it is called.
        sensors: The sensors, in the order of all arrays' sensor axis.
        rate: Samples a second.
    """

    name: str
    sensors: tuple[SensorSpec, ...]
    rate: float

    def __len__(self) -> int:
        return len(self.sensors)

    @property
    def names(self) -> tuple[str, ...]:
        """The sensors' names in order."""
        return tuple(sensor.name for sensor in self.sensors)

    def index(self, name: str) -> int:
        """Position of a sensor on the sensor axis. Raises SensorError, with the valid names, for an unknown one."""
        names = self.names
        if name not in names:
            raise unknown_name("sensor", name, names, SensorError)
        return names.index(name)

    def of_kind(self, kind: SensorKind) -> tuple[int, ...]:
        """Positions of the sensors of one kind."""
        return tuple(i for i, sensor in enumerate(self.sensors) if sensor.kind is kind)


def make_layout(name: str, sensors: Iterable[SensorSpec], rate: float) -> SensorLayout:
    """Checks a layout and freezes it.

    Raises:
        SensorError: for no sensors, doubled or empty names, or a rate that is not positive and finite.
    """
    specs = tuple(sensors)
    names = [sensor.name for sensor in specs]
    if not specs:
        raise SensorError(f"layout {name!r} has no sensors", remedy="Give at least one sensor")
    doubled = sorted(name for name, count in Counter(names).items() if count > 1)
    if doubled or "" in names:
        wrong = f"doubled sensors {', '.join(doubled)}" if doubled else "sensors without a name"
        raise SensorError(f"layout {name!r} has {wrong}", remedy="Give each sensor a name of its own")
    if not (math.isfinite(rate) and rate > 0):
        raise SensorError(f"layout {name!r} has a rate of {rate} Hz", remedy="Give a positive, finite rate")
    return SensorLayout(name, specs, float(rate))


_TRACKER_RATE = 40.0
_IMU_RATE = 60.0
_FLEX_RATE = 50.0

# Sensor name and bone. An ankle strap sits on the shank, above the ankle: it follows the lower leg, not the foot.
_HEAD_AND_HANDS = (("head", "head"), ("leftHand", "leftHand"), ("rightHand", "rightHand"))
_SIX = (
    ("head", "head"),
    ("upperChest", "upperChest"),
    ("leftHand", "leftHand"),
    ("rightHand", "rightHand"),
    ("leftAnkle", "leftLowerLeg"),
    ("rightAnkle", "rightLowerLeg"),
)
_FOUR_BENDS = (
    ("leftKnee", "leftLowerLeg"),
    ("rightKnee", "rightLowerLeg"),
    ("leftElbow", "leftLowerArm"),
    ("rightElbow", "rightLowerArm"),
)
# Where the field's methods for six IMUs wear them: wrist straps follow the forearm.
_SIX_IMUS = (
    ("hips", "hips"),
    ("head", "head"),
    ("leftWrist", "leftLowerArm"),
    ("rightWrist", "rightLowerArm"),
    ("leftShank", "leftLowerLeg"),
    ("rightShank", "rightLowerLeg"),
)
# Bones that may wear an IMU, by the word that stands in a layout's name.
_IMU_BONES: Mapping[str, str] = {
    "hips": "hips",
    "head": "head",
    **{
        f"{side}-{word}": f"{side}{bone}"
        for side in ("left", "right")
        for word, bone in (
            ("foot", "Foot"),
            ("shank", "LowerLeg"),
            ("thigh", "UpperLeg"),
            ("hand", "Hand"),
            ("forearm", "LowerArm"),
        )
    },
}
_MOST_IMUS = 3


@cache
def _layouts() -> Mapping[str, SensorLayout]:
    made = [
        _named("six-trackers", SensorKind.TRACKER, _SIX, _TRACKER_RATE),
        _named("three-trackers", SensorKind.TRACKER, _HEAD_AND_HANDS, _TRACKER_RATE),
        _named("six-imus", SensorKind.IMU, _SIX_IMUS, _IMU_RATE),
        *(imu_layout(word) for word in _IMU_BONES),
        imu_layout("right-foot", "right-hand"),
        imu_layout("right-foot", "left-hand"),
        _named("flex-four", SensorKind.FLEX, _FOUR_BENDS, _FLEX_RATE),
        make_layout(
            "flex-four+hips-imu",
            [
                *(SensorSpec(sensor, SensorKind.FLEX, bone) for sensor, bone in _FOUR_BENDS),
                SensorSpec("hips", SensorKind.IMU, "hips"),
            ],
            _FLEX_RATE,
        ),
    ]
    return {each.name: each for each in made}


def _named(name: str, kind: SensorKind, sensors: Iterable[tuple[str, str]], rate: float) -> SensorLayout:
    return make_layout(name, (SensorSpec(sensor, kind, bone) for sensor, bone in sensors), rate)


def imu_layout(*words: str, rate: float = _IMU_RATE) -> SensorLayout:
    """A layout of one to three IMUs, named by where they are worn, such as `right-foot+right-hand-imu`.

    Args:
        words: "hips", "head", or left- or right- with foot, shank, thigh, hand or forearm.
        rate: Samples a second.

    Raises:
        SensorError: for an unknown word, none, more than three, or the same one twice.
    """
    unknown = next((word for word in words if word not in _IMU_BONES), None)
    if unknown is not None:
        raise unknown_name("place for an IMU", unknown, _IMU_BONES, SensorError)
    if len(words) > _MOST_IMUS:
        raise SensorError(f"a layout of {len(words)} IMUs", remedy=f"Choose at most {_MOST_IMUS}")
    name = f"{'+'.join(words)}-imu"
    bones = [_IMU_BONES[word] for word in words]
    return make_layout(name, (SensorSpec(bone, SensorKind.IMU, bone) for bone in bones), rate)


def layout_names() -> tuple[str, ...]:
    """Names of the built-in layouts."""
    return tuple(_layouts())


def layout(name: str) -> SensorLayout:
    """A built-in layout, or one to three IMUs at any places, such as `left-shank+right-hand-imu`.

    Raises:
        SensorError: with the valid names, for an unknown one.
    """
    known = _layouts()
    words = name.removesuffix("-imu").split("+")
    if name not in known and name.endswith("-imu") and all(word in _IMU_BONES for word in words):
        return imu_layout(*words)
    if name not in known:
        raise unknown_name("sensor layout", name, known, SensorError)
    return known[name]
