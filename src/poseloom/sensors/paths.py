"""Smooth paths through sampled values, with exact derivatives: quintic splines with the bandwidth of a sensor.

Differentiating a recorded motion twice lifts its rounding and jitter by the square of the frequency, so what a sensor
would not pass is taken out first. The spline minimises the sum of squared misses plus a multiple of the squared third
differences of its coefficients (the P-spline of Eilers and Marx 1996, here with the quintic basis): a low-pass filter
without delay, maximally flat below its bandwidth, that bends freely at the ends.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline  # pyright: ignore[reportMissingTypeStubs]
from scipy.linalg import solveh_banded  # pyright: ignore

from poseloom.arrays import Array, Floats

_DEGREE = 5
_BASIS = np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120.0
"""The quintic B-spline at the knots of its inside."""
_THIRD_DIFFERENCE = np.array([-1.0, 3.0, -3.0, 1.0])
_HIGHEST = 1 / 3
"""Highest bandwidth in units of the frame rate: above it a recorded motion is mostly rounding and jitter."""
_INTERPOLATES = 1e-8
"""Weight of the third differences when nothing is to be smoothed: it only settles the ends."""


class SmoothPath:
    """A smooth curve through values at frames 0, 1, 2 ...

    Args:
        values: One row a frame; straight lines and parabolas pass unchanged.
        rate: Frames a second.
        bandwidth_hz: Frequency at which the gain is one half, at most a third of the rate; infinite: the curve goes
            through all values.
    """

    def __init__(self, values: Floats[Array, "frames components"], rate: float, bandwidth_hz: float) -> None:
        self._rate = rate
        self._origin = values[0]
        padded = values - self._origin  # what does not move has no rounding errors to be differentiated
        while len(padded) < 3:  # a parabola must be determined
            padded = np.concatenate([padded, 2 * padded[-1:] - padded[max(len(padded) - 2, 0)][None]])
        weight = _INTERPOLATES if math.isinf(bandwidth_hz) else _weight(min(bandwidth_hz / rate, _HIGHEST))
        count = len(padded) + _DEGREE - 1
        right = np.zeros((count, values.shape[1]))
        for shift, share in enumerate(_BASIS):
            right[shift : shift + len(padded)] += share * padded
        bands = _gram(_BASIS, count) + weight * _gram(_THIRD_DIFFERENCE, count)
        coefficients = np.asarray(solveh_banded(bands, right), dtype=np.float64)
        knots = np.arange(-_DEGREE, len(padded) + _DEGREE, dtype=np.float64)
        self._spline = BSpline(knots, coefficients, _DEGREE)

    def at(self, places: Floats[Array, "places"], degree: int = 0) -> Floats[Array, "places components"]:
        """Values, or their derivatives by time in seconds, at places counted in frames."""
        values = self._spline(places, nu=degree) * self._rate**degree
        return np.asarray(values + self._origin if degree == 0 else values)


def _weight(frequency: float) -> float:
    """The weight for which the gain is one half at a frequency in cycles a frame.

    A wave of w radians a frame passes by b^2 / (b^2 + weight d), with the basis' symbol b(w) and d = (2 sin(w/2))^6.
    """
    wave = 2 * math.pi * frequency
    passed = (66 + 52 * math.cos(wave) + 2 * math.cos(2 * wave)) / 120
    return passed**2 / (2 * math.sin(wave / 2)) ** 6


def _gram(stencil: NDArray[np.float64], count: int) -> Floats[Array, "5 count"]:
    """Upper bands, as `solveh_banded` wants them, of A^T A, where A slides the stencil over `count` coefficients."""
    rows = count - len(stencil) + 1
    bands = np.zeros((_DEGREE, count))
    for i in range(len(stencil)):
        for j in range(i, len(stencil)):
            bands[_DEGREE - 1 - (j - i), j : j + rows] += stencil[i] * stencil[j]
    return bands
