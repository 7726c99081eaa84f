"""How far off a series of angles is, and how jerky."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats, Floats32
from poseloom.methods.flex.angles import angle_errors, moving_angles
from poseloom.rotations import unwrap_rotvec
from poseloom.training.sessions import Session
from poseloom.training.splits import Piece

Teller = Callable[[Floats32[Array, "frames inputs"]], Floats[Array, "frames angles"]]
"""What a contestant makes of a series from an empty memory: angles in radians, one row a frame, causally."""

Output = Callable[[Floats[Array, "frames angles"]], Floats[Array, "frames angles"]]
"""What is made of a contestant's answers over time: a median, a smoothing, or nothing."""


@dataclass(frozen=True, eq=False)
class PieceScore:
    """What came of one piece.

    Attributes:
        person: Who.
        name: Which take.
        tags: Words for what happens in it.
        frames: Frames that count.
        errors: Mean absolute error of each angle, degrees.
        jitter: Mean absolute third derivative over all angles, degrees a cubic second; NaN for under four frames.
    """

    person: str
    name: str
    tags: tuple[str, ...]
    frames: int
    errors: Floats[Array, "angles"]
    jitter: float


@dataclass(frozen=True)
class Score:
    """A contestant's score over pieces: means over all their frames, as the paper's.

    Attributes:
        error: Mean over all 39 angles, degrees, the paper's measure.
        moving: Mean over the angles that move, degrees.
        jitter: Degrees a cubic second over the 39 angles.
        sequences: Number of pieces.
        frames: Number of frames.
    """

    error: float
    moving: float
    jitter: float
    sequences: int
    frames: int


def jitter_of(angles: Floats[Array, "frames angles"], rate: float) -> float:
    """Mean absolute third derivative in degrees a cubic second; NaN for under four frames."""
    if len(angles) < 4:
        return float("nan")
    turns = unwrap_rotvec(angles.reshape(len(angles), -1, 3)).reshape(len(angles), -1)
    return float(np.abs(np.diff(np.degrees(turns), n=3, axis=0)).mean() * rate**3)


def score_pieces(
    sessions: Sequence[Session],
    pieces: Sequence[Piece],
    inputs: Sequence[Floats32[Array, "_ inputs"]],
    tell: Teller,
) -> tuple[PieceScore, ...]:
    """Scores a contestant on pieces; each is begun anew."""
    return score_outputs(sessions, pieces, inputs, tell, {"": lambda told: told})[""]


def score_outputs(
    sessions: Sequence[Session],
    pieces: Sequence[Piece],
    inputs: Sequence[Floats32[Array, "_ inputs"]],
    tell: Teller,
    outputs: Mapping[str, Output],
) -> dict[str, tuple[PieceScore, ...]]:
    """Scores several outputs of one contestant, which is asked once.

    Args:
        sessions: The sessions.
        pieces: What is asked.
        inputs: What is heard of each session.
        tell: The contestant.
        outputs: What is made of its answers, by name.
    """
    scores: dict[str, list[PieceScore]] = {name: [] for name in outputs}
    for piece in pieces:
        session = sessions[piece.session]
        truth = session.angles[piece.start : piece.stop].astype(np.float64)
        told = tell(inputs[piece.session][piece.heard : piece.stop])
        for name, output in outputs.items():
            said = output(told)[piece.start - piece.heard :]
            scores[name].append(
                PieceScore(
                    session.person, piece.take.name, piece.take.tags, len(truth),
                    angle_errors(truth, said).mean(axis=0), jitter_of(said, session.rate),
                )
            )  # fmt: skip
    return {name: tuple(own) for name, own in scores.items()}


def pooled(scores: Sequence[PieceScore]) -> Score:
    """The mean over all frames of all pieces."""
    frames = np.array([score.frames for score in scores], dtype=np.float64)
    errors = pooled_errors(scores)
    jitters = np.array([score.jitter for score in scores])
    known = np.isfinite(jitters)
    jitter = float(np.average(jitters[known], weights=frames[known])) if known.any() else float("nan")
    return Score(float(errors.mean()), float(errors[moving_angles()].mean()), jitter, len(scores), int(frames.sum()))


def pooled_errors(scores: Sequence[PieceScore]) -> Floats[Array, "angles"]:
    """Mean error of each angle over all frames of all pieces, degrees."""
    frames = np.array([score.frames for score in scores], dtype=np.float64)
    return np.asarray(np.average(np.stack([score.errors for score in scores]), axis=0, weights=frames))
