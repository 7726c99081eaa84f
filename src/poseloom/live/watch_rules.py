"""The single signs of trouble with sensors, each a function of the last moments alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from poseloom.arrays import Array, Bools, Floats
from poseloom.live.contract import Trouble
from poseloom.rotations import quat_conjugate, quat_multiply, rotvec_from_quat
from poseloom.sensors import Sample, SensorKind, SensorLayout

Sign = tuple[tuple[str, Trouble], str]
"""Sensor, trouble, and the words for it."""


_RAILS = (0.0, 1023.0, 4095.0, 65535.0)
"""Ends of the ranges of converters with 10, 12 and 16 bits."""


_NOISE_OVER = 0.9
"""Seconds over which noise is judged at least; what is wrong with a unit shows by then, too."""


@dataclass(frozen=True)
class WatchSettings:
    """What counts as trouble. Not tuned on any recording that a table reports: bounds of what bodies do.

    Attributes:
        silent_after: Seconds without a reading after which a sensor is silent.
        silent_at_start: The same for one that has not spoken since the session began.
        stuck_after: Seconds of exactly the same values after which a tracker or IMU is stuck.
        flex_stuck_after: The same for a flex sensor, whose few bits do not change while a limb rests.
        rail_after: Share of the last second that a flex sensor must spend at one extreme of its converter.
        noise_position: Metres of noise (median third difference over root 20) from which a tracker is noisy.
        noise_orientation: The same for its orientation, radians.
        swap_step: Metres that both must jump for two trackers to be taken for exchanged.
        swap_share: Share of that jump by which they may miss each other's places.
        crossed_ankles: Metres by which the left ankle must be to the right of the right one, in the median.
        crossed_hands: The same for the hands, which people cross more.
        tallest: Metres between two trackers that no body spans.
        smallest: Metres that a body's trackers span at least.
        least_force: Median specific force, m/s^2, below which an IMU's unit is another.
        most_force: The same above.
        most_rate: Median angular rate, rad/s, above which an IMU speaks in degrees.
        memory: Seconds of the slow signs.
        sparse_step: Seconds between the moments that they look at.
        judge_every: Seconds between looks.
        hold: Seconds for which a slow sign must be gone before the trouble is over.
    """

    silent_after: float = 0.13
    silent_at_start: float = 2.0
    stuck_after: float = 0.5
    flex_stuck_after: float = 10.0
    rail_after: float = 0.95
    noise_position: float = 0.012
    noise_orientation: float = np.deg2rad(4.0)
    swap_step: float = 0.25
    swap_share: float = 0.4
    crossed_ankles: float = 0.08
    crossed_hands: float = 0.2
    tallest: float = 3.5
    smallest: float = 0.35
    least_force: float = 5.0
    most_force: float = 200.0
    most_rate: float = 20.0
    memory: float = 5.0
    sparse_step: float = 0.1
    judge_every: float = 0.25
    hold: float = 1.0


@dataclass(frozen=True, eq=False)
class Moments:
    """A few samples, oldest first; channels as in `Sample`."""

    times: Floats[Array, "moments"]
    positions: Floats[Array, "moments sensors 3"]
    quats_wxyz: Floats[Array, "moments sensors 4"]
    specific_forces: Floats[Array, "moments sensors 3"]
    angular_rates: Floats[Array, "moments sensors 3"]
    counts: Floats[Array, "moments sensors"]

    def __len__(self) -> int:
        return len(self.times)

    @property
    def came(self) -> Bools[Array, "moments sensors"]:
        """Who said anything."""
        finite = np.isfinite(self.counts)
        for channel in (self.positions, self.quats_wxyz, self.specific_forces, self.angular_rates):
            finite = finite | np.isfinite(channel[..., 0])
        return finite

    @classmethod
    def empty(cls, sensors: int) -> "Moments":
        """None of so many sensors."""
        return cls(np.empty(0), *(np.empty((0, sensors, size)) for size in (3, 4, 3, 3)), counts=np.empty((0, sensors)))

    @classmethod
    def of(cls, sample: Sample) -> "Moments":
        """One."""
        return cls(
            np.array([sample.time]),
            sample.positions[None],
            sample.quats_wxyz[None],
            sample.specific_forces[None],
            sample.angular_rates[None],
            sample.counts[None],
        )

    def with_newest(self, newest: "Moments", since: float) -> "Moments":
        """These from a time on, and then one more."""
        first = int(np.searchsorted(self.times, since))
        mine = (self.times, self.positions, self.quats_wxyz, self.specific_forces, self.angular_rates, self.counts)
        its = (
            newest.times,
            newest.positions,
            newest.quats_wxyz,
            newest.specific_forces,
            newest.angular_rates,
            newest.counts,
        )
        return Moments(*(np.concatenate([a[first:], b]) for a, b in zip(mine, its, strict=True)))


def stuck_sensors(recent: Moments, said: Moments) -> Bools[Array, "sensors"]:
    """Which sensors said exactly what they said in the sample before. Silence is not the same as itself."""
    came = said.came[-1] & recent.came[-1]
    for name in ("positions", "quats_wxyz", "specific_forces", "angular_rates", "counts"):
        now, before = getattr(said, name)[-1], getattr(recent, name)[-1]
        same = (now == before) | (np.isnan(now) & np.isnan(before))
        came = came & (same if same.ndim == 1 else same.all(axis=-1))
    return came


def noisy_trackers(recent: Moments, layout: SensorLayout, settings: WatchSettings) -> Iterator[Sign]:
    """Trackers whose third differences are larger than what movement leaves of them.

    White noise of s an axis has third differences of variance 20 s^2; a hand that swings 15 cm at 3 Hz leaves 1 mm of
    them at 60 Hz. Medians, so that a single jump does not count.
    """
    trackers = list(layout.of_kind(SensorKind.TRACKER))
    if len(recent) < 16 or not trackers or recent.times[-1] - recent.times[0] < _NOISE_OVER:
        return
    places = np.abs(np.diff(recent.positions[:, trackers], n=3, axis=0))
    quats = recent.quats_wxyz[:, trackers]
    turns = rotvec_from_quat(quat_multiply(quat_conjugate(quats[:-1]), quats[1:]))
    twists = np.abs(np.diff(turns, n=2, axis=0))
    # The median of a normal variable's size is 0.6745 of its standard deviation.
    scale = 0.6745 * np.sqrt(20.0)
    for column, sensor in enumerate(trackers):
        place, twist = _median(places[:, column]) / scale, _median(twists[:, column]) / scale
        if place > settings.noise_position or twist > settings.noise_orientation:
            name = layout.names[sensor]
            told = f"{1e3 * place:.0f} mm and {np.degrees(twist):.1f} degrees of noise"
            yield (name, Trouble.NOISY), f"{name} is noisy ({told}): check how it is fixed and what it can see"


def _median(values: Floats[Array, "..."]) -> float:
    said = values[np.isfinite(values)]
    return float(np.median(said)) if said.size >= 8 else 0.0


def exchanged_pair(
    recent: Moments, said: Moments, layout: SensorLayout, settings: WatchSettings
) -> tuple[int, int] | None:
    """Two trackers that jumped to each other's places between two samples, the lower index first."""
    if not len(recent):
        return None
    before, now = recent.positions[-1], said.positions[-1]
    steps = np.linalg.norm(now - before, axis=-1)
    jumped = [i for i in layout.of_kind(SensorKind.TRACKER) if steps[i] > settings.swap_step]
    for one, other in combinations(jumped, 2):
        crossed = np.linalg.norm(now[one] - before[other]) + np.linalg.norm(now[other] - before[one])
        if crossed < settings.swap_share * (steps[one] + steps[other]):
            return one, other
    return None


