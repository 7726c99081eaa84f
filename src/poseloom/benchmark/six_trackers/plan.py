"""What to run of the six-sensor paper's experiments, and on what."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from poseloom.evaluation.cases import Conditions

Progress = Callable[[str, int, int], None]
"""Called with the name of what is being done, and how many of how many are."""

OURS = "local-filter"
PAPERS = "local-regression"


@dataclass(frozen=True)
class Contestant:
    """A method of table 2.

    Attributes:
        label: What it is called there.
        method: Its name.
        changes: What differs from its own settings.
    """

    label: str
    method: str
    changes: Mapping[str, Any] = field(default_factory=dict[str, Any])


CONTESTANTS = (
    Contestant("inverse-kinematics", "inverse-kinematics"),
    Contestant("nearest-example", "nearest-example"),
    Contestant("local-pca", "local-pca"),
    Contestant("local-pcr", "local-pcr"),
    Contestant("local-regression", PAPERS),
    Contestant("local-regression, history query", PAPERS, {"query": "history"}),
    Contestant("local-gaussian", "local-gaussian"),
    Contestant("local-filter", OURS),
)
"""Every method with its tuned settings, and the paper's once more with the query that the paper has."""


@dataclass(frozen=True)
class Plan:
    """What to run.

    Attributes:
        data: Folder of the recordings.
        libraries: Folders of the libraries, the small one first.
        quick: An honest subset: every sixth sequence, one library, by-sequence only.
        limit: Samples of each sequence.
        workers: Processes.
        conditions: Sensors, noise and seed.
        people: Simulated people of table 1; 0 leaves it out.
        fault_sequences: Sequences on which sensors fail.
        parts: Which parts to run, of `PARTS`.
    """

    data: Path
    libraries: tuple[Path, ...]
    quick: bool = False
    limit: int = 200
    workers: int = 2
    conditions: Conditions = field(default_factory=Conditions)
    people: int = 20
    fault_sequences: int = 10
    parts: tuple[str, ...] = ("1", "2", "5", "7", "three", "faults", "rejections", "search", "speed")


PARTS = ("1", "2", "5", "7", "three", "faults", "rejections", "search", "speed")
"""Table 1, table 2, figures 5 and 7, three trackers, recovery after faults, rejections of sound sensors, quality and
speed of the search."""


def quick_plan(data: Path, library: Path, conditions: Conditions) -> Plan:
    """What fits into a minute on two cores."""
    return Plan(
        data, (library,), True, 100, 2, conditions, 0, 3, tuple(part for part in PARTS if part not in ("1", "search"))
    )
