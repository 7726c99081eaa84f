"""A take: all samples of a layout, column by column, with where the sensors sat and the truth where it is known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseloom.arrays import Array, Bools, Floats, Ints, frozen, frozen_float
from poseloom.errors import SensorError
from poseloom.sensors.layout import SensorLayout
from poseloom.sensors.placement import Placement
from poseloom.sensors.sample import Sample, SensorStatus
from poseloom.skeleton.motion import Motion
from poseloom.skeleton.skeleton import Skeleton

CHANNEL_SHAPES: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {"positions": (3,), "quats_wxyz": (4,), "specific_forces": (3,), "angular_rates": (3,), "counts": ()}
)
"""The channels of a sample in order, with the shape of one sensor's value."""

SUBJECT = "subject"
"""Key in a recording's settings of who moves, as motion libraries call them."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of one layout in time order. Make one with `make_recording`, which checks. Channels as in `Sample`.

    Attributes:
        layout: The sensors.
        placements: Where each sensor is said to sit, one a sensor.
        skeleton: What a method may know of the body: the wearer's calibrated bones.
        times: Device time of each sample, seconds, increasing.
        arrivals: Host time at which each sample came, seconds.
        positions: Metres, world; NaN = missing.
        quats_wxyz: Unit quaternions, `R_world_sensor`; NaN = missing.
        specific_forces: m/s^2, sensor frame; NaN = missing.
        angular_rates: rad/s, sensor frame; NaN = missing.
        counts: Converter counts; NaN = missing.
        status: A `SensorStatus` for each sample and sensor.
        truth: The motion itself where it is known, at the layout's rate; frame i belongs to sample i.
        name: What it is called.
        settings: How it was made, for people and reports: source, noise, seed ...
    """

    layout: SensorLayout
    placements: tuple[Placement, ...]
    skeleton: Skeleton
    times: Floats[Array, "samples"]
    arrivals: Floats[Array, "samples"]
    positions: Floats[Array, "samples sensors 3"]
    quats_wxyz: Floats[Array, "samples sensors 4"]
    specific_forces: Floats[Array, "samples sensors 3"]
    angular_rates: Floats[Array, "samples sensors 3"]
    counts: Floats[Array, "samples sensors"]
    status: Ints[Array, "samples sensors"]
    truth: Motion | None
    name: str
    settings: Mapping[str, str]

    def __len__(self) -> int:
        return len(self.times)

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.times[-1] - self.times[0])

    def sample(self, index: int) -> Sample:
        """One sample, as the live path would hear it."""
        return Sample(
            float(self.times[index]),
            float(self.arrivals[index]),
            self.positions[index],
            self.quats_wxyz[index],
            self.specific_forces[index],
            self.angular_rates[index],
            self.counts[index],
            self.status[index],
        )

    def cut(self, start: int, stop: int) -> "Recording":
        """The samples start to stop - 1, with their truth; times stay as they are.

        Raises:
            SensorError: if that leaves no sample.
        """
        part = slice(start, stop)
        if len(self.times[part]) == 0:
            raise SensorError(
                f"samples {start} to {stop - 1} of a recording of {len(self)} leave nothing",
                remedy=f"Choose a start below the stop, between 0 and {len(self)}",
            )
        columns = {name: getattr(self, name)[part] for name in ("times", "arrivals", *CHANNEL_SHAPES, "status")}
        first, last, _ = part.indices(len(self))
        return replace(self, **columns, truth=None if self.truth is None else self.truth.cut(first, last))

    def only(self, kept: Bools[Array, "samples"]) -> "Recording":
        """The samples that a mask keeps, without the truth, which has one frame a sample of an even rate.

        Raises:
            SensorError: if that leaves no sample.
        """
        if not kept.any():
            raise SensorError("no sample is left of the recording", remedy="Keep at least one")
        columns = {name: frozen(getattr(self, name)[kept]) for name in ("times", "arrivals", *CHANNEL_SHAPES, "status")}
        return replace(self, **columns, truth=None)


def make_recording(
    layout: SensorLayout,
    placements: Sequence[Placement],
    skeleton: Skeleton,
    times: ArrayLike,
    *,
    arrivals: ArrayLike | None = None,
    positions: ArrayLike | None = None,
    quats_wxyz: ArrayLike | None = None,
    specific_forces: ArrayLike | None = None,
    angular_rates: ArrayLike | None = None,
    counts: ArrayLike | None = None,
    status: ArrayLike | None = None,
    truth: Motion | None = None,
    name: str = "",
    settings: Mapping[str, str] | None = None,
) -> Recording:
    """Checks and freezes a recording.

    Channels left out are NaN throughout; arrivals left out are the times; a status left out is MISSING where nothing of
    a sensor came and OK elsewhere.

    Raises:
        SensorError: for shapes that do not fit, no samples, times that do not increase, infinite numbers, quaternions
            that are not unit, values half missing, a status that contradicts the values, a placement on another bone
            than the layout's, or a truth of another length, rate or hierarchy.
    """
    moments = frozen_float(times)
    _check_body(layout, placements, skeleton)
    _check_times(moments)
    given = (positions, quats_wxyz, specific_forces, angular_rates, counts)
    columns = {
        channel: _column(channel, values, (len(moments), len(layout), *shape))
        for (channel, shape), values in zip(CHANNEL_SHAPES.items(), given, strict=True)
    }
    _check_unit(columns["quats_wxyz"])
    came = np.zeros((len(moments), len(layout)), dtype=np.bool_)
    for values in columns.values():
        came |= np.isfinite(values.reshape(*came.shape, -1)).any(axis=-1)
    state = np.where(came, SensorStatus.OK, SensorStatus.MISSING).astype(np.int64)
    if status is not None:
        state = np.asarray(status, dtype=np.int64)
        _check_status(state, came, layout)
    came_at = moments if arrivals is None else frozen_float(arrivals)
    if came_at.shape != moments.shape or not np.isfinite(came_at).all():
        raise SensorError("arrival times are not one finite number a sample", remedy="Give seconds, one a sample")
    _check_truth(truth, len(moments), layout, skeleton)
    return Recording(
        layout,
        tuple(placements),
        skeleton,
        moments,
        came_at,
        **columns,
        status=frozen(state),
        truth=truth,
        name=name,
        settings=MappingProxyType(dict(settings or {})),
    )