def sides_troubles(sparse: Moments, layout: SensorLayout, settings: WatchSettings) -> Iterator[Sign]:
    """Left and right ankles or hands that have been on the wrong sides all the time, and ankles above the head."""
    bones = {sensor.bone: i for i, sensor in enumerate(layout.sensors) if sensor.kind is SensorKind.TRACKER}
    middle = next((bones[bone] for bone in ("upperChest", "hips", "head") if bone in bones), None)
    if middle is None or len(sparse) < 0.8 * settings.memory / settings.sparse_step:
        return
    quats = sparse.quats_wxyz[:, middle]
    lefts = 2 * np.arctan2(quats[:, 2], quats[:, 0])
    axis = np.stack([np.cos(lefts), np.zeros_like(lefts), -np.sin(lefts)], axis=-1)
    for bone, least in (("LowerLeg", settings.crossed_ankles), ("Hand", settings.crossed_hands)):
        pair = [bones.get(f"{side}{bone}") for side in ("left", "right")]
        if pair[0] is None or pair[1] is None:
            continue
        across = np.sum((sparse.positions[:, pair[0]] - sparse.positions[:, pair[1]]) * axis, axis=-1)
        if _share_below(across, -least) > 0.8:
            one, other = layout.names[pair[0]], layout.names[pair[1]]
            for name, twin in ((one, other), (other, one)):
                text = f"{name} and {twin} are swapped: each has been on the other's side for {settings.memory:g} s"
                yield (name, Trouble.SWAPPED), text
    head = bones.get("head")
    for side in ("left", "right"):
        ankle = bones.get(f"{side}LowerLeg")
        if head is None or ankle is None:
            continue
        rise = sparse.positions[:, head, 1] - sparse.positions[:, ankle, 1]
        if _share_below(rise, 0.0) > 0.9:
            one, other = layout.names[head], layout.names[ankle]
            for name, twin in ((one, other), (other, one)):
                yield (name, Trouble.SWAPPED), f"{name} and {twin} are swapped: the ankle is above the head"


