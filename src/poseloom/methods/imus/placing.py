"""The pose that the segments state, blended with the last one and put in its place: heading, way and standing feet."""

import math
from dataclasses import replace

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.methods.imus import _pose_kernels
from poseloom.methods.imus.ground import Footing, heading_turn, move, start_ground
from poseloom.methods.imus.model import WAY_ENTRIES
from poseloom.methods.imus.settings import PhaseHmmSettings
from poseloom.methods.imus.state import Guess, PhaseHmmState
from poseloom.methods.imus.strides import missing_turn, missing_way, shown
from poseloom.rotations import nearest_branch, quat_from_matrix, quat_multiply, rotvec_from_quat


def footing_of(how: PhaseHmmSettings, rate: float) -> Footing:
    """How the body is put on its feet at a rate in Hz."""
    paid = min(1 / (how.way_seconds * rate), 1.0) if how.way_seconds > 0 else 0.0
    return Footing(how.contact_lock, how.lock_limit, paid, float(np.exp(-1 / (how.way_memory * rate))))


def in_place(
    before: PhaseHmmState,
    state: PhaseHmmState,
    guess: Guess,
    live: Floats[Array, "channels"],
    how: PhaseHmmSettings,
    footing: Footing,
    rate: float,
) -> PhaseHmmState:
    """The state with the blended pose in its place.

    Args:
        before: At the last sample.
        state: At this one, the pose still the last one.
        guess: What the segments say now.
        live: What well-mounted sensors would say now.
        how: Settings.
        footing: How the body is put on its feet.
        rate: Samples a second.
    """
    height = float(guess.others[0]) * state.wearer.leg
    standing = np.clip(guess.others[WAY_ENTRIES:], 0.0, 1.0)
    if before.ground is None or before.guess is None:
        q = _vector(guess.quats_wxyz, 0.0, before.q)
        q[1] = height
        ground = start_ground(state.wearer.legs, q, standing)
        q[:3] = ground.root
        return replace(state, quats_wxyz=guess.quats_wxyz, q=q, ground=ground)
    blended = _blended(before, state, guess, how)
    excess = float((guess.ups * (live - guess.signal).reshape(-1, 2, 3)[:, 1]).sum()) / len(guess.ups)
    drift = before.drift + (excess / rate - before.drift) / (how.turn_seconds * rate)
    last = before.guess.others
    heading = before.heading + float(last[3]) + drift + footing.paid * missing_turn(state.strides)
    way = state.wearer.leg * (heading_turn(before.heading) @ np.array([last[1], 0.0, last[2]]))[[0, 2]]
    q, missing = _vector(blended, heading, before.q), missing_way(state.strides)
    ground, q = move(state.wearer.legs, before.ground, q, way, height, standing, missing, footing)
    went = (ground.soles - before.ground.soles).reshape(2, 2, 3).mean(axis=1)[:, [0, 2]]
    ahead = (ground.soles[1::2] - ground.soles[::2])[:, [0, 2]]
    strides = tuple(
        shown(
            stride, foot, went[foot.side], math.atan2(ahead[foot.side, 0], ahead[foot.side, 1]), footing.paid, 1 / rate
        )
        for stride, foot in zip(state.strides, state.wearer.feet, strict=True)
    )
    gone = before.gone + float(np.linalg.norm(ground.root[[0, 2]] - before.ground.root[[0, 2]]))
    return replace(
        state, quats_wxyz=blended, q=q, ground=ground, strides=strides, heading=heading, drift=drift, gone=gone
    )


def _blended(
    before: PhaseHmmState, state: PhaseHmmState, guess: Guess, how: PhaseHmmSettings
) -> Floats[Array, "joints 4"]:
    """The last pose moved on by its velocity and from there a share of the way to the guess."""
    assert before.guess is not None
    whole = state.age >= len(state.window)
    share, limit = (how.blend, how.turn_limit) if whole else (how.start_blend, how.start_limit)
    limit = how.rejoin_limit if state.rejoining else limit
    out = np.empty_like(guess.quats_wxyz)
    _pose_kernels.blend(before.quats_wxyz, before.guess.speed, guess.quats_wxyz, share, limit, out)
    return out


def _vector(quats: Floats[Array, "joints 4"], heading: float, last: Floats[Array, "dofs"]) -> Floats[Array, "dofs"]:
    """The pose vector of a heading and local rotations, on the last one's branch, the root's place left at zero."""
    turned = quats.copy()
    turned[0] = quat_multiply(quat_from_matrix(heading_turn(heading)), quats[0])
    q = np.zeros(3 + 3 * len(quats))
    q[3:] = nearest_branch(rotvec_from_quat(turned), last[3:].reshape(-1, 3)).reshape(-1)
    return q
