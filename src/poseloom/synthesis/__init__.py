"""Virtual sensors on a moving body."""

from poseloom.synthesis.faults import Fault, FaultKind
from poseloom.synthesis.imus import NO_IMU_NOISE, ImuNoise, simulate_imus
from poseloom.synthesis.noise import NO_NOISE, TrackerNoise
from poseloom.synthesis.trackers import simulate_trackers
from poseloom.synthesis.wearing import true_placements

__all__ = [
    "NO_IMU_NOISE",
    "NO_NOISE",
    "Fault",
    "FaultKind",
    "ImuNoise",
    "TrackerNoise",
    "simulate_imus",
    "simulate_trackers",
    "true_placements",
]
