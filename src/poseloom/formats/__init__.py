"""Files in and out: motions, recordings and artefacts."""

from poseloom.formats.motions import (
    format_name,
    is_motion_file,
    motion_suffixes,
    read_motion,
    read_motions,
    writable_suffixes,
    write_motion,
)
from poseloom.formats.rest_frame import drop_rest_frame, starts_with_rest_frame
from poseloom.formats.table import FORMATS, Format, ReadOptions

__all__ = [
    "FORMATS",
    "Format",
    "ReadOptions",
    "drop_rest_frame",
    "format_name",
    "is_motion_file",
    "motion_suffixes",
    "read_motion",
    "read_motions",
    "starts_with_rest_frame",
    "writable_suffixes",
    "write_motion",
]
