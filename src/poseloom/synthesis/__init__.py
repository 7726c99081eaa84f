"""Virtual sensors on a moving body."""

from poseloom.synthesis.faults import Fault, FaultKind, parse_fault
from poseloom.synthesis.flex import bend_angles, simulate_flex
from poseloom.synthesis.flex_readings import flex_counts
from poseloom.synthesis.flex_sensors import IDEAL_FLEX, FlexBoard, FlexChannels, FlexSensors, Spread, draw_channels
from poseloom.synthesis.imus import NO_IMU_NOISE, ImuNoise, simulate_imus
from poseloom.synthesis.mixed import merge_recordings, simulate_sensors
from poseloom.synthesis.noise import NO_NOISE, TrackerNoise
from poseloom.synthesis.orientations import NO_ORIENTATION_ERRORS, OrientationErrors, add_orientations
from poseloom.synthesis.trackers import simulate_trackers
from poseloom.synthesis.wearing import true_placements

__all__ = [
    "IDEAL_FLEX",
    "NO_IMU_NOISE",
    "NO_NOISE",
    "NO_ORIENTATION_ERRORS",
    "Fault",
    "FaultKind",
    "FlexBoard",
    "FlexChannels",
    "FlexSensors",
    "ImuNoise",
    "OrientationErrors",
    "Spread",
    "TrackerNoise",
    "add_orientations",
    "bend_angles",
    "draw_channels",
    "flex_counts",
    "merge_recordings",
    "parse_fault",
    "simulate_flex",
    "simulate_imus",
    "simulate_sensors",
    "simulate_trackers",
    "true_placements",
]
