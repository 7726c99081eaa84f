"""The metrics, one definition each. `docs/metrics.md` says in words what each measures and what it hides.

All compare two motions of the 22-bone body, frame for frame at one rate, and return one number; smaller is better. A
metric that a sequence does not define (jitter of fewer than four frames, drift a metre of somebody who stands) is NaN.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.evaluation import profiles
from poseloom.evaluation.observed import Observed, begun_as, facing_as
from poseloom.rotations import unwrap_rotvec
from poseloom.skeleton.body import BODY_BONES, moving_dofs
from poseloom.skeleton.contacts import contacts, sole_positions
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion

SIP_BONES = ("leftUpperLeg", "rightUpperLeg", "leftUpperArm", "rightUpperArm")
"""Hips and shoulders, the joints farthest from sensors out on the limbs (named after the Sparse Inertial Poser)."""

EVERYTHING = Observed()
"""Sensors that observe place and heading."""

SHORTEST_WALK = 1.0
"""Metres of the truth's way below which drift a metre is not defined."""


def joint_angle_deg(truth: Motion, estimate: Motion) -> float:
    """Mean absolute difference of the pose-vector angles, over frames and the body's moving degrees of freedom."""
    return float(profiles.angle_errors(truth, estimate)[:, _moving_axes()].mean())


def joint_rotation_deg(truth: Motion, estimate: Motion) -> float:
    """Mean geodesic angle between local joint rotations, over all joints, the root among them."""
    return float(profiles.rotation_errors(truth, estimate).mean())


def global_rotation_deg(truth: Motion, estimate: Motion) -> float:
    """Mean geodesic angle between the world rotations of the bones, over all joints."""
    return float(profiles.global_rotation_errors(truth, estimate).mean())


def sip_deg(truth: Motion, estimate: Motion) -> float:
    """Mean geodesic angle between world rotations over both upper legs and both upper arms."""
    bones = [BODY_BONES.index(name) for name in SIP_BONES]
    return float(profiles.global_rotation_errors(truth, estimate)[:, bones].mean())


def joint_position_cm(truth: Motion, estimate: Motion) -> float:
    """Mean distance of joints, root position removed, over the joints that are not the root's own place.

    `hips` and `spine` begin at the same point, which is removed: counting their zeros would flatter every method.
    """
    return float(profiles.position_errors(truth, estimate)[:, _placed_joints()].mean())


def joint_position_rms_cm(truth: Motion, estimate: Motion) -> float:
    """Root of the mean square of the same distances as in `joint_position_cm`."""
    return float(np.sqrt((profiles.position_errors(truth, estimate)[:, _placed_joints()] ** 2).mean()))


def root_position_cm(truth: Motion, estimate: Motion) -> float:
    """Mean distance between the roots."""
    return float(profiles.root_position_errors(truth, estimate).mean())


def root_drift_m(truth: Motion, estimate: Motion) -> float:
    """Distance of the root from the truth in the last frame, in metres."""
    return float(profiles.root_position_errors(truth, estimate)[-1]) / 100


def root_drift_per_metre(truth: Motion, estimate: Motion) -> float:
    """The same divided by the length of the truth's way over the ground; NaN for a way of less than `SHORTEST_WALK`."""
    way = float(np.linalg.norm(np.diff(truth.root_positions[:, [0, 2]], axis=0), axis=1).sum())
    return root_drift_m(truth, estimate) / way if way >= SHORTEST_WALK else float("nan")


def jitter_deg_s3(motion: Motion) -> float:
    """Mean absolute third derivative of a motion's moving joint angles, in degrees a cubic second."""
    if len(motion) < 4:
        return float("nan")
    angles = np.degrees(unwrap_rotvec(motion.rotvecs)[:, _moving_axes()])
    return float(np.abs(np.diff(angles, n=3, axis=0)).mean() * motion.rate**3)


def jitter_km_s3(motion: Motion) -> float:
    """Mean size of the third derivative of a motion's joint positions in the world, in kilometres a cubic second."""
    if len(motion) < 4:
        return float("nan")
    third = np.diff(motion_frames(motion).positions, n=3, axis=0)
    return float(np.linalg.norm(third, axis=-1).mean() * motion.rate**3) / 1000


def foot_skate_cm_s(truth: Motion, estimate: Motion) -> float:
    """Mean horizontal speed of the estimate's heels and toes while the truth has them in contact with the floor.

    A speed counts where the truth's point stands in both frames that it is taken from; NaN where nothing ever stands.
    """
    if len(truth) < 2:
        return float("nan")
    stands = contacts(truth)
    standing = np.stack([stands.left_heel, stands.left_toe, stands.right_heel, stands.right_toe], axis=1)
    both = standing[1:] & standing[:-1]
    speed = np.linalg.norm(np.diff(sole_positions(estimate)[..., [0, 2]], axis=0), axis=-1) * estimate.rate
    return 100 * float(speed[both].mean()) if both.any() else float("nan")


