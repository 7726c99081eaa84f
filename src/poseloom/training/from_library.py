"""Fits a flex network to a motion library and writes its model file, with a card."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import LibraryError
from poseloom.library import Clip, MotionLibrary
from poseloom.methods.flex.angles import angle_columns
from poseloom.methods.flex.network_method import RATE
from poseloom.training.export import export
from poseloom.training.fitting import FitSettings, Fitted, fit, held_out_takes, paper_settings, scales_settings
from poseloom.training.loop import Progress
from poseloom.training.sessions import Session, chosen_clips, make_sessions, mean_angles

FLEX_LSTM, FLEX_SCALES = "flex-lstm", "flex-scales"

_VALIDATING = 0.1
_UNOBSERVED_M = 1.0


@dataclass(frozen=True)
class LibraryFit:
    """What came of fitting to a library.

    Attributes:
        path: The model's file.
        takes: Recorded takes that it learnt from.
        frames: Their frames.
        epochs: Epochs that were run.
        error: Least validation error, degrees, over takes that it did not learn from.
    """

    path: Path
    takes: int
    frames: int
    epochs: int
    error: float


def flex_settings(method: str, epochs: int | None = None, hidden: int | None = None) -> FitSettings:
    """The settings with which `poseloom fit` fits a method; epochs and hidden units in place of its own."""
    settings = paper_settings() if method == FLEX_LSTM else scales_settings()
    network = settings.network if hidden is None else replace(settings.network, hidden=hidden)
    loop = settings.loop if epochs is None else replace(settings.loop, epochs=epochs)
    if method == FLEX_SCALES and epochs is not None:
        loop = replace(loop, patience=epochs)
    return replace(settings, network=network, loop=loop, draw=replace(settings.draw, drop_outs=0.2))


def fit_to_library(
    library: MotionLibrary,
    out: Path,
    method: str,
    settings: FitSettings,
    seed: int = 0,
    wanted: Callable[[Clip], bool] = lambda clip: True,
    checkpoint: Path | None = None,
    progress: Progress | None = None,
) -> LibraryFit:
    """Fits a method to a library and writes the model.

    A tenth of the recorded takes, drawn by the seed, is not learnt from and judges when to stop.

    Args:
        library: At 50 Hz, the networks' rate.
        out: The model's file.
        method: "flex-lstm" or "flex-scales".
        settings: How.
        seed: Of weights, order, sensors and the takes that judge.
        wanted: Which clips to learn from.
        checkpoint: A file to go on from after a kill.
        progress: Told after each epoch.

    Raises:
        LibraryError: for a library at another rate, or without motions.
    """
    if library.rate != RATE:
        raise LibraryError(
            f"this library has {library.rate:g} poses a second, and flex networks hear {RATE:g} samples a second",
            remedy=f"Build one with `poseloom library build ... --rate {RATE:g}`",
            file=library.path,
        )
    clips = chosen_clips(library, wanted)
    sessions = make_sessions(library, clips, mean_angles(library, clips))
    divided = held_out_takes(sessions, _VALIDATING, seed)
    fitted = fit(sessions, divided, settings, seed, sensor_seed=1000 * seed, checkpoint=checkpoint, progress=progress)
    rest, spread = rest_pose(library, clips)
    frames = sum(len(clip) for clip in clips)
    report = LibraryFit(out, len(clips), frames, len(fitted.history.errors), min(fitted.history.errors))
    card = model_card(fitted, sessions, report)
    export(fitted, out, method, rest, spread, card, data_digest=library.digest)
    return report


def rest_pose(library: MotionLibrary, clips: tuple[Clip, ...]) -> tuple[Floats[Array, "dofs"], Floats[Array, "dofs"]]:
    """What a model says of all that it does not tell: mean angles, a root at rest at its mean height, and spreads."""
    q = np.concatenate([library.poses[clip.rows].astype(np.float64) for clip in clips])
    rest, spread = q.mean(axis=0), q.std(axis=0)
    height, rise = rest[1], spread[1]
    rest[:6] = 0.0
    rest[1] = height
    # Nobody hears the hips: anywhere, and turned anyhow.
    spread[:6] = (_UNOBSERVED_M, rise, _UNOBSERVED_M, *(np.pi / np.sqrt(3),) * 3)
    rest[angle_columns()] = 0.0
    return rest, spread


def model_card(fitted: Fitted, sessions: tuple[Session, ...], report: LibraryFit) -> dict[str, str]:
    """What one should know of a fitted model."""
    settings = fitted.settings
    people = ", ".join(session.person for session in sessions)
    return {
        "network": f"{settings.network.kind}, {settings.network.hidden} hidden units",
        "learnt from": f"{report.takes} takes, {report.frames} frames at {RATE:g} Hz of {people}",
        "sensors": f"simulated: {settings.draws} sets a person, 0 to {settings.draw.most_minutes:g} minutes of use; "
        "every second set worn by the mirror image",
        "hears": "four bends (knees, elbows), each normalised by its range as learnt on line",
        "tells": "39 angles of 13 joints; not the hips' turn and place, the neck, head, hands and feet",
        "validation error": f"{report.error:.2f} degrees a joint angle on a tenth of the takes, left out of learning",
        "limits": "simulated sensors only; what an arm does about its own length, and where the hips are, is guessed",
    }
