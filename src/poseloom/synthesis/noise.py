"""How virtual sensors err and deliver: parameters, and the errors drawn from them."""

import math
import zlib
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from poseloom.arrays import Array, Bools, Floats
from poseloom.errors import SensorError

_PROBABILITIES = ("outlier_probability", "drop_out_probability")
_MAY_BE_INFINITE = ("bandwidth_hz", "force_range_m_s2", "rate_range_rad_s")
_MUST_BE_POSITIVE = ("drift_seconds", "burst_seconds", *_MAY_BE_INFINITE)


@dataclass(frozen=True)
class Delivery:
    """How samples of any kind of sensor get lost and come late. By default none does.

    Attributes:
        drop_out_probability: That a single sample of a sensor is missing.
        burst_rate_hz: How often, per second and sensor, a longer drop-out begins.
        burst_seconds: Mean length of those (exponential).
        latency_s: From a sample's time to its arrival.
        jitter_s: Scale of a further random delay (half-normal). Samples never overtake each other.
    """

    drop_out_probability: float = 0.0
    burst_rate_hz: float = 0.0
    burst_seconds: float = 0.3
    latency_s: float = 0.0
    jitter_s: float = 0.0


@dataclass(frozen=True)
class TrackerNoise(Delivery):
    """Errors of trackers. By default 3 mm and 0.5 degrees of white noise, and nothing else.

    Lengths are metres in the world, angles radians about the sensor's own axes (`R_measured = R_true exp(error)`); a
    standard deviation holds for each of the three axes. Losses and delays: see `Delivery`.

    Attributes:
        position_m: Standard deviation of white noise, each sample anew.
        orientation_rad: The same for the orientation.
        bias_m: Standard deviation of an error that a sensor keeps for the whole recording.
        bias_rad: The same for the orientation.
        drift_m: Standard deviation of a slowly varying error (Ornstein-Uhlenbeck, stationary).
        drift_rad: The same for the orientation.
        drift_seconds: Time after which the drift's correlation has fallen to 1/e.
        outlier_probability: That a sensor's sample is an outlier.
        outlier_m: How far an outlier lies off, in a random direction.
        outlier_rad: By what angle it is turned, about a random axis.
        lag_s: By how much older the measured pose is than the sample's time, as with devices that stamp on sending.
        placement_m: Standard deviation of the offset between where a sensor really sits and where the recording says.
        placement_rad: The same for how it is turned.
    """

    position_m: float = 0.003
    orientation_rad: float = math.radians(0.5)
    bias_m: float = 0.0
    bias_rad: float = 0.0
    drift_m: float = 0.0
    drift_rad: float = 0.0
    drift_seconds: float = 20.0
    outlier_probability: float = 0.0
    outlier_m: float = 0.3
    outlier_rad: float = 0.5
    lag_s: float = 0.0
    placement_m: float = 0.0
    placement_rad: float = 0.0


NO_NOISE = TrackerNoise(position_m=0.0, orientation_rad=0.0)
"""Trackers that tell the truth."""


def check_noise(noise: Delivery) -> None:
    """Raises SensorError for a parameter that is not finite, negative, or a probability above one.

    A bandwidth and the ends of a sensor's range may be infinite.
    """
    for each in fields(noise):
        value = getattr(noise, each.name)
        upper = 1.0 if each.name in _PROBABILITIES else math.inf
        finite = math.isfinite(value) or (value == math.inf and each.name in _MAY_BE_INFINITE)
        if not (finite and 0.0 <= value <= upper) or (value == 0.0 and each.name in _MUST_BE_POSITIVE):
            asked = "a number from 0 to 1" if each.name in _PROBABILITIES else "a finite number that is not negative"
            raise SensorError(
                f"the noise's {each.name} is {value}",
                remedy="Give a positive number" if each.name in _MUST_BE_POSITIVE else f"Give {asked}",
            )


