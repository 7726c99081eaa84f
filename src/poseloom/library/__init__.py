"""Motion libraries: built from motion files, catalogued, indexed, and added to without risk."""

from poseloom.library.build import BuildReport, add_to_library, build_library
from poseloom.library.catalogue import Clip, SkipKind, Skipped
from poseloom.library.library import MotionLibrary, open_library

__all__ = [
    "BuildReport",
    "Clip",
    "MotionLibrary",
    "SkipKind",
    "Skipped",
    "add_to_library",
    "build_library",
    "open_library",
]
