"""Training pairs: a motion and what the IMUs of a layout said while it happened, frame by frame."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import MethodError
from poseloom.library import Clip, MotionLibrary
from poseloom.methods.imus.behaviours import Behaviour, behaviour_of
from poseloom.sensors import Recording, Sample, SensorKind, SensorLayout
from poseloom.skeleton.motion import Motion
from poseloom.synthesis import ImuNoise, simulate_imus

CHANNELS = 6
"""Channels of one IMU: specific force (3, m/s^2) and angular rate (3, rad/s), both in the sensor's own frame."""

SHORTEST_FRAMES = 24
"""Shorter clips make no pair: they hold less than one phase of a walk."""

WELL_MOUNTED = ImuNoise(placement_m=0.0, placement_rad=0.0)
"""Sensors that sit as stated: what models learn from that align the wearer's sensors online."""

LOCOMOTION = (
    Behaviour.WALKING,
    Behaviour.RUNNING,
    Behaviour.JUMPING,
    Behaviour.HOPPING,
    Behaviour.SIDE_STEPPING,
    Behaviour.TURNING,
    Behaviour.IDLE,
)
"""Behaviours that one to three IMUs can tell; what else people do is not in the signal."""


@dataclass(frozen=True, eq=False)
class SignalPair:
    """A motion and the signal that belongs to it: the paper's X and Y.

    Attributes:
        motion: On its body, at the layout's rate.
        signal: For each frame the channels of the layout's IMUs side by side (6 each): specific force in m/s^2, angular
            rate in rad/s, in the sensor's frame. Never NaN in training pairs.
        behaviour: What happens.
        clip: Name of the clip, unique among pairs.
        take: The recorded take: mirror images and copies share it.
        subject: Who moves.
    """

    motion: Motion
    signal: Floats[Array, "frames channels"]
    behaviour: Behaviour
    clip: str
    take: str
    subject: str

    def __len__(self) -> int:
        return len(self.signal)


def sample_signal(sample: Sample) -> Floats[Array, "channels"]:
    """What a sample's IMUs say, side by side; NaN where nothing came."""
    return np.concatenate([sample.specific_forces, sample.angular_rates], axis=1).reshape(-1)


def recording_signal(recording: Recording) -> Floats[Array, "frames channels"]:
    """What a recording's IMUs say, one row a sample; NaN where nothing came."""
    both = np.concatenate([recording.specific_forces, recording.angular_rates], axis=2)
    return both.reshape(len(recording), -1)


def check_imus(layout: SensorLayout) -> None:
    """Raises MethodError for a layout that is not of IMUs alone."""
    others = [sensor.name for sensor in layout.sensors if sensor.kind is not SensorKind.IMU]
    if others:
        raise MethodError(
            f"layout {layout.name!r} has sensors that are no IMUs: {', '.join(others)}",
            remedy="Choose a layout of one to three IMUs, such as right-foot-imu",
        )


def pair_of_recording(
    recording: Recording, behaviour: Behaviour | None = None, subject: str = "", take: str = ""
) -> SignalPair:
    """A pair of a recording whose truth is known; gaps of the signal are bridged in straight lines.

    Raises:
        MethodError: for a recording without truth, of other sensors than IMUs, or without any signal.
    """
    check_imus(recording.layout)
    if recording.truth is None:
        raise MethodError(
            f"the recording {recording.name!r} has no truth to learn from", remedy="Give recordings with their motion"
        )
    signal = _bridged(recording_signal(recording), recording.name)
    known = behaviour or behaviour_of((), recording.truth)
    return SignalPair(
        recording.truth, frozen_float(signal), known, recording.name, take or recording.name, subject or recording.name
    )


