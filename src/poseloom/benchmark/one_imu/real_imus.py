"""All that is measured of real inertial sensors: alignment, the walk with truth, the others' cadence, and pictures."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from poseloom.benchmark.one_imu.alignment_check import real_alignment, simulated_alignment
from poseloom.benchmark.one_imu.bands import signal_bands
from poseloom.benchmark.one_imu.cadence import Cadences, compare_cadences
from poseloom.benchmark.one_imu.measures import headings
from poseloom.benchmark.one_imu.optical import read_optical_walk
from poseloom.benchmark.one_imu.plan import OURS, Progress
from poseloom.benchmark.one_imu.real_walk import neura_moments, neura_recording, optical_motion, real_walk
from poseloom.benchmark.one_imu.trials import Question, fitted, pooled
from poseloom.calibration.imu_alignment import align_imus, turn_to_bones
from poseloom.evaluation.rows import Results, Row, motions_digest
from poseloom.formats.imus import assemble_imus, read_imu_tracks
from poseloom.methods.contract import Reconstructor
from poseloom.methods.reconstruction import Reconstruction, reconstruct
from poseloom.rotations import heading_matrix, matrix_from_rotvec, rotvec_from_matrix
from poseloom.sensors.recording import Recording
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton

WALK_PLACES: tuple[tuple[str, ...], ...] = (
    ("right-foot",),
    ("right-shank",),
    ("right-thigh",),
    ("hips",),
    ("left-foot", "right-foot"),
)
"""What S02 wears in the walk with truth."""

PARTS = ("alignment", "walk", "cadence")
"""Bands of the signal and alignment to bones; the walk with truth; cadence of all recordings."""

SHOWN_SECONDS = 3.0
"""Of each recording, in pictures."""


class RealRecording(NamedTuple):
    """A real recording without truth.

    Attributes:
        path: From the folder of real recordings on.
        sensor: What the file calls the sensor.
        rate: Samples a second, where the file does not say.
        walking: Seconds of the walk that aligns it, where more than walking is in it.
    """

    path: str
    sensor: str
    rate: float | None = None
    walking: tuple[float, float] | None = None


REAL_RECORDINGS: Mapping[str, RealRecording] = MappingProxyType(
    {
        "neura_walk": RealRecording("imu/neura_walk/imu", "00B40C48"),
        "gaitmap": RealRecording("imu/gaitmap/imu_sample.csv", "right_sensor", 204.8),
        "gaitmap, stairs up": RealRecording("imu/gaitmap/imu_sample_healthy_stair_up.csv", "right_sensor"),
        "opensense": RealRecording("imu/opensense/OpenSenseExampleIMUData", "00B421E6"),
        "qmt": RealRecording(
            "imu/qmt_fullbody/examples/full_body_example_data.mat", "foot_right", walking=(56.0, 74.0)
        ),
        "xio": RealRecording("imu/xio_lower_body/Examples/logged_lower_body", "Right Foot"),
    }
)
"""Sensors on right feet (of opensense on one of the feet; its files do not say which)."""


@dataclass(frozen=True, eq=False)
class RealOutcome:
    """What `measure_real_imus` found.

    Attributes:
        results: Rows of the tables bands, alignment-simulated, alignment-real, real-walk and cadence.
        pictures: For each recording its motions by name, over the same moments; the truth first where there is one.
        cadences: Of each recording.
    """

    results: Results
    pictures: Mapping[str, Mapping[str, Motion]]
    cadences: Mapping[str, Cadences]


def measure_real_imus(
    data: Path,
    methods: tuple[str, ...] = (OURS,),
    seed: int = 0,
    progress: Progress | None = None,
    parts: tuple[str, ...] = PARTS,
) -> RealOutcome:
    """Measures real sensors; methods are fitted to the whole pool of motions, in which nobody of these walks.

    Args:
        data: Folder of the recordings.
        methods: Of `plan.METHODS`; for the walk with truth. Cadence and pictures are of the first.
        seed: Of all that is drawn.
        progress: Told what is being done.
        parts: Of `PARTS`.
    """
    tell: Progress = progress or (lambda what, done, total: None)
    pool = pooled(data)
    rows: list[Row] = []
    pictures: dict[str, Mapping[str, Motion]] = {}
    cadences: dict[str, Cadences] = {}
    if "alignment" in parts:
        tell("alignment", 0, 1)
        walks = [take.motion for take in pool.takes if take.behaviour == "walking"]
        rows += [*signal_bands(data, walks), *simulated_alignment(walks, seed), *real_alignment(data)]
        tell("alignment", 1, 1)
    if "walk" in parts:
        found, pictures["neura_walk"] = _walks(data, methods, seed, tell)
        rows += found
    if "cadence" in parts:
        found, cadences, drawn = _cadences(data, methods[0], seed, tell)
        rows += found
        pictures = {**drawn, **pictures}
    results = Results("real-imus", motions_digest(take.motion for take in pool.takes), tuple(rows))
    return RealOutcome(results, MappingProxyType(pictures), MappingProxyType(cadences))


def _walks(data: Path, methods: tuple[str, ...], seed: int, tell: Progress) -> tuple[list[Row], Mapping[str, Motion]]:
    """The walk with truth, by all places, and a picture of it by the first."""
    rows: list[Row] = []
    shown: Mapping[str, Motion] = {}
    for done, words in enumerate(WALK_PLACES):
        tell("the walk with truth", done, len(WALK_PLACES))
        sensors = f"{'+'.join(words)}-imu"
        makers = {name: partial(_made, _question(data, name, sensors, seed)) for name in methods}
        found, made = real_walk(data, makers, words)
        rows += [row for row in found if done == 0 or row.setting != "no sensor"]
        if done == 0:
            shown = _beside_truth(data, made)
    tell("the walk with truth", len(WALK_PLACES), len(WALK_PLACES))
    return rows, shown


def _cadences(
    data: Path, method: str, seed: int, tell: Progress
) -> tuple[list[Row], dict[str, Cadences], dict[str, Mapping[str, Motion]]]:
    """Rows, cadences and pictures of all recordings."""
    rows: list[Row] = []
    cadences: dict[str, Cadences] = {}
    pictures: dict[str, Mapping[str, Motion]] = {}
    runs = fitted(_question(data, method, "right-foot-imu", seed))
    for done, (name, recording) in enumerate(REAL_RECORDINGS.items()):
        tell("cadence", done, len(REAL_RECORDINGS))
        heard = aligned_recording(data, recording)
        made = reconstruct(runs, heard)
        cadences[name] = compare_cadences(heard, made.motion, int(made.samples[0]))
        rows += _cadence_rows(method, name, cadences[name])
        pictures[name] = {method: _middle(heard, made)}
    tell("cadence", len(REAL_RECORDINGS), len(REAL_RECORDINGS))
    return rows, cadences, pictures


def aligned_recording(data: Path, recording: RealRecording) -> Recording:
    """A real recording as a sensor along the axes of the right foot would have made it."""
    track = read_imu_tracks(data / recording.path, recording.rate)[recording.sensor]
    heard = assemble_imus({"right-foot": track}, name=recording.path)
    return turn_to_bones(heard, align_imus(heard, walking=recording.walking))


def _question(data: Path, method: str, sensors: str, seed: int) -> Question:
    return Question(data, method, sensors, asked=(), seed=seed)


def _made(question: Question, wearer: Skeleton) -> Reconstructor[Any]:
    """A method is fitted alike for every wearer, whose bones it is told when it starts."""
    return fitted(question)


def _cadence_rows(method: str, name: str, found: Cadences) -> list[Row]:
    count = len(found.times)
    figures: dict[str, Any] = {"windows": count}
    if count:
        figures["signal_steps_min"] = float(np.median(found.signal))
        figures["agreeing_share"] = found.agreeing
        apart = np.abs(found.motion - found.signal)
        if np.isfinite(apart).any():
            figures["median_difference_steps_min"] = float(np.nanmedian(apart))
    return [
        Row("cadence", method, name, "none", metric, float(value), sequences=1) for metric, value in figures.items()
    ]


def _beside_truth(data: Path, made: Mapping[str, Reconstruction]) -> Mapping[str, Motion]:
    """Three seconds of the walk: the cameras' legs, and each method's body at the same moments."""
    recording = neura_recording(data)
    optical = read_optical_walk(data / "imu" / "neura_walk")
    shown: dict[str, Motion] = {}
    for name, reconstruction in made.items():
        seen, moments = neura_moments(recording, reconstruction)
        middle = seen[60 : 60 + round(SHOWN_SECONDS * recording.layout.rate)]
        if not shown:
            shown["cameras (hips and legs)"] = optical_motion(optical, moments[60 : 60 + len(middle)])
        made_then = reconstruction.motion.cut(int(middle[0]), int(middle[-1]) + 1)
        shown[name] = _placed_as(made_then, next(iter(shown.values())))
    return shown


def _placed_as(motion: Motion, other: Motion) -> Motion:
    """The motion with the other's place on the ground and heading, frame by frame: poses are compared, not ways."""
    turn = heading_matrix(headings(other) - headings(motion))
    q = np.array(motion.q)
    q[:, [0, 2]] = other.q[:, [0, 2]]
    q[:, 3:6] = rotvec_from_matrix(turn @ matrix_from_rotvec(q[:, 3:6]))
    return make_motion(motion.skeleton, q, motion.rate, motion.name)


def _middle(recording: Recording, made: Reconstruction) -> Motion:
    """Seconds in the middle of the recording's liveliest part."""
    turning = np.nan_to_num(np.linalg.norm(recording.angular_rates[made.samples, 0], axis=1))
    width = min(round(SHOWN_SECONDS * recording.layout.rate), len(turning))
    total = np.convolve(turning, np.ones(width), "valid")
    start = int(np.argmax(total))
    return made.motion.cut(start, start + width)
