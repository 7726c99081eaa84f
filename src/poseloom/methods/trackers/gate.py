"""What of the trackers' word is taken at once, what is doubted, and how a lost tracker goes and comes back gently."""

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
        doubted: Samples in a row in which it was too far from where it was expected.
        missing: Samples in a row in which its position and its orientation were not taken; -1 where never yet.
        places: Where it was in the last sample, metres: as heard, else as the pose carried it.
        turns: How it was turned there.
        steps: How far it had moved since the sample before.
        place_offsets: Metres still added to its position since it came back, so that the pose glides to it.
        turn_offsets: The same for its orientation: rotation vectors in the world.
    """

    doubted: Ints[Array, "sensors"]
    missing: Ints[Array, "sensors 2"]
    places: Floats[Array, "sensors 3"]
    turns: Floats[Array, "sensors 3 3"]
    steps: Floats[Array, "sensors 3"]
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
    """The first readings: all are taken, and stand still as far as is known."""
    nothing, said = np.zeros_like(readings.positions), heard(readings)
    missing = np.where(said, 0, -1)
    doubted = np.zeros(len(nothing), dtype=np.int64)
    return Gated(
        readings, said, Trust(doubted, missing, readings.positions, readings.rotations, nothing, nothing, nothing)
    )


def gate(
    trust: Trust, readings: SensorReadings, wearer: Wearer, newest: Floats[Array, "dofs"], settings: GateSettings
) -> Gated:
    """Silences what nobody's movement explains, and lets lost trackers go and come back gently.

    A tracker far from where its own movement leads to is not heard for a few samples; if it stays there, it is right.
    If most are far off, something else has happened, and all are heard. What is not heard is held where the newest pose
    carries it, with less trust each sample, so that the pose glides to what the model believes. What comes back starts
    from where the newest pose has it, and the difference fades away.
    """
    places, turns = _carried(wearer, newest)
    said = heard(readings)
    moved = readings.positions + trust.place_offsets
    known = trust.missing == 0
    shifts = np.where(known[:, :1], trust.places + trust.steps, places) - moved
    swings, gaps = np.empty_like(moved), np.empty_like(moved)
    last = np.where(known[:, 1, None, None], trust.turns, turns)
    _kernels.turn_gaps(trust.turn_offsets, readings.rotations, last, turns, swings, gaps)
    far = _far(shifts, swings, said, settings)
    doubted = np.where(far, trust.doubted + 1, 0)
    silenced = far & (doubted <= settings.patience)
    taken = said & ~silenced[:, None]
    back = taken & ((trust.missing != 0) | (far & ~silenced)[:, None])
    place_offsets = np.where(back[:, :1], places - readings.positions, trust.place_offsets)
    place_offsets = _faded(place_offsets, settings.fading, settings.glide_position)
    turn_offsets = _faded(np.where(back[:, 1:], gaps, trust.turn_offsets), settings.fading, settings.glide_orientation)
    positions = readings.positions + place_offsets
    rotations = matrix_from_rotvec(turn_offsets) @ readings.rotations
    missing = np.where(taken, 0, np.where(trust.missing < 0, -1, trust.missing + 1))
    steady = taken[:, 0] & known[:, 0] & ~back[:, 0]
    steps = np.where(steady[:, None], positions - trust.places, 0.0)
    drift = steps[steady].mean(axis=0) if steady.any() else np.zeros(3)
    positions = np.where(taken[:, :1], positions, places + drift)
    rotations = np.where(taken[:, 1, None, None], rotations, turns)
    following = Trust(doubted * silenced, missing, positions, rotations, steps, place_offsets, turn_offsets)
    return Gated(_held(positions, rotations, readings.sigmas, missing, settings), taken, following)


def _faded(offsets: Floats[Array, "sensors 3"], fading: float, most: float) -> Floats[Array, "sensors 3"]:
    """What is left of offsets after one more sample, in which none shrinks by more than `most`."""
    sizes = np.sqrt((offsets**2).sum(axis=1, keepdims=True))
    return offsets * np.maximum(fading, 1.0 - most / np.maximum(sizes, 1e-12))


def _far(
    shifts: Floats[Array, "sensors 3"],
    swings: Floats[Array, "sensors 3"],
    said: Bools[Array, "sensors 2"],
    settings: GateSettings,
) -> Bools[Array, "sensors"]:
    # A comparison with a missing value is false: a tracker without a position is judged by its orientation alone.
    far = (shifts**2).sum(axis=1) > settings.step_position**2
    far |= (swings**2).sum(axis=1) > settings.step_orientation**2
    return far if 2 * int(far.sum()) <= int(said.any(axis=1).sum()) else np.zeros_like(far)


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
