"""Which readings of trackers are taken and which rejected, and how a lost tracker goes and comes back gently."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Ints
from poseloom.methods.trackers import _kernels
from poseloom.methods.trackers.observation import heard
from poseloom.methods.trackers.state import GateSettings, Wearer
from poseloom.rotations import matrix_from_rotvec
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.solve import SensorReadings


@dataclass(frozen=True, eq=False)
class Trust:
    """What is remembered of each tracker.

    Attributes:
        doubted: Samples in a row in which it was rejected and agreed with where it was the time before.
        missing: Samples in a row in which its position and its orientation were not taken; -1 where never yet.
        places: Where it was in the last sample, metres: as received, else as the pose carried it.
        turns: How it was turned there.
        steps: How far it had moved since the sample before; NaN where that is not known.
        own: Where its own movement led to at the last sample, metres; where it was received, if it was.
        strays: Where it was rejected last, metres; NaN while it is not.
        unsteady: Samples in a row in which its orientation jumped while its position did not.
        place_offsets: Metres still added to its position since it came back, so that the pose glides to it.
        turn_offsets: The same for its orientation: rotation vectors in the world.
    """

    doubted: Ints[Array, "sensors"]
    missing: Ints[Array, "sensors 2"]
    places: Floats[Array, "sensors 3"]
    turns: Floats[Array, "sensors 3 3"]
    steps: Floats[Array, "sensors 3"]
    own: Floats[Array, "sensors 3"]
    strays: Floats[Array, "sensors 3"]
    unsteady: Ints[Array, "sensors"]
    place_offsets: Floats[Array, "sensors 3"]
    turn_offsets: Floats[Array, "sensors 3"]


class Gated(NamedTuple):
    """Readings fit to be solved with.

    Attributes:
        readings: What was taken, and, with little trust, where the pose carries what was not.
        taken: Which positions and orientations were taken.
        trust: What to remember.
    """

    readings: SensorReadings
    taken: Bools[Array, "sensors 2"]
    trust: Trust


def take_all(readings: SensorReadings) -> Gated:
    """The first readings: all are taken, and how they move is not known yet."""
    nothing, said = np.zeros_like(readings.positions), heard(readings)
    missing = np.where(said, 0, -1)
    none, unknown = np.zeros(len(nothing), dtype=np.int64), np.full_like(nothing, np.nan)
    trust = Trust(
        none, missing, readings.positions, readings.rotations, unknown, readings.positions,
        unknown, none, nothing, nothing,
    )  # fmt: skip
    return Gated(readings, said, trust)


def gate(
    trust: Trust, readings: SensorReadings, wearer: Wearer, newest: Floats[Array, "dofs"], settings: GateSettings
) -> Gated:
    """Rejects what contradicts a tracker's own movement, and lets lost trackers go and come back gently.

    A sound tracker goes on from where it was; an outlier jumps away from itself. What a library predicts is no reason
    to reject: it may know neither the wearer nor the motion. Only where a tracker's own movement is not known (it was
    missing or rejected) may it instead be near to where the newest pose carries it. A tracker that is rejected, but
    stays where it jumped to, is right after a few samples. If most jump and keep their distances from each other, the
    whole body was moved, and all are taken. An orientation that jumps while the position goes on is held back for one
    sample, for it may have turned for good; it is rejected if it jumps again.

    What is not taken is held where the newest pose carries it, with less trust each sample, so that the pose glides to
    what the model believes. What comes back starts from where the newest pose has it, and the difference fades away.
    """
    places, turns = _carried(wearer, newest)
    said = heard(readings)
    moved = readings.positions + trust.place_offsets
    known = trust.missing == 0
    own = trust.own + np.nan_to_num(trust.steps)
    swings, gaps = np.empty_like(moved), np.empty_like(moved)
    last = np.where(known[:, 1, None, None], trust.turns, turns)
    _kernels.turn_gaps(trust.turn_offsets, readings.rotations, last, turns, swings, gaps)
    swung = np.sqrt((swings**2).sum(axis=1))
    jumped, spun = _jumped(trust, moved, own, places, settings), swung > settings.step_orientation
    far = jumped | (spun & ~said[:, 0])
    if 2 * int(far.sum()) > int(said.any(axis=1).sum()) and _rigid(moved[far], own[far], settings.step_position):
        far = np.zeros_like(far)
    stays = ~(_distances(moved, trust.strays) > 2.0 * settings.step_position)
    doubted = np.where(far, np.where(stays, trust.doubted + 1, 1), 0)
    silenced = far & (doubted <= settings.patience)
    unsteady = np.where(spun & said[:, 0] & ~far, trust.unsteady + 1, 0)
    taken = said & ~silenced[:, None]
    taken[:, 1] &= (unsteady <= 1) | (unsteady > settings.patience)
    back = taken & ((trust.missing != 0) | (far & ~silenced)[:, None])
    place_offsets = np.where(back[:, :1], places - readings.positions, trust.place_offsets)
    place_offsets = _faded(place_offsets, settings.fading, settings.glide_position)
    turn_offsets = _faded(np.where(back[:, 1:], gaps, trust.turn_offsets), settings.fading, settings.glide_orientation)
    positions = readings.positions + place_offsets
    rotations = matrix_from_rotvec(turn_offsets) @ readings.rotations
    missing = np.where(taken, 0, np.where(trust.missing < 0, -1, trust.missing + 1))
    steady = taken[:, 0] & known[:, 0] & ~back[:, 0]
    steps = np.where(steady[:, None], moved - trust.places, trust.steps)
    drift = steps[steady].mean(axis=0) if steady.any() else np.zeros(3)
    sigmas = readings.sigmas.copy()
    held_back = (unsteady == 1) & taken[:, 1]
    sigmas[held_back, 1] = swung[held_back]
    own = np.where(taken[:, :1], positions, own)
    positions = np.where(taken[:, :1], positions, places + drift)
    rotations = np.where(taken[:, 1, None, None], rotations, turns)
    following = Trust(
        doubted * silenced, missing, positions, rotations, steps, own,
        np.where(silenced[:, None], moved, np.nan), unsteady, place_offsets, turn_offsets,
    )  # fmt: skip
    judged = taken.copy()
    judged[held_back, 1] = False
    return Gated(_held(positions, rotations, sigmas, missing, settings), judged, following)


def _jumped(
    trust: Trust,
    moved: Floats[Array, "sensors 3"],
    own: Floats[Array, "sensors 3"],
    carried: Floats[Array, "sensors 3"],
    settings: GateSettings,
) -> Bools[Array, "sensors"]:
    """Which positions are far from where the tracker's own movement led, and, where that is old, from the pose too."""
    # A comparison with a missing value is false: a tracker without a position is judged by its orientation alone.
    reach = settings.step_position * np.where(np.isfinite(trust.steps[:, 0]), 1.0, 1.5)
    by_itself = _distances(moved, own) > reach
    by_pose = _distances(moved, carried) > settings.step_position
    missing = trust.missing[:, 0]
    return np.where(missing < 0, by_pose, by_itself & (by_pose | (missing == 0)))


