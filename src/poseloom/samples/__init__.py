"""The motions that travel with poseloom, so that it can show itself without any recording. See PROVENANCE.md."""

from poseloom.samples.motions import sample_motion_names, sample_motions

__all__ = ["sample_motion_names", "sample_motions"]
