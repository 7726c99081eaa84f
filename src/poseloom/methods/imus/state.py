"""What the phase HMM carries from sample to sample."""

from dataclasses import dataclass

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.methods.imus.echoes import Echoes
from poseloom.methods.imus.ground import Ground, Legs
from poseloom.methods.imus.mounting import Mounting
from poseloom.methods.imus.strides import FootSensor, Stride


@dataclass(frozen=True, eq=False)
class Wearer:
    """What stays the same from the first sample to the last.

    Attributes:
        legs: The wearer's skeleton, legs and soles.
        leg: Length of a leg, metres.
        log_weight: Of each segment, how well the person's build in it fits the wearer's.
        strangeness: Of each segment, how differently who moved there is built, for the nearest frames.
        feet: The sensors on feet that are listened to for the way.
    """

    legs: Legs
    leg: float
    log_weight: Floats[Array, "segments"]
    strangeness: Floats32[Array, "segments"]
    feet: tuple[FootSensor, ...]


@dataclass(frozen=True, eq=False)
class Guess:
    """What the segments say together.

    Attributes:
        quats_wxyz: Local rotations, the root's with its heading taken off.
        variance: Of the joints' angles.
        speed: Turn of each joint to the next frame.
        others: Height, way, turn and contacts.
        signal: What the sensors are expected to say now, well mounted.
        ups: World up in the sensors' frames.
        segments: The K best segments, without the second opinion's.
        weights: Their weights among themselves.
    """

    quats_wxyz: Floats[Array, "joints 4"]
    variance: Floats[Array, "entries"]
    speed: Floats[Array, "entries"]
    others: Floats[Array, "others"]
    signal: Floats[Array, "channels"]
    ups: Floats[Array, "sensors 3"]
    segments: Ints[Array, "best"]
    weights: Floats[Array, "best"]


@dataclass(frozen=True, eq=False)
class PhaseHmmState:
    """What changes from sample to sample.

    Attributes:
        wearer: What does not.
        log_alpha: Log probability of each state given all samples; None before the first.
        echoes: How far the last samples are from those of every state.
        window: The last samples as the sensors said them, gaps filled with what was expected.
        mounting: What is known of the sensors' mounting errors.
        guess: What the segments said last; None before the first sample.
        quats_wxyz: The last pose after blending.
        q: The last pose vector.
        ground: Where the body is; None before the first sample.
        strides: What each of the sensors on feet says of the way.
        heading: Radians about world up.
        drift: How much faster the wearer turns than the examples, radians a frame.
        gone: Metres gone so far.
        age: Samples heard so far, up to a window's length.
        turn: Which states are looked at anew at the next sample.
        silent: Samples in a row in which no sensor spoke.
        rejoining: Samples left in which the pose only slowly follows, after a silence.
    """

    wearer: Wearer
    log_alpha: Floats[Array, "states"] | None
    echoes: Echoes
    window: Floats[Array, "window channels"]
    mounting: Mounting
    guess: Guess | None
    quats_wxyz: Floats[Array, "joints 4"]
    q: Floats[Array, "dofs"]
    ground: Ground | None
    strides: tuple[Stride, ...]
    heading: float = 0.0
    drift: float = 0.0
    gone: float = 0.0
    age: int = 0
    turn: int = 0
    silent: int = 0
    rejoining: int = 0