def _share_below(values: Floats[Array, "moments"], bound: float) -> float:
    said = values[np.isfinite(values)]
    return float((said < bound).mean()) if said.size >= 10 else 0.0


def scale_trouble(sparse: Moments, layout: SensorLayout, settings: WatchSettings) -> Iterator[Sign]:
    """Trackers that are farther apart than any body is large, or nearer than any is small: another unit of length."""
    trackers = list(layout.of_kind(SensorKind.TRACKER))
    if len(sparse) < 10 or len(trackers) < 3:
        return
    places = np.median(sparse.positions[:, trackers], axis=0)
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    known = np.isfinite(apart)
    if known.sum() < len(trackers):
        return
    widest = float(apart[known].max())
    if settings.smallest < widest < settings.tallest:
        return
    middle = np.nanmedian(places, axis=0)
    away = np.linalg.norm(places - middle, axis=-1)
    far = away > settings.tallest
    # One tracker far off speaks in another unit, or lies on a table; if they all are, all do.
    blamed = (
        np.flatnonzero(far) if widest >= settings.tallest and 2 * far.sum() < len(trackers) else np.arange(len(far))
    )
    for column in blamed.tolist():
        name = layout.names[trackers[column]]
        yield (
            (name, Trouble.MIS_SCALED),
            f"{name} is mis-scaled: the trackers span {widest:.3g} m; they should speak in metres",
        )


def imu_troubles(sparse: Moments, layout: SensorLayout, settings: WatchSettings) -> Iterator[Sign]:
    """IMUs that speak in g or in degrees."""
    if len(sparse) < 10:
        return
    for index in layout.of_kind(SensorKind.IMU):
        force = _median(np.linalg.norm(sparse.specific_forces[:, index], axis=-1))
        rate = _median(np.linalg.norm(sparse.angular_rates[:, index], axis=-1))
        name = layout.names[index]
        if force and not settings.least_force < force < settings.most_force:
            text = f"{name} is mis-scaled: its median specific force is {force:.3g}, and gravity alone is 9.81 m/s²"
            yield (name, Trouble.MIS_SCALED), text
        elif rate > settings.most_rate:
            text = f"{name} is mis-scaled: its median angular rate is {rate:.3g} rad/s; it may speak in degrees"
            yield (name, Trouble.MIS_SCALED), text


def flex_troubles(recent: Moments, layout: SensorLayout, settings: WatchSettings) -> Iterator[Sign]:
    """Flex sensors at the end of their converter's range, and such that jump about from sample to sample."""
    if len(recent) < 16:
        return
    for index in layout.of_kind(SensorKind.FLEX):
        counts = recent.counts[:, index]
        counts = counts[np.isfinite(counts)]
        if counts.size < 16:
            continue
        name = layout.names[index]
        at_end = next(
            (end for end in (0.0, 1023.0, 4095.0, 65535.0) if (counts == end).mean() >= settings.rail_after), None
        )
        if at_end is not None:
            text = f"{name} is stuck at the end of its range ({at_end:g}): check its wire and its resistor"
            yield (name, Trouble.STUCK), text
        # Noise as large as the whole range of what it says: no bend is left in it.
        noise = float(np.median(np.abs(np.diff(counts, n=3)))) / (0.6745 * np.sqrt(20.0))
        if noise > 10 and noise > 0.5 * float(np.std(counts)):
            yield (name, Trouble.NOISY), f"{name} is noisy ({noise:.0f} counts): check its wire"
