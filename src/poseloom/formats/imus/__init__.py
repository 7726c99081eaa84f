"""Recordings of real inertial sensors, in the formats that they come in."""

from poseloom.formats.imus.assembly import assemble_imus
from poseloom.formats.imus.choices import ImuChoices
from poseloom.formats.imus.reading import read_imu_tracks
from poseloom.formats.imus.tracks import ImuTrack, make_track

__all__ = ["ImuChoices", "ImuTrack", "assemble_imus", "make_track", "read_imu_tracks"]
