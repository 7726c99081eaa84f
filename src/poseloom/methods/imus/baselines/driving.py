"""What the comparators share as reconstructors: hearing samples, walking the root on, health, and their files."""

import abc
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from poseloom.arrays import Array, Floats, Floats32, Ints, frozen_float
from poseloom.errors import FormatError
from poseloom.formats._files import reading
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.formats.artefact_arrays import ArtefactArrays, rate
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.methods.imus.baselines.examples import (
    FEATURES,
    STEP,
    Examples,
    joint_spreads,
    leg_length,
    posed_rotvecs,
    posture_of,
)
from poseloom.methods.imus.pairs import CHANNELS, sample_signal
from poseloom.rotations import nearest_branch
from poseloom.sensors import Placement, Sample, SensorKind, SensorSpec, make_layout
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.skeleton import Skeleton

FORMAT_VERSION = 1

LOST_AFTER = 1.0
"""Seconds of silence after which a pose means little."""


class Guess(NamedTuple):
    """What a comparator makes of a moment.

    Attributes:
        features: The pose (see `examples.FEATURES`).
        step: What led there from the moment before.
        variances: Of the features.
    """

    features: Floats[Array, "features"]
    step: Floats[Array, "3"]
    variances: Floats[Array, "features"]


@dataclass(frozen=True, eq=False)
class DriveState:
    """What changes with time.

    Attributes:
        skeleton: The wearer's bones.
        window: The last signals, standardised, newest first; NaN where nothing came.
        silent: Samples since any sensor spoke; -1 before the first word.
        ground: Where the hips are above the floor, metres (x, z).
        heading: Where they face, radians.
        rotvecs: The pose before, for continuity.
        path_variance: Of the way walked so far, square metres.
        memory: What the comparator itself keeps.
    """

    skeleton: Skeleton
    window: Floats[Array, "samples channels"]
    silent: int
    ground: Floats[Array, "2"]
    heading: float
    rotvecs: Floats[Array, "joints 3"]
    path_variance: float
    memory: Any


Settings = TypeVar("Settings", bound="WindowSettings")


@dataclass(frozen=True)
class WindowSettings:
    """Settings that every comparator has.

    Attributes:
        samples: Length of the window of signals.
    """

    samples: int = 20


class SignalComparator(Reconstructor[DriveState], abc.ABC, Generic[Settings]):
    """A comparator: a guess of the pose from the last signals, and a root that walks on by the guessed steps.

    Where a sensor is silent its channels do not count; where all are, the comparator carries its guess on by itself.

    Args:
        examples: What it learns from.
        settings: Its settings.
    """

    kind: ClassVar[str]
    """Its name, and the kind of its files."""

    delay: int = 0

    def __init__(self, examples: Examples, settings: Settings) -> None:
        self.examples = examples
        self.layout = examples.layout
        self.settings = settings

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> DriveState:
        """The state before the first sample; where the sensors sit is known from the examples, not from placements."""
        window = np.full((self.settings.samples, self.examples.signals.shape[1]), np.nan)
        joints = len(skeleton)
        return DriveState(skeleton, window, -1, np.zeros(2), 0.0, np.zeros((joints, 3)), 0.0, self._begin(skeleton))

    def step(self, state: DriveState, sample: Sample) -> tuple[DriveState, Frame | None]:
        """Takes in one sample; None before any sensor has spoken."""
        signal = self.examples.standardised(sample_signal(sample))
        came = np.isfinite(signal)
        if not came.any() and state.silent < 0:
            return state, None
        silent = 0 if came.any() else state.silent + 1
        window = np.concatenate([signal[None], state.window[:-1]])
        memory, guess = self._estimate(state.memory, window)
        following = self._walk(replace(state, window=window, silent=silent, memory=memory), guess, state.silent < 0)
        return following, self._frame(following, guess, sample, came)

    @abc.abstractmethod
    def _begin(self, skeleton: Skeleton) -> Any:
        """What it keeps before the first sample of this wearer."""

    @abc.abstractmethod
    def _estimate(self, memory: Any, window: Floats[Array, "samples channels"]) -> tuple[Any, Guess]:
        """The guess of this moment, from the last standardised signals, newest first, NaN where none came."""

    def _walk(self, state: DriveState, guess: Guess, first: bool) -> DriveState:
        leg = leg_length(state.skeleton)
        left, ahead, turn = (0.0, 0.0, 0.0) if first else map(float, guess.step)
        sine, cosine = np.sin(state.heading), np.cos(state.heading)
        way = leg * np.array([cosine * left + sine * ahead, -sine * left + cosine * ahead])
        rotvecs = posed_rotvecs(posture_of(guess.features), state.heading + turn)
        return replace(
            state,
            ground=state.ground + way,
            heading=state.heading + turn,
            rotvecs=nearest_branch(rotvecs, rotvecs if first else state.rotvecs),
            path_variance=state.path_variance + leg**2 * float(guess.variances[0]) / self.layout.rate,
        )

    def _frame(self, state: DriveState, guess: Guess, sample: Sample, came: Any) -> Frame:
        leg = leg_length(state.skeleton)
        root = np.array([state.ground[0], leg * guess.features[0], state.ground[1]])
        ground = np.sqrt(state.path_variance)
        place = np.array([ground, leg * np.sqrt(max(float(guess.variances[0]), 0.0)), ground])
        spread = np.concatenate([place, joint_spreads(guess.variances).repeat(3)])
        return Frame(
            sample.time,
            Pose(state.skeleton, frozen_float(np.concatenate([root, state.rotvecs.reshape(-1)]))),
            frozen_float(spread),
            self._health(state, came.reshape(len(self.layout), -1).all(axis=1)),
        )

    def _health(self, state: DriveState, came: Any) -> Health:
        missing = tuple(name for name, there in zip(self.layout.names, came, strict=True) if not there)
        if state.silent > LOST_AFTER * self.layout.rate:
            return Health(HealthState.LOST, missing)
        if state.silent > 0:
            return Health(HealthState.COASTING, missing)
        return Health(HealthState.DEGRADED if missing else HealthState.OK, missing)


