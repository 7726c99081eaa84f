"""What the sensors of a case say: read or simulated, at the rate that the methods need, as far as it is used."""

from dataclasses import replace

import numpy as np

from poseloom.arrays import frozen
from poseloom.errors import PoseloomError
from poseloom.evaluation.cases import Case, Channels, Conditions
from poseloom.formats.recording import read_recording
from poseloom.sensors import Recording, SensorKind, SensorLayout, SensorStatus
from poseloom.sensors.rate import at_rate, resample_recording, same_rate
from poseloom.sensors.recording import CHANNEL_SHAPES
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_sensors


def sensed(case: Case, conditions: Conditions, seed: int) -> Recording:
    """What the sensors say of a case, at the rate of its truth: recorded, or simulated with this seed."""
    if case.recording is None:
        motion = case.truth if case.motion is None else case.motion
        recording = simulate_sensors(motion, at_rate(conditions.worn, case.truth.rate), conditions.noise, seed=seed)
    elif isinstance(case.recording, Recording):
        recording = resample_recording(case.recording, case.truth.rate)
    else:
        recording = resample_recording(read_recording(case.recording), case.truth.rate)
    return _used(recording, conditions)


def case_at_rate(case: Case, rate: float) -> Case:
    """The case with its truth, and so its sensors, at another rate."""
    if same_rate(case.truth.rate, rate):
        return case
    if case.recording is None:
        return replace(case, truth=resample(case.truth if case.motion is None else case.motion, rate))
    recording = case.recording if isinstance(case.recording, Recording) else read_recording(case.recording)
    truth = resample_recording(recording, rate).truth
    assert truth is not None
    return replace(case, truth=truth)


def _used(recording: Recording, conditions: Conditions) -> Recording:
    """A recording of which only some channels and sensors are used."""
    columns = {name: getattr(recording, name).copy() for name in CHANNEL_SHAPES}
    trackers = list(recording.layout.of_kind(SensorKind.TRACKER))
    if conditions.channels is not Channels.BOTH:
        if not trackers:
            raise PoseloomError(
                f"the layout {recording.layout.name!r} has no trackers whose {conditions.channels.value} could be used",
                remedy="Leave --channels out",
            )
        columns["quats_wxyz" if conditions.channels is Channels.POSITION else "positions"][:, trackers] = np.nan
    for name in conditions.drop:
        at = recording.layout.index(name)
        for values in columns.values():
            values[:, at] = np.nan
    came = np.zeros(recording.status.shape, dtype=np.bool_)
    for values in columns.values():
        came |= np.isfinite(values.reshape(*came.shape, -1)).any(axis=-1)
    status = np.where(came, recording.status, int(SensorStatus.MISSING))
    return replace(recording, **{name: frozen(values) for name, values in columns.items()}, status=frozen(status))


def layout_of(case: Case, conditions: Conditions) -> SensorLayout:
    """The sensors of a case, at their own rate."""
    if case.recording is None:
        return conditions.worn
    return (case.recording if isinstance(case.recording, Recording) else read_recording(case.recording)).layout
