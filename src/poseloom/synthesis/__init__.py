"""Virtual sensors on a moving body."""

from poseloom.synthesis.faults import Fault, FaultKind
from poseloom.synthesis.noise import NO_NOISE, TrackerNoise
from poseloom.synthesis.trackers import simulate_trackers, true_placements

__all__ = ["NO_NOISE", "Fault", "FaultKind", "TrackerNoise", "simulate_trackers", "true_placements"]
