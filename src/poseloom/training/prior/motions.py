"""Draws stretches of motion from shards: balanced by person, mirrored, faster or slower, with others' arms."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor

from poseloom.arrays import Array, Floats, Floats32
from poseloom.skeleton.body import BODY_BONES
from poseloom.training.prior.kinematics import mirror
from poseloom.training.prior.people import check_split, person_weights
from poseloom.training.prior.shards import Shard
from poseloom.training.tensors import tensor

LEAD = 3
"""Frames before a stretch's first that accelerations need; one more after its last."""

ARMS = tuple(index for index, name in enumerate(BODY_BONES) if "Shoulder" in name or "Arm" in name or "Hand" in name)


@dataclass(frozen=True)
class MotionSettings:
    """How motions are varied.

    Attributes:
        frames: Of a stretch.
        mirrored: Share of stretches that are mirrored.
        slowest: Least factor of speed.
        fastest: Greatest factor of speed.
        arms: Share of stretches that carry the arms of another stretch.
        joint_rad: Standard deviation, an axis, of a constant by which joints are turned.
        turned: Share of stretches in which they are.
    """

    frames: int = 200
    mirrored: float = 0.5
    slowest: float = 0.8
    fastest: float = 1.25
    arms: float = 0.25
    joint_rad: float = 0.08
    turned: float = 0.6


@dataclass(frozen=True, eq=False)
class Motions:
    """A batch of stretches: `LEAD` frames, the frames that count, one more.

    Attributes:
        rotvecs: (batch, frames, joints, 3), relative to the parents.
        root: (batch, frames, 3), metres.
        contacts: (batch, frames, 4).
        weights: (batch, frames): 0 where a stretch is padded.
    """

    rotvecs: Tensor
    root: Tensor
    contacts: Tensor
    weights: Tensor


class MotionPool:
    """Shards to draw from.

    Args:
        shards: People who may be trained on.

    Raises:
        PoseloomError: for a person who is left out.
    """

    def __init__(self, shards: Sequence[Shard]) -> None:
        check_split([shard.person for shard in shards])
        self.shards = tuple(shard for shard in shards if len(shard.bounds))
        self._people = person_weights({shard.person: len(shard.q) for shard in self.shards})
        self._clips = [_shares(shard) for shard in self.shards]

    @property
    def frames(self) -> int:
        """Frames in all."""
        return sum(len(shard.q) for shard in self.shards)

    def draw(self, size: int, settings: MotionSettings, generator: Generator) -> Motions:
        """A batch of varied stretches."""
        drawn = [self._stretch(settings, generator) for _ in range(size)]
        q, contacts, weights = (tensor(np.stack(parts)) for parts in zip(*drawn, strict=True))
        root, rotvecs = q[..., :3], q[..., 3:].reshape(*q.shape[:2], -1, 3)
        flips = tensor(generator.random(size) < settings.mirrored)[:, None, None]
        turned, moved = mirror(rotvecs, root)
        rotvecs = torch.where(flips[..., None], turned, rotvecs)
        root = torch.where(flips, moved, root)
        contacts = torch.where(flips, contacts[..., [2, 3, 0, 1]], contacts)
        lent = tensor(generator.random(size) < settings.arms)[:, None, None, None]
        others = rotvecs[tensor(generator.permutation(size))][:, :, list(ARMS)]
        arms = torch.where(lent, others, rotvecs[:, :, list(ARMS)])
        rotvecs = rotvecs.index_copy(2, torch.tensor(ARMS), arms)
        return Motions(rotvecs, root, contacts, weights)

    def _stretch(
        self, settings: MotionSettings, generator: Generator
    ) -> tuple[Floats32[Array, "frames dofs"], Floats32[Array, "frames 4"], Floats32[Array, "frames"]]:
        person = int(generator.choice(len(self.shards), p=self._people))
        shard = self.shards[person]
        clip = int(generator.choice(len(shard.bounds), p=self._clips[person]))
        start, stop = int(shard.bounds[clip, 0]), int(shard.bounds[clip, 1])
        factor = math.exp(generator.uniform(math.log(settings.slowest), math.log(settings.fastest)))
        wanted = settings.frames + LEAD + 1
        room = (stop - start - 1) - (wanted - 1) * factor
        first = float(generator.uniform(0, room)) if room > 0 else 0.0
        return cut_stretch(shard.q[start:stop], shard.contacts[start:stop], first + factor * np.arange(wanted))


def cut_stretch(
    q: Floats32[Array, "clip dofs"], contacts: Floats32[Array, "clip 4"], places: Floats[Array, "frames"]
) -> tuple[Floats32[Array, "frames dofs"], Floats32[Array, "frames 4"], Floats32[Array, "frames"]]:
    """A clip at any places between its frames, and whether each is within it; past its end it stands still."""
    inside = np.clip(places, 0, len(q) - 1)
    before = np.minimum(inside.astype(np.int64), max(len(q) - 2, 0))
    after = np.minimum(before + 1, len(q) - 1)
    share = (inside - before).astype(np.float32)[:, None]
    # Rotation vectors stay on one branch and turn little from frame to frame: a straight line between them will do.
    between = (1 - share) * q[before] + share * q[after]
    touch = np.where(share < 0.5, contacts[before], contacts[after])
    return between, touch, (places <= len(q) - 1).astype(np.float32)


def _shares(shard: Shard) -> Floats[Array, "clips"]:
    lengths = (shard.bounds[:, 1] - shard.bounds[:, 0]).astype(np.float64)
    return lengths / lengths.sum()
