"""What makes two moments alike: numbers whose distance says how near two short histories and sensor readings are.

A moment is described by the last few poses, seen from the ground point and along the heading of the newest one, and, if
wished, by the sensors at the moment itself, seen from the ground below the chest sensor. Rotations enter as two columns
of their matrices: distances then know no wraps, which rotation vectors and Euler angles have.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.library import _kernels
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.skeleton import Skeleton

_BONE_WEIGHTS = {
    "spine": 1.0,
    "chest": 1.0,
    "upperChest": 1.0,
    "neck": 0.5,
    "head": 0.5,
    "Shoulder": 0.7,
    "UpperArm": 1.0,
    "LowerArm": 0.7,
    "Hand": 0.3,
    "UpperLeg": 1.0,
    "LowerLeg": 0.8,
    "Foot": 0.4,
}
"""How much a bone's rotation counts: by how much of the body hangs on it. Toes do not count."""


@dataclass(frozen=True)
class FeatureSettings:
    """How moments are described.

    Attributes:
        history: Poses before the moment that count; 0 for sensors alone.
        sensor_bones: Bones whose sensors count at the moment itself; empty for history alone.
        root_weight: Weight of the root's place, per metre.
        change_weight: Weight of the change from pose to pose: how much velocity counts beside posture.
        place_weight: Weight of sensors' places, per metre.
        turn_weight: Weight of sensors' rotations.
        by_sensors: Whether the search compares the sensors too; else the history alone, and sensors only at a start.
        history_columns: Principal components kept of the history.
        sensor_columns: Principal components kept of the sensors.
    """

    history: int = 1
    sensor_bones: tuple[str, ...] = ()
    root_weight: float = 1.0
    change_weight: float = 4.0
    place_weight: float = 3.0
    turn_weight: float = 2.0
    by_sensors: bool = True
    history_columns: int = 40
    sensor_columns: int = 32

    @property
    def reach(self) -> int:
        """Poses of the same clip that a moment needs before it."""
        return max(self.history, 1)

    def digest(self) -> str:
        """A short name that differs whenever a setting does."""
        text = json.dumps(asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def reference_sensor(bones: Sequence[str]) -> int:
    """Which of the sensors gives the ground point and heading: the steadiest, so the one nearest to the trunk."""
    for bone in ("upperChest", "chest", "spine", "hips", "neck", "head"):
        if bone in bones:
            return list(bones).index(bone)
    return 0


def feature_points(skeleton: Skeleton, bones: Sequence[str]) -> Floats[Array, "bones 3"]:
    """Where on each bone the features look, in the bone's frame: half way to its end, whatever the body's size."""
    points = np.zeros((len(bones), 3))
    for row, bone in enumerate(bones):
        joint = skeleton.index(bone)
        tip = skeleton.tips[joint]
        children = skeleton.children(joint)
        end = tip if np.isfinite(tip).all() else skeleton.offsets[children[0]] if children else np.zeros(3)
        points[row] = 0.5 * end
    return points


def _weighted_bones() -> tuple[Ints[Array, "bones"], Floats[Array, "bones"]]:
    indices: list[int] = []
    weights: list[float] = []
    for index, bone in enumerate(BODY_BONES):
        weight = _BONE_WEIGHTS.get(bone.removeprefix("left").removeprefix("right"))
        if weight is not None:
            indices.append(index)
            weights.append(weight)
    return np.array(indices, dtype=np.int64), np.array(weights)


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Features by fixed settings. Make one with `make_feature_map`.

    Attributes:
        settings: The settings.
        bones: Bones whose rotations count, by index.
        weights: Their weights.
        sensor_joints: Bones whose sensors count, by index.
        sensor_points: The point on each that features look at, in the bone's frame of the average body.
        reference: The sensor whose ground point and heading the features are seen from.
    """

    settings: FeatureSettings
    bones: Ints[Array, "bones"]
    weights: Floats[Array, "bones"]
    sensor_joints: Ints[Array, "sensors"]
    sensor_points: Floats[Array, "sensors 3"]
    reference: int

    def history(self, poses: Floats[Array, "moments dofs"]) -> Floats[Array, "columns"]:
        """History features of the last poses, newest first."""
        out = np.empty(self.settings.history * (9 + 6 * len(self.bones)))
        how = self.settings
        _kernels.history_block(poses, self.bones, self.weights, how.root_weight, how.change_weight, out)
        return out

    def sensors(
        self, positions: Floats[Array, "sensors 3"], rotations: Floats[Array, "sensors 3 3"]
    ) -> Floats[Array, "columns"]:
        """Sensor features of the places of `sensor_points`, scaled to the average body, and of bone rotations."""
        out = np.empty(9 * len(self.sensor_joints))
        how = self.settings
        _kernels.sensor_block(positions, rotations, self.reference, how.place_weight, how.turn_weight, out)
        return out

    def library_history(
        self, poses: Floats32[Array, "poses dofs"], rows: Ints[Array, "rows"]
    ) -> Floats32[Array, "rows columns"]:
        """History features of library rows."""
        how = self.settings
        out = np.empty((len(rows), how.history * (9 + 6 * len(self.bones))), dtype=np.float32)
        if how.history:
            _kernels.library_history(
                poses, rows, how.history, self.bones, self.weights, how.root_weight, how.change_weight, out
            )
        return out

    def library_sensors(
        self, poses: Floats32[Array, "poses dofs"], rows: Ints[Array, "rows"]
    ) -> Floats32[Array, "rows columns"]:
        """Sensor features of library rows, on the average body."""
        how, body = self.settings, average_body()
        out = np.empty((len(rows), 9 * len(self.sensor_joints)), dtype=np.float32)
        if len(self.sensor_joints):
            _kernels.library_sensors(
                body.parents, body.offsets, poses, rows, self.sensor_joints, self.sensor_points, self.reference,
                how.place_weight, how.turn_weight, out,
            )  # fmt: skip
        return out


def make_feature_map(settings: FeatureSettings) -> FeatureMap:
    """Features by `settings`. Raises SkeletonError for an unknown bone."""
    bones, weights = _weighted_bones()
    joints = np.array([average_body().index(bone) for bone in settings.sensor_bones], dtype=np.int64)
    points = feature_points(average_body(), settings.sensor_bones)
    return FeatureMap(settings, bones, weights, joints, points, reference_sensor(settings.sensor_bones))