def _skate_of_truth(truth: Motion, _estimate: Motion) -> float:
    return foot_skate_cm_s(truth, truth)


@dataclass(frozen=True)
class Latency:
    """How late a pose is, kept apart by reason, in milliseconds.

    Attributes:
        look_ahead_ms: Samples that the method waits for, divided by the rate.
        step_ms_p50: Median of the compute of one step.
        step_ms_p95: Its 95th percentile.
        step_ms_p99: Its 99th percentile.
    """

    look_ahead_ms: float
    step_ms_p50: float
    step_ms_p95: float
    step_ms_p99: float


def latency(step_seconds: Floats[Array, "steps"], delay: int, rate: float) -> Latency:
    """Look-ahead and percentiles of the steps' compute times.

    Args:
        step_seconds: Compute of each step, seconds; steps that were not timed are NaN and left out.
        delay: Samples between hearing a moment and speaking of it.
        rate: Samples a second.
    """
    timed = step_seconds[np.isfinite(step_seconds)]
    p50, p95, p99 = np.percentile(1000 * timed, [50, 95, 99]) if timed.size else np.full(3, np.nan)
    return Latency(1000 * delay / rate, float(p50), float(p95), float(p99))


def evaluate_motion(truth: Motion, estimate: Motion, observed: Observed = EVERYTHING) -> dict[str, float]:
    """All metrics of one sequence by name, and the truth's own jitter beside the estimate's.

    Args:
        truth: The true motion, on the body.
        estimate: The estimate, on the body, frame for frame at the same rate.
        observed: What the sensors observe. A heading that none does is removed frame by frame for the pose; for the
            path, place and heading that none observes are brought to the truth's at the beginning.

    Raises:
        PoseloomError: where the two cannot be compared (see `profiles.check_pair`).
    """
    profiles.check_pair(truth, estimate)
    path = begun_as(truth, estimate, observed)
    pose = path if observed.heading else facing_as(truth, path)
    return {metric.name: metric.measure(truth, path if metric.of_path else pose) for metric in METRICS.values()}


@dataclass(frozen=True)
class Metric:
    """A metric's name, which ends in its unit, a short label for tables, its definition, and whether it is of paths.

    Those of paths look at movement from frame to frame and at the root; the others at each pose by itself.
    """

    name: str
    label: str
    measure: Callable[[Motion, Motion], float]
    of_path: bool = False


def _of_estimate(measure: Callable[[Motion], float]) -> Callable[[Motion, Motion], float]:
    return lambda truth, estimate: measure(estimate)


def _of_truth(measure: Callable[[Motion], float]) -> Callable[[Motion, Motion], float]:
    return lambda truth, estimate: measure(truth)


METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        metric.name: metric
        for metric in (
            Metric("joint_angle_deg", "joint angle, °", joint_angle_deg),
            Metric("joint_rotation_deg", "joint rotation, °", joint_rotation_deg),
            Metric("global_rotation_deg", "global rotation, °", global_rotation_deg),
            Metric("sip_deg", "hips and shoulders, °", sip_deg),
            Metric("joint_position_cm", "joint position, cm", joint_position_cm),
            Metric("joint_position_rms_cm", "joint position RMS, cm", joint_position_rms_cm),
            Metric("root_position_cm", "root position, cm", root_position_cm, True),
            Metric("root_drift_m", "root drift, m", root_drift_m, True),
            Metric("root_drift_per_metre", "root drift, m per m", root_drift_per_metre, True),
            Metric("jitter_deg_s3", "jitter, °/s³", _of_estimate(jitter_deg_s3), True),
            Metric("truth_jitter_deg_s3", "jitter of the truth, °/s³", _of_truth(jitter_deg_s3)),
            Metric("jitter_km_s3", "jitter, km/s³", _of_estimate(jitter_km_s3), True),
            Metric("truth_jitter_km_s3", "jitter of the truth, km/s³", _of_truth(jitter_km_s3)),
            Metric("foot_skate_cm_s", "foot skate, cm/s", foot_skate_cm_s, True),
            Metric("truth_foot_skate_cm_s", "foot skate of the truth, cm/s", _skate_of_truth),
        )
    }
)
"""All metrics of one sequence, by name, in the order of tables."""

METRIC_LABELS: Mapping[str, str] = MappingProxyType(
    {name: metric.label for name, metric in METRICS.items()}
    | {
        "look_ahead_ms": "look-ahead, ms",
        "step_ms_p50": "compute per step p50, ms",
        "step_ms_p95": "compute per step p95, ms",
        "step_ms_p99": "compute per step p99, ms",
    }
)
"""What tables call the metrics and the parts of the latency."""


def _moving_axes() -> Bools[Array, "joints 3"]:
    return moving_dofs()[3:].reshape(-1, 3)


def _placed_joints() -> Bools[Array, "joints"]:
    placed = np.ones(len(BODY_BONES), dtype=np.bool_)
    placed[[BODY_BONES.index("hips"), BODY_BONES.index("spine")]] = False
    return placed
