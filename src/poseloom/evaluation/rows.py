"""The one form in which benchmarks and evaluations leave their figures: a JSON file of rows.

{"benchmark": ..., "version": ..., "data_digest": ...,
 "rows": [{"table", "method", "setting", "split", "metric", "value", "spread", "sequences", "frames", "seed"}, ...],
 "sequences": [{"name", "frames", "seed", "methods": {method: {metric: value}}}, ...]}   (where a run keeps them)
"""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

from poseloom.errors import FormatError
from poseloom.formats._files import read_json
from poseloom.formats.atomic import atomic_file
from poseloom.skeleton.motion import Motion


@dataclass(frozen=True)
class Row:
    """One figure of one table.

    Attributes:
        table: Which table it belongs to, e.g. "evaluate".
        method: Method, or the thing measured, e.g. "local-regression" or "forward kinematics".
        setting: What was varied or held, in words, e.g. "six-trackers, 3 mm"; empty where there is one setting only.
        split: "by-sequence", "by-subject", "within-sequence" or "none".
        metric: Name with its unit, e.g. "joint_angle_deg".
        value: The figure: a mean over sequences where there are several.
        spread: Standard deviation over sequences; None where there are fewer than two.
        sequences: Number of sequences behind it, 0 where the notion does not apply.
        frames: Number of frames, or of repetitions, behind it.
        seed: Seed of what was drawn; None where nothing was.
    """

    table: str
    method: str
    setting: str
    split: str
    metric: str
    value: float
    spread: float | None = None
    sequences: int = 0
    frames: int = 0
    seed: int | None = None


@dataclass(frozen=True)
class SequenceFigures:
    """The figures of one sequence.

    Attributes:
        name: What the sequence is called.
        frames: Frames of its truth.
        seed: Seed of what was drawn for it.
        methods: Metrics by method; one that is not defined is left out.
    """

    name: str
    frames: int
    seed: int
    methods: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Results:
    """The rows of one run.

    Attributes:
        benchmark: Name of what ran, e.g. "evaluate" or "core".
        data_digest: Digest of the data behind the rows (see `motions_digest`); empty where no data was read.
        rows: The figures.
        version: Version of poseloom that made them.
        sequences: The figures of each sequence by itself, where a run keeps them.
    """

    benchmark: str
    data_digest: str
    rows: tuple[Row, ...]
    version: str = ""
    sequences: tuple[SequenceFigures, ...] = ()


def motions_digest(motions: Iterable[Motion]) -> str:
    """SHA-256 over rates, bone offsets and pose vectors, in the order given; names do not count."""
    digest = hashlib.sha256()
    for motion in motions:
        digest.update(repr((motion.rate, motion.q.shape)).encode())
        digest.update(motion.skeleton.offsets.astype("<f8").tobytes())
        digest.update(motion.q.astype("<f8").tobytes())
    return digest.hexdigest()


def write_results(results: Results, path: str | Path) -> None:
    """Writes the JSON file, whole or not at all; an empty version is filled with the running one.

    Raises:
        FormatError: where a value is not finite (leave such a row out).
        OSError: where the file cannot be written.
    """
    target = Path(path)
    for row in results.rows:
        if not math.isfinite(row.value) or (row.spread is not None and not math.isfinite(row.spread)):
            raise FormatError(
                f"row {row.method!r} {row.metric!r} has value {row.value} and spread {row.spread}",
                cause="JSON knows no such numbers",
                remedy="Leave rows without a figure out",
                file=target,
            )
    content: dict[str, Any] = {
        "benchmark": results.benchmark,
        "version": results.version or version("poseloom"),
        "data_digest": results.data_digest,
        "rows": [asdict(row) for row in results.rows],
    }
    if results.sequences:
        content["sequences"] = [asdict(sequence) for sequence in results.sequences]
    with atomic_file(target) as part:
        part.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_results(path: str | Path) -> Results:
    """Reads a file of `write_results`.

    Raises:
        FormatError: where the file is none of these.
        OSError: where it cannot be read.
    """
    source = Path(path)
    try:
        content = read_json(source, "a file of benchmark rows")
        rows = tuple(_row(entry) for entry in content["rows"])
        sequences = tuple(SequenceFigures(**entry) for entry in content.get("sequences", ()))
        return Results(str(content["benchmark"]), str(content["data_digest"]), rows, str(content["version"]), sequences)
    except (ValueError, TypeError, KeyError) as error:
        raise FormatError(
            "this is no file of benchmark rows", cause=f"{type(error).__name__}: {error}", file=source
        ) from error


def _row(entry: Any) -> Row:
    values = cast("dict[str, Any]", entry)
    names = {field.name for field in fields(Row)}
    if set(values) != names:
        raise ValueError(f"a row has {sorted(values)} instead of {sorted(names)}")
    return Row(**values)
