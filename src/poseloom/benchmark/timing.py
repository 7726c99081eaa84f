"""Wall time of a call: the median of repeats, with the least and the most beside it."""

import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Timing:
    """Wall time of one call.

    Attributes:
        median: Seconds.
        least: Seconds of the fastest repeat.
        most: Seconds of the slowest repeat.
        repeats: How many there were.
    """

    median: float
    least: float
    most: float
    repeats: int


def timing_of(seconds: Iterable[float]) -> Timing:
    """The timing that single repeats add up to."""
    values = [float(value) for value in seconds]
    return Timing(statistics.median(values), min(values), max(values), len(values))


def time_calls(call: Callable[[], object], repeats: int, calls_each: int = 1) -> Timing:
    """Times a call after one that does not count.

    Args:
        call: What to time.
        repeats: How many times to time it.
        calls_each: Calls a repeat, for what is too short to time alone; the timing is of one call.
    """
    call()
    seconds: list[float] = []
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in range(calls_each):
            call()
        seconds.append((time.perf_counter() - begin) / calls_each)
    return timing_of(seconds)