def mean_guess(examples: Examples, rows: Ints[Array, "rows"], weights: Floats[Array, "rows"]) -> Guess:
    """Mean pose, step and variances of some examples, by weights that sum to one."""
    features = examples.features[rows].astype(np.float64)
    mean = weights @ features
    return Guess(mean, weights @ examples.steps[rows].astype(np.float64), weights @ (features - mean) ** 2)


def save_comparator(method: SignalComparator[Any], path: str | Path) -> None:
    """Writes a comparator's examples and settings; what it derives from them it derives again when it is read.

    Raises:
        OSError: where the file cannot be written.
    """
    examples = method.examples
    header: Mapping[str, Any] = {
        "layout": examples.layout.name,
        "rate": examples.layout.rate,
        "sensors": [[sensor.name, sensor.bone] for sensor in examples.layout.sensors],
        "behaviours": list(examples.behaviours),
        "settings": asdict(method.settings),
    }
    arrays = {
        name: getattr(examples, name)
        for name in ("signals", "features", "steps", "standing", "starts", "builds", "centre", "scale")
    }
    write_artefact(path, method.kind, FORMAT_VERSION, header, arrays, data_digest=examples.digest)


def read_examples(path: str | Path, kind: str) -> tuple[Examples, Mapping[str, Any]]:
    """The examples and settings in a file of `save_comparator`.

    Raises:
        FormatError: where the file holds no such comparator.
    """
    artefact = read_artefact(path, kind, FORMAT_VERSION)
    header = artefact.header
    with reading(path, f"a {kind}"):
        sensors = [SensorSpec(str(name), SensorKind.IMU, str(bone)) for name, bone in header["sensors"]]
        layout = make_layout(str(header["layout"]), sensors, rate(header["rate"]))
        arrays = ArtefactArrays(artefact.arrays, channels=CHANNELS * len(layout), features=FEATURES)
        signals = arrays.floats("signals", "frames channels", np.float32, -1e4, 1e4)
        starts = arrays.indices("starts", "clips", len(signals))
        behaviours = tuple(str(word) for word in header["behaviours"])
        if starts[0] != 0 or (np.diff(starts) <= 0).any() or len(behaviours) != len(starts):
            raise FormatError("its clips do not follow each other")
        examples = Examples(
            layout,
            signals,
            _features(arrays),
            arrays.floats("steps", f"frames {STEP}", np.float32, -100.0, 100.0),
            arrays.booleans("standing", "frames 2"),
            starts,
            behaviours,
            arrays.floats("builds", f"clips {len(BODY_BONES) - 1}", low=0.0, high=100.0),
            arrays.floats("centre", "channels", low=-1e6, high=1e6),
            arrays.floats("scale", "channels", low=1e-9, high=1e6),
            artefact.data_digest,
        )
        return examples, dict(header["settings"])


def _features(arrays: ArtefactArrays) -> Floats32[Array, "frames features"]:
    """Heights, and columns of rotation matrices: of length one, and at right angles."""
    features = arrays.floats("features", "frames features", np.float32, -100.0, 100.0)
    columns = features[:, 1:].reshape(len(features), -1, 2, 3)
    lengths = np.linalg.norm(columns, axis=-1)
    if np.abs(lengths - 1).max() > 1e-3 or np.abs((columns[:, :, 0] * columns[:, :, 1]).sum(axis=-1)).max() > 1e-3:
        raise FormatError("its poses hold something else than rotations")
    return features
