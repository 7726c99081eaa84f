"""Fits networks. Only here is torch known, and only in the modules that need it; the extra `train` brings it."""
