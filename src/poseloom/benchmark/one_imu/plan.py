"""What to run of the single-IMU paper's experiments, and on what."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Progress = Callable[[str, int, int], object]
"""Called with the name of what is being done, and how many of how many are."""

OURS = "phase-hmm"
PAPERS = "phase-hmm-paper"
METHODS = (
    OURS,
    PAPERS,
    "nearest-window",
    "phase-regression",
    "sparse-accelerometers",
    "motion-primitives",
    "motion-graph",
)
"""Ours, the paper's own settings of it, and the comparators."""

FOOT, FOOT_AND_HAND = "right-foot-imu", "right-foot+right-hand-imu"
LAYOUTS = (FOOT, FOOT_AND_HAND)
"""The paper's one sensor and two."""

PLACEMENTS = ("right-foot", "right-hand", "right-forearm", "right-shank", "right-thigh", "hips", "head")
"""Of figure 10."""

PARTS = ("3", "specialists", "subject", "10", "2", "long", "transitions", "phases", "dropouts", "real", "sweep")
"""Table 3 of the joint model, of specialists and by subject; figure 10, table 2, ten minutes, transitions and changes,
phase labels, drop-outs, the real walk, and the choice of settings."""


@dataclass(frozen=True)
class Plan:
    """What to run.

    Attributes:
        data: Folder of the recordings.
        parts: Of `PARTS`.
        only: Methods that are asked where a part asks several.
        quick: An honest subset: fewer sequences and methods, one fold of the tables.
        limit: Samples of each sequence; None asks them whole.
        seed: Of all that is drawn.
        workers: Processes.
        mirrored: Whether mirror images of the training motions are trained on too.
    """

    data: Path
    parts: tuple[str, ...] = tuple(part for part in PARTS if part != "sweep")
    only: tuple[str, ...] = METHODS
    quick: bool = False
    limit: int | None = None
    seed: int = 0
    workers: int = 1
    mirrored: bool = False

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods of table 3."""
        return self.chosen((OURS, "nearest-window", "sparse-accelerometers") if self.quick else METHODS)

    def chosen(self, methods: tuple[str, ...]) -> tuple[str, ...]:
        """Those of some methods that are asked."""
        return tuple(method for method in methods if method in self.only)
