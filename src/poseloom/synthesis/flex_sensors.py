"""What flex sensors are like: figures of a whole batch of them, and single sensors drawn from it."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.random import Generator

from poseloom.arrays import Array, Floats
from poseloom.errors import SensorError

FULL_BEND = math.radians(150.0)
"""Bend at which a sensor's range is stated, radians: about a fully bent elbow or knee."""


@dataclass(frozen=True)
class Spread:
    """A positive figure that differs from sensor to sensor (log-normal).

    Attributes:
        median: Its median.
        log_sd: Standard deviation of its natural logarithm.
    """

    median: float
    log_sd: float = 0.0


@dataclass(frozen=True)
class FlexBoard:
    """The electronics: Wheatstone bridge, amplifier, low-pass and converter (flex paper, equation 1).

    `V / Vcc = (R_sensor / (R_divider + R_sensor) - 1/2) gain`; the converter reads `4096 V / Vcc`.

    Attributes:
        gain: Of the amplifier.
        low_pass_hz: Corner of the filter of first order; the paper's is 300 Hz.
        bits: Of the converter.
    """

    gain: float = 4.0
    low_pass_hz: float = 300.0
    bits: int = 12

    @property
    def top(self) -> float:
        """The highest count."""
        return float(2**self.bits - 1)


@dataclass(frozen=True)
class FlexSensors:
    """A batch of flex sensors, worn on joints: each sensor's figures are drawn from these.

    The defaults come from real sensors as far as these tell them (`flex_sensors.json` beside this module, which
    `poseloom fit flex-sensor` writes); the others are assumed, as it says there.

    Resistances are in units of the sensor's flat, new resistance. A bend x, as a share of `FULL_BEND`, gives the
    resistance `flat(m) + range left(m) (exp(c y) - 1) / (exp(c) - 1)` after m minutes of use, with y the bend after
    slip, hysteresis and lag.

    Attributes:
        range: Growth of the resistance from flat to the full bend, when new.
        curvature: c of the curve; 0 is a straight line.
        hysteresis: Height of the loop between bending and straightening, as a share of the range. Four play operators
            (Prandtl and Ishlinskii), so small movements make small loops.
        lag_share: Share of the bend that follows only slowly, as a viscous strip does.
        lag_seconds: Its time constant.
        divider: Resistance of the divider, in units of the sensor's flat resistance.
        slip: Standard deviation of the share by which the bend of the strip differs from the joint's while the
            sensor wanders on the cloth.
        slip_seconds: Time after which slip is forgotten.
        creep: Growth of the flat resistance by each factor e of 1 + minutes / creep_minutes.
        creep_minutes: Minutes of use until creep slows.
        shrink: Share of the range that long use takes.
        shrink_minutes: Minutes of use that take 63 % of that.
        noise: Standard deviation of white noise, counts.
        opens: Open contacts a minute: the reading runs to the upper end.
        open_seconds: Mean length of those (exponential).
        spikes: Shorts of a single sample a minute: the reading falls to zero.
        loose: Probability that a sensor has a loose contact ...
        loose_opens: ... and how many open contacts a minute it then has.
        lost_lines: Probability that the board's line, all sensors of it, is lost.
        board: The electronics.
    """

    range: Spread = Spread(0.8, 0.213)
    curvature: Spread = Spread(2.89, 0.705)
    hysteresis: Spread = Spread(0.0101, 1.2)
    lag_share: Spread = Spread(0.0341, 1.47)
    lag_seconds: Spread = Spread(3.54, 0.519)
    divider: Spread = Spread(0.85, 0.04)
    slip: Spread = Spread(0.0365, 0.871)
    slip_seconds: Spread = Spread(6.19, 0.5)
    creep: Spread = Spread(0.0369, 0.4)
    creep_minutes: Spread = Spread(5.0, 0.2)
    shrink: Spread = Spread(0.15, 0.4)
    shrink_minutes: Spread = Spread(40.0, 0.2)
    noise: Spread = Spread(2.0, 0.3)
    opens: Spread = Spread(0.01, 1.0)
    open_seconds: Spread = Spread(0.172, 0.0)
    spikes: Spread = Spread(0.01, 1.0)
    loose: float = 0.0
    loose_opens: Spread = Spread(29.4, 0.5)
    lost_lines: float = 0.001
    board: FlexBoard = FlexBoard()

    @property
    def spreads(self) -> dict[str, Spread]:
        """The figures that differ from sensor to sensor, by name."""
        return {each.name: value for each in fields(self) if isinstance(value := getattr(self, each.name), Spread)}


