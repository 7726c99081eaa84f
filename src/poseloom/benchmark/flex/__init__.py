"""The flex paper's tables, measured on simulated sensors over real motions."""
