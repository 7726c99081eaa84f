"""The motions that travel with poseloom, so that it can show itself without any recording. See PROVENANCE.md."""

from poseloom.samples.clips import SAMPLE_PREFIX, read_clip, sample_motion
from poseloom.samples.motions import sample_motion_names, sample_motions

__all__ = ["SAMPLE_PREFIX", "read_clip", "sample_motion", "sample_motion_names", "sample_motions"]
