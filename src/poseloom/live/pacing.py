"""Samples that come faster than a method can use, thinned to its rate."""

from dataclasses import dataclass, replace

_MUCH_FASTER = 1.2
"""Times the wanted rate from which samples are left out. Below that, clocks differ and times are uneven."""
_LEAST, _MOST = 60, 120
"""Arrivals over which the rate is told: enough that a stalled sender's packets, which come at once, do not count."""


@dataclass(frozen=True)
class Pace:
    """What is remembered.

    Attributes:
        arrivals: Host's times of the last samples, seconds.
        due: Session time from which the next sample is taken.
    """

    arrivals: tuple[float, ...] = ()
    due: float = 0.0

    @property
    def rate(self) -> float:
        """Samples a second that come; 0 while unknown."""
        if len(self.arrivals) < _LEAST:
            return 0.0
        span = self.arrivals[-1] - self.arrivals[0]
        return (len(self.arrivals) - 1) / span if span > 0 else 0.0


def step_pace(pace: Pace, time: float, arrival: float, wanted: float) -> tuple[Pace, bool]:
    """Takes in a sample; says whether it is to be used.

    All are used until it is clear that they come much faster than wanted; then as many as are wanted, as evenly as can
    be, always the newest.

    Args:
        pace: What is remembered.
        time: The sample's time, seconds.
        arrival: When it came on the host's clock, seconds.
        wanted: Samples a second that can be used.
    """
    following = replace(pace, arrivals=(*pace.arrivals[-_MOST:], arrival))
    rate = following.rate
    if rate < _MUCH_FASTER * wanted:
        return replace(following, due=time), True
    if time < pace.due - 0.5 / rate:
        return following, False
    return replace(following, due=max(pace.due, time - 1.0 / wanted) + 1.0 / wanted), True
