"""What all sensors of a layout say at one moment."""

import enum
from dataclasses import dataclass

from poseloom.arrays import Array, Floats, Ints


class SensorStatus(enum.IntEnum):
    """What is known about one sensor's part of a sample.

    OK: measured. MISSING: nothing came; its channels are NaN. LATE: came after the sample was passed on. SATURATED: at
    the end of the sensor's range. STUCK: repeats the same value although the device says it is new.
    """

    OK = 0
    MISSING = 1
    LATE = 2
    SATURATED = 3
    STUCK = 4


@dataclass(frozen=True, eq=False)
class Sample:
    """One moment of all sensors of a layout; channels that a sensor does not have, or that did not come, are NaN.

    Attributes:
        time: The device's time, seconds.
        arrival: The host's monotonic time at which the sample came, seconds.
        positions: `p_world_sensor` of trackers, metres.
        quats_wxyz: `R_world_sensor` of trackers, and of IMUs that say it, as unit quaternions, scalar first.
        specific_forces: Of IMUs, sensor frame, m/s^2: +9.81 along world up at rest.
        angular_rates: Of IMUs, sensor frame, rad/s.
        counts: Of flex sensors, counts of their converter.
        status: A `SensorStatus` for each sensor.
    """

    time: float
    arrival: float
    positions: Floats[Array, "sensors 3"]
    quats_wxyz: Floats[Array, "sensors 4"]
    specific_forces: Floats[Array, "sensors 3"]
    angular_rates: Floats[Array, "sensors 3"]
    counts: Floats[Array, "sensors"]
    status: Ints[Array, "sensors"]
