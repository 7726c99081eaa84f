"""The one loop over samples: `reconstruct`, the live session's method thread and reprocessing all run this code."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from poseloom.methods.alignment import NO_ALIGNMENT, Alignment, aligned
from poseloom.methods.contract import Frame, Reconstructor
from poseloom.sensors import Placement, Sample
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Engine:
    """A method, and what it is started with.

    Attributes:
        name: The method's name.
        method: The method.
        skeleton: The wearer's bones.
        placements: Where the sensors are worn.
        alignment: From the sensors' world to the one in which the method receives them.
    """

    name: str
    method: Reconstructor[Any]
    skeleton: Skeleton
    placements: Sequence[Placement]
    alignment: Alignment = NO_ALIGNMENT


@dataclass(frozen=True, eq=False)
class Fold:
    """Everything that changes from sample to sample.

    Attributes:
        engine: What runs.
        state: The method's own state.
    """

    engine: Engine
    state: Any


class Advance(NamedTuple):
    """What one sample led to.

    Attributes:
        fold: The fold after the sample.
        sample: The sample as the method received it: in the aligned world.
        frame: The method's estimate; None where it gave none.
    """

    fold: Fold
    sample: Sample
    frame: Frame | None


def begin(engine: Engine) -> Fold:
    """The fold before the first sample. Raises what the method's `start` raises."""
    return Fold(engine, engine.method.start(engine.skeleton, engine.placements))


def advance(fold: Fold, sample: Sample) -> Advance:
    """Takes in one sample; changes neither argument. Raises what the method's `step` raises."""
    received = aligned(sample, fold.engine.alignment)
    state, frame = fold.engine.method.step(fold.state, received)
    return Advance(Fold(fold.engine, state), received, frame)