def library_pairs(
    library: MotionLibrary,
    layout: SensorLayout,
    *,
    noise: ImuNoise | None = None,
    seed: int = 0,
    without_takes: Iterable[str] = (),
    without_subjects: Iterable[str] = (),
    behaviours: Iterable[Behaviour] | None = None,
    choose: Callable[[Clip], bool] | None = None,
    progress: Callable[[int, int], object] | None = None,
    left_out: Callable[[Clip, str], object] | None = None,
) -> tuple[SignalPair, ...]:
    """Pairs of a library's clips, the IMUs simulated at the layout's usual places.

    Each clip's errors are drawn anew, from the seed and the clip's name, so that a pair does not depend on what else is
    in the library.

    Args:
        library: Motions of the average body; best built at the layout's rate or a multiple, with mirror images.
        layout: One to three IMUs.
        noise: Errors of the sensors, mounting included; the simulator's usual ones unless given.
        seed: Of the errors.
        without_takes: Takes to leave out, with their mirror images and copies.
        without_subjects: People to leave out, with every take that one of them is known to be in.
        behaviours: Which to keep; all unless given.
        choose: Which clips to look at; all unless given.
        progress: Told how many of how many clips are done.
        left_out: Told each clip that makes no pair, and why.

    Raises:
        MethodError: for a layout that is not of IMUs alone.
        LibraryError: for a take or subject that no clip has.
    """
    check_imus(layout)
    allowed = library.rows_excluding(without_takes, without_subjects)
    wanted = None if behaviours is None else frozenset(behaviours)
    tell = left_out or _untold
    clips: list[Clip] = []
    for clip in library.clips:
        if not allowed[clip.start]:
            tell(clip, "of a take or subject that is left out")
        elif choose is not None and not choose(clip):
            tell(clip, "not among the clips that were asked for")
        else:
            clips.append(clip)
    pairs: list[SignalPair] = []
    for done, clip in enumerate(clips, 1):
        pair = _pair_of_clip(library, clip, layout, noise, seed)
        if pair is None:
            tell(clip, f"shorter than {SHORTEST_FRAMES} frames at {layout.rate:g} Hz")
        elif wanted is not None and pair.behaviour not in wanted:
            tell(clip, f"{pair.behaviour.value} is not among the behaviours")
        else:
            pairs.append(pair)
        if progress is not None:
            progress(done, len(clips))
    return tuple(pairs)


def _untold(_clip: Clip, _reason: str) -> None:
    """Tells nobody."""


def pairs_digest(pairs: Sequence[SignalPair]) -> str:
    """SHA-256 of all motions and signals, in their order: what a model was fitted to."""
    digest = sha256()
    for pair in pairs:
        digest.update(pair.clip.encode())
        digest.update(pair.motion.q.tobytes())
        digest.update(pair.signal.tobytes())
    return digest.hexdigest()


def _pair_of_clip(
    library: MotionLibrary, clip: Clip, layout: SensorLayout, noise: ImuNoise | None, seed: int
) -> SignalPair | None:
    if len(clip) * layout.rate < SHORTEST_FRAMES * library.rate:
        return None
    name = sha256(clip.name.encode()).digest()
    drawn = int(np.random.default_rng([seed, *name]).integers(2**62))
    recording = simulate_imus(library.motion(clip), layout, noise or ImuNoise(), seed=drawn)
    truth = recording.truth
    if truth is None or len(truth) < SHORTEST_FRAMES:
        return None
    signal = frozen_float(_bridged(recording_signal(recording), clip.name))
    return SignalPair(truth, signal, behaviour_of(clip.tags, truth), clip.name, clip.take, clip.subject)


def _bridged(signal: Floats[Array, "frames channels"], name: str) -> Floats[Array, "frames channels"]:
    """The signal with its gaps filled in straight lines."""
    out = signal.copy()
    frames = np.arange(len(out))
    for channel in range(out.shape[1]):
        known = np.isfinite(out[:, channel])
        if not known.any():
            raise MethodError(f"the recording {name!r} has no signal in channel {channel}", remedy="Leave it out")
        if not known.all():
            out[:, channel] = np.interp(frames, frames[known], out[known, channel])
    return out