class Streams:
    """Random streams by name: what is drawn for one purpose and sensor is the same whatever else is drawn.

    So a sensor, a fault or another kind of noise can be added without changing the rest.
    """

    def __init__(self, seed: int | Generator) -> None:
        if isinstance(seed, int) and seed < 0:
            raise SensorError(f"the seed is {seed}", remedy="Give a seed that is not negative")
        self._seed = int(seed.integers(2**63)) if isinstance(seed, Generator) else seed

    @property
    def seed(self) -> int:
        """The number all streams stem from."""
        return self._seed

    def stream(self, *names: str) -> Generator:
        """The stream of a purpose, e.g. of a sensor and a kind of error."""
        return np.random.default_rng([self._seed, *(zlib.crc32(name.encode()) for name in names)])


class TrackerErrors(NamedTuple):
    """What happens to one tracker.

    Attributes:
        shifts: Added to its position, metres, world.
        turns: Rotation vectors about its own axes.
        gone: Samples that are missing.
    """

    shifts: Floats[Array, "samples 3"]
    turns: Floats[Array, "samples 3"]
    gone: Bools[Array, "samples"]


def draw_errors(noise: TrackerNoise, samples: int, rate: float, sensor: str, streams: Streams) -> TrackerErrors:
    """Bias, drift, white noise, outliers and drop-outs of one tracker."""

    def six(purpose: str, count: int, lengths: float, angles: float) -> Floats[Array, "count 6"]:
        return two_vectors(streams.stream(sensor, purpose), count, lengths, angles)

    total = six("white", samples, noise.position_m, noise.orientation_rad)
    total += six("bias", 1, noise.bias_m, noise.bias_rad)
    if noise.drift_m or noise.drift_rad:
        total += _drift(
            six("drift", samples, noise.drift_m, noise.drift_rad), math.exp(-1 / (rate * noise.drift_seconds))
        )
    far = streams.stream(sensor, "outlier rate").random(samples) < noise.outlier_probability
    off = outliers(streams.stream(sensor, "outlier"), samples, noise.outlier_m, noise.outlier_rad)
    total[far] += off[far]
    gone = draw_gaps(noise, samples, rate, sensor, streams)
    return TrackerErrors(np.ascontiguousarray(total[:, :3]), np.ascontiguousarray(total[:, 3:]), gone)


def two_vectors(stream: Generator, count: int, first: float, second: float) -> Floats[Array, "count 6"]:
    """White noise of two vectors, with a standard deviation an axis for each."""
    return np.asarray(stream.normal(size=(count, 6)) * np.repeat([first, second], 3))


def draw_gaps(noise: Delivery, samples: int, rate: float, sensor: str, streams: Streams) -> Bools[Array, "samples"]:
    """Which samples of a sensor are missing."""
    gone = streams.stream(sensor, "drop-out").random(samples) < noise.drop_out_probability
    return np.asarray(gone | _bursts(noise, samples, rate, streams.stream(sensor, "burst")))


def _drift(draws: Floats[Array, "samples 6"], keep: float) -> Floats[Array, "samples 6"]:
    """A stationary first-order process of the draws' own standard deviation; the first draw is its first state."""
    states = draws * math.sqrt(1 - keep**2)
    states[0] = draws[0]
    for sample in range(1, len(states)):
        states[sample] += keep * states[sample - 1]
    return states


def outliers(stream: Generator, samples: int, length: float, angle: float) -> Floats[Array, "samples 6"]:
    """Two vectors of given lengths in random directions for each sample, such as a shift and a rotation vector."""
    directions = stream.normal(size=(samples, 2, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.asarray((directions * np.array([length, angle])[:, None]).reshape(samples, 6))


def _bursts(noise: Delivery, samples: int, rate: float, stream: Generator) -> NDArray[np.bool_]:
    gone = np.zeros(samples, dtype=np.bool_)
    begins = stream.random(samples) < -math.expm1(-noise.burst_rate_hz / rate)
    lengths = np.ceil(stream.exponential(noise.burst_seconds * rate, samples)).astype(np.int64)
    for begin in np.flatnonzero(begins):
        gone[begin : begin + lengths[begin]] = True
    return gone


def draw_arrivals(noise: Delivery, times: Floats[Array, "samples"], streams: Streams) -> Floats[Array, "samples"]:
    """When samples reach the host: later by latency and jitter, in order."""
    delays = noise.latency_s + noise.jitter_s * np.abs(streams.stream("arrival").normal(size=len(times)))
    return np.asarray(np.maximum.accumulate(times + delays))
