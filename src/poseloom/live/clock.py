"""A device's clock put on the host's, and what comes twice or late told from a device that was started again."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class ClockSettings:
    """When a clock is believed to have jumped.

    Attributes:
        jump: Seconds by which a device's clock may get ahead at once before that counts as a jump.
        late: Seconds of network delay, beside the least, from which a packet is late.
        patience: Seconds for which only late packets, or older ones in order, must come before the device's clock is
            set anew: a stalled network or sender catches up before, a clock that stood still or was set back does not.
        drift: Seconds a second by which a device's clock may be slower than the host's and is followed.
    """

    jump: float = 0.5
    late: float = 0.1
    patience: float = 0.25
    drift: float = 0.01


@dataclass(frozen=True)
class DeviceClock:
    """What is remembered of one device's clock.

    Attributes:
        offset: Host's time minus device's, of the packet that was on its way for the least time; None before the first.
        newest: Newest device time that was taken.
        arrival: Host's time at which that packet came.
        jumps: How often the clock was set anew.
        late_since: Host's time since which all packets have been late; None where the newest was not.
        older: Newest of the older times that come in order; None while none do.
        older_since: Host's time at which these began.
    """

    offset: float | None = None
    newest: float = 0.0
    arrival: float = 0.0
    jumps: int = 0
    late_since: float | None = None
    older: float | None = None
    older_since: float = 0.0


def step_clock(
    clock: DeviceClock, device: float, arrival: float, settings: ClockSettings
) -> tuple[DeviceClock, float | None]:
    """Takes in a packet's time.

    A packet that was on its way for less time than all before, as far as both clocks tell, sets how far they are
    apart; what others come later than it says is their network delay. So no time is ever after the packet's arrival.

    Args:
        clock: What is remembered.
        device: The device's time, seconds.
        arrival: The host's time, seconds.
        settings: When a clock is believed to have jumped.

    Returns:
        What to remember, and the time on the host's clock; None for a packet that is stale and to be dropped.
    """
    if clock.offset is None:
        return DeviceClock(arrival - device, device, arrival), arrival
    if device <= clock.newest:
        return _older(clock, device, arrival, settings)
    delay = arrival - device - clock.offset
    if delay <= 0.0:
        return DeviceClock(arrival - device, device, arrival, clock.jumps + (-delay > settings.jump)), arrival
    followed = min(delay, settings.drift * max(arrival - clock.arrival, 0.0))
    if delay - followed <= settings.late:
        late_since = None
    elif clock.late_since is None:
        late_since = arrival
    elif arrival - clock.late_since < settings.patience:
        late_since = clock.late_since
    else:
        return _anew(clock, device, arrival)
    offset = clock.offset + followed
    return DeviceClock(offset, device, arrival, clock.jumps, late_since), min(device + offset, arrival)


def _older(
    clock: DeviceClock, device: float, arrival: float, settings: ClockSettings
) -> tuple[DeviceClock, float | None]:
    if clock.older is None or device <= clock.older:
        return replace(clock, older=device, older_since=arrival), None
    if arrival - clock.older_since < settings.patience:
        return replace(clock, older=device), None
    return _anew(clock, device, arrival)


def _anew(clock: DeviceClock, device: float, arrival: float) -> tuple[DeviceClock, float]:
    return DeviceClock(arrival - device, device, arrival, clock.jumps + 1), arrival
