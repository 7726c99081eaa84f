"""What the phase HMM has learnt: states, phases, transitions and maps, as arrays."""

from dataclasses import dataclass

from poseloom.arrays import Array, Floats, Floats32, Ints
from poseloom.methods.imus.features import SignalFeatures


@dataclass(frozen=True, eq=False)
class Emission:
    """What one length of windows says of the states.

    Attributes:
        signal_features: How windows of the live signal become columns.
        features: Of each state, the columns of its window.
        precision: Of the Gaussian about them, by upper state and column.
    """

    signal_features: SignalFeatures
    features: Floats32[Array, "states columns"]
    precision: Floats[Array, "phases columns"]


@dataclass(frozen=True, eq=False)
class HmmModel:
    """The fitted arrays. A state is a frame of a segment; segments follow each other in the order of their states.

    Attributes:
        emissions: Of windows of growing length; the last serves once so many samples were heard.
        signals: Of each state, the signal itself: specific force and angular rate of each sensor.
        quats_wxyz: Local rotations of all joints; the root's with its heading taken off.
        others: Of each state: root height, way aside and ahead to the next frame (leg lengths), turn of the heading
            (radians a frame), and whether left heel, left toes, right heel and right toes stand (0 or 1).
        ups: World up in the frame of each sensor.
        maps: Index of each state's Gaussian map: its phase and warped time.
        gains: Of each map, entries (3 a joint, then 4 of `others`) by columns.
        variances: Of each map, of the same entries given the signal.
        first: First state of each segment.
        stop: State after its last.
        phase_of_segment: Its upper state.
        successor: The segment that followed it in the recording, -1 for none.
        body_of_segment: Row of `bodies` of who moved.
        phase_of_state: Upper state of each state.
        phase_names: Of each upper state, its behaviour and phase.
        phase_sizes: Segments of each upper state.
        entry: Where the mass goes that leaves an upper state's segments.
        bodies: Bone lengths of the people recorded, metres.
    """

    emissions: tuple[Emission, ...]
    signals: Floats32[Array, "states channels"]
    quats_wxyz: Floats32[Array, "states joints 4"]
    others: Floats32[Array, "states others"]
    ups: Floats32[Array, "states sensors 3"]
    maps: Ints[Array, "states"]
    gains: Floats32[Array, "maps entries columns"]
    variances: Floats32[Array, "maps entries"]
    first: Ints[Array, "segments"]
    stop: Ints[Array, "segments"]
    phase_of_segment: Ints[Array, "segments"]
    successor: Ints[Array, "segments"]
    body_of_segment: Ints[Array, "segments"]
    phase_of_state: Ints[Array, "states"]
    phase_names: tuple[str, ...]
    phase_sizes: Ints[Array, "phases"]
    entry: Floats[Array, "phases phases"]
    bodies: Floats[Array, "bodies bones"]

    def __len__(self) -> int:
        return len(self.signals)

    @property
    def window(self) -> int:
        """Samples of the longest window."""
        return self.emissions[-1].signal_features.window


WAY_ENTRIES = 4
"""Columns of `others` that the Gaussian map corrects: height, aside, ahead, turn. The rest is contact."""
