"""poseloom weaves a full-body human motion from what a few body-worn sensors say.

The names that most programs need stand here, and load what is behind them on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from poseloom.errors import PoseloomError
    from poseloom.methods.contract import Frame, Reconstruction, Reconstructor, reconstruct
    from poseloom.sensors.layout import SensorLayout, layout
    from poseloom.sensors.recording import Recording
    from poseloom.sensors.sample import Sample
    from poseloom.skeleton.body import average_body
    from poseloom.skeleton.kinematics import motion_frames
    from poseloom.skeleton.motion import Motion
    from poseloom.skeleton.skeleton import Skeleton

_HOMES = {
    "Frame": "methods.contract",
    "Motion": "skeleton.motion",
    "PoseloomError": "errors",
    "Reconstruction": "methods.contract",
    "Reconstructor": "methods.contract",
    "Recording": "sensors.recording",
    "Sample": "sensors.sample",
    "SensorLayout": "sensors.layout",
    "Skeleton": "skeleton.skeleton",
    "average_body": "skeleton.body",
    "layout": "sensors.layout",
    "motion_frames": "skeleton.kinematics",
    "reconstruct": "methods.contract",
}

__all__ = [
    "Frame",
    "Motion",
    "PoseloomError",
    "Reconstruction",
    "Reconstructor",
    "Recording",
    "Sample",
    "SensorLayout",
    "Skeleton",
    "average_body",
    "layout",
    "motion_frames",
    "reconstruct",
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
