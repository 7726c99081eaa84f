"""Samples that come faster than a method can use, thinned to its rate."""

from dataclasses import dataclass, replace

_MUCH_FASTER = 1.2
"""Times the wanted rate from which samples are left out. Below that, clocks differ and times are uneven."""
_SMOOTHING = 0.05


@dataclass(frozen=True)
class Pace:
    """What is remembered.

    Attributes:
        last: Time of the newest sample; None before the first.
        period: Smoothed seconds from sample to sample; 0 before the second.
        due: Time from which the next sample is taken.
    """

    last: float | None = None
    period: float = 0.0
    due: float = 0.0

    @property
    def rate(self) -> float:
        """Samples a second that come; 0 while unknown."""
        return 1.0 / self.period if self.period > 0 else 0.0


def step_pace(pace: Pace, time: float, wanted: float) -> tuple[Pace, bool]:
    """Takes in a sample's time; says whether the sample is to be used.

    All are used until it is clear that they come much faster than wanted; then as many as are wanted, as evenly as can
    be, always the newest.
    """
    if pace.last is None:
        return Pace(time, 0.0, time), True
    gap = time - pace.last
    period = gap if pace.period == 0 else pace.period + _SMOOTHING * (min(gap, 4 * pace.period) - pace.period)
    following = replace(pace, last=time, period=period)
    if period <= 0 or 1.0 / period < _MUCH_FASTER * wanted:
        return replace(following, due=time), True
    if time < pace.due - 0.5 * period:
        return following, False
    return replace(following, due=max(pace.due, time - 1.0 / wanted) + 1.0 / wanted), True
