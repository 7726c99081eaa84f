"""The contract of a method."""

import pickle
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor
from poseloom.sensors import Recording, Sample
from poseloom.sensors.rate import resample_recording, same_rate
from poseloom.sensors.sample import SensorStatus

_SHORTEST = 32
_SILENCE = 8
"""Samples for which sensors are taken away: a method may bridge a shorter gap without a word."""


def check_method(method: Reconstructor[Any], recording: Recording, samples: int = 48) -> None:
    """Checks that a method keeps the contract of `Reconstructor`.

    - A whole run and one that goes on from a kept state give the same bits, whatever ran in between.
    - `step` changes neither the state nor the sample: their pickles are the same before and after.
    - There is a frame for every sample once every sensor has spoken and `delay` samples were heard; it has the time of
      the sample that is `delay` samples back.
    - Pose and spread have the wearer's pose vector's shape and are finite, whatever channels are missing.
    - `health` names sensors of the layout only, those that fell silent among them, and is not ok while they are.
    - Nothing at all, from the first sample on, is survived.

    Args:
        method: The method.
        recording: Samples of the method's layout without gaps, 32 at least, on a wearer that it can move. One of
            another rate is resampled where the method needs that.
        samples: How many of them are used at most.

    Raises:
        AssertionError: naming what is broken, and at which sample.
    """
    _check_claims(method, recording)
    if not method.any_rate and not same_rate(recording.layout.rate, method.layout.rate):
        recording = resample_recording(recording, method.layout.rate)
    count = min(len(recording), samples)
    _ensure(count >= _SHORTEST + method.delay, f"the recording has {count} samples: give {_SHORTEST + method.delay}")
    heard = [recording.sample(index) for index in range(count)]
    _check_whole_and_split(method, recording, heard)
    _check_silences(method, recording, heard)


def _check_claims(method: Reconstructor[Any], recording: Recording) -> None:
    given: Any = method
    _ensure(isinstance(given, Reconstructor), f"{type(given).__name__} is no Reconstructor")
    delay: Any = method.delay
    _ensure(type(delay) is int and delay >= 0, f"delay is {delay!r}, not a number of samples from 0 on")
    own, other = method.layout.names, recording.layout.names
    _ensure(own == other, f"the method listens to {', '.join(own)}; the recording has {', '.join(other)}")


def _check_whole_and_split(method: Reconstructor[Any], recording: Recording, heard: Sequence[Sample]) -> None:
    half = len(heard) // 2
    state = method.start(recording.skeleton, recording.placements)
    kept, kept_bytes, whole = state, b"", list[Frame | None]()
    for index, sample in enumerate(heard):
        if index == half:
            kept, kept_bytes = state, _pickled(state, "the state")
            other = method.start(recording.skeleton, recording.placements)
            method.step(other, heard[3])  # another session in between leaves nothing behind
        before = _pickled(state, "the state"), _pickled(sample, "the sample")
        following, frame = method.step(state, sample)
        _ensure(_pickled(state, "the state") == before[0], f"step changed the state that it was given, at {index}")
        _ensure(_pickled(sample, "the sample") == before[1], f"step changed the sample that it was given, at {index}")
        if frame is None:
            _ensure(index < method.delay, f"there is no frame at sample {index}, though delay is {method.delay}")
        else:
            _check_frame(method, recording, heard, index, frame)
        whole.append(frame)
        state = following
    _ensure(_pickled(kept, "the state") == kept_bytes, f"later steps changed the state kept before sample {half}")
    for index in range(half, len(heard)):
        kept, frame = method.step(kept, heard[index])
        difference = _difference(whole[index], frame)
        _ensure(not difference, f"going on from a kept state gives another {difference} at sample {index} than before")


