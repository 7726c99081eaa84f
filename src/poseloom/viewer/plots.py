"""Plots of what goes on, with as many points as a small plot can show and no more."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import viser
from viser import uplot

from poseloom.arrays import Array, Floats
from poseloom.sensors import Sample, SensorKind, SensorLayout
from poseloom.viewer.colours import Colour, hexadecimal

LINE_COLOURS: tuple[Colour, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
    (107, 91, 149),
)
POINTS = 240
"""Points of a plot: a panel is about 300 pixels wide."""

_HEIGHT = 150


@dataclass(frozen=True)
class PlotLook:
    """What a plot says of itself.

    Attributes:
        title: What is shown, with its unit.
        labels: One a line.
        colours: One a line.
        low: Lowest value that the axis reaches at least; None for the data's.
    """

    title: str
    labels: tuple[str, ...]
    colours: tuple[Colour, ...] = LINE_COLOURS
    low: float | None = None


@dataclass
class Rolling:
    """The last seconds of a few quantities, decimated: of all values within one of the plot's steps the last counts, or
    the largest where peaks matter.

    Attributes:
        count: How many quantities.
        seconds: How long values are kept.
        peaks: Whether the largest value of a step is kept.
    """

    count: int
    seconds: float = 12.0
    peaks: bool = False
    _times: list[float] = field(default_factory=list[float])
    _rows: list[Floats[Array, "lines"]] = field(default_factory=list[np.ndarray])
    _step: int = -1

    def add(self, time: float, values: Floats[Array, "lines"]) -> None:
        """Takes in the values of a moment; NaN repeats the last known one."""
        if self._times and time < self._times[-1] - self.seconds:
            self._times, self._rows, self._step = [], [], -1
        step = int(time * POINTS / self.seconds)
        if self._rows:
            values = np.where(np.isfinite(values), values, self._rows[-1])
        if step == self._step and self._rows:
            self._rows[-1] = np.fmax(self._rows[-1], values) if self.peaks else values
            return
        self._step = step
        self._times.append(time)
        self._rows.append(values)
        while len(self._times) > POINTS or self._times[0] < time - self.seconds:
            del self._times[0], self._rows[0]

    def lines(self) -> tuple[Floats[Array, "points"], ...]:
        """Times, counted back from the last one, and for each quantity its values."""
        if not self._times:
            return tuple(np.zeros(1) for _ in range(self.count + 1))
        rows = np.nan_to_num(np.stack(self._rows))
        return (np.array(self._times) - self._times[-1], *(np.ascontiguousarray(rows[:, i]) for i in range(self.count)))


def add_plot(gui: viser.GuiApi, look: PlotLook, lines: tuple[Floats[Array, "points"], ...]) -> viser.GuiUplotHandle:
    """A plot over seconds.

    Args:
        gui: Where it goes: into the container that is open.
        look: What it says of itself.
        lines: Seconds, then the values of each line.
    """
    series: list[uplot.Series] = [uplot.Series(label="s")]
    for index, label in enumerate(look.labels):
        colour = hexadecimal(look.colours[index % len(look.colours)])
        series.append(uplot.Series(label=label, stroke=colour, width=1.5))
    value: uplot.Scale = uplot.Scale(auto=True)
    if look.low is not None:
        value = uplot.Scale(auto=True, range={"min": {"soft": look.low, "mode": 1}, "max": {"pad": 0.1}})  # type: ignore[typeddict-item]
    return gui.add_uplot(
        lines,
        tuple(series),
        title=look.title,
        scales={"x": uplot.Scale(time=False), "y": value},
        legend=uplot.Legend(show=len(look.labels) > 1, live=False),
        height=_HEIGHT,
        padding=(4, 8, 0, 0),
    )


def decimated(
    times: Floats[Array, "samples"], values: Floats[Array, "samples lines"], points: int = 2 * POINTS
) -> tuple[Floats[Array, "points"], ...]:
    """Every so-manyth moment of a long series, as lines of a plot; gaps hold the last value."""
    chosen = np.unique(np.linspace(0, len(times) - 1, min(points, len(times))).astype(np.int64))
    held = np.empty_like(values[chosen])
    last = np.zeros(values.shape[1])
    for row, index in enumerate(chosen):
        last = np.where(np.isfinite(values[index]), values[index], last)
        held[row] = last
    return (times[chosen], *(np.ascontiguousarray(held[:, i]) for i in range(values.shape[1])))


@dataclass(frozen=True)
class Signal:
    """One sort of signal of a layout's sensors.

    Attributes:
        kind: Whose.
        title: What is shown, with its unit.
        sensors: Positions of these sensors on the sensor axis.
        labels: Their names.
    """

    kind: SensorKind
    title: str
    sensors: tuple[int, ...]
    labels: tuple[str, ...]

    def values(self, sample: Sample) -> Floats[Array, "lines"]:
        """One number a sensor: a tracker's height, an IMU's specific force, a flex sensor's counts."""
        rows = list(self.sensors)
        if self.kind is SensorKind.TRACKER:
            return sample.positions[rows, 1]
        if self.kind is SensorKind.IMU:
            return np.linalg.norm(sample.specific_forces[rows], axis=1)
        return sample.counts[rows]


_TITLES = {
    SensorKind.TRACKER: "height, m",
    SensorKind.IMU: "specific force, m/s²",
    SensorKind.FLEX: "counts",
}


def signals_of(layout: SensorLayout) -> Sequence[Signal]:
    """What is plotted of a layout's sensors: one plot a kind."""
    found: list[Signal] = []
    for kind, title in _TITLES.items():
        sensors = layout.of_kind(kind)
        if sensors:
            found.append(Signal(kind, title, sensors, tuple(layout.names[i] for i in sensors)))
    return found
