"""Fitting the phase HMM: phases, registration, Gaussian maps and transitions of training pairs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats, Floats32, Ints, frozen, frozen_float
from poseloom.errors import MethodError
from poseloom.methods.imus.emissions import noise_scale, precision, windowed
from poseloom.methods.imus.features import (
    MotionFeatures,
    motion_features,
    registered_columns,
)
from poseloom.methods.imus.gaussian_map import fit_gaussian_map
from poseloom.methods.imus.model import WAY_ENTRIES, Emission, HmmModel
from poseloom.methods.imus.pairs import SignalPair
from poseloom.methods.imus.phases import label_phases
from poseloom.methods.imus.registration import medoid, time_warp
from poseloom.methods.imus.settings import PhaseHmmSettings
from poseloom.rotations import quat_conjugate, quat_multiply, rotvec_from_quat
from poseloom.sensors import Placement, default_placements
from poseloom.sensors.layout import SensorLayout
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.skeleton import Skeleton

Progress = Callable[[str, int, int], object]
"""Called with the name of what is being done, and how many of how many are."""

_FEWEST = 60
"""Examples below which a warped time takes its neighbours' too."""


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A segment before it has its place in the model."""

    pair: int
    start: int
    stop: int
    upper: str


def fit_model(
    pairs: Sequence[SignalPair],
    layout: SensorLayout,
    settings: PhaseHmmSettings,
    seed: int = 0,
    progress: Progress | None = None,
) -> HmmModel:
    """Learns the phase HMM's arrays.

    Args:
        pairs: Motions and signals at the layout's rate, all of the layout's sensors; best without mounting error, which
            the model aligns online.
        layout: The sensors.
        settings: What to learn.
        seed: Of the draws: windows, medoid candidates, nearest states.
        progress: Told what is being done.

    Raises:
        MethodError: for no pairs, or pairs of another rate or number of channels.
        SkeletonError: for motions that are not on the body.
    """
    tell = progress or _untold
    _check(pairs, layout)
    stretches, features = _cut(pairs, settings, tell)
    uppers = sorted({stretch.upper for stretch in stretches})
    upper_index = {name: index for index, name in enumerate(uppers)}
    lengths = np.array([s.stop - s.start for s in stretches], dtype=np.int64)
    stops = np.cumsum(lengths)
    firsts = stops - lengths
    phase_of_segment = np.array([upper_index[s.upper] for s in stretches], dtype=np.int64)
    owners = np.array([s.pair for s in stretches], dtype=np.int64)
    quats = np.concatenate([f.quats_wxyz for f in features])
    others = np.concatenate([_others(f) for f in features])
    signals = np.concatenate([pair.signal for pair in pairs])
    ups = np.concatenate([_ups(pair, layout) for pair in pairs])
    # Segments cover the pairs frame by frame and in order, so states are the pairs' frames one after another.
    successor = np.where(np.diff(owners, append=-1) == 0, np.arange(1, len(stretches) + 1), -1).astype(np.int64)
    phase_of_state = np.repeat(phase_of_segment, lengths)
    maps = _register(stretches, features, phase_of_segment, len(uppers), seed, tell)
    scale = noise_scale(signals, maps)
    sizes = (*settings.short_windows, (settings.window, settings.columns))
    windows = [windowed(pairs, scale, window, columns, seed) for window, columns in sizes]
    gains, variances = _fit_maps(maps, phase_of_state, quats, others, windows[-1][1], settings.shrinkage)
    takes = np.array([pair.take for pair in pairs])
    take_of_state = np.repeat(np.unique(takes, return_inverse=True)[1][owners], lengths)
    kinds = (phase_of_state, take_of_state, maps, len(uppers))
    emissions = tuple(
        Emission(how, seen, frozen_float(precision(seen, *kinds, settings, seed))) for how, seen in windows
    )
    bodies, body_of_pair = _bodies(pairs)
    return HmmModel(
        emissions=emissions,
        signals=frozen(signals.astype(np.float32)),
        quats_wxyz=frozen(quats.astype(np.float32)),
        others=frozen(others.astype(np.float32)),
        ups=frozen(ups.astype(np.float32)),
        maps=frozen(maps),
        gains=frozen(gains.astype(np.float32)),
        variances=frozen(variances.astype(np.float32)),
        first=frozen(firsts),
        stop=frozen(stops),
        phase_of_segment=frozen(phase_of_segment),
        successor=frozen(successor),
        body_of_segment=frozen(body_of_pair[owners]),
        phase_of_state=frozen(phase_of_state),
        phase_names=tuple(uppers),
        phase_sizes=frozen(np.bincount(phase_of_segment, minlength=len(uppers)).astype(np.int64)),
        entry=frozen_float(_entries(phase_of_segment, successor, len(uppers), settings.upper_next)),
        bodies=frozen_float(bodies),
    )


def bone_lengths(skeleton: Skeleton) -> Floats[Array, "bones"]:
    """Length of every bone of the body, metres."""
    return np.asarray(np.linalg.norm(skeleton.offsets[1:], axis=1))


def _untold(_what: str, _done: int, _total: int) -> None:
    """Tells nobody."""


def _check(pairs: Sequence[SignalPair], layout: SensorLayout) -> None:
    if not pairs:
        raise MethodError("there are no pairs to learn from", remedy="Give motions of the behaviours to reconstruct")
    for pair in pairs:
        if pair.signal.shape != (len(pair.motion), 6 * len(layout)) or abs(pair.motion.rate - layout.rate) > 1e-6:
            raise MethodError(
                f"the pair {pair.clip!r} has {pair.signal.shape[1]} channels at {pair.motion.rate:g} Hz; "
                f"the layout {layout.name!r} has {6 * len(layout)} at {layout.rate:g} Hz",
                remedy="Make the pairs for this layout",
            )


def _cut(
    pairs: Sequence[SignalPair], settings: PhaseHmmSettings, tell: Progress
) -> tuple[list[_Stretch], list[MotionFeatures]]:
    stretches: list[_Stretch] = []
    features: list[MotionFeatures] = []
    for index, pair in enumerate(pairs):
        track = label_phases(pair.motion, pair.behaviour, settings.phases)
        longest = max(round(settings.phases.longest * pair.motion.rate), 1)
        for segment in track.segments(longest):
            name = f"{pair.behaviour.value}: {segment.phase.title}"
            stretches.append(_Stretch(index, segment.start, segment.stop, name))
        features.append(motion_features(pair))
        tell("telling phases", index + 1, len(pairs))
    return stretches, features


def _others(features: MotionFeatures) -> Floats[Array, "frames others"]:
    parts = (features.height[:, None], features.way, features.turn[:, None], features.standing.astype(np.float64))
    return np.concatenate(parts, axis=1)


def _ups(pair: SignalPair, layout: SensorLayout) -> Floats[Array, "frames sensors 3"]:
    """World up in each sensor's frame, for sensors at their usual places."""
    placements: tuple[Placement, ...] = default_placements(layout, pair.motion.skeleton)
    rotations = motion_frames(pair.motion).rotations
    bones = [pair.motion.skeleton.index(placement.bone) for placement in placements]
    turns = np.stack([placement.R_bone_sensor for placement in placements])
    return np.asarray((rotations[:, bones] @ turns)[:, :, 1, :])


