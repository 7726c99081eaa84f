"""Which options of `poseloom simulate` belong to which kind of sensor, and the simulator of each kind."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians
from types import MappingProxyType
from typing import Any

from poseloom.errors import SensorError
from poseloom.sensors import Recording, SensorKind, SensorLayout
from poseloom.skeleton.motion import Motion
from poseloom.synthesis import (
    IDEAL_FLEX,
    NO_IMU_NOISE,
    NO_NOISE,
    Fault,
    FlexSensors,
    ImuNoise,
    TrackerNoise,
    merge_recordings,
    simulate_flex,
    simulate_imus,
    simulate_trackers,
)
from poseloom.synthesis.imus import GRAVITY
from poseloom.synthesis.mixed import layout_of_kind

IDEAL = "ideal"
"""The option that takes away all errors but those that other options ask for."""

_DEGREE = radians(1.0)
_DELIVERY: Mapping[str, tuple[str, float]] = {
    "drop_outs": ("drop_out_probability", 1.0),
    "bursts": ("burst_rate_hz", 1.0),
    "latency_ms": ("latency_s", 1e-3),
    "jitter_ms": ("jitter_s", 1e-3),
}
_PLACEMENT: Mapping[str, tuple[str, float]] = {
    "placement_error_mm": ("placement_m", 1e-3),
    "placement_error_deg": ("placement_rad", _DEGREE),
}
_TRACKER: Mapping[str, tuple[str, float]] = {
    "noise_mm": ("position_m", 1e-3),
    "noise_deg": ("orientation_rad", _DEGREE),
    "bias_mm": ("bias_m", 1e-3),
    "bias_deg": ("bias_rad", _DEGREE),
    "drift_mm": ("drift_m", 1e-3),
    "drift_deg": ("drift_rad", _DEGREE),
    "outliers": ("outlier_probability", 1.0),
}
_IMU: Mapping[str, tuple[str, float]] = {
    "noise_m_s2": ("force_m_s2", 1.0),
    "noise_deg_s": ("rate_rad_s", _DEGREE),
    "bias_m_s2": ("force_bias_m_s2", 1.0),
    "bias_deg_s": ("rate_bias_rad_s", _DEGREE),
    "bandwidth_hz": ("bandwidth_hz", 1.0),
    "range_g": ("force_range_m_s2", GRAVITY),
    "range_deg_s": ("rate_range_rad_s", _DEGREE),
    "clock_ppm": ("clock_error", 1e-6),
    "clock_offset_ms": ("clock_offset_s", 1e-3),
}
_FLEX: Mapping[str, tuple[str, float]] = {"minutes_of_use": ("minutes_of_use", 1.0)}

Given = Mapping[str, float]
"""What the user asked for, by the name of the option's parameter."""


@dataclass(frozen=True)
class _Kind:
    """One kind of sensor for the command.

    Attributes:
        words: What to call such sensors.
        options: The options that it knows, by parameter: where each goes, and its unit in SI units.
        simulate: Makes a recording from motion, layout, options, faults and seed.
    """

    words: str
    options: Mapping[str, tuple[str, float]]
    simulate: Callable[[Motion, SensorLayout, Given, Sequence[Fault], int], Recording]


def _in_si(given: Given, options: Mapping[str, tuple[str, float]]) -> dict[str, Any]:
    return {options[name][0]: value * options[name][1] for name, value in given.items() if name in options}


def _trackers(motion: Motion, layout: SensorLayout, given: Given, faults: Sequence[Fault], seed: int) -> Recording:
    noise = NO_NOISE if given.get(IDEAL) else TrackerNoise()
    noise = replace(noise, **_in_si(given, _KINDS[SensorKind.TRACKER].options))
    return simulate_trackers(motion, layout, noise, faults, seed)


def _imus(motion: Motion, layout: SensorLayout, given: Given, faults: Sequence[Fault], seed: int) -> Recording:
    noise = NO_IMU_NOISE if given.get(IDEAL) else ImuNoise()
    return simulate_imus(motion, layout, replace(noise, **_in_si(given, _KINDS[SensorKind.IMU].options)), faults, seed)


def _flex(motion: Motion, layout: SensorLayout, given: Given, faults: Sequence[Fault], seed: int) -> Recording:
    sensors = IDEAL_FLEX if given.get(IDEAL) else FlexSensors()
    return simulate_flex(motion, layout, sensors, faults=faults, seed=seed, **_in_si(given, _FLEX))


_KINDS: Mapping[SensorKind, _Kind] = MappingProxyType(
    {
        SensorKind.TRACKER: _Kind("trackers", {**_TRACKER, **_DELIVERY, **_PLACEMENT}, _trackers),
        SensorKind.IMU: _Kind("IMUs", {**_IMU, **_DELIVERY, **_PLACEMENT}, _imus),
        SensorKind.FLEX: _Kind("flex sensors", _FLEX, _flex),
    }
)


def simulate_worn(motion: Motion, layout: SensorLayout, given: Given, faults: Sequence[Fault], seed: int) -> Recording:
    """Lets a body wear a layout, with the simulators of its kinds of sensors.

    Args:
        motion: What the body does.
        layout: The sensors.
        given: Options that the user gave, in the options' own units.
        faults: What goes wrong in addition.
        seed: Of all that is drawn.

    Raises:
        SensorError: for an option that these kinds of sensors do not know, or a parameter that makes no sense.
    """
    kinds = [kind for kind in _KINDS if layout.of_kind(kind)]
    known = {name for kind in kinds for name in _KINDS[kind].options}
    strange = [name for name in given if name not in known and name != IDEAL]
    if strange:
        words = " and ".join(_KINDS[kind].words for kind in kinds)
        raise SensorError(
            f"{', '.join(_flag(name) for name in strange)} does not belong to {words}",
            cause=f"the sensors of layout {layout.name!r} are {words}",
            remedy=f"Choose from {', '.join(_flag(name) for kind in kinds for name in _KINDS[kind].options)}",
        )
    if len(kinds) == 1:
        return _KINDS[kinds[0]].simulate(motion, layout, given, faults, seed)
    for fault in faults:
        layout.index(fault.sensor)
    parts: list[Recording] = []
    for kind in kinds:
        part = layout_of_kind(layout, kind)
        options = {name: value for name, value in given.items() if name in _KINDS[kind].options or name == IDEAL}
        own = [fault for fault in faults if fault.sensor in part.names]
        parts.append(_KINDS[kind].simulate(motion, part, options, own, seed))
    return merge_recordings(layout, parts)


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"
