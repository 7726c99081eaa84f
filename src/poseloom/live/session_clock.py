"""Which samples a session takes, and their session times: never ahead of the host's clock, never above its rate."""

from dataclasses import dataclass, replace

_EARLY = 0.75
"""Share of a period by which a sample may be early: so much may arrival times jitter at the session's own rate without
a sample being left out. What comes faster is thinned all the same, for the even times go on by whole periods."""
_LATE = 1.75
"""Periods after the even time of the newest sample from which even times begin anew: a pause, or a slower device."""
_CLOSEST = 0.1
"""Share of a period by which two samples are at least apart."""
_PROMPT = 0.1
"""Seconds that a measurement may have been on its way to be the first after empty samples have taken its time."""
_SMALLEST_STEP = 1e-6
"""Seconds between samples that have the same time, where none is left out."""


@dataclass(frozen=True)
class SessionTime:
    """What is remembered between samples.

    Attributes:
        time: Session time of the newest sample; None before the first.
        even: The time for which it stands: these are whole periods apart while samples come fast enough.
        empty: Whether it was an empty one.
    """

    time: float | None = None
    even: float = 0.0
    empty: bool = False


@dataclass(frozen=True)
class SessionClock:
    """Gives samples their session time, and thins them to the session's rate.

    A sample's session time is its own, as its source's clock or its arrival says; it is never pushed ahead. So session
    time and host time differ by the measured network delay and a part of a period, whatever comes: what comes too fast
    is left out, not put later.

    Attributes:
        period: Seconds from sample to sample at the session's rate.
        thin: Whether samples beyond that rate are left out.
    """

    period: float
    thin: bool = True

    def take(self, state: SessionTime, time: float, arrival: float) -> tuple[SessionTime, float | None]:
        """Takes a sample, or leaves it out.

        Args:
            state: What is remembered.
            time: When it was measured, on the host's clock, seconds.
            arrival: When it came, on the host's clock, seconds.

        Returns:
            What to remember, and its session time; None for a sample that is left out.
        """
        if state.time is None:
            return SessionTime(time, time), time
        if not self.thin:
            time = max(time, state.time + _SMALLEST_STEP)
            return SessionTime(time, time), time
        earliest = state.even + (1.0 - _EARLY) * self.period
        if state.empty and arrival - time <= _PROMPT:
            # Empty samples have taken the time that it was on its way: it is the first to end them nevertheless.
            time = max(time, earliest)
        if time < max(earliest, state.time + _CLOSEST * self.period):
            return state, None
        in_pace = time < state.even + _LATE * self.period
        return SessionTime(time, state.even + self.period if in_pace else time), time

    def fill(self, state: SessionTime, time: float) -> SessionTime:
        """Takes an empty sample at a session time."""
        return replace(state, time=time, even=time, empty=True)
