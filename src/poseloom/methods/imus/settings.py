"""What can be chosen of the phase HMM."""

from dataclasses import dataclass, field

import numpy as np

from poseloom.methods.imus.phases import PhaseSettings


@dataclass(frozen=True)
class PhaseHmmSettings:
    """Settings of fitting and running; the defaults are those that the validation sequences chose.

    Attributes:
        window: Samples of the signal, the newest last, of which the emission looks at; the paper's 1.
        columns: Principal components of that window that are compared; 0 compares its channels themselves.
        short_windows: Samples and columns of shorter windows, which serve until the next longer one is filled.
        window_emission: Whether a state's precision is the nearest other takes' (True) or the spread of the registered
            segments about their mean, channel by channel (False, nearer to the paper's).
        tempering: Factor of the emission's precision: windows overlap, so their evidence must not be counted anew.
        steps: Probabilities within a segment: stay, next frame, the one after it.
        upper_next: Of what leaves a segment, the share that enters the next phases; the rest exits to all others.
        continuity: Share of what leaves a segment that enters the segment that followed it in the recording.
        restart: Probability that a state is entered from nowhere.
        restart_states: States looked at for that at each step at most.
        beam: States whose log probability is so far below the best are dropped.
        neighbours: K, segments that are interpolated.
        reach: States to either side of a segment's likeliest one that count where in it one is.
        one_phase: Whether they must all be of the most probable phase.
        evenness: Segments that count in effect at least (1 over the sum of squared weights): the posterior of windows
            that overlap is too sure of itself, and the mean of some examples is nearer than the best of them.
        echoes: Frames of the examples with the nearest signals that are asked for a second opinion; 0 asks none.
        echo_share: What that opinion counts.
        echo_seconds: Time constant with which their signals' differences fade.
        echo_build: Weight of a differing build there, in variances of the signal a squared centimetre a bone.
        weight_smoothing: Share of the last step's weights that is kept.
        shrinkage: Of the Gaussian map, see `fit_gaussian_map`.
        correction: Share of the Gaussian map's correction by the live signal that is applied.
        blend: Share of the way from the last pose, moved on by its velocity, to the new one.
        turn_limit: Most radians a frame by which a joint is turned beyond its velocity.
        start_blend: `blend` until the longest window is filled: what was guessed first means little.
        start_limit: `turn_limit` until then.
        rejoin_limit: `turn_limit` during a silence and for `rejoin_seconds` after it.
        rejoin_seconds: How long a pose takes to rejoin what the sensors say after a silence.
        body_scale: Metres of difference of a bone's length that count as one standard deviation between the wearer
            and the people recorded.
        body_limit: Most standard deviations that the difference in build can count; 0 ignores the wearer's build.
        mounting: Standard deviation of the sensors' mounting error, radians: what is aligned online. 0: no alignment.
        mounting_gain: How far one sample's evidence of the mounting counts: samples are not independent.
        turn_seconds: Time constant with which the gyroscope's turning corrects the examples' turning.
        contact_lock: Probability of contact from which on a foot is held where it stands.
        lock_limit: Metres by which a held foot may be pulled away from where the pose puts it.
        way_seconds: Time constant with which the way is made up for that standing feet withhold; 0 leaves it.
        way_memory: Seconds after which that is forgotten.
        foot_odometer: Whether sensors on feet say how far a stride went (where `way_seconds` is not 0).
        lost_after: Seconds of silence after which the pose means little.
        phases: How phases are told.
    """

    window: int = 20
    columns: int = 45
    short_windows: tuple[tuple[int, int], ...] = ((4, 16), (12, 32))
    window_emission: bool = True
    tempering: float = 0.1
    steps: tuple[float, float, float] = (0.2, 0.6, 0.2)
    upper_next: float = 0.5
    continuity: float = 0.5
    restart: float = 0.2
    restart_states: int = 12_000
    beam: float = 12.0
    neighbours: int = 16
    reach: int = 3
    one_phase: bool = False
    evenness: float = 4.0
    echoes: int = 5
    echo_share: float = 0.5
    echo_seconds: float = 0.3
    echo_build: float = 0.03
    weight_smoothing: float = 0.0
    shrinkage: float = 0.3
    correction: float = 0.0
    blend: float = 0.3
    turn_limit: float = 0.07
    start_blend: float = 0.7
    start_limit: float = 0.3
    rejoin_limit: float = 0.025
    rejoin_seconds: float = 0.4
    body_scale: float = 0.002
    body_limit: float = 7.0
    mounting: float = np.deg2rad(5.0)
    mounting_gain: float = 0.3
    turn_seconds: float = 0.6
    contact_lock: float = 0.5
    lock_limit: float = 0.04
    way_seconds: float = 0.8
    way_memory: float = 4.0
    foot_odometer: bool = True
    lost_after: float = 2.0
    phases: PhaseSettings = field(default_factory=PhaseSettings)


PAPER_SETTINGS = PhaseHmmSettings(
    window=1,
    neighbours=5,
    reach=1000,
    evenness=1.0,
    columns=0,
    short_windows=(),
    window_emission=False,
    tempering=1.0,
    steps=(1 / 3, 1 / 3, 1 / 3),
    continuity=0.0,
    restart=0.001,
    one_phase=True,
    echoes=0,
    weight_smoothing=0.7,
    shrinkage=0.3,
    correction=1.0,
    blend=0.5,
    turn_limit=0.15,
    start_blend=0.5,
    start_limit=0.15,
    rejoin_limit=0.05,
    body_limit=0.0,
    mounting=0.0,
    way_seconds=0.0,
)
"""The paper's model as far as it can be run: one sample an emission, its transition probabilities, segments of the most
probable phase. A small probability of entering any state is kept, without which a lost beam could not recover."""
