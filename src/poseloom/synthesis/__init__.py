"""Virtual sensors on a moving body."""

from poseloom.synthesis.faults import Fault, FaultKind
from poseloom.synthesis.flex import bend_angles, simulate_flex
from poseloom.synthesis.flex_readings import flex_counts
from poseloom.synthesis.flex_sensors import FlexBoard, FlexChannels, FlexSensors, Spread, draw_channels
from poseloom.synthesis.imus import NO_IMU_NOISE, ImuNoise, simulate_imus
from poseloom.synthesis.noise import NO_NOISE, TrackerNoise
from poseloom.synthesis.trackers import simulate_trackers
from poseloom.synthesis.wearing import true_placements

__all__ = [
    "NO_IMU_NOISE",
    "NO_NOISE",
    "Fault",
    "FaultKind",
    "FlexBoard",
    "FlexChannels",
    "FlexSensors",
    "ImuNoise",
    "Spread",
    "TrackerNoise",
    "bend_angles",
    "draw_channels",
    "flex_counts",
    "simulate_flex",
    "simulate_imus",
    "simulate_trackers",
    "true_placements",
]
