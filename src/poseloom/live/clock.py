"""A device's clock put on the host's, and what comes twice or late told from a device that was started again."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class ClockSettings:
    """When a clock is believed to have jumped.

    Attributes:
        jump: Seconds by which device and host may differ before the device's clock is set anew.
        patience: Seconds for which only older times must come, in order, before they are taken for a device that was
            started again and not for packets that came late or twice.
        following: Share of the difference between both clocks that is taken up a packet: follows their drift.
    """

    jump: float = 0.5
    patience: float = 0.25
    following: float = 0.01


@dataclass(frozen=True)
class DeviceClock:
    """What is remembered of one device's clock.

    Attributes:
        offset: Host's time minus device's; None before the first packet.
        newest: Newest device time that was taken.
        jumps: How often the clock was set anew.
        older: Newest of the older times that come in order; None while none do.
        older_since: Host's time at which these began.
    """

    offset: float | None = None
    newest: float = 0.0
    jumps: int = 0
    older: float | None = None
    older_since: float = 0.0


def step_clock(
    clock: DeviceClock, device: float, arrival: float, settings: ClockSettings
) -> tuple[DeviceClock, float | None]:
    """Takes in a packet's time.

    Args:
        clock: What is remembered.
        device: The device's time, seconds.
        arrival: The host's time, seconds.
        settings: When a clock is believed to have jumped.

    Returns:
        What to remember, and the time on the host's clock; None for a packet that is stale and to be dropped.
    """
    if clock.offset is None:
        return replace(clock, offset=arrival - device, newest=device), arrival
    if device <= clock.newest:
        return _older(clock, device, arrival, settings)
    error = arrival - device - clock.offset
    if abs(error) > settings.jump:
        return DeviceClock(arrival - device, device, clock.jumps + 1), arrival
    offset = clock.offset + settings.following * error
    return DeviceClock(offset, device, clock.jumps), device + offset


def _older(
    clock: DeviceClock, device: float, arrival: float, settings: ClockSettings
) -> tuple[DeviceClock, float | None]:
    if clock.older is None or device <= clock.older:
        return replace(clock, older=device, older_since=arrival), None
    if arrival - clock.older_since < settings.patience:
        return replace(clock, older=device), None
    return DeviceClock(arrival - device, device, clock.jumps + 1), arrival