def _register(
    stretches: Sequence[_Stretch],
    features: Sequence[MotionFeatures],
    phase_of_segment: Ints[Array, "segments"],
    phases: int,
    seed: int,
    tell: Progress,
) -> Ints[Array, "states"]:
    """For each state its phase and warped time as one number: those of a phase follow each other."""
    shapes = [registered_columns(each) for each in features]
    times: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)] * len(stretches)
    count = 0
    for phase in range(phases):
        members: list[int] = np.flatnonzero(phase_of_segment == phase).tolist()
        pieces = [shapes[stretches[m].pair][stretches[m].start : stretches[m].stop] for m in members]
        reference = medoid(pieces, seed)
        for member, piece in zip(members, pieces, strict=True):
            times[member] = count + time_warp(piece, pieces[reference]).of_segment(len(piece))
        count += len(pieces[reference])
        tell("registering phases", phase + 1, phases)
    return np.concatenate(times)


def _fit_maps(
    maps: Ints[Array, "states"],
    phase_of_state: Ints[Array, "states"],
    quats: Floats[Array, "states joints 4"],
    others: Floats[Array, "states others"],
    seen: Floats32[Array, "states columns"],
    shrinkage: float,
) -> tuple[Floats[Array, "maps entries columns"], Floats[Array, "maps entries"]]:
    """The Gaussian map of each phase and warped time."""
    gains: list[NDArray[np.float64]] = []
    variances: list[NDArray[np.float64]] = []
    for phase in range(int(phase_of_state.max()) + 1):
        states = np.flatnonzero(phase_of_state == phase)
        times = maps[states]
        for time in range(len(gains), int(times.max()) + 1):
            near = states[_at_time(times, time)]
            fitted = fit_gaussian_map(_residuals(quats[near], others[near]), seen[near].astype(np.float64), shrinkage)
            gains.append(fitted.gain)
            variances.append(fitted.variance)
    return np.stack(gains), np.stack(variances)


def _at_time(times: Ints[Array, "states"], time: int) -> Ints[Array, "near"]:
    """States at a warped time; where they are few, those just before and after it too."""
    reach = 0
    near = np.flatnonzero(times == time)
    while len(near) < min(_FEWEST, len(times)):
        reach += 1
        near = np.flatnonzero(np.abs(times - time) <= reach)
    return near


def _residuals(
    quats: Floats[Array, "examples joints 4"], others: Floats[Array, "examples others"]
) -> Floats[Array, "examples entries"]:
    """Each example's turn from the examples' mean rotation, in the joints' own axes, then height, way and turn."""
    aligned = np.where(np.sum(quats * quats[:1], axis=-1, keepdims=True) < 0, -1.0, 1.0) * quats
    mean = aligned.mean(axis=0)
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    turns = rotvec_from_quat(quat_multiply(quat_conjugate(mean)[None], aligned))
    return np.concatenate([turns.reshape(len(turns), -1), others[:, :WAY_ENTRIES]], axis=1)


def _entries(
    phase_of_segment: Ints[Array, "segments"], successor: Ints[Array, "segments"], phases: int, upper_next: float
) -> Floats[Array, "phases phases"]:
    """Where mass goes that leaves a phase: to phases that followed it in the recordings, or by exit to all others."""
    follows = np.zeros((phases, phases))
    known = successor >= 0
    np.add.at(follows, (phase_of_segment[known], phase_of_segment[successor[known]]), 1.0)
    np.fill_diagonal(follows, 0.0)
    total = follows.sum(axis=1, keepdims=True)
    exits = (1.0 - np.eye(phases)) / max(phases - 1, 1)
    if phases == 1:
        return np.ones((1, 1))
    nexts = np.where(total > 0, follows / np.where(total > 0, total, 1.0), exits)
    return upper_next * nexts + (1 - upper_next) * exits


def _bodies(pairs: Sequence[SignalPair]) -> tuple[Floats[Array, "bodies bones"], Ints[Array, "pairs"]]:
    lengths = np.stack([bone_lengths(pair.motion.skeleton) for pair in pairs])
    bodies, index = np.unique(lengths.round(4), axis=0, return_inverse=True)
    return bodies, index.reshape(-1).astype(np.int64)