def _rigid(moved: Floats[Array, "far 3"], expected: Floats[Array, "far 3"], bound: float) -> bool:
    """Whether trackers kept their distances from each other, as a body that is moved as a whole does."""
    first, second = np.triu_indices(len(moved), 1)
    change = _distances(moved[first], moved[second]) - _distances(expected[first], expected[second])
    return not bool((np.abs(change) > bound).any())


def _distances(one: Floats[Array, "points 3"], other: Floats[Array, "points 3"]) -> Floats[Array, "points"]:
    return np.sqrt(((one - other) ** 2).sum(axis=1))


def _faded(offsets: Floats[Array, "sensors 3"], fading: float, most: float) -> Floats[Array, "sensors 3"]:
    """What is left of offsets after one more sample, in which none shrinks by more than `most`."""
    sizes = np.sqrt((offsets**2).sum(axis=1, keepdims=True))
    return offsets * np.maximum(fading, 1.0 - most / np.maximum(sizes, 1e-12))


def _held(
    positions: Floats[Array, "sensors 3"],
    rotations: Floats[Array, "sensors 3 3"],
    sigmas: Floats[Array, "sensors 2"],
    missing: Ints[Array, "sensors 2"],
    settings: GateSettings,
) -> SensorReadings:
    held = (missing > 0) & (missing <= settings.hold_samples)
    silent = (missing != 0) & ~held
    loose = missing * np.array([settings.hold_position, settings.hold_orientation])
    return SensorReadings(
        np.where(silent[:, :1], np.nan, positions),
        np.where(silent[:, 1, None, None], np.nan, rotations),
        np.where(held, loose, sigmas),
    )


def _carried(
    wearer: Wearer, q: Floats[Array, "dofs"]
) -> tuple[Floats[Array, "sensors 3"], Floats[Array, "sensors 3 3"]]:
    """Where a pose carries the trackers."""
    frames, mount = forward_kinematics(wearer.skeleton, q), wearer.mount
    bones = frames.rotations[mount.bones]
    arms = (bones @ mount.p_bone_sensor[:, :, None])[:, :, 0]
    return frames.positions[mount.bones] + arms, bones @ mount.R_bone_sensor