@dataclass(frozen=True, eq=False)
class FlexChannels:
    """Sensors that were drawn.

    Attributes:
        figures: One row a sensor, one column for each name of `FlexSensors.spreads`, in its order.
        lost_lines: As in `FlexSensors`.
        board: As in `FlexSensors`.
    """

    figures: Floats[Array, "channels figures"]
    lost_lines: float
    board: FlexBoard

    def __len__(self) -> int:
        return len(self.figures)

    def figure(self, name: str) -> Floats[Array, "channels"]:
        """One figure of all sensors, by its name in `FlexSensors`."""
        return self.figures[:, _FIGURES.index(name)]


IDEAL_FLEX = FlexSensors(
    hysteresis=Spread(0.0),
    lag_share=Spread(0.0),
    slip=Spread(0.0),
    noise=Spread(0.0),
    opens=Spread(0.0),
    spikes=Spread(0.0),
    lost_lines=0.0,
)
"""Sensors whose counts depend on the bend alone, as long as they do not age."""

_FIGURES = tuple(FlexSensors().spreads)
"""Names of the drawn figures; `flex_kernels` reads the columns in this order."""

_LARGEST = {"curvature": 6.0, "hysteresis": 0.2, "lag_share": 0.6, "slip": 0.3, "shrink": 0.9}
"""Draws above these are cut: no sensor was found beyond them, and far beyond the curve would turn over."""


def check_sensors(sensors: FlexSensors) -> None:
    """Raises SensorError for figures that are not finite, negative, or no probability."""
    for name, spread in sensors.spreads.items():
        median, log_sd = spread.median, spread.log_sd
        positive = name in ("range", "divider") or name.endswith(("_seconds", "_minutes"))
        if not (math.isfinite(median) and math.isfinite(log_sd) and median >= 0 and log_sd >= 0) or (
            positive and median == 0
        ):
            raise SensorError(
                f"the flex sensors' {name} is {median} with a spread of {log_sd}",
                remedy=f"Give finite numbers{', positive' if positive else ' that are not negative'}",
            )
    for name in ("loose", "lost_lines"):
        if not 0 <= getattr(sensors, name) <= 1:
            raise SensorError(
                f"the flex sensors' {name} is {getattr(sensors, name)}", remedy="Give a number from 0 to 1"
            )
    board = sensors.board
    if not (math.isfinite(board.gain) and board.gain > 0 and board.low_pass_hz > 0 and 1 <= board.bits <= 24):
        raise SensorError(
            f"the board has a gain of {board.gain}, a low-pass of {board.low_pass_hz} Hz and {board.bits} bits",
            remedy="Give a positive gain and corner, and 1 to 24 bits",
        )


def draw_channels(sensors: FlexSensors, count: int, generator: Generator) -> FlexChannels:
    """Draws single sensors from a batch.

    Raises:
        SensorError: if a figure makes no sense.
    """
    check_sensors(sensors)
    spreads = sensors.spreads
    figures = np.array([spread.median for spread in spreads.values()]) * np.exp(
        np.array([spread.log_sd for spread in spreads.values()]) * generator.normal(size=(count, len(spreads)))
    )
    names = list(spreads)
    loose = generator.random(count) < sensors.loose
    figures[loose, names.index("opens")] = figures[loose, names.index("loose_opens")]
    for column, name in enumerate(names):
        if name in _LARGEST:
            figures[:, column] = np.minimum(figures[:, column], _LARGEST[name])
    return FlexChannels(figures, sensors.lost_lines, sensors.board)