def _check_body(layout: SensorLayout, placements: Sequence[Placement], skeleton: Skeleton) -> None:
    worn = [placement.bone for placement in placements]
    bones = [sensor.bone for sensor in layout.sensors]
    if worn != bones:
        raise SensorError(
            f"placements on {', '.join(worn) or 'no bones'} do not fit layout {layout.name!r} on {', '.join(bones)}",
            remedy="Give one placement a sensor, in the layout's order",
        )
    for bone in bones:
        if bone not in skeleton.names:
            raise SensorError(f"the skeleton has no bone {bone!r} to wear a sensor", remedy="Choose another layout")


def _check_times(times: Floats[Array, "..."]) -> None:
    if times.ndim != 1 or len(times) == 0:
        raise SensorError("the recording has no samples", remedy="Give at least one sample time")
    if not np.isfinite(times).all():
        at = int(np.flatnonzero(~np.isfinite(times))[0])
        raise SensorError(f"the time of sample {at} is not finite", remedy="Mend or cut out that sample")
    if (np.diff(times) <= 0).any():
        at = int(np.flatnonzero(np.diff(times) <= 0)[0]) + 1
        raise SensorError(
            f"the time of sample {at} is not after the one before", remedy="Sort the samples and drop doubled ones"
        )


def _column(channel: str, values: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.float64]:
    if values is None:
        return frozen_float(np.full(shape, np.nan))
    column = frozen_float(values)
    if column.shape != shape:
        raise SensorError(
            f"channel {channel!r} has shape {column.shape}, not {shape}", remedy="Give samples x sensors x components"
        )
    flat = column.reshape(shape[0], shape[1], -1)
    gaps = np.isnan(flat)
    bad = np.isinf(flat).any(axis=-1) | (gaps.any(axis=-1) & ~gaps.all(axis=-1))
    if bad.any():
        sample, sensor = (int(i[0]) for i in np.nonzero(bad))
        raise SensorError(
            f"channel {channel!r} of sample {sample}, sensor {sensor}, is infinite or half missing",
            remedy="Give finite numbers, or NaN in all components for a missing value",
        )
    return column


def _check_unit(quats_wxyz: Floats[Array, "samples sensors 4"]) -> None:
    off = np.abs(np.sum(quats_wxyz**2, axis=-1) - 1) > 1e-3
    if off.any():
        sample, sensor = (int(i[0]) for i in np.nonzero(off))
        raise SensorError(
            f"the quaternion of sample {sample}, sensor {sensor}, is not of unit length", remedy="Normalise quaternions"
        )


def _check_status(status: Ints[Array, "..."], came: NDArray[np.bool_], layout: SensorLayout) -> None:
    if status.shape != came.shape:
        raise SensorError(
            f"the status has shape {status.shape}, not {came.shape}", remedy="Give one a sample and sensor"
        )
    if not np.isin(status, [int(known) for known in SensorStatus]).all():
        raise SensorError("a status is unknown", remedy=f"Use {', '.join(f'{s.value} {s.name}' for s in SensorStatus)}")
    wrong = ((status == SensorStatus.OK) & ~came) | ((status == SensorStatus.MISSING) & came)
    if wrong.any():
        sample, sensor = (int(i[0]) for i in np.nonzero(wrong))
        raise SensorError(
            f"sample {sample} of sensor {layout.names[sensor]!r} has the status "
            f"{SensorStatus(int(status[sample, sensor])).name} but {'a value' if came[sample, sensor] else 'no value'}",
            remedy="A missing value is NaN and has the status MISSING; a measured one has another",
        )


def _check_truth(truth: Motion | None, samples: int, layout: SensorLayout, skeleton: Skeleton) -> None:
    if truth is None:
        return
    if len(truth) != samples or abs(truth.rate - layout.rate) > 1e-9 * layout.rate:
        raise SensorError(
            f"the truth has {len(truth)} frames at {truth.rate:g} Hz, "
            f"the recording {samples} samples at {layout.rate:g} Hz",
            remedy="Resample the truth to the layout's rate, one frame a sample",
        )
    if truth.skeleton.names != skeleton.names or (truth.skeleton.parents != skeleton.parents).any():
        raise SensorError(
            "the truth moves other bones than the recording's skeleton", remedy="Retarget it to that skeleton"
        )