def _check_frame(
    method: Reconstructor[Any], recording: Recording, heard: Sequence[Sample], index: int, frame: Frame
) -> None:
    given: Any = frame
    _ensure(isinstance(given, Frame), f"step gave a {type(frame).__name__} at sample {index}, not a Frame")
    _ensure(index >= method.delay, f"there is a frame at sample {index} already, though delay is {method.delay}")
    own = heard[index - method.delay].time
    _ensure(frame.time == own, f"the frame at sample {index} has the time {frame.time:g}, not its sample's: {own:g}")
    names = frame.pose.skeleton.names
    _ensure(names == recording.skeleton.names, f"the pose at sample {index} is on another skeleton than the wearer's")
    size = recording.skeleton.size
    for what, values in (("pose", frame.pose.q), ("spread", frame.spread)):
        _ensure(np.shape(values) == (size,), f"{what} has the shape {np.shape(values)} at {index}, not ({size},)")
        _ensure(bool(np.isfinite(values).all()), f"{what} is not finite at sample {index}")
    _ensure(bool((frame.spread >= 0).all()), f"spread is negative at sample {index}")
    health: Any = frame.health
    _ensure(type(health) is Health and health.state in set(HealthState), f"health at {index} is {health!r}")
    strangers = set(health.sensors) - set(method.layout.names)
    _ensure(not strangers, f"health at {index} names {', '.join(sorted(strangers))}, which the layout does not have")


def _check_silences(method: Reconstructor[Any], recording: Recording, heard: Sequence[Sample]) -> None:
    sensors, draw = len(recording.layout), np.random.default_rng(0)
    _run(method, recording, [_without(sample, draw.random(sensors) < 0.3) for sample in heard])
    start, stop = 10, 10 + _SILENCE
    silenced: list[Collection[int]] = [range(sensors), *([sensor] for sensor in range(sensors) if sensors > 1)]
    for silent in silenced:
        names = tuple(recording.layout.names[sensor] for sensor in silent)
        mask = np.isin(np.arange(sensors), list(silent))
        gap = [_without(each, mask) if start <= index < stop else each for index, each in enumerate(heard[:_SHORTEST])]
        health = _run(method, recording, gap)[stop - 1 + method.delay].health
        who = "all sensors were" if len(names) == sensors else f"{names[0]} was"
        told = f"after {who} silent for {_SILENCE} samples"
        _ensure(health.state is not HealthState.OK, f"health is ok {told}")
        if len(names) < sensors:
            _ensure(names[0] in health.sensors, f"health names {health.sensors or 'no sensor'} {told}")
    everything = np.ones(sensors, dtype=np.bool_)
    late = [_without(each, everything) if index < 3 else each for index, each in enumerate(heard[:12])]
    _run(method, recording, late)
    _run(method, recording, [_without(each, everything) for each in heard[:12]])


def _run(method: Reconstructor[Any], recording: Recording, samples: Sequence[Sample]) -> dict[int, Frame]:
    """Frames by the sample with which they were given; none is needed before every sensor has spoken once."""
    state = method.start(recording.skeleton, recording.placements)
    frames: dict[int, Frame] = {}
    known = np.zeros(len(recording.layout), dtype=np.bool_)
    for index, sample in enumerate(samples):
        known |= sample.status == SensorStatus.OK
        state, frame = method.step(state, sample)
        if frame is not None:
            _check_frame(method, recording, samples, index, frame)
            frames[index] = frame
        else:
            due = index >= method.delay and (bool(known.all()) or bool(frames))
            _ensure(not due, f"there is no frame at sample {index}, where some sensors are missing")
    return frames


def _without(sample: Sample, silent: "np.ndarray[Any, np.dtype[np.bool_]]") -> Sample:
    """A sample in which some sensors said nothing."""

    def holed(values: Floats[Array, "sensors *channel"]) -> Floats[Array, "sensors *channel"]:
        copy = np.array(values)
        copy[silent] = np.nan
        return frozen_float(copy)

    status = np.where(silent, int(SensorStatus.MISSING), sample.status)
    status.flags.writeable = False
    return replace(
        sample,
        positions=holed(sample.positions),
        quats_wxyz=holed(sample.quats_wxyz),
        specific_forces=holed(sample.specific_forces),
        angular_rates=holed(sample.angular_rates),
        counts=holed(sample.counts),
        status=status,
    )


def _difference(one: Frame | None, other: Frame | None) -> str:
    """What differs between two frames, in a word; empty if nothing does, to the bit."""
    if one is None or other is None:
        return "" if one is other else "number of frames"
    if one.time != other.time:
        return "time"
    if not np.array_equal(one.pose.q, other.pose.q):
        return "pose"
    if not np.array_equal(one.spread, other.spread):
        return "spread"
    return "" if one.health == other.health else "health"


def _pickled(value: object, what: str) -> bytes:
    try:
        return pickle.dumps(value)
    except Exception as error:
        raise AssertionError(f"{what} cannot be pickled, so that nobody can keep it: {error}") from error


def _ensure(kept: bool, broken: str) -> None:
    if not kept:
        raise AssertionError(broken)
