"""poseloom weaves a full-body human motion from what a few body-worn sensors say.

The names that most programs need stand here, and load what is behind them on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from poseloom.errors import PoseloomError
    from poseloom.evaluation.metrics import evaluate_motion
    from poseloom.evaluation.request import evaluate
    from poseloom.formats import read_motion, read_motions, write_motion
    from poseloom.formats.recording import read_recording, write_recording
    from poseloom.library import MotionLibrary, build_library, open_library
    from poseloom.methods.contract import Frame, Reconstructor
    from poseloom.methods.reconstruction import Reconstruction, reconstruct
    from poseloom.methods.trackers import InverseKinematics, LocalFilter, LocalRegression
    from poseloom.report.html import write_report
    from poseloom.samples import sample_motions
    from poseloom.sensors.layout import layout, make_layout
    from poseloom.sensors.placement import default_placements
    from poseloom.sensors.recording import Recording, make_recording
    from poseloom.skeleton.body import average_body
    from poseloom.skeleton.kinematics import motion_frames
    from poseloom.skeleton.motion import Motion
    from poseloom.skeleton.retarget import retarget
    from poseloom.skeleton.skeleton import Skeleton
    from poseloom.synthesis.imus import ImuNoise, simulate_imus
    from poseloom.synthesis.noise import TrackerNoise
    from poseloom.synthesis.trackers import simulate_trackers

_HOMES = {
    "Frame": "methods.contract",
    "ImuNoise": "synthesis.imus",
    "InverseKinematics": "methods.trackers",
    "LocalFilter": "methods.trackers",
    "LocalRegression": "methods.trackers",
    "Motion": "skeleton.motion",
    "MotionLibrary": "library",
    "PoseloomError": "errors",
    "Reconstruction": "methods.reconstruction",
    "Reconstructor": "methods.contract",
    "Recording": "sensors.recording",
    "Skeleton": "skeleton.skeleton",
    "TrackerNoise": "synthesis.noise",
    "average_body": "skeleton.body",
    "build_library": "library",
    "default_placements": "sensors.placement",
    "evaluate": "evaluation.request",
    "evaluate_motion": "evaluation.metrics",
    "layout": "sensors.layout",
    "make_layout": "sensors.layout",
    "make_recording": "sensors.recording",
    "motion_frames": "skeleton.kinematics",
    "open_library": "library",
    "read_motion": "formats",
    "read_motions": "formats",
    "read_recording": "formats.recording",
    "reconstruct": "methods.reconstruction",
    "retarget": "skeleton.retarget",
    "sample_motions": "samples",
    "simulate_imus": "synthesis.imus",
    "simulate_trackers": "synthesis.trackers",
    "write_motion": "formats",
    "write_recording": "formats.recording",
    "write_report": "report.html",
}

__all__ = [
    "Frame",
    "ImuNoise",
    "InverseKinematics",
    "LocalFilter",
    "LocalRegression",
    "Motion",
    "MotionLibrary",
    "PoseloomError",
    "Reconstruction",
    "Reconstructor",
    "Recording",
    "Skeleton",
    "TrackerNoise",
    "average_body",
    "build_library",
    "default_placements",
    "evaluate",
    "evaluate_motion",
    "layout",
    "make_layout",
    "make_recording",
    "motion_frames",
    "open_library",
    "read_motion",
    "read_motions",
    "read_recording",
    "reconstruct",
    "retarget",
    "sample_motions",
    "simulate_imus",
    "simulate_trackers",
    "write_motion",
    "write_recording",
    "write_report",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("poseloom")
    if name not in _HOMES:
        raise AttributeError(f"module 'poseloom' has no attribute {name!r}")
    value = getattr(import_module(f"poseloom.{_HOMES[name]}"), name)
    globals()[name] = value  # the next look goes straight to it
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
